"""Joints of smaller copies, and those counted from boxes, are refused, and no others."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.image_file import image_size
from perfcap.train.photograph_copies import require_whole
from perfcap.train.photographs import read_annotations

PATH = Path("annotations.json")
LSPET = Path(__file__).parents[3] / "shared" / "data" / "lspet"
Floats = np.ndarray


def people(count: int, seed: int = 0) -> tuple[Floats, Floats]:
    """Joints (N, 16, 2) of large and small people about the middle, and sizes of photographs."""
    rng = np.random.default_rng(seed)
    sizes = rng.uniform(200, 900, (count, 2))
    spans = rng.uniform(0.25, 0.6, (count, 1, 1)) * sizes.min(1)[:, None, None]
    middles = rng.normal([0.5, 0.44], 0.08, (count, 2)) * sizes
    joints = middles[:, None] + spans * rng.uniform(-0.5, 0.5, (count, 16, 2))
    return joints.astype(np.float32), sizes.astype(np.float32)


def from_box(joints: Floats) -> Floats:
    found: Floats = joints - np.nanmin(joints, 1, keepdims=True) + 10
    return found


WRONG: dict[str, tuple[Callable[[Floats], Floats], int, str]] = {
    "a fifth smaller": (lambda joints: 0.8 * joints, 200, "copies about 0.8 times as large"),
    "smaller": (lambda joints: 0.6 * joints, 60, "are at 30% of the width .* about 0.6 times"),
    "of another shape": (lambda joints: joints * [0.5, 0.667], 20, "about 0.5 times as large"),
    "from boxes": (
        from_box,
        20,
        "small and of large people all begin at about 10, 10; .* each one's box",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_joints_of_copies_are_refused(name: str) -> None:
    spoil, count, words = WRONG[name]
    joints, sizes = people(count)
    require_whole(PATH, joints, sizes)
    with pytest.raises(InputError, match=words):
        require_whole(PATH, spoil(joints).astype(np.float32), sizes)


def test_a_part_of_a_list_that_is_counted_from_boxes() -> None:
    joints, sizes = people(600)
    joints[400:500] = from_box(joints[400:500])
    with pytest.raises(InputError, match=r"of people \d+ to \d+ of the list, joints of small"):
        require_whole(PATH, joints, sizes)


def test_photographs_that_were_cut_out_are_accepted() -> None:
    joints, sizes = people(200)
    joints = from_box(joints)
    require_whole(PATH, joints, joints.max(1) + 10)
    with pytest.raises(InputError):  # of whole photographs they are no places
        require_whole(PATH, joints, sizes)


def test_people_low_and_left_before_one_camera_are_accepted() -> None:
    joints, sizes = people(200)
    require_whole(PATH, joints + sizes[:, None] * np.float32([-0.15, 0.2]), sizes)
    with pytest.raises(InputError):  # high and left, as of copies
        require_whole(PATH, joints + sizes[:, None] * np.float32([-0.15, -0.15]), sizes)


def test_few_people_say_nothing() -> None:
    joints, sizes = people(60)
    joints = (0.4 * joints).astype(np.float32)
    require_whole(PATH, joints[:19], sizes[:19])
    with pytest.raises(InputError):
        require_whole(PATH, joints, sizes)


@pytest.mark.skipif(not LSPET.is_dir(), reason="needs shared/data/lspet")
def test_sports_people_in_subsets_and_orders() -> None:
    known = read_annotations(LSPET)
    joints = np.stack([each.joints2d for each in known])
    sizes = np.array([image_size(each.path.read_bytes()) for each in known], np.float32)
    rng = np.random.default_rng(0)
    for count in 100 * [20] + 100 * [60] + 50 * [200]:
        part = rng.choice(len(joints), count, replace=False)
        require_whole(PATH, joints[part], sizes[part])
    low = np.nanmin(joints, 1)
    for values in (low[:, 0], low[:, 1], np.nanmax(joints, 1)[:, 0] - low[:, 0], sizes[:, 0]):
        for sign in (1, -1):
            order = np.argsort(sign * values, kind="stable")
            require_whole(PATH, joints[order], sizes[order])
    for spoil, _, words in WRONG.values():
        with pytest.raises(InputError, match=words):
            require_whole(PATH, spoil(joints).astype(np.float32), sizes)
