"""Which detections and cameras belong to a video, or to a part of it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from openpose_take import write_openpose
from takes import TakeFiles, camera_entry, write_detections, write_json

from perfcap.app.inputs import Inputs, read_inputs
from perfcap.commands.views import Views
from perfcap.errors import InputError
from perfcap.io.clip import Clip
from perfcap.io.detections import save_detections
from perfcap.io.doctor import Severity, examine_inputs

PART = "10:16"


def read(
    take: TakeFiles, detections: Path, frames: str | None = PART, cameras: Path | None = None
) -> Inputs:
    request = Views(
        videos=(take.video,),
        cameras=cameras or take.camera,
        detections=(detections,),
        frames=frames,
    )
    return read_inputs(request)


def neck(inputs: Inputs) -> torch.Tensor:
    return inputs.detections.joints2d[:, 0, 1]


def true_neck(take: TakeFiles, part: slice = slice(10, 16)) -> torch.Tensor:
    return take.take.detections.joints2d[part, 0, 1]


def test_openpose_files_that_start_late_are_not_shifted(take: TakeFiles, tmp_path: Path) -> None:
    """Files of the frames 4 to 23 of 24, and 8 to 23: of a part, and of all."""
    for first in (4, 8):
        folder = tmp_path / f"from_{first}"
        write_openpose(folder, take.take, range(first, 24))
        for frames, part in ((PART, slice(10, 16)), (None, slice(None))):
            inputs = read(take, folder, frames)
            seen = inputs.detections.confidence2d[:, 0, 1] > 0
            torch.testing.assert_close(neck(inputs)[seen], true_neck(take, part)[seen])
            assert (~seen).sum() == (0 if frames else first)
            told = f"files start at frame {first}; counted from 0"
            assert any(told in line for line in inputs.warnings)


def test_openpose_files_of_images_cut_from_a_recording(take: TakeFiles, tmp_path: Path) -> None:
    for offset in (1, 101):
        folder = tmp_path / f"by_{offset}"
        write_openpose(folder, take.take, range(24), offset)
        for frames, part in ((PART, slice(10, 16)), (None, slice(None))):
            inputs = read(take, folder, frames)
            torch.testing.assert_close(neck(inputs), true_neck(take, part))
            assert not any("counted from" in line for line in inputs.warnings)


def test_detections_made_for_the_part(take: TakeFiles, tmp_path: Path) -> None:
    """Those that end with it are taken, with a note; a file that counts its video needs none."""
    plain, counted = tmp_path / "plain.npz", tmp_path / "counted.npz"
    seen = take.take.detections.frames(slice(0, 16))
    write_detections(plain, seen)
    inputs = read(take, plain)
    torch.testing.assert_close(neck(inputs), true_neck(take))
    assert any("taken for its first 16 frames" in line for line in inputs.warnings)
    save_detections(counted, seen, video_frames=24)
    for frames, part in ((PART, slice(10, 16)), ("2:6", slice(2, 6))):
        inputs = read(take, counted, frames)
        torch.testing.assert_close(neck(inputs), true_neck(take, part), atol=1e-3, rtol=0)
        assert not inputs.warnings


@pytest.mark.parametrize("frames", [None, PART])
def test_detections_of_a_longer_video(take: TakeFiles, tmp_path: Path, frames: str | None) -> None:
    """A part of it has as many frames as this video; ``--frames`` alone made that be looked at."""
    path = tmp_path / "longer.npz"
    save_detections(path, take.take.detections, video_frames=60)
    said = "longer.npz is of 60, the video has 24"
    with pytest.raises(InputError, match=said):
        read(take, path, frames)
    (found,) = examine_inputs(take.camera, [path], [take.video])
    assert found.severity is Severity.ERROR and said in found.what


def test_detections_that_were_kept_of_a_broken_video(take: TakeFiles, tmp_path: Path) -> None:
    """They count the frames that it promises, and are of those that it has."""
    data = take.video.read_bytes()
    (tmp_path / "cut.mp4").write_bytes(data[: len(data) // 2])
    clip = Clip.open(tmp_path / "cut.mp4")
    assert clip.total == 24 and len(clip) < 18
    path = tmp_path / "kept.npz"
    kept = take.take.detections.frames(slice(0, len(clip)))
    save_detections(path, kept, video_frames=clip.total)
    request = Views(videos=(tmp_path / "cut.mp4",), cameras=take.camera, detections=(path,))
    assert read_inputs(request).detections.frame_count == len(clip)
    found = examine_inputs(take.camera, [path], [tmp_path / "cut.mp4"])
    assert not any(each.severity is Severity.ERROR for each in found)


def test_a_few_frames_more_or_less_than_the_video_promises(take: TakeFiles, tmp_path: Path) -> None:
    """Containers miscount: nothing is cut, and nothing is said."""
    for count in (20, 28):
        rows = torch.arange(count).clamp(max=23)
        write_detections(tmp_path / "a.npz", take.take.detections.frames(rows))
        inputs = read(take, tmp_path / "a.npz")
        assert inputs.detections.frame_count == 6 and not inputs.warnings


def test_cameras_of_about_the_video_s_rate_and_length(take: TakeFiles, tmp_path: Path) -> None:
    """29.97 is 30, a few poses more do no harm, and a camera at rest has no rate."""
    entry = camera_entry(take.take.cameras)
    shifts = np.tile(np.array(entry["t"]), (28, 1)) + 0.01 * np.arange(28)[:, None]
    write_json(tmp_path / "moving.json", entry | {"t": shifts.tolist(), "fps": 29.97})
    for frames, part in ((PART, slice(10, 16)), (None, slice(0, 24))):
        inputs = read(take, take.detections, frames, tmp_path / "moving.json")
        assert not inputs.warnings
        np.testing.assert_allclose(inputs.rig.cameras.translation[:, 0], shifts[part])
    write_json(tmp_path / "fixed.json", entry | {"fps": 60})
    inputs = read(take, take.detections, PART, tmp_path / "fixed.json")
    (warning,) = inputs.warnings
    assert "run at 60 frames a second, the video at 30" in warning


def test_poses_of_a_part_are_said_to_be_of_the_first_frames(
    take: TakeFiles, tmp_path: Path
) -> None:
    """Those of another part were taken for the first frames without a word; joints are told of."""
    entry = camera_entry(take.take.cameras)
    shifts = np.tile(np.array(entry["t"]), (16, 1)) + 0.01 * np.arange(16)[:, None]
    write_json(tmp_path / "moving.json", entry | {"t": shifts.tolist()})
    (warning,) = read(take, take.detections, PART, tmp_path / "moving.json").warnings
    assert "has 16 poses, the video 24 frames; they are taken for its first 16" in warning


def test_results_of_a_part_are_numbered_by_the_video(take: TakeFiles, tmp_path: Path) -> None:
    """Nobody before frame 12: the lowest number of the results is not the first frame."""
    entries: list[dict[str, Any]] = []
    for f in range(12, 24):
        points = np.full((17, 3), 0.9)
        points[:, 0], points[:, 1] = f, 6 * np.arange(17)
        entries.append({"image_id": f"{f}.jpg", "keypoints": points.ravel().tolist()})
    write_json(tmp_path / "a.json", entries)
    inputs = read(take, tmp_path / "a.json")
    seen = (inputs.detections.confidence2d[:, 0] > 0).any(-1)
    assert seen.tolist() == [False, False, True, True, True, True]
    assert inputs.detections.joints2d[2, 0, :, 0].max().round(decimals=6) == 12
