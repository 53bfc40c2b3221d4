"""Videos that are cut, and people who walk past each other, which is none of it."""

import cv2
import numpy as np
import pytest
import torch
from doctored_views import one
from numpy.typing import NDArray
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import CameraRig, PixelMap
from perfcap.io.clip import Clip
from perfcap.io.doctor.finding import Finding
from perfcap.io.doctor.inputs import examine_take
from perfcap.io.doctor.shots import examine_standing
from perfcap.pipeline.images import Images
from perfcap.pipeline.input_doubts import scene_doubts
from perfcap.pipeline.people import Person, Scene

FRAMES, SIDE, CUT = 90, 240, 40
WORDS = "what is behind the person is another, or elsewhere"

Image = NDArray[np.uint8]


def texture(seed: int, low: int, high: int) -> Image:
    spots = np.random.default_rng(seed).integers(low, high, (40, 40), dtype=np.uint8)
    return np.asarray(cv2.resize(spots, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC), np.uint8)


class Pair:
    """Before a dim wall one person stands, and one in a bright pattern goes to another place."""

    name, lost, warnings, fps, timestamps = "filmed", 0, (), 30.0, None
    size, total = (SIDE, SIDE), FRAMES

    def __init__(self, later: Image | None = None) -> None:
        self.wall = texture(0, 100, 125)
        self.later = self.wall if later is None else later

    def __len__(self) -> int:
        return FRAMES

    def joints(self) -> NDArray[np.float64]:
        """(P, F, 1, 16, 2)."""
        still = np.stack((np.tile((10.0, 30.0), 8), np.linspace(60, 180, 16)), -1)
        other = np.stack((np.tile((0.0, 60.0), 8), np.linspace(30, 210, 16)), -1)
        left = 60 + 100 * np.clip((np.arange(FRAMES) - CUT) / 4, 0, 1)
        way = other + np.stack((left, np.zeros(FRAMES)), -1)[:, None]
        return np.stack((np.broadcast_to(still, way.shape), way))[:, :, None]

    def read(self, start: int, stop: int) -> Image:
        images = []
        for frame in range(start, stop):
            image = (self.wall if frame < CUT else self.later).copy()
            for joints, coat in zip(self.joints()[:, frame, 0], (250, None), strict=True):
                (x0, y0), (x1, y1) = joints.min(0).astype(int), joints.max(0).astype(int)
                dress = texture(7, 0, 255)[: y1 - y0, : x1 - x0]
                image[y0:y1, x0:x1] = dress if coat is None else coat
            images.append(image)
        return np.stack(images)[..., None].repeat(3, -1)

    def read_view(self, _: int, start: int, stop: int) -> Image:
        return self.read(start, stop)

    def close(self) -> None: ...


def looked_at(source: Pair, *, alone: bool) -> list[Finding]:
    joints = source.joints()
    certain = np.ones(joints.shape[:-1])
    take = Clip([source], 30.0), ["left"], 30.0, joints[0], certain[0]
    return examine_standing(*take, rests=True, everybody=None if alone else (joints, certain))


def test_who_walks_past_is_no_cut() -> None:
    """Corners on the other person, which were most of all, were taken for the background."""
    assert WORDS in one(looked_at(Pair(), alone=True)).what  # nothing says that a person is there
    assert looked_at(Pair(), alone=False) == []


@pytest.mark.parametrize(
    "later",
    [texture(1, 100, 125), np.roll(texture(0, 100, 125), (2, 3), (0, 1))],
    ids=["another", "knocked"],
)
def test_cuts_behind_two_people_are_named(later: Image) -> None:
    found = one(looked_at(Pair(later), alone=False))
    assert found.subject == "left" and f"{WORDS}, from frame {CUT} on" in found.what


def scene(source: Pair) -> Scene:
    actor, joints = make_take(2).actor, torch.tensor(source.joints())
    people = [Detections.from_joints(each, torch.ones(each.shape[:-1])) for each in joints]
    intrinsics = torch.tensor([[240.0, 0, 119.5], [0, 240, 119.5], [0, 0, 1]]).double()
    turn, place = torch.eye(3).double(), torch.zeros(3).double()
    camera = Camera(intrinsics[None], turn[None], place[None], size=((SIDE, SIDE),))
    return Scene(
        camera, tuple(Person(actor, each) for each in people), 30.0, Images(source, camera)
    )


@pytest.mark.long
@pytest.mark.parametrize(("later", "named"), [(None, False), (texture(1, 100, 125), True)])
def test_inputs_of_several_people_are_judged_together(later: Image | None, named: bool) -> None:
    """By ``perfcap capture`` of files, and by ``capture`` of what is given in Python."""
    source = Pair(later)
    given = scene(source)
    seen = [each.detections for each in given.people]
    everybody = Detections.from_joints(
        torch.stack([each.joints2d for each in seen]),
        torch.stack([each.confidence2d for each in seen]),
    )
    take = CameraRig(("left",), given.cameras), seen[0], Clip([source], 30.0)
    pixels = PixelMap(torch.eye(3).double()[None])
    found = examine_take(*take, pixels, detected=True, everybody=everybody)
    assert any(WORDS in each.what for each in found) is named
    told = [scene_doubts(given, person, True).sentences for person in given.people]
    assert [any(WORDS in line for line in each) for each in told] == [named] * 2
