"""``perfcap doctor`` finds what would spoil a capture and says so by its exit code."""

from dataclasses import replace
from pathlib import Path

import pytest
from runs import Command
from takes import TakeFiles, write_detections

import perfcap.app.doctor as module
from perfcap.io.doctor import Finding, Severity


def test_an_installation_without_errors_is_code_0(
    perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    fine = [Finding(Severity.INFO, "python", "3"), Finding(Severity.WARNING, "cv2", "two of them")]
    monkeypatch.setattr(module, "examine_installation", lambda: fine)
    outcome = perfcap(["doctor"])
    assert outcome.code == 0 and "0 errors, 2 other findings" in outcome.out


def test_a_missing_package_is_code_2(perfcap: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = [Finding(Severity.ERROR, "av", "is not installed", "pip install av")]
    monkeypatch.setattr(module, "examine_installation", lambda: missing)
    outcome = perfcap(["doctor"])
    assert outcome.code == 2 and "pip install av" in outcome.out


def test_this_installation_can_be_examined(perfcap: Command) -> None:
    outcome = perfcap(["doctor"])
    assert outcome.code in (0, 2) and "python" in outcome.out


def test_good_inputs_are_code_0(
    take: TakeFiles, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    files = ["--cameras", take.camera, "--detections", take.detections]
    outcome = perfcap(["doctor", take.video, *files])
    assert outcome.code == 0, outcome.out


def test_bad_inputs_are_code_2_and_all_named(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    (tmp_path / "c.json").write_text("{")
    (tmp_path / "v.mp4").write_bytes(b"")
    files = ["--cameras", tmp_path / "c.json", "--detections", take.detections]
    outcome = perfcap(["doctor", tmp_path / "v.mp4", *files])
    assert outcome.code == 2 and "Traceback" not in outcome.err
    text = "".join(outcome.out.split())
    assert "c.json" in text and "v.mp4" in text and "2errors" in text


def test_nobody_in_the_detections(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    empty = replace(take.take.detections, confidence2d=0 * take.take.detections.confidence2d)
    write_detections(tmp_path / "none.npz", empty)
    files = ["--cameras", take.camera, "--detections", tmp_path / "none.npz"]
    assert perfcap(["doctor", *files]).code == 2


@pytest.mark.parametrize("option", ["--detections", "--video-map"])
def test_files_without_cameras_are_not_passed_over(
    take: TakeFiles, perfcap: Command, option: str
) -> None:
    line = perfcap(["doctor", option, take.detections]).refused()
    assert "--cameras" in line
