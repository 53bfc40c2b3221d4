"""What the layer says of the 3D joints of the first clip that it is given."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.joint_set import COCO17, LANDMARKS, JointSet
from perfcap.detect.retarget import mid_hip
from perfcap.errors import InputError
from perfcap.pipeline import PoseRefiner

TAKE = make_take(10)
JOINTS = TAKE.actor.joints(TAKE.truth)
LOCAL = TAKE.cameras.to_camera(JOINTS)
PIXELS = TAKE.detections.joints2d


def refine(
    joints3d: Tensor, joints2d: Tensor | None = None, joint_set: str = "landmarks16"
) -> Tensor:
    layer = PoseRefiner(TAKE.actor, joint_set=joint_set).eval()
    joints: Tensor = layer(TAKE.cameras, joints2d, joints3d=joints3d).joints
    return joints


@pytest.mark.parametrize(
    ("words", "joints", "pixels"),
    [
        ("the feet point backwards", LOCAL * LOCAL.new_tensor([-1, 1, 1]), None),
        ("expected 0.3 to 3.0", 3.28 * LOCAL, None),
        (
            "no pose of them counts",
            LOCAL.clone().index_fill(-2, torch.tensor([0]), math.nan),
            PIXELS,
        ),
    ],
)
def test_mistakes_are_named(words: str, joints: Tensor, pixels: Tensor | None) -> None:
    with pytest.warns(UserWarning, match=f"PoseRefiner: .*{words}"):
        refine(joints, pixels)


def test_padding_is_no_other_unit() -> None:
    padded = torch.cat((LOCAL, 0 * LOCAL, 0 * LOCAL))
    with pytest.raises(InputError, match="say with lengths which frames are padding"):
        refine(padded[None])


@pytest.mark.parametrize("placed", [False, True])
def test_zeros_in_frames_without_anybody_count_as_missing(placed: bool) -> None:
    found = []
    for nothing in (0.0, math.nan):
        joints = LOCAL.clone()
        joints[3:6] = nothing
        layer = PoseRefiner(TAKE.actor).eval()
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found.append(layer(TAKE.cameras, joints3d=joints, placed=placed).joints)
        named = [
            str(w.message) for w in said if "frames 3-5 are all in one place" in str(w.message)
        ]
        assert len(named) == (nothing == 0)
    assert torch.equal(*found)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_frames_in_another_unit_are_named(factor: float) -> None:
    joints = torch.where((torch.arange(10) > 6)[:, None, None, None], factor * LOCAL, LOCAL)
    with pytest.warns(UserWarning, match=r"3D joints of frames 7-9 span less than 0.3 or more"):
        refine(joints)


def test_joints_of_the_world_are_named() -> None:
    turned = TAKE.cameras.rotation.new_tensor([[[1, 0, 0], [0, -1, 0], [0, 0, -1]]])
    cameras = replace(TAKE.cameras, rotation=turned)
    world = (LOCAL - cameras.translation[..., None, :]) @ turned
    layer = PoseRefiner(TAKE.actor).eval()
    with pytest.warns(UserWarning, match="stands on their head in 100% of the frames"):
        layer(cameras, joints3d=world)


@pytest.mark.long
def test_good_joints_are_not() -> None:
    coco = torch.zeros(*LOCAL.shape[:2], len(COCO17), 3, dtype=LOCAL.dtype)
    pixels = torch.zeros(*LOCAL.shape[:2], len(COCO17), 2, dtype=LOCAL.dtype)
    for place, name in enumerate(COCO17.joints):
        mark = LANDMARKS.index(name) if name in LANDMARKS else 0
        coco[:, :, place], pixels[:, :, place] = LOCAL[:, :, mark], PIXELS[:, :, mark]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = [
            refine(LOCAL),
            refine(LOCAL, PIXELS),
            refine(coco, joint_set="COCO-17"),  # has no toes, which point nowhere
            refine(coco, pixels, joint_set="COCO-17"),
        ]
        # a camera that does not turn stands for none: the axes are the world's own
        turn = torch.eye(3, dtype=LOCAL.dtype)[None]
        still = replace(TAKE.cameras, rotation=turn)
        PoseRefiner(TAKE.actor).eval()(still, joints3d=LOCAL * LOCAL.new_tensor([1, -1, -1]))
    knees = [LANDMARKS.index(f"{side}_knee") for side in "lr"]
    for joints in found:
        assert float((joints - JOINTS)[:, knees].norm(dim=-1).mean()) < 0.05  # m


def test_confidences_that_hardly_count_are_named_unless_they_are_learned() -> None:
    faint = 0.01 * TAKE.detections.confidence2d
    with pytest.warns(UserWarning, match="confidences are 0.01 at most"):
        PoseRefiner(TAKE.actor).eval()(TAKE.cameras, PIXELS, faint)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        PoseRefiner(TAKE.actor)(TAKE.cameras, PIXELS, faint.requires_grad_())


def test_other_spellings_are_named() -> None:
    """A knee of another name was an unseen knee."""
    names = ["LKnee" if name == "l_knee" else name for name in LANDMARKS]
    with pytest.raises(InputError, match=r"not ours: LKnee \(expected l_knee\)"):
        PoseRefiner(TAKE.actor, JointSet("mine", tuple(names)))


def test_a_joint_that_is_there_in_two_spellings_is_named() -> None:
    """The one in another spelling was left out with no word."""
    for other in ("RAnkle", "R Ankle", "right_ankle"):
        names = JointSet("mine", (*LANDMARKS, other))
        with pytest.raises(InputError, match=f"has r_ankle and {other}, the same joint"):
            PoseRefiner(TAKE.actor, names)
    PoseRefiner(TAKE.actor, JointSet("mine", (*LANDMARKS, "head")))  # of SMPL, beside the crown


def test_placed_joints_of_another_size_are_named() -> None:
    """They put the person at half the distance."""
    with pytest.warns(UserWarning, match="legs are 2 times as long as those of the placed"):
        refine(0.5 * LOCAL)


def test_a_person_far_from_3d_joints_alone() -> None:
    """As where x is in another unit than y and z."""
    wide = LOCAL * LOCAL.new_tensor([2.5, 1, 1])
    with pytest.warns(UserWarning, match="from that of the 3D joints; check that"):
        refine(wide)


def test_an_actor_of_another_size_than_views_show() -> None:
    """As where joints are drawn towards the middle of each crop."""
    two = make_take(12, views=2)
    pixels = two.detections.joints2d
    layer = PoseRefiner(two.actor).eval()
    middle = pixels.mean(-2, keepdim=True)
    with pytest.warns(UserWarning, match="legs are 1.7 times as long as those that the views show"):
        layer(two.cameras, middle + 0.6 * (pixels - middle))


@pytest.mark.long
def test_3d_joints_alone_of_several_views() -> None:
    """No joint is expected in the images; cameras in another order, and no place, are named."""
    two = make_take(12, views=2)
    local = two.cameras.to_camera(two.actor.joints(two.truth))
    layer = PoseRefiner(two.actor).eval()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        layer(two.cameras, joints3d=local)
    with pytest.warns(UserWarning, match="view 0 and view 1: their 3D joints look exchanged"):
        PoseRefiner(two.actor).eval()(two.cameras.select([1, 0]), joints3d=local)
    with pytest.warns(UserWarning, match="relative to a root, and nothing says where") as said:
        PoseRefiner(two.actor).eval()(two.cameras, joints3d=local - mid_hip(local)[..., None, :])
    assert len(said) == 1


def test_a_rate_in_another_unit() -> None:
    layer = PoseRefiner(TAKE.actor, rate=3000).eval()
    with pytest.warns(UserWarning, match="rate is 3000 frames a second, at which people"):
        layer(TAKE.cameras, PIXELS)
