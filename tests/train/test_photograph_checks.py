"""Lists of annotated people whose joints are wrong, in all of the list or in a part of it."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from synthetic import actor

from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.train.photograph_checks import require_people, require_places, stretches
from perfcap.train.photographs import Photographs, read_annotations

COUNT, WIDTH, HEIGHT = 1000, 400, 300
PATH = Path("annotations.json")
LSPET = Path(__file__).parents[3] / "shared" / "data" / "lspet"
Floats = np.ndarray


def people() -> Floats:
    """Joints (N, 16, 2) of people in all poses, most of whom face the camera; 25 % upside down."""
    generator = torch.Generator().manual_seed(0)
    person = actor()
    skeleton = person.skeleton
    share = 0.5 + 0.12 * torch.randn(COUNT, len(skeleton.lower), generator=generator).double()
    angles = skeleton.lower + share.clamp(0, 1) * (skeleton.upper - skeleton.lower)
    yaw = 1.0 * torch.randn(COUNT, generator=generator).double()
    yaw[: COUNT // 5] += math.pi
    turns = torch.stack((0 * yaw, yaw, 0 * yaw), -1)
    places = person.joints(Motion(0 * turns, turns, angles))[..., :2].numpy() * [1, -1]
    lying = np.random.default_rng(0).normal(0, 0.4, COUNT)
    lying[-COUNT // 4 :] += math.pi
    turn = np.array([[np.cos(lying), -np.sin(lying)], [np.sin(lying), np.cos(lying)]])
    places = np.einsum("ijn,nkj->nki", turn, places)
    low, high = places.min(1, keepdims=True), places.max(1, keepdims=True)
    rng = np.random.default_rng(1)
    size = rng.uniform(120, 250, (COUNT, 1, 1)) / (high - low).max(-1, keepdims=True)
    size = np.minimum(size, 270 / (high - low).max(-1, keepdims=True))
    span = size * (high - low)
    corner = rng.uniform(0, 1, (COUNT, 1, 2)) * ([WIDTH - 5, HEIGHT - 5] - span)
    joints = ((places - low) * size + corner).astype(np.float32)
    return joints[np.random.default_rng(2).permutation(COUNT)]


SOUND = people()


def check(joints: Floats, count: int = COUNT) -> None:
    sizes = np.tile(np.float32([WIDTH, HEIGHT]), (count, 1))
    known = np.isfinite(joints).all(-1)
    outside = ((joints < -1) | (joints > sizes[:, None])).any(-1) & known
    require_people(PATH, joints)
    require_places(PATH, joints, sizes, outside)


def exchanged(*pairs: tuple[str, str]) -> Callable[[Floats], Floats]:
    order = list(range(16))
    for one, other in pairs:
        a, b = LANDMARKS.index(one), LANDMARKS.index(other)
        order[a], order[b] = order[b], order[a]
    return lambda joints: joints[:, order]


def both(one: str, other: str) -> Callable[[Floats], Floats]:
    return exchanged(*((f"{s}_{one}", f"{s}_{other}") for s in "lr"))


def sides(*names: str) -> Callable[[Floats], Floats]:
    return exchanged(*((f"l_{name}", f"r_{name}") for name in names))


WRONG = {
    "wrists and elbows": (both("wrist", "elbow"), r"elbow lies beyond ._wrist"),
    "hips and knees": (both("hip", "knee"), r"_knee lies beyond ._hip"),
    "knees and ankles": (both("knee", "ankle"), r"_knee lies beyond ._ankle"),
    "sides of arms": (sides("shoulder", "elbow", "wrist"), "left and right of shoulders and of"),
    "sides of wrists": (sides("wrist"), "_wrist is nearer to"),
    "up": (lambda joints: np.array([0, HEIGHT]) - joints * [-1, 1], "upside down|feet below"),
    "normalised": (lambda joints: joints / [WIDTH, HEIGHT], "expected pixels; multiply"),
    "copies": (lambda joints: joints / 2, "upper left quarter"),
    "another photograph": (
        lambda joints: joints + np.array([250, 0]),
        "lie outside of their photographs",
    ),
}


def accepted(joints: Floats) -> bool:
    """Whether nothing is odd of joints."""
    try:
        check(joints)
    except InputError:
        return False
    return True


def test_sound_people_are_accepted() -> None:
    assert accepted(SOUND)
    assert accepted(without(SOUND, "neck", "head_top"))


def without(joints: Floats, *names: str) -> Floats:
    left = joints.copy()
    left[:, [LANDMARKS.index(name) for name in names]] = np.nan
    return left


@pytest.mark.parametrize("part", [slice(None), slice(700, 1000)], ids=["whole", "last third"])
@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_refused(name: str, part: slice) -> None:
    spoil, words = WRONG[name]
    joints = SOUND.copy()
    joints[part] = spoil(joints[part]).astype(np.float32)
    with pytest.raises(InputError, match=words):
        check(joints)
    with pytest.raises(InputError, match=words):
        check(without(joints, "neck", "head_top"))  # as those of COCO


def test_joints_that_are_copies_of_others() -> None:
    for own, other in (("head_top", "neck"), ("l_toe", "l_ankle")):
        joints = SOUND.copy()
        joints[700:, LANDMARKS.index(own)] = joints[700:, LANDMARKS.index(other)]
        with pytest.raises(InputError, match="at one place, to the last digit"):
            check(joints)


def test_neck_and_crown_exchanged() -> None:
    spoil = exchanged(("neck", "head_top"))
    with pytest.raises(InputError, match="are neck and head_top exchanged"):
        require_people(PATH, spoil(SOUND))
    joints = SOUND.copy()
    joints[700:] = spoil(joints[700:])
    with pytest.raises(InputError, match=r"in people \d+ to \d+ of the list, neck is nearer to"):
        require_people(PATH, joints)


def test_x_and_y_exchanged() -> None:
    with pytest.raises(InputError, match="expected x before y"):
        require_people(PATH, without(SOUND, "neck")[..., ::-1])


@pytest.mark.parametrize("sign", [1, -1])
def test_sorted_lists_are_accepted(sign: int) -> None:
    """As all gymnasts upside down at the end."""
    shoulder, hip, wrist = (LANDMARKS.index(f"l_{n}") for n in ("shoulder", "hip", "wrist"))
    keys = {
        "upside down": SOUND[:, shoulder, 1] - SOUND[:, hip, 1],
        "broad": np.abs(SOUND[:, shoulder, 0] - SOUND[:, shoulder + 3, 0]),
        "size": np.ptp(SOUND, axis=1).max(-1),
        "left": SOUND.max(1)[:, 0],
        "raised hands": SOUND[:, wrist, 1] - SOUND[:, shoulder, 1],
    }
    for name, values in keys.items():
        assert accepted(SOUND[np.argsort(sign * values, kind="stable")]), name


def test_a_list_is_read_in_overlapping_stretches() -> None:
    parts = list(stretches(1000))
    assert parts[:3] == [slice(0, 1000), slice(0, 100), slice(50, 150)]
    assert parts[-1] == slice(900, 1000)
    assert list(stretches(50)) == [slice(0, 50)]


def test_a_wrong_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "images" / "one.png"), image)

    def write(joints: Floats) -> None:
        rows = np.concatenate([joints + 0.5, np.ones_like(joints[..., :1])], -1).tolist()
        table = {
            "joint_names": LANDMARKS,
            "images": [{"file": "one.png", "joints": r} for r in rows],
        }
        (tmp_path / "annotations.json").write_text(json.dumps(table))

    write(SOUND)
    assert len(Photographs(tmp_path, 64, 1.8)) == COUNT
    joints = SOUND.copy()
    joints[600:] /= 2
    write(joints)
    with pytest.raises(
        InputError, match=r"in people \d+ to \d+ of the list, joints lie in the upper"
    ):
        Photographs(tmp_path, 64, 1.8)


@pytest.mark.skipif(not LSPET.is_dir(), reason="needs shared/data/lspet")
def test_sports_people_in_any_order() -> None:
    joints = np.stack([each.joints2d for each in read_annotations(LSPET)])
    shoulders, hips = (
        0.5 * sum(joints[:, LANDMARKS.index(f"{s}_{n}"), 1] for s in "lr")
        for n in ("shoulder", "hip")
    )
    for values in (shoulders - hips, np.nanmax(joints, 1)[:, 0], np.isnan(joints).sum((1, 2))):
        for sign in (1, -1):
            require_people(PATH, joints[np.argsort(sign * values, kind="stable")])
    rng = np.random.default_rng(0)
    for _ in range(20):
        require_people(PATH, joints[rng.permutation(len(joints))[: rng.integers(30, 600)]])
    upside_down = joints.copy()
    upside_down[840:, :, 1] *= -1
    with pytest.raises(InputError, match="as in a mirror"):
        require_people(PATH, upside_down)
