"""Detections and cameras of another number of frames, or another rate, than the video."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from mistakes import Case, register, require_one_line
from runs import Command
from takes import TakeFiles, camera_entry, write_detections, write_json

CASES: dict[str, Case] = {}
case = register(CASES)


@case("has 12, the video has 24")
def detections_of_every_other_frame_for_a_part(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_detections(at / "a.npz", take.take.detections.frames(slice(0, 24, 2)))
    return {"detections": at / "a.npz", "frames": "2:10"}


@case("has 48, the video has 24")
def detections_of_twice_the_rate_for_a_part(take: TakeFiles, at: Path) -> dict[str, Any]:
    twice = torch.arange(24).repeat_interleave(2)
    write_detections(at / "a.npz", take.take.detections.frames(twice))
    return {"detections": at / "a.npz", "frames": "2:10"}


@case("has 16, the video has 24")
def detections_that_start_late_for_a_part(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_detections(at / "a.npz", take.take.detections.frames(slice(8, 24)))
    return {"detections": at / "a.npz", "frames": "2:10"}


@case("is of 90, the video has 24")
def detections_of_a_part_of_another_video(take: TakeFiles, at: Path) -> dict[str, Any]:
    seen = take.take.detections.frames(slice(0, 10))
    write_detections(at / "a.npz", seen, video_frames=np.array(90))
    return {"detections": at / "a.npz", "frames": "2:10"}


@case("video_frames is array")
def detections_that_do_not_count_their_video(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_detections(at / "a.npz", take.take.detections, video_frames=np.array([2, 3]))
    return {"detections": at / "a.npz"}


def moving(take: TakeFiles, at: Path, poses: int, **changes: Any) -> dict[str, Any]:
    shifts = np.tile(take.take.cameras.translation[0].numpy(), (poses, 1))
    shifts[:, 0] += 0.01 * np.arange(poses)
    entry = camera_entry(take.take.cameras) | {"t": shifts.tolist()} | changes
    write_json(at / "c.json", entry)
    return {"cameras": at / "c.json"}


@case("has 48 frames, the video 24")
def a_moving_camera_of_twice_the_rate(take: TakeFiles, at: Path) -> dict[str, Any]:
    return moving(take, at, 48)


@case("has 48 frames, the video 24")
def a_moving_camera_of_twice_the_rate_for_a_part(take: TakeFiles, at: Path) -> dict[str, Any]:
    return moving(take, at, 48) | {"frames": "2:10"}


@case("run at 60 frames a second, the video at 30")
def a_moving_camera_that_says_another_rate(take: TakeFiles, at: Path) -> dict[str, Any]:
    return moving(take, at, 24, fps=60)


@pytest.mark.parametrize("name", CASES)
def test_one_line_and_code_2(take: TakeFiles, tmp_path: Path, perfcap: Command, name: str) -> None:
    require_one_line(CASES[name], take, tmp_path, perfcap)
