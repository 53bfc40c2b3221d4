"""What the README and the conventions page say is so."""

import ast
import configparser
import math
import re
import shlex
import sys
from pathlib import Path

import pytest
import tyro

from perfcap.actor.skeleton import Skeleton
from perfcap.cli import Command
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.actor import find_actor, load_actor

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONVENTIONS = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")


def block(marker: str) -> str:
    """The fenced block after an HTML comment."""
    found = re.search(rf"<!-- {marker} -->\n```\w+\n(.*?)```", README, re.DOTALL)
    assert found, f"README.md has no block after <!-- {marker} -->"
    return found.group(1)


def commands() -> list[str]:
    """Every ``perfcap ...`` line of a shell block."""
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    parts = (part.strip() for text in blocks for part in re.split(r"&&|\n", text))
    return [part for part in parts if part.startswith("perfcap ")]


def skeleton() -> Skeleton:
    actor = load_actor("sam")
    return actor.skeleton


def test_install_commands_are_one_line_each() -> None:
    for marker in ("demo", "test"):
        assert len(block(marker).splitlines()) == 1
        assert block(marker).startswith("python3 -m venv .venv && . .venv/bin/activate && pip ")


@pytest.mark.parametrize("line", commands())
def test_commands_parse(line: str) -> None:
    command = tyro.cli(Command, prog="perfcap", args=shlex.split(line)[1:])
    assert command is not None


def test_all_commands_are_shown() -> None:
    assert {shlex.split(line)[1] for line in commands()} >= {
        "demo",
        "capture",
        "doctor",
        "evaluate",
    }


def test_python_block_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(block("python"), "README.md", "exec"), names)
    assert capsys.readouterr().out == "torch.Size([120, 16, 3])\n\n"  # and no warning
    written = {path.name for path in (tmp_path / "dance").iterdir()}
    assert written == {"motion.npz", "motion.bvh", "capture.glb", "run.json", "config.yaml"}


def test_it_can_be_read_in_five_minutes() -> None:
    assert len(README.split()) <= 900
    assert len(block("python").splitlines()) <= 12


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "docs/conventions.md"])
def test_links_lead_somewhere(page: str) -> None:
    for target in re.findall(r"\]\(([^)#]+)", (ROOT / page).read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert ((ROOT / page).parent / target).exists(), target


def test_conventions_list_the_angles_with_their_limits() -> None:
    rows = re.findall(
        r"^\| (`\w+`(?:, `\w+`)*) \| [^|]+ \| (-?\d+) to (-?\d+) \|$", CONVENTIONS, re.M
    )
    stated = {
        name: (int(lower), int(upper))
        for names, lower, upper in rows
        for name in re.findall(r"\w+", names)
    }
    rig = skeleton()
    limits = {
        name: (round(math.degrees(lower)), round(math.degrees(upper)))
        for name, lower, upper in zip(
            rig.angle_names, rig.lower.tolist(), rig.upper.tolist(), strict=True
        )
    }
    assert len(stated) == 27
    assert stated == limits


def test_conventions_list_the_landmarks_in_order() -> None:
    stated = dict(re.findall(r"\| (\d+) `(\w+)`(?= \|)", CONVENTIONS.replace(" | ", " | | ")))
    assert [stated[str(index)] for index in range(16)] == list(LANDMARKS)


def test_the_default_actor_stands_for_anybody() -> None:
    """Its bones are solved where views show them, which the README promises."""
    assert find_actor("sam").generic


def test_every_shipped_model_is_installed() -> None:
    """An install without a checkout has what stands in the list of data files alone."""
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg", encoding="utf-8")
    listed = {name.removeprefix("share/perfcap/") for name in setup["options.data_files"]}
    folders = {path.parent for path in (ROOT / "models").rglob("*") if path.is_file()}
    assert {folder.relative_to(ROOT).as_posix() for folder in folders} <= listed


@pytest.mark.long
def test_what_is_imported_at_once_is_installed() -> None:
    """README's install has no extras: what modules import on their own is required."""
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg", encoding="utf-8")
    required = setup["options"]["install_requires"].split()
    names = {re.split(r"[<>=]", each)[0].replace("-", "_") for each in required}
    known = names | {"cv2", "skimage", "yaml"} | set(sys.stdlib_module_names) | {"perfcap"}
    found = set()
    for path in (ROOT / "perfcap").rglob("*.py"):
        for line in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(line, ast.Import):
                found |= {alias.name.split(".")[0] for alias in line.names}
            elif isinstance(line, ast.ImportFrom):
                found.add((line.module or "").split(".")[0])
    assert found <= known
