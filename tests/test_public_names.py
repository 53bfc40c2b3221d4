"""What ``import perfcap`` promises: every public name, and no cost before one is used."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import perfcap

HEAVY = ("torch", "numpy", "cv2", "av", "numba", "kornia")
PACKAGES = ("actor", "detect", "energy", "geometry", "io", "metrics", "pipeline", "render", "solve")


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_import_is_free() -> None:
    assert run(f"import sys, perfcap; print([m for m in {HEAVY} if m in sys.modules])") == "[]"


def test_help_is_free() -> None:
    code = (
        "import sys\n"
        "from perfcap.cli import main\n"
        "try: main(['--help'])\n"
        f"except SystemExit: sys.exit(str([m for m in {HEAVY} if m in sys.modules]))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr.strip() == "[]"
    for command in ("demo", "capture", "evaluate", "render", "export", "actor", "doctor"):
        assert command in done.stdout


@pytest.mark.parametrize("name", perfcap.__all__)
def test_public_names_exist(name: str) -> None:
    assert getattr(perfcap, name) is not None
    assert name in dir(perfcap)


def test_types_are_those_that_are_loaded() -> None:
    """The imports that only a type checker sees name the same homes as the lazy ones."""
    tree = ast.parse(Path(perfcap.__file__).read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {
        node.module: {alias.name for alias in node.names}
        for node in block.body
        if isinstance(node, ast.ImportFrom)
    }
    assert seen == {home: set(names) for home, names in perfcap._HOMES.items()}


def test_unknown_name() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Avatar'"):
        perfcap.Avatar  # noqa: B018


@pytest.mark.parametrize("package", PACKAGES)
def test_no_name_hides_a_module(package: str) -> None:
    """``import perfcap.x.y as y`` must stay the module, whatever ``perfcap.x`` re-exports."""
    module = importlib.import_module(f"perfcap.{package}")
    files = {path.stem for path in Path(module.__path__[0]).glob("*.py")}
    folders = {path.parent.name for path in Path(module.__path__[0]).glob("*/__init__.py")}
    hidden = (files | folders) & set(module.__all__)
    assert not hidden - {"solve"}
