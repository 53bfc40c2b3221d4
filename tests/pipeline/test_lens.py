"""The lens that a moving person shows: recovered where joints are good, left alone elsewhere."""

import math
from dataclasses import replace

import pytest
import torch
from synthetic import actor
from takes import Take, make_take

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline.lens import Lens, LensConfig, solve_lens

F64 = torch.float64


def taken(noise: float = 1.0) -> Take:
    """A person who walks about and turns, 5 m away, seen with a pixel of noise."""
    take = make_take(90, turns=0.3)
    random = torch.Generator().manual_seed(3)
    moved = noise * torch.randn(take.detections.joints2d.shape, generator=random, dtype=F64)
    detections = replace(take.detections, joints2d=take.detections.joints2d + moved)
    return replace(take, detections=detections)


def with_lens(cameras: Camera, factor: float) -> Camera:
    return Lens(factor, 0.0, shown=True).of_camera(cameras)


@pytest.mark.long
@pytest.mark.parametrize("wrong", [0.5, 0.7])
def test_a_wrong_lens_is_corrected(wrong: float) -> None:
    """With a generic body, whose bones are other than the person's."""
    take = taken()
    stated = with_lens(take.cameras, wrong)
    found = solve_lens(actor(), stated, take.detections, take.rate)
    assert found.shown and found.deviation < 0.2
    left = abs(math.log(found.factor * wrong))
    assert left < 0.25 * abs(math.log(wrong)) and left < 2 * found.deviation
    focal = found.of_camera(stated).intrinsics[0, 0, 0] / stated.intrinsics[0, 0, 0]
    assert float(focal) == pytest.approx(found.factor)


@pytest.mark.long
def test_a_shorter_lens_is_not_believed() -> None:
    take = taken()
    stated = with_lens(take.cameras, 1.4)
    found = solve_lens(actor(), stated, take.detections, take.rate)
    assert not found.shown and found.factor == 1.0


def test_flat_joints_show_no_lens() -> None:
    take = taken()
    found = solve_lens(actor(), take.cameras, take.detections.without_poses(), take.rate)
    assert not found.shown and found.factor == 1.0
    assert found.of_camera(take.cameras).intrinsics.equal(take.cameras.intrinsics)
    assert "no other lens than the assumed" in found.sentence(take.cameras)


def test_a_few_frames_show_no_lens() -> None:
    take = taken()
    fewest = LensConfig().fewest
    found = solve_lens(actor(), take.cameras, take.detections.frames(slice(fewest - 1)), take.rate)
    assert not found.shown


def test_the_sentence_gives_angles_and_their_range() -> None:
    cameras = make_take(2).cameras  # of 600 pixels
    focal = float(cameras.intrinsics[0, 0, 0])

    def angle(factor: float) -> str:
        return f"{2 * math.degrees(math.atan(300 / (focal * factor))):.0f}"

    said = Lens(1.5, 0.2, shown=True).sentence(cameras)
    assert f"a lens of {angle(1.5)} degrees" in said
    assert f"({angle(1.5 * math.exp(0.2))} to {angle(1.5 * math.exp(-0.2))})" in said
    assert f"assumed {angle(1.0)}" in said
    assert Lens(1.5, 0.2, shown=True).report() == {
        "factor": 1.5,
        "log_deviation": 0.2,
        "shown": True,
    }


def test_what_is_refused() -> None:
    one, two, moving = taken(), make_take(20, views=2), make_take(20, moving=True)
    for take, why in ((two, "2 views"), (moving, "moving")):
        with pytest.raises(InputError, match=why):
            solve_lens(actor(), take.cameras, take.detections, 30.0)
    with pytest.raises(InputError, match="actor"):
        solve_lens(None, one.cameras, one.detections, 30.0)  # type: ignore[arg-type]
    hidden = Detections.from_joints(one.detections.joints2d, 0 * one.detections.confidence2d)
    assert not solve_lens(actor(), one.cameras, hidden, 30.0).shown
