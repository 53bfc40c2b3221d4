"""Views that ``--sync auto`` corrects: joints between frames, images that say how late they are."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from takes import make_take

from perfcap.app.inputs import Inputs
from perfcap.app.true_views import settled
from perfcap.detect.detections import Detections
from perfcap.io.calibration import CameraRig, PixelMap
from perfcap.io.clip import Clip
from perfcap.pipeline.lens import Lens

FRAMES = 60
LATE = (0.0, 2.5, -1.0)  # frames


@dataclass(frozen=True)
class Numbered:
    """A view whose frames show their number."""

    name: str
    size: tuple[int, int] = (4, 4)
    lost: int = 0
    total: int = FRAMES
    warnings: tuple[str, ...] = ()
    fps: float = 30.0
    timestamps: None = None

    def __len__(self) -> int:
        return self.total

    def read(self, start: int, stop: int) -> NDArray[np.uint8]:
        frames = np.arange(start, stop, dtype=np.uint8)[:, None, None, None]
        return np.broadcast_to(frames, (stop - start, 4, 4, 3))

    def close(self) -> None:
        """Nothing is open."""


def filmed() -> Inputs:
    """Three views of a take at four times the rate, each from its own time."""
    take = make_take(260, views=3, lifted=False, rate=120.0)
    starts = [12 - round(4 * late) for late in LATE]
    pixels = torch.stack(
        [take.detections.joints2d[f : f + 240 : 4, view] for view, f in enumerate(starts)], 1
    )
    detections = Detections.from_joints(pixels, torch.ones(pixels.shape[:-1], dtype=pixels.dtype))
    clip = Clip([Numbered(name) for name in "abc"], 30.0)
    whole = PixelMap(torch.eye(3, dtype=torch.float64).repeat(3, 1, 1))
    return Inputs(clip, CameraRig(("a", "b", "c"), take.cameras), detections, whole, ())


def alone(guessed: bool) -> Inputs:
    """One view with a lens of half the true focal length."""
    take = make_take(60, turns=0.3)
    wrong = Lens(0.5, 0.0, shown=True).of_camera(take.cameras)
    whole = PixelMap(torch.eye(3, dtype=torch.float64)[None])
    rig = CameraRig(("a",), wrong, guessed=guessed)
    return Inputs(Clip([Numbered("a")], 30.0), rig, take.detections, whole, ())


@pytest.mark.long
def test_a_guessed_lens_becomes_the_one_that_is_shown() -> None:
    given = alone(guessed=True)
    found, views = settled(given, sync=False, refine=False, assumed=True)
    factor = views["lens"]["factor"]
    assert 1.6 < factor < 2.4 and views["lens"]["shown"]
    before, after = (each.rig.cameras.intrinsics for each in (given, found))
    assert torch.allclose(after[..., :2, :2], factor * before[..., :2, :2])
    assert torch.equal(after[..., 2], before[..., 2])
    assert "instead of the assumed" in found.warnings[0]
    kept = alone(guessed=False)
    found, views = settled(kept, sync=False, refine=False, assumed=True)
    assert (replace(found, rests=False), views) == (kept, {}) and found.rests


@pytest.mark.long
def test_images_say_how_late_they_are() -> None:
    given = filmed()
    found, views = settled(given, sync=True, refine=False)
    assert set(views) == {"clock_frames"} and len(found.warnings) == 1
    assert found.lag is not None and found.lag.shape == (FRAMES, 3)
    shown = [int(found.clip.read_view(view, 30, 31)[0, 0, 0, 0]) for view in range(3)]
    assert shown[0] == 30 and shown[2] == 29 and shown[1] in (32, 33)
    lag = torch.tensor([0.0, shown[1] - 32.5, 0.0], dtype=torch.float64)
    torch.testing.assert_close(found.lag[30].double(), lag, atol=0.05, rtol=0)
    # the clip goes on in the second view only, and the third begins later
    assert bool(found.lag[-1, 1].isnan()) and bool(found.lag[0, 2].isnan())
    assert not bool(found.lag[5:-5].isnan().any())


def test_nothing_asked_for_changes_nothing() -> None:
    given = filmed()
    same, views = settled(given, sync=False, refine=False)
    assert same is given and views == {} and same.lag is None
