"""Frames between others."""

import pytest
import torch
from synthetic import actor, random_motion
from takes import sway

from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.gaps import fill_gaps, ranges


def flags(text: str) -> torch.Tensor:
    return torch.tensor([c == "x" for c in text])


@pytest.mark.parametrize(
    ("missing", "expected"),
    [
        ("....", []),
        ("xxxx", [(0, 4)]),
        ("x..x", [(0, 1), (3, 4)]),
        (".xx.x.", [(1, 3), (4, 5)]),
        ("x", [(0, 1)]),
    ],
)
def test_ranges(missing: str, expected: list[tuple[int, int]]) -> None:
    assert ranges(flags(missing)) == expected


def test_what_was_seen_stays_to_the_bit() -> None:
    motion = random_motion(actor().skeleton, 8)
    seen = flags("x.xx..x.")
    filled = fill_gaps(motion, seen)
    for name in ("translation", "rotation", "angles"):
        assert torch.equal(getattr(filled, name)[seen], getattr(motion, name)[seen])
    assert fill_gaps(motion, flags("xxxxxxxx")) is motion


def test_what_was_not_seen_does_not_matter_even_as_nan() -> None:
    motion = random_motion(actor().skeleton, 8)
    seen = flags(".xx..x..")
    expected = fill_gaps(motion, seen)
    for name in ("translation", "rotation", "angles"):
        getattr(motion, name)[~seen] = torch.nan
    found = fill_gaps(motion, seen)
    for name in ("translation", "rotation", "angles"):
        assert torch.equal(getattr(found, name), getattr(expected, name))


def test_even_motion_is_filled_in_exactly() -> None:
    motion = sway(actor(), 5)
    steps = torch.arange(5.0, dtype=torch.float64)[:, None]
    axis = torch.tensor([0.1, 0.9, -0.2], dtype=torch.float64)
    even = type(motion)(steps * axis, 0.05 * steps * axis, motion.angles[:1] + 0.01 * steps)
    filled = fill_gaps(even, flags("x...x"))
    torch.testing.assert_close(filled.translation, even.translation)
    torch.testing.assert_close(filled.angles, even.angles)
    # rotations go straight, nearly evenly, for small turns
    torch.testing.assert_close(filled.rotation, even.rotation, atol=1e-4, rtol=0)


def test_a_gap_across_half_a_turn_takes_the_short_way() -> None:
    """3.0 and -3.0 rad about an axis are 0.28 apart, not 6."""
    skeleton = actor().skeleton
    motion = random_motion(skeleton, 3)
    axis = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    motion.rotation[0], motion.rotation[2] = 3.0 * axis, -3.0 * axis
    middle = fill_gaps(motion, flags("x.x")).rotation[1]
    half_turn = rotvec_to_matrix(torch.pi * axis)
    torch.testing.assert_close(rotvec_to_matrix(middle), half_turn, atol=1e-9, rtol=0)


def test_ends_hold_the_nearest_pose() -> None:
    motion = random_motion(actor().skeleton, 6)
    filled = fill_gaps(motion, flags("..xx.."))
    assert torch.equal(filled.angles[0], motion.angles[2])
    assert torch.equal(filled.angles[5], motion.angles[3])
    assert torch.equal(filled.translation[1], motion.translation[2])


def test_filled_angles_stay_within_the_limits() -> None:
    skeleton = actor().skeleton
    motion = random_motion(skeleton, 40)
    motion.angles[::3] = skeleton.upper
    motion.angles[1::7] = skeleton.lower
    seen = flags("x..x.x...x" * 4)
    angles = fill_gaps(motion, seen).angles
    assert (angles >= skeleton.lower).all() and (angles <= skeleton.upper).all()


def test_nothing_seen_is_bad_input() -> None:
    with pytest.raises(InputError, match="in no frame"):
        fill_gaps(random_motion(actor().skeleton, 3), flags("..."))
