"""What scripts import is there, also where no test runs them."""

import ast
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted([*(ROOT / "experiments").glob("*.py"), *(ROOT / "tools").rglob("*.py")])


def imported(script: Path) -> list[tuple[str, str]]:
    """Modules of perfcap and names that a script takes from them."""
    return [
        (node.module, alias.name)
        for node in ast.walk(ast.parse(script.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module is not None
        if node.module.split(".")[0] == "perfcap"
        for alias in node.names
    ]


def is_there(module: str, name: str) -> bool:
    """Whether a module holds a name, or is a package with a module of that name."""
    found = import_module(module)
    below = hasattr(found, "__path__") and find_spec(f"{module}.{name}") is not None
    return hasattr(found, name) or below


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_names_of_perfcap_are_there(script: Path) -> None:
    assert [found for found in imported(script) if not is_there(*found)] == []


def patched(script: Path) -> list[tuple[str, str]]:
    """Modules of perfcap and names that a script replaces in them."""
    sources = {name: f"{module}.{name}" for module, name in imported(script)}
    return [
        (sources[node.args[0].id], node.args[1].value)
        for node in ast.walk(ast.parse(script.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
        if ast.unparse(node.func) == "mock.patch.object"
        if isinstance(node.args[0], ast.Name) and node.args[0].id in sources
        if isinstance(node.args[1], ast.Constant) and isinstance(node.args[1].value, str)
    ]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_what_scripts_replace_is_there(script: Path) -> None:
    """A name that had moved ended a script after the first of its captures."""
    assert [found for found in patched(script) if not is_there(*found)] == []


def test_a_name_that_is_not_there_is_found() -> None:
    assert is_there("perfcap.io", "actor")
    assert not is_there("perfcap.io", "nothing") and not is_there("perfcap.io.actor", "nothing")
