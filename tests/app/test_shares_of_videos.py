"""Joints as shares of the image, where the video has other pixels than its calibration."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from takes import TakeFiles, write_video

from perfcap.app.inputs import read_inputs
from perfcap.commands.views import Views
from perfcap.detect.joint_set import COCO17, LANDMARKS

SIZE = np.array([160, 120])  # width and height of the calibration's images
SHARED = [name for name in LANDMARKS if name in COCO17.joints]


def shares(take: TakeFiles, path: Path) -> Path:
    """What is seen, as shares of the image, in COCO's order."""
    joints = take.take.detections.joints2d[:, 0].numpy()
    values = np.zeros((len(joints), len(COCO17), 3))
    for name in SHARED:
        place = joints[:, LANDMARKS.index(name)] + 0.5
        values[:, COCO17.joints.index(name)] = np.concatenate(
            (place / SIZE, np.ones((len(joints), 1))), -1
        )
    np.save(path, values)
    return path


def check(take: TakeFiles, request: Views) -> None:
    places = [LANDMARKS.index(name) for name in SHARED]
    found = read_inputs(request).detections.joints2d[:, :, places]
    expected = take.take.detections.joints2d[:, :, places]
    torch.testing.assert_close(found, expected, atol=1e-6, rtol=0)


@pytest.mark.parametrize("given_in", ["calibration", "video"])
def test_shares_are_of_the_image_that_they_are_said_to_be_in(
    take: TakeFiles, tmp_path: Path, given_in: str
) -> None:
    """In pixels of the calibration they were multiplied by the size of the video."""
    write_video(tmp_path / "video.mp4", 24, (60, 80))
    half = [[2.0, 0.0, 0.5], [0.0, 2.0, 0.5]]
    text = json.dumps({"video_px_to_native_px": {"video": half, "camera": half}})
    (tmp_path / "map.json").write_text(text)
    request = Views(
        videos=(tmp_path / "video.mp4",),
        cameras=take.camera,
        detections=(shares(take, tmp_path / "a.npy"),),
        video_map=tmp_path / "map.json",
        detections_in=given_in,  # type: ignore[arg-type]
    )
    check(take, request)


def test_shares_beside_a_camera_that_counts_from_the_corner(
    take: TakeFiles, tmp_path: Path
) -> None:
    """They were moved by half a pixel twice."""
    data = json.loads(take.camera.read_text())
    data["pixel_centre"] = 0.5
    (tmp_path / "camera.json").write_text(json.dumps(data))
    request = Views(
        videos=(take.video,),
        cameras=tmp_path / "camera.json",
        detections=(shares(take, tmp_path / "a.npy"),),
    )
    check(take, request)
