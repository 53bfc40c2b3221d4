"""``perfcap report``, ``view`` and ``capture --report``: from a folder of results to a page."""

from __future__ import annotations

import json
import os
import re
import shutil
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from runs import Command
from takes import TakeFiles

from perfcap.io.video_writer import VideoWriter

PAGE = "report.html"


@pytest.fixture
def folder(captured: Path, tmp_path: Path) -> Path:
    """A copy of the one captured folder, with a blank in its name."""
    return Path(shutil.copytree(captured, tmp_path / "my result"))


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Addresses that a browser would have shown."""
    shown: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: shown.append(address) or True)
    return shown


def titles(page: Path) -> list[str]:
    data = re.search(r'id="data">(.*?)</script>', page.read_text(encoding="utf-8"), re.DOTALL)
    assert data is not None
    return [chart["title"] for chart in json.loads(data[1])["charts"]]


def test_a_capture_writes_its_report(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    out = tmp_path / "out"
    outcome = perfcap(take.command(out, "--report", "--no-overlay"))
    assert outcome.code == 0 and not outcome.said
    found = titles(out / PAGE)
    assert {"Energy", "Distance to the detections", "Acceleration"} <= set(found)
    assert "report" not in json.loads((out / "run.json").read_text())["request"]
    assert not [path for path in out.iterdir() if path.name.startswith(".")]


def test_energies_of_frames_add_up_to_those_of_windows(captured: Path) -> None:
    run = json.loads((captured / "run.json").read_text())
    (window,) = run["windows"]
    for name, values in run["energy"].items():
        assert len(values) == 24
        assert sum(values) == pytest.approx(window["terms"][name], rel=1e-3, abs=1e-6)


def test_a_report_with_a_truth(folder: Path, take: TakeFiles, perfcap: Command) -> None:
    outcome = perfcap(["report", folder, "--truth", take.truth, "--frames", "2:20"])
    assert outcome.code == 0 and PAGE in outcome.out.replace("\n", "")
    assert titles(folder / PAGE)[0] == "Joint error"


def test_a_truth_of_another_world_is_told(
    folder: Path, take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    """The curves would show it as errors of the capture; ``perfcap evaluate`` named it."""
    with np.load(take.truth) as data:
        x, y, z = np.moveaxis(data["joints3d"], -1, 0)
    np.savez(tmp_path / "turned.npz", joints3d=np.stack((x, -z, y), -1))
    done = perfcap(["report", folder, "--truth", tmp_path / "turned.npz"])
    assert done.code == 0 and any("one rotation of all frames" in line for line in done.notes)
    assert "--truth: after one rotation of all frames" in (folder / PAGE).read_text()


def test_frames_that_the_result_lacks_are_told(folder: Path, perfcap: Command) -> None:
    assert "ends with 23" in perfcap(["report", folder, "--frames", "20:40"]).out


def test_view_makes_the_page_once(folder: Path, opened: list[str], perfcap: Command) -> None:
    page = folder / PAGE
    assert perfcap(["view", folder]).code == 0
    assert opened == [page.resolve().as_uri()] and "my%20result" in opened[0]
    page.write_text("kept")
    assert perfcap(["view", folder]).code == 0
    assert page.read_text() == "kept"
    os.utime(folder / "run.json", (page.stat().st_mtime + 5,) * 2)  # captured again
    assert perfcap(["view", folder]).code == 0
    assert page.read_text() != "kept" and len(opened) == 3


def test_view_shows_what_evaluate_found_since(
    folder: Path, take: TakeFiles, tmp_path: Path, opened: list[str], perfcap: Command
) -> None:
    """Errors against a truth that was corrected; the page had those of the wrong one."""
    with np.load(take.truth) as data:
        joints, frames = data["joints3d"], np.arange(len(data["joints3d"]))
    np.savez(tmp_path / "away.npz", joints3d=joints + np.array([3.0, 0, 0]), frames=frames)
    assert perfcap(["evaluate", folder, "--truth", tmp_path / "away.npz"]).code == 0
    assert perfcap(["view", folder]).code == 0
    page = (folder / PAGE).read_text()
    assert "<li>After one shift of all frames by 3 m" in page
    again = perfcap(["evaluate", folder, "--truth", take.truth])
    assert again.code == 0 and "does not show these errors yet: perfcap report" in again.out
    elsewhere = ["evaluate", folder, "--truth", take.truth, "--out", tmp_path / "errors.json"]
    assert "does not show" not in perfcap(elsewhere).out
    made = (folder / PAGE).stat().st_mtime
    os.utime(folder / "metrics.json", (made + 5,) * 2)
    assert perfcap(["view", folder]).code == 0
    shown = (folder / PAGE).read_text()
    found = json.loads((folder / "metrics.json").read_text())["mpjpe_mm"]
    row = "Joints, absolute</th><td>"
    assert f"{row}{found:.1f} mm" in shown and f"{row}{found:.1f} mm" not in page
    assert "After one shift" not in shown and len(opened) == 2


def test_errors_of_another_capture_are_not_shown(
    folder: Path, take: TakeFiles, perfcap: Command
) -> None:
    assert perfcap(["evaluate", folder, "--truth", take.truth]).code == 0
    found = json.loads((folder / "metrics.json").read_text())
    assert perfcap(["report", folder]).code == 0
    assert "Joints, absolute</th>" in (folder / PAGE).read_text()
    (folder / "metrics.json").write_text(json.dumps(found | {"capture": "another"}))
    assert perfcap(["report", folder]).code == 0
    page = (folder / PAGE).read_text()
    assert "Joints, absolute</th>" not in page and "metrics.json is of another capture" in page
    del found["capture"]  # as older versions wrote it
    (folder / "metrics.json").write_text(json.dumps(found))
    assert perfcap(["report", folder]).code == 0
    assert "Joints, absolute</th>" in (folder / PAGE).read_text()


def test_view_without_a_browser_says_where_the_page_is(
    folder: Path, monkeypatch: pytest.MonkeyPatch, perfcap: Command
) -> None:
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    (folder / PAGE).touch()
    outcome = perfcap(["view", folder])
    assert outcome.code == 0 and PAGE in outcome.out.replace("\n", "")


def test_two_results_share_a_page(
    folder: Path,
    captured: Path,
    tmp_path: Path,
    opened: list[str],
    monkeypatch: pytest.MonkeyPatch,
    perfcap: Command,
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = perfcap(["view", captured, folder])
    page = Path(f"{captured.name}_and_my result.html")
    assert outcome.code == 0 and page.name in outcome.out.replace("\n", " ")
    assert opened == [page.resolve().as_uri()]
    assert titles(page)[0] == "Distance between A and B"
    assert "expected one result, or two" in perfcap(["view", folder, folder, folder]).refused()


def test_bad_input_is_refused_in_one_line(
    folder: Path, take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    (tmp_path / "empty").mkdir()
    with np.load(take.truth) as truth:
        np.savez(tmp_path / "fast.npz", **{**truth, "fps": 60.0})
    for call, words in (
        (["report", tmp_path / "nothing"], "no such folder"),
        (["view", tmp_path / "empty"], "has no run.json"),
        (["report", folder, "--frames", "x"], "--frames x"),
        (["report", folder, "--frames", "90:99"], "holds frames 0 to 23"),
        (["report", folder, "--videos", take.video, take.video], "views"),
        (["report", folder, "--videos", tmp_path / "no.mp4"], "no.mp4"),
        (["report", folder, "--cameras", tmp_path / "no.json"], "no.json"),
        (["report", folder, "--truth", tmp_path / "empty"], "truth.npz"),
        (["report", folder, "--truth", take.detections], "joints3d"),
        (["report", folder, "--truth", tmp_path / "fast.npz"], "runs at 60 frames a second"),
    ):
        assert words in perfcap(call).refused(), call
    assert not (folder / PAGE).exists()


def test_a_place_that_cannot_be_written(folder: Path, perfcap: Command) -> None:
    (folder / PAGE).mkdir()
    assert "cannot be written" in perfcap(["report", folder]).refused()
    assert not [path for path in folder.iterdir() if path.name.endswith(".tmp")]


def test_videos_of_another_take_are_told(
    folder: Path, take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    """A page showed the capture over another film, and nothing on the terminal said so."""
    moved = Path(shutil.copy(take.video, tmp_path / "moved.mp4"))
    done = perfcap(["report", folder, "--videos", moved])
    assert done.code == 0 and not done.notes
    assert "bytes, that of the capture had" not in (folder / PAGE).read_text()
    with moved.open("ab") as file:
        file.write(b"\0" * 8)
    done = perfcap(["report", folder, "--videos", moved])
    assert done.code == 0 and any("that of the capture had" in line for line in done.notes)
    assert "bytes, that of the capture had" in (folder / PAGE).read_text()
    known = json.loads(take.camera.read_text())
    moved = tmp_path / take.camera.name
    moved.write_text(json.dumps(known | {"t": [1000 * each for each in known["t"]]}, indent=3))
    done = perfcap(["report", folder, "--cameras", moved])
    assert any(line.startswith("--cameras: ") and "had" in line for line in done.notes), done
    shutil.copy(take.camera, moved)
    assert not perfcap(["report", folder, "--cameras", moved]).notes
    small = tmp_path / "small.mp4"
    with VideoWriter(small, 30.0) as writer:
        for _ in range(24):
            writer.write(np.zeros((48, 64, 3), np.uint8))
    before = (folder / PAGE).read_bytes()
    assert (
        "for 160x120; give the capture's own"
        in perfcap(["report", folder, "--videos", small]).refused()
    )
    assert (folder / PAGE).read_bytes() == before
