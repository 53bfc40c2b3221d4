"""What a capture says of inputs that do not belong together, and what it refuses."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from runs import Command
from takes import TakeFiles, write_detections, write_json, write_take

from perfcap.app import capture_checks
from perfcap.io.actor import models_folder
from perfcap.io.video_writer import VideoWriter


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> TakeFiles:
    return write_take(tmp_path_factory.mktemp("take"), 40)


def test_good_input_is_quiet(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    outcome = perfcap(take.command(tmp_path / "out", "--until", "initialize", "--no-overlay"))
    assert outcome.code == 0 and not outcome.notes


@pytest.mark.long
def test_what_is_asked_for_in_vain_is_told(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    """Frames behind the end, and a lifter beside 3D poses."""
    more = ("--until", "initialize", "--no-overlay", "--frames", "2:99")
    lifter = models_folder() / "lifters" / "cmu"
    told = perfcap(take.command(tmp_path / "out", *more, "--lifter", str(lifter))).notes
    assert any("--frames 2:99: the video ends with frame 39" in line for line in told)
    assert any("--lifter: is not used" in line for line in told)


@pytest.mark.long
def test_joints_named_after_another_camera(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    one = json.loads(take.camera.read_text())
    cameras = tmp_path / "cameras.json"
    write_json(cameras, {"views": {"cam1": one, "cam2": one}})
    more = ("--until", "initialize", "--no-overlay")
    for name, told in (("cam1", True), ("cam2", False), ("cam2_json", False), ("walk", False)):
        files = {"detections": tmp_path / f"{name}.npz", "cameras": cameras}
        files["video"] = tmp_path / "cam2.mp4"
        shutil.copy(take.detections, files["detections"])
        shutil.copy(take.video, files["video"])
        notes = perfcap(take.command(tmp_path / f"of {name}", *more, **files)).notes
        assert any("named after the view cam1" in line for line in notes) == told, notes


def test_exchanged_axes_and_other_frames(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    seen = take.take.detections
    assert seen.joints3d is not None
    more = ("--until", "initialize", "--no-overlay")
    write_detections(tmp_path / "d.npz", replace(seen, joints3d=seen.joints3d[..., [1, 0, 2]]))
    line = take.command(tmp_path / "exchanged", *more, detections=tmp_path / "d.npz")
    assert "exchanged" in perfcap(line).refused()
    index = (torch.arange(40) - 10).clamp(min=0)
    write_detections(tmp_path / "d.npz", replace(seen, joints3d=seen.joints3d[index]))
    line = take.command(tmp_path / "late", *more, detections=tmp_path / "d.npz")
    assert "10 frames late" in perfcap(line).refused()


@pytest.mark.long
def test_a_black_video_is_refused_where_images_are_needed(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    with VideoWriter(tmp_path / "black.mp4", 30.0, preset="ultrafast") as writer:
        for _ in range(40):
            writer.write(np.zeros((120, 160, 3), np.uint8))
    out = tmp_path / "out"
    call = take.command(out, "--until", "refine_surface", video=tmp_path / "black.mp4")
    outcome = perfcap(call)
    assert outcome.code == 2 and "of one color" in outcome.err and not out.exists()
    call = take.command(out, "--until", "initialize", video=tmp_path / "black.mp4")
    outcome = perfcap(call)
    assert outcome.code == 0 and any("of one color" in note for note in outcome.notes)


def test_the_video_is_looked_at_where_joints_come_from_files(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Joints that were found in the very images cannot be of other frames."""
    asked: list[bool] = []

    def examine(
        rig: object, detections: object, clip: object, _: object, *, detected: bool, **more: bool
    ) -> list[object]:
        asked.append(detected)
        assert not more["rests"]  # cameras are given: nothing was looked at before
        return []

    monkeypatch.setattr(capture_checks, "examine_take", examine)
    assert (
        perfcap(take.command(tmp_path / "out", "--until", "initialize", "--no-overlay")).code == 0
    )
    assert asked == [False]


@pytest.mark.long
def test_frames_that_a_check_names_are_not_trusted(tmp_path: Path, perfcap: Command) -> None:
    files = write_take(tmp_path, 60)
    """Three poses that were not solved, of a camera that moves."""
    files = write_take(tmp_path, 60, moving=True)
    entry = json.loads(files.camera.read_text())
    for frame in range(30, 33):
        entry["R"][frame], entry["t"][frame] = torch.eye(3).tolist(), [0.0, 0.0, 0.0]
    write_json(files.camera, entry)
    out = tmp_path / "out"
    line = files.command(out, "--until", "track_motion", "--no-overlay", "--frames", "10:")
    outcome = perfcap(line)
    assert any("identity at the origin in frames 30-32" in note for note in outcome.notes)
    quality = json.loads((out / "run.json").read_text())["quality"]
    (named,) = quality["not_trusted"]
    first, stop = named["frames"]
    assert 27 <= first <= 30 and 33 <= stop <= 36, named
    assert any(f"frames {first} to {stop - 1} are not to be trusted" in n for n in outcome.notes)
