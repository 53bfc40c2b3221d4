"""Two views of a short clip: calibration errors are no lag, and lags are named where they show."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from doctored_views import NAMES, detections, one, rig

from perfcap.detect.detections import Detections
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.detections import read_detections
from perfcap.io.doctor import Finding, Severity, examine_agreement
from perfcap.io.doctor.hypotheses import _error, hypotheses

BASE = Path(__file__).parents[3] / "shared" / "data" / "pose2sim_balancing"
needs_data = pytest.mark.skipif(not BASE.is_dir(), reason="needs the recordings")


@pytest.fixture(scope="module")
def balancing() -> tuple[CameraRig, Detections]:
    real = read_cameras(BASE / "calibration/Calib_scene.toml")
    paths = sorted((BASE / "pose2d_associated").iterdir())
    return real, read_detections(paths, views=len(real.names))[0]


def examined(
    given: tuple[CameraRig, Detections], views: list[int], first: int, length: int, late: int = 0
) -> list[Finding]:
    """Of a part of two views, the second one as it was so many frames before."""
    real, seen = given[0], given[1].select(views)
    here, before = (seen.frames(slice(at, at + length)) for at in (first, first - late))
    second = torch.tensor([[False, True]])
    return examine_agreement(real.select(views), before.where(second, here))


@needs_data
@pytest.mark.parametrize(("first", "length"), [(20, 16), (12, 24), (48, 12), (42, 16), (21, 10)])
def test_calibration_errors_are_no_lag(
    balancing: tuple[CameraRig, Detections], first: int, length: int
) -> None:
    assert examined(balancing, [0, 1], first, length) == []


def away(seen: Detections, around: int) -> Detections:
    """The same with so many frames before and after in which nobody is seen."""
    count = seen.frame_count
    index = torch.cat((torch.zeros(around), torch.arange(count), torch.full((around,), count - 1)))
    longer = seen.frames(index.long())
    confidence = longer.confidence2d.clone()
    confidence[:around] = confidence[around + count :] = 0
    return replace(longer, confidence2d=confidence)


@needs_data
@pytest.mark.parametrize(("first", "length"), [(20, 16), (12, 24), (48, 12), (42, 16), (21, 10)])
def test_few_frames_of_a_longer_clip(
    balancing: tuple[CameraRig, Detections], first: int, length: int
) -> None:
    """Who is seen in a part of it is seen in as many frames as in a short clip."""
    real, seen = balancing
    part = seen.select([0, 1]).frames(slice(first, first + length))
    assert examine_agreement(real.select([0, 1]), away(part, 16)) == []


def test_a_late_view_needs_frames_in_which_the_person_is_seen() -> None:
    pixels = torch.rand(40, 16, 2, generator=torch.Generator().manual_seed(0))
    known = torch.zeros(40, 16, dtype=torch.bool)
    known[4:13] = True
    assert _error(pixels, known, pixels, known, 0) == float("inf")  # of nine frames
    known[4:14] = True
    assert _error(pixels, known, pixels, known, 0) == 0
    assert _error(pixels, known, pixels, known, 1) == float("inf")
    assert _error(pixels, known, pixels, known, 40) == float("inf")


@needs_data
@pytest.mark.parametrize("length", [16, 24])
def test_clear_lags_are_refused(balancing: tuple[CameraRig, Detections], length: int) -> None:
    found = one(examined(balancing, [0, 1], 20, length, 7))
    assert found.severity is Severity.ERROR and "synchronise" in found.remedy
    # of two views, that the first is early is the same
    assert found.subject == "int_cam01_img" and "or so frames early" in found.what
    assert found.views == (0, 1)


@needs_data
def test_lags_that_are_less_clear_take_no_trust(balancing: tuple[CameraRig, Detections]) -> None:
    found = one(examined(balancing, [0, 1], 20, 24, 4))
    assert found.severity is Severity.WARNING and "may be chance" in found.what
    assert found.views == () and "synchronise" in found.remedy


@pytest.mark.parametrize(("frames", "most"), [(10, 5), (12, 5), (24, 10), (29, 14), (30, 20)])
def test_most_of_a_clip_is_compared(frames: int, most: int) -> None:
    tried = [each.delay for each in hypotheses(NAMES[:2], range(2), frames)]
    assert max(tried) == most and min(tried) == -most


def test_lags_of_made_up_views_are_named_in_few_frames() -> None:
    pair, seen = rig().select([1, 3]), detections().select([1, 3])
    assert examine_agreement(pair, seen.frames(slice(5, 21))) == []
    found = one(examined((pair, seen), [0, 1], 8, 16, 5))
    assert found.severity is Severity.ERROR and "5 or so frames early" in found.what
