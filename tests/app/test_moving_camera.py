"""One video without a calibration, filmed by a camera that turns, through the steps of capture."""

import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from takes import make_take
from torch import Tensor

from perfcap.app import moving_camera
from perfcap.app.inputs import Inputs
from perfcap.app.true_views import settled
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig, PixelMap
from perfcap.io.clip import Clip
from perfcap.matchmove import CameraWay, CornerTracks, Sightings
from perfcap.pipeline.lens import Lens

SIDE, FRAMES = 600, 45
TURN = math.radians(12)


def turns(most: float) -> Tensor:
    """Of a camera that is panned, (F, 3, 3)."""
    share = torch.linspace(0, 1, FRAMES, dtype=torch.float64)
    vectors = torch.stack((0.1 * (6 * share).sin() * most, most * share, 0 * share), -1)
    return rotvec_to_matrix(vectors)


@dataclass
class Panned:
    """A far wall through a camera (1,) that is turned (F, 3, 3) from where it begins."""

    camera: Camera
    turned: Tensor
    name: str = "panned"
    lost: int = 0
    warnings: tuple[str, ...] = ()
    fps: float = 30.0
    timestamps: None = None
    total: int = FRAMES
    size: tuple[int, int] = (SIDE, SIDE)
    wall: NDArray[np.uint8] = field(init=False)

    def __post_init__(self) -> None:
        spots = np.random.default_rng(0).integers(40, 215, (90, 90), dtype=np.uint8)
        large = cv2.resize(spots, (3 * SIDE, 3 * SIDE), interpolation=cv2.INTER_CUBIC)
        self.wall = np.asarray(large, np.uint8)

    def __len__(self) -> int:
        return FRAMES

    def read(self, start: int, stop: int) -> NDArray[np.uint8]:
        lens = self.camera.intrinsics[0].numpy()
        begin = np.array([[1, 0, -SIDE], [0, 1, -SIDE], [0, 0, 1.0]])
        images = []
        for turn in self.turned[start:stop].numpy():
            matrix = lens @ turn @ np.linalg.inv(lens) @ begin
            images.append(cv2.warpPerspective(self.wall, matrix, self.size))
        return np.stack(images)[..., None].repeat(3, -1)

    def close(self) -> None:
        """Nothing is open."""


def given(most: float = TURN, guessed: bool = True) -> Inputs:
    """A person who sways before the wall; the lens is assumed to be too wide."""
    take = make_take(FRAMES)
    camera = take.cameras
    source = Panned(camera, turns(most))
    known = camera.every_frame(FRAMES)
    moved = replace(
        known,
        rotation=source.turned[:, None] @ known.rotation,
        translation=(source.turned[:, None] @ known.translation[..., None]).squeeze(-1),
    )
    pixels = moved.project(take.actor.joints(take.truth))
    detections = replace(take.detections, joints2d=pixels)
    start = Camera(
        camera.intrinsics,
        torch.eye(3, dtype=torch.float64)[None],
        torch.zeros(1, 3, dtype=torch.float64),
        None,
        camera.size,
    )
    wrong = Lens(0.6, 0.0, shown=True).of_camera(start)
    rig = CameraRig(("panned",), wrong if guessed else start, guessed=guessed)
    whole = PixelMap(torch.eye(3, dtype=torch.float64)[None])
    return Inputs(Clip([source], 30.0), rig, detections, whole, ())


@pytest.mark.long
def test_a_panned_camera_is_found_with_its_lens() -> None:
    inputs = given()
    found, views = settled(inputs, sync=False, refine=False, assumed=True)
    cameras = found.rig.cameras
    assert cameras.moving and len(cameras.rotation) == FRAMES
    error = (cameras.rotation[:, 0] @ turns(TURN)[0] @ turns(TURN).mT).diagonal(dim1=-2, dim2=-1)
    degrees = ((error.sum(-1) - 1) / 2).clamp(-1, 1).arccos().rad2deg()
    assert float(degrees.max()) < 0.5
    assert abs(math.log(views["camera_motion"]["factor"] * 0.6)) < 0.05
    assert views["camera_motion"]["reach_m"] == 0
    assert "the camera moves" in found.warnings[0]
    kept, lens = settled(inputs, sync=False, refine=False, assumed=True, held=False)
    assert not kept.rig.cameras.moving and "lens" in lens and not kept.rests


@pytest.mark.long
def test_a_lens_that_is_known_stays() -> None:
    inputs = given(guessed=False)
    found, views = settled(inputs, sync=False, refine=False, assumed=True)
    assert found.rig.cameras.moving and views["camera_motion"]["factor"] == 1.0
    assert torch.equal(found.rig.cameras.intrinsics[7], inputs.rig.cameras.intrinsics)


@pytest.mark.long
def test_a_camera_at_rest_stays() -> None:
    inputs = given(0.0)
    found, views = settled(inputs, sync=False, refine=False, assumed=True)
    assert not found.rig.cameras.moving and "camera_motion" not in views and found.rests


def unmoved(inputs: Inputs) -> str:
    """What is kept for run.json of a camera that moves in a way that is not found."""
    found, views = settled(inputs, sync=False, refine=False, assumed=True)
    assert not found.rig.cameras.moving and "camera_motion" not in views and not found.rests
    return "\n".join(found.warnings)


@pytest.mark.long
def test_a_way_that_is_too_long_is_not_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moving_camera, "_LONGEST", 40)
    assert "40 frames at most, of 45" in unmoved(given())


@pytest.mark.long
def test_a_picture_that_is_moved_in_a_program_has_no_lens(monkeypatch: pytest.MonkeyPatch) -> None:
    inputs = given()

    def far(*_: object, **__: object) -> CameraWay:
        return CameraWay(turns(TURN).numpy(), np.zeros((FRAMES, 3)), 8.0, 0.03, False, 0.9)

    monkeypatch.setattr(moving_camera, "find_way", far)
    assert "is the picture cropped" in unmoved(inputs)
    known = replace(inputs, rig=replace(inputs.rig, guessed=False))
    assert moving_camera.find_motion(known)[0] is not None


@pytest.mark.long
def test_a_video_that_cuts_is_captured_in_shots() -> None:
    """It was said to need a tripod."""
    inputs = given()
    source = inputs.clip.sources[0]
    assert isinstance(source, Panned)
    whole = source.read

    def cut(start: int, stop: int) -> NDArray[np.uint8]:
        images = whole(start, stop)
        for frame in range(max(start, 30), stop):
            images[frame - start] = images[frame - start][::-1, ::-1]
        return images

    source.read = cut  # type: ignore[method-assign]
    said = unmoved(inputs)
    assert "the video cuts, or the camera swings, before frame 30: one shot" in said
    assert "the longest is --frames 0:30" in said


@pytest.mark.long
def test_a_lens_that_zooms_is_not_taken_for_a_camera_that_walks() -> None:
    """It walked by metres, and took the person along."""
    inputs = given()
    source = inputs.clip.sources[0]
    assert isinstance(source, Panned)
    whole = source.read

    def zoomed(start: int, stop: int) -> NDArray[np.uint8]:
        images = whole(start, stop)
        for frame in range(start, stop):
            matrix = cv2.getRotationMatrix2D((SIDE / 2, SIDE / 2), 0, 1.5 ** (frame / FRAMES))
            images[frame - start] = cv2.warpAffine(images[frame - start], matrix, (SIDE, SIDE))
        return images

    source.turned = turns(0.0)
    source.read = zoomed  # type: ignore[method-assign]
    assert "the lens zooms" in unmoved(inputs)


@pytest.mark.long
def test_no_corner_is_followed_at_bars_beside_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their edges stand still: the lens of a pillarboxed clip came out longer still."""
    inputs = given()
    source = inputs.clip.sources[0]
    assert isinstance(source, Panned)
    whole = source.read

    def between(start: int, stop: int) -> NDArray[np.uint8]:
        images = whole(start, stop)
        images[:, :, :170] = images[:, :, -170:] = 0
        return images

    seen = []

    class Watched(CornerTracks):
        def sightings(self) -> Sightings:
            seen.append(super().sightings())
            return seen[-1]

    source.read = between  # type: ignore[method-assign]
    monkeypatch.setattr(moving_camera, "CornerTracks", Watched)
    found, _ = moving_camera.find_motion(inputs)
    assert found is not None and abs(math.log(found.factor * 0.6)) < 0.05
    across = seen[0].pixels[:, 0] / seen[0].scale
    assert across.min() > 175 and across.max() < SIDE - 175
