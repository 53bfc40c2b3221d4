"""What a capture said of its own frames is said again of what is made from them."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from runs import Command

from perfcap.io.distrust import distrust

SAID = "as the capture said, frames 5-6 show no person and are made up from those beside them, and "
SAID += "frames 3-5 are not to be trusted"


@pytest.fixture
def folder(captured: Path, tmp_path: Path) -> Path:
    """A capture some of whose frames are bad."""
    place = Path(shutil.copytree(captured, tmp_path / "doubted"))
    report = json.loads((place / "run.json").read_text())
    report["not_captured"] = [[5, 7]]
    report["quality"] = {"not_trusted": [{"frames": [3, 6], "reason": "a reason"}]}
    (place / "run.json").write_text(json.dumps(report))
    return place


@pytest.mark.parametrize(
    "options",
    [
        ("export", "--to", "trc"),
        ("render", "--size", 64, 48, "--out", "a.mp4"),
        ("retarget", "--actor", "sam", "--out", "moved"),
    ],
)
def test_every_command_that_makes_something_says_it(
    folder: Path,
    perfcap: Command,
    options: Sequence[Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    command, *rest = options
    outcome = perfcap([command, folder, "--frames", "0:8", *rest])
    assert outcome.code == 0
    assert sum(SAID in " ".join(each.split()) for each in (outcome.out, *outcome.notes)) == 1
    if command != "retarget":
        outcome = perfcap([command, folder, "--frames", "8:12", *rest])
        assert outcome.code == 0 and "the capture said" not in outcome.out


@pytest.mark.long
def test_what_is_made_of_a_retargeted_motion_says_it_as_well(
    folder: Path, perfcap: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for source, made in ((folder, "moved"), ("moved", "again")):
        perfcap(["retarget", source, "--actor", "sam", "--out", made])
        outcome = perfcap(["export", made, "--to", "trc", "--frames", "0:8"])
        assert outcome.code == 0 and SAID in " ".join(outcome.out.split())
        outcome = perfcap(["export", made, "--to", "trc", "--frames", "8:12"])
        assert outcome.code == 0 and "the capture said" not in outcome.out


def test_parts_and_reports_of_others() -> None:
    report = {"not_captured": [[5, 7]], "quality": {"not_trusted": [{"frames": [3, 6]}]}}
    assert distrust(report, range(10)) == (SAID,)
    (line,) = distrust(report, range(5))
    assert line == "as the capture said, frames 3-4 are not to be trusted"
    for other in ({}, {"quality": None}, {"not_captured": 3, "quality": {"not_trusted": [1, {}]}}):
        assert distrust(other, range(10)) == ()
    # numbers that a damaged file holds cost no time
    damaged = {"not_captured": [[0, 10**30], [-(10**30), 2]]}
    (line,) = distrust(damaged, (1, 2, 10**15))
    assert "frames 1-2, 1000000000000000 show" in line
