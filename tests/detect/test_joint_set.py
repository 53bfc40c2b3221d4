"""Joint sets and the map to the landmarks."""

import pytest
import torch

from perfcap.detect import joint_set as sets
from perfcap.detect.joint_set import LANDMARKS, JointSet, canonical_name, map_to_landmarks

SIZES = {
    "landmarks16": 16,
    "COCO-17": 17,
    "COCO-18": 18,
    "BODY_25": 25,
    "BODY_25B": 25,
    "Halpe-26": 26,
    "COCO-WholeBody": 133,
    "Halpe-136": 136,
    "MPII": 16,
    "LSP": 14,
    "H36M-17": 17,
    "BlazePose-33": 33,
}
MISSING = {
    "COCO-17": {"r_toe", "l_toe"},
    "COCO-18": {"r_toe", "l_toe"},
    "MPII": {"r_toe", "l_toe"},
    "LSP": {"r_toe", "l_toe"},
    "H36M-17": {"r_toe", "l_toe"},
}


def body(joint_set: JointSet) -> tuple[torch.Tensor, torch.Tensor]:
    """A pose whose coordinates depend on the joint's name alone, so that order cannot matter."""
    places = {name: float(1 + i) for i, name in enumerate(sorted(sets.KNOWN_JOINTS))}
    x = torch.tensor([places[name] for name in joint_set.joints], dtype=torch.float64)
    return torch.stack((x, x**2), -1), torch.full_like(x, 0.5)


@pytest.mark.parametrize("joint_set", sets.JOINT_SETS, ids=lambda s: s.name)
def test_sizes_and_missing_landmarks(joint_set: JointSet) -> None:
    assert len(joint_set) == SIZES[joint_set.name]
    assert set(joint_set.missing()) == MISSING.get(joint_set.name, set())


@pytest.mark.parametrize("joint_set", sets.JOINT_SETS, ids=lambda s: s.name)
def test_joints_are_found_by_name(joint_set: JointSet) -> None:
    values, confidence = body(joint_set)
    mapped, trust = map_to_landmarks(values, confidence, joint_set)
    named = dict(zip(joint_set.joints, values, strict=True))
    for i, landmark in enumerate(LANDMARKS):
        if landmark in named:
            torch.testing.assert_close(mapped[i], named[landmark])
        elif landmark in joint_set.missing():
            assert trust[i] == 0 and (mapped[i] == 0).all()
        elif landmark == "head_top":
            ears, shoulders = (
                (named[f"l_{part}"] + named[f"r_{part}"]) / 2 for part in ("ear", "shoulder")
            )
            torch.testing.assert_close(mapped[i], ears + 0.6 * (ears - shoulders))
        elif landmark == "neck" and "thorax" in named:
            torch.testing.assert_close(mapped[i], named["thorax"])
        elif landmark == "neck":
            torch.testing.assert_close(mapped[i], (named["l_shoulder"] + named["r_shoulder"]) / 2)
        else:
            torch.testing.assert_close(mapped[i], named[landmark[:2] + "big_toe"])


def test_published_index_tables() -> None:
    """A few indices as the formats' own documentation lists them."""
    for joint_set, joint, index in (
        (sets.COCO17, "r_ankle", 16),
        (sets.COCO18, "l_ankle", 13),
        (sets.COCO18, "r_eye", 14),
        (sets.BODY_25, "mid_hip", 8),
        (sets.BODY_25, "l_ankle", 14),
        (sets.BODY_25, "r_ear", 17),
        (sets.BODY_25, "r_big_toe", 22),
        (sets.BODY_25B, "neck", 17),
        (sets.BODY_25B, "l_big_toe", 19),
        (sets.BODY_25B, "r_heel", 24),
        (sets.HALPE26, "head_top", 17),
        (sets.HALPE26, "r_big_toe", 21),
        (sets.HALPE26, "l_small_toe", 22),
        (sets.COCO_WHOLEBODY, "l_heel", 19),
        (sets.COCO_WHOLEBODY, "r_big_toe", 20),
        (sets.MPII, "thorax", 7),
        (sets.MPII, "r_wrist", 10),
        (sets.MPII, "l_wrist", 15),
        (sets.LSP, "head_top", 13),
        (sets.LSP, "l_hip", 3),
        (sets.H36M17, "l_hip", 4),
        (sets.H36M17, "r_wrist", 16),
        (sets.BLAZEPOSE33, "l_shoulder", 11),
        (sets.BLAZEPOSE33, "r_hip", 24),
        (sets.BLAZEPOSE33, "l_heel", 29),
        (sets.BLAZEPOSE33, "r_big_toe", 32),
    ):
        assert joint_set.joints.index(joint) == index


def test_neck_takes_the_lesser_confidence_and_needs_both_shoulders() -> None:
    values, confidence = body(sets.COCO17)
    confidence[sets.COCO17.joints.index("l_shoulder")] = 0.1
    assert map_to_landmarks(values, confidence, sets.COCO17)[1][1] == 0.1
    values[sets.COCO17.joints.index("r_shoulder")] = torch.nan
    mapped, trust = map_to_landmarks(values, confidence, sets.COCO17)
    assert trust[1] == 0 and (mapped[1] == 0).all()


def test_a_crown_needs_both_ears() -> None:
    values, confidence = body(sets.COCO17)
    confidence[sets.COCO17.joints.index("l_ear")] = 0.2
    assert map_to_landmarks(values, confidence, sets.COCO17)[1][0] == 0.2
    confidence[sets.COCO17.joints.index("l_ear")] = 0
    assert map_to_landmarks(values, confidence, sets.COCO17)[1][0] == 0


@pytest.mark.parametrize("bad", [torch.nan, torch.inf, -torch.inf])
def test_not_finite_becomes_unseen(bad: float) -> None:
    values, confidence = body(sets.LANDMARKS16)
    values[3, 1] = bad
    confidence[4] = bad
    mapped, trust = map_to_landmarks(values, confidence, sets.LANDMARKS16)
    assert mapped.isfinite().all() and trust.isfinite().all()
    assert trust.nonzero().flatten().tolist() == [i for i in range(16) if i not in (3, 4)]


def test_corner_pixel_is_unseen_but_the_3d_origin_is_not() -> None:
    confidence = torch.ones(16)
    assert (map_to_landmarks(torch.zeros(16, 2), confidence, sets.LANDMARKS16)[1] == 0).all()
    assert (map_to_landmarks(torch.zeros(16, 3), confidence, sets.LANDMARKS16)[1] == 1).all()


def test_batch_equals_loop() -> None:
    values, confidence = torch.randn(3, 2, 25, 2), torch.rand(3, 2, 25)
    mapped, trust = map_to_landmarks(values, confidence, sets.BODY_25)
    for i in range(3):
        for j in range(2):
            one = map_to_landmarks(values[i, j], confidence[i, j], sets.BODY_25)
            torch.testing.assert_close((mapped[i, j], trust[i, j]), one)


@pytest.mark.parametrize("joint_set", sets.JOINT_SETS, ids=lambda s: s.name)
def test_mirroring_twice_is_nothing_and_swaps_sides(joint_set: JointSet) -> None:
    other = joint_set.mirrored()
    assert [other[other[i]] for i in range(len(joint_set))] == list(range(len(joint_set)))
    assert other[joint_set.joints.index("l_hip")] == joint_set.joints.index("r_hip")


def test_wrong_count_and_repeated_names_are_refused() -> None:
    with pytest.raises(ValueError, match="17 joints of 'COCO-17'"):
        map_to_landmarks(torch.zeros(5, 16, 2), torch.zeros(5, 16), sets.COCO17)
    with pytest.raises(ValueError, match="nose more than once"):
        JointSet("odd", ("nose", "nose"))


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        ("RShoulder", "r_shoulder"),
        ("right_shoulder", "r_shoulder"),
        ("Left Wrist", "l_wrist"),
        ("LBigToe", "l_big_toe"),
        ("shoulder_left", "l_shoulder"),
        ("l_toe", "l_toe"),
        ("Head", "head_top"),
        ("HeadTop", "head_top"),
        ("MidHip", "mid_hip"),
        ("Pelvis", "mid_hip"),
        ("leftAnkle", "l_ankle"),
        ("Neck", "neck"),
    ],
)
def test_canonical_name(theirs: str, ours: str) -> None:
    assert canonical_name(theirs) == ours
    assert canonical_name(ours) == ours


def test_whole_numbers_and_one_word_are_refused() -> None:
    """The mean of two shoulders in whole numbers was (0, 0)."""
    with pytest.raises(ValueError, match=r"values are torch\.int64 .* expected floating-point"):
        map_to_landmarks(torch.ones(16, 2).long(), torch.ones(16), sets.LANDMARKS16)
    with pytest.raises(ValueError, match="names 'l_hip', expected several"):
        JointSet("mine", "l_hip")  # type: ignore[arg-type]
