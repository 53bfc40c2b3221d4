"""Which way is up, from a video and the poses in it; and a capture that stands upright by it."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from synthetic import actor
from takes import make_take
from torch import Tensor

from perfcap.app.gravity import find_up
from perfcap.app.inputs import Inputs
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig, PixelMap
from perfcap.io.clip import Clip
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.stage import Stage

SIDE, FRAMES = 600, 12
TILT = 0.2  # rad, by which the camera looks down


@dataclass
class Fence:
    """Posts through a camera (1,), which stand upright in the world of a take."""

    camera: Camera
    posts: int = 9
    name: str = "fence"
    lost: int = 0
    warnings: tuple[str, ...] = ()
    fps: float = 30.0
    timestamps: None = None
    total: int = FRAMES
    size: tuple[int, int] = (SIDE, SIDE)

    def __len__(self) -> int:
        return FRAMES

    def read(self, start: int, stop: int) -> NDArray[np.uint8]:
        centre = self.camera.centre[0]
        ahead = self.camera.rotation[0, 2]
        right = self.camera.rotation[0, 0]
        image = np.full((SIDE, SIDE, 3), 210, np.uint8)
        for place in torch.linspace(-2, 2, self.posts).tolist():
            foot = centre + 7 * ahead + place * right
            ends = torch.stack((foot, foot + foot.new_tensor([0, 2.0, 0])))
            pixels = self.camera.project(ends)[0].round().int().tolist()
            cv2.line(image, pixels[0], pixels[1], (50, 40, 60), 3, cv2.LINE_AA)
        return np.repeat(image[None], stop - start, 0)

    def close(self) -> None:
        """Nothing is open."""


def given(posts: int = 9) -> tuple[Inputs, Tensor]:
    """A person before a fence, and the true direction of up in the axes of the camera."""
    take = make_take(FRAMES)
    tilt = rotvec_to_matrix(torch.tensor([TILT, 0.0, 0.0], dtype=torch.float64))
    centre = take.cameras.centre
    rotation = tilt @ take.cameras.rotation
    down = replace(
        take.cameras, rotation=rotation, translation=-(rotation @ centre[..., None]).squeeze(-1)
    )
    joints = take.actor.joints(take.truth)
    local = down.to_camera(joints)
    seen = replace(
        take.detections,
        joints2d=down.project(joints),
        joints3d=local - local[..., :1, :],
    )
    own = Camera(
        down.intrinsics,
        torch.eye(3, dtype=torch.float64)[None],
        torch.zeros(1, 3, dtype=torch.float64),
        None,
        down.size,
    )
    whole = PixelMap(torch.eye(3, dtype=torch.float64)[None])
    rig = CameraRig(("fence",), own)
    inputs = Inputs(Clip([Fence(down, posts)], 30.0), rig, seen, whole, ())
    return inputs, rotation[0] @ torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)


def test_edges_say_it_where_there_are_some() -> None:
    inputs, true = given()
    found = find_up(inputs)
    assert found is not None
    assert float(torch.rad2deg((found @ true).clamp(max=1).arccos())) < 1.0
    assert find_up(given(posts=0)[0]) is None
    assert find_up(replace(inputs, detections=inputs.detections.without_poses())) is None


def test_a_level_world_has_it_along_y() -> None:
    inputs, true = given()
    seen = inputs.detections
    found = capture(
        *(actor(), inputs.rig.cameras, seen, 30.0),
        until=Stage.TRACK_MOTION,
        level=True,
        up=3 * true,
    )
    y = found.cameras.rotation.reshape(3, 3).mT @ true
    assert float(y[1]) == pytest.approx(1.0, abs=1e-3)
    own = capture(*(actor(), inputs.rig.cameras, seen, 30.0), until=Stage.TRACK_MOTION, up=true)
    if own.floor is not None:
        assert float(own.floor.normal @ true) > 0.999


@pytest.mark.parametrize("up", [torch.zeros(3), torch.ones(2), [0.0, 1.0, 0.0]])
def test_what_is_no_direction_is_refused(up: Tensor) -> None:
    inputs, _ = given()
    with pytest.raises(InputError, match="against gravity"):
        capture(actor(), inputs.rig.cameras, inputs.detections, 30.0, up=up)
