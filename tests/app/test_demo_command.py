"""``perfcap demo`` captures what is shipped and prints errors against its truth."""

import json
import os
from pathlib import Path

import pytest
from runs import Command

from perfcap.app import demo
from perfcap.io.actor import models_folder

missing = not (models_folder() / "demo" / "video.mp4").is_file()


@pytest.mark.slow
@pytest.mark.skipif(missing, reason="the demo clip is not there")
def test_the_demo_runs_and_is_accurate(tmp_path: Path, perfcap: Command) -> None:
    outcome = perfcap(["demo", "--out", tmp_path])
    assert outcome.code == 0, outcome
    assert "similarity-aligned" in outcome.out
    assert {"motion.npz", "overlay.mp4", "capture.glb", "run.json"} <= set(os.listdir(tmp_path))
    run = json.loads((tmp_path / "run.json").read_text())
    assert run["complete"] and run["frames"] == 120


def test_the_demo_says_where_to_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "run_capture", lambda request: 3)
    monkeypatch.setattr(demo, "evaluate", lambda found, truth: (found.name, truth.name))
    monkeypatch.setattr(demo, "error_table", " of ".join)
    assert demo.run_demo(tmp_path) == 3
    *_, errors, files, report = capsys.readouterr().out.splitlines()
    assert errors == "motion.npz of truth.npz"
    assert str(tmp_path / "overlay.mp4") in files and "capture.glb" in files
    assert report == f"perfcap view {tmp_path} plays it in a browser"
