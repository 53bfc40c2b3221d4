"""Joint sets that lack landmarks in the middle of limbs, at their ends, or by a slip of the pen."""

from __future__ import annotations

import warnings
from dataclasses import replace

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect import retarget as retarget_module
from perfcap.detect.joint_set import (
    COCO17,
    COCO18,
    H36M17,
    JOINT_SETS,
    LANDMARKS,
    LSP,
    MPII,
    JointSet,
)
from perfcap.detect.retarget import bone_vectors, filled, mid_hip, retarget
from perfcap.errors import InputError
from perfcap.pipeline import PoseRefiner
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import jitter
from perfcap.pipeline.refiner_joints import without_missing

TAKE = make_take(10)
JOINTS = TAKE.actor.joints(TAKE.truth)
PLACES = TAKE.cameras.to_camera(JOINTS)
LOCAL = PLACES - mid_hip(PLACES).unsqueeze(-2)
PIXELS = TAKE.detections.joints2d
LENGTHS = bone_vectors(TAKE.actor.skeleton.rest_landmarks).norm(dim=-1)
ENDS = ("r_wrist", "l_wrist", "r_ankle", "l_ankle")


def without(*names: str) -> tuple[JointSet, list[int]]:
    """A set of the other landmarks, and which these are."""
    kept = [place for place, name in enumerate(LANDMARKS) if name not in names]
    return JointSet("mine", tuple(LANDMARKS[place] for place in kept)), kept


def refine(
    *names: str, places: Tensor = LOCAL, pixels: bool = True, placed: bool = False
) -> Tensor:
    """Landmarks (F, 16, 3) of a set without some names."""
    joint_set, kept = without(*names)
    layer = PoseRefiner(TAKE.actor, joint_set=joint_set).eval()
    joints2d = PIXELS[:, :, kept] if pixels else None
    found: Tensor = layer(TAKE.cameras, joints2d, joints3d=places[:, :, kept], placed=placed).joints
    return found


def errors(joints: Tensor, name: str) -> float:
    """Mean distance (F, 16, 3) of a landmark from the truth, about the hips, metres."""
    off = joints - mid_hip(joints).unsqueeze(-2) - (JOINTS - mid_hip(JOINTS).unsqueeze(-2))
    return float(off[:, LANDMARKS.index(name)].norm(dim=-1).mean())


@pytest.mark.parametrize(
    "names", [("r_elbow",), ("r_knee",), ("r_elbow", "l_elbow"), ("r_knee", "r_ankle")]
)
def test_bones_beyond_a_lacking_landmark_lead_to_the_next_one(names: tuple[str, ...]) -> None:
    lost = [LANDMARKS.index(name) for name in names]
    lacking = LOCAL.clone()
    lacking[..., lost, :] = 0
    lengths = bone_vectors(LOCAL).norm(dim=-1)[0, 0]
    for scale in (1.0, 1.1):  # a network's people are of another size
        found = retarget(filled(scale * lacking, lengths, names), lengths)
        off = (found - LOCAL).norm(dim=-1).amax((0, 1))
        off[lost] = 0
        assert float(off.max()) < 0.02


def test_straight_limbs_have_finite_derivatives() -> None:
    pose = LOCAL.clone()
    shoulder, elbow, wrist = (
        LANDMARKS.index(f"r_{name}") for name in ("shoulder", "elbow", "wrist")
    )
    pose[..., wrist, :] = (
        3 * (pose[..., elbow, :] - pose[..., shoulder, :]) + pose[..., shoulder, :]
    )
    for poses in (pose, torch.zeros_like(pose)):
        poses.requires_grad_()
        found = filled(poses, LENGTHS, ("r_elbow", "head_top"))
        found.sum().backward()
        assert found.isfinite().all()
        assert poses.grad is not None
        assert poses.grad.isfinite().all()
        assert float(poses.grad.abs().max()) < 100


def test_derivatives_are_those_of_where_bones_lead(monkeypatch: pytest.MonkeyPatch) -> None:
    pose = LOCAL[:2].clone()
    hips = LANDMARKS.index("r_hip")
    bent, names = pose[..., hips:, :].clone().requires_grad_(), ("r_elbow", "r_knee")

    def ends(legs: Tensor) -> Tensor:
        whole = torch.cat((pose[..., :hips, :], legs), -2)
        return retarget(filled(whole, LENGTHS, names), LENGTHS)[..., [4, 10], :]

    lengths = retarget_module._lengths(LOCAL[:2], LENGTHS, [LANDMARKS.index(n) for n in names])
    monkeypatch.setattr(retarget_module, "_lengths", lambda *_: lengths)  # constants of a solve
    assert torch.autograd.gradcheck(ends, bent)


@pytest.mark.parametrize("names", [("r_elbow",), ("r_knee",), ("r_elbow", "l_elbow")])
def test_sets_without_joints_of_limbs_refine_as_those_that_have_them(
    names: tuple[str, ...],
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, whole = refine(*names), refine()
    for name in (*ENDS, *names):
        assert errors(found, name) < errors(whole, name) + 0.03


def test_frames_without_a_joint_are_left_out_as_a_whole() -> None:
    """NaN of single joints never leads bones elsewhere: these poses do not count."""
    places = LOCAL.clone()
    places[3:6, :, LANDMARKS.index("r_elbow")] = torch.nan
    found = refine(places=places)
    for name in ENDS:
        assert errors(found, name) < 0.03


@pytest.mark.parametrize(
    "joint_set", [COCO17, COCO18, MPII, LSP, H36M17], ids=lambda each: each.name
)
def test_sets_without_toes_are_placed(joint_set: JointSet) -> None:
    """Zeros for toes were taken for toes in the camera."""
    called = {"thorax": "neck", "upper_neck": "neck"}
    names = [called.get(name, name) for name in joint_set.joints]
    kept = [LANDMARKS.index(name) if name in LANDMARKS else 0 for name in names]
    layer = PoseRefiner(TAKE.actor, joint_set=joint_set).eval()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = layer(TAKE.cameras, PIXELS[:, :, kept], joints3d=PLACES[:, :, kept], placed=True)
    for name in ENDS:
        assert float((found.joints - JOINTS)[:, LANDMARKS.index(name)].norm(dim=-1).mean()) < 0.03


def test_joints_about_a_root_are_still_refused_as_places() -> None:
    with pytest.raises(InputError, match="the camera is inside of the person"):
        refine("r_toe", "l_toe", placed=True)


@pytest.mark.parametrize(
    "names",
    [
        ("head_top",),
        ("r_wrist", "l_wrist"),
        ("r_elbow", "l_elbow", "r_wrist", "l_wrist"),
        ("r_elbow",),
        ("r_elbow", "l_elbow", "r_knee", "l_knee", "r_toe", "l_toe"),
    ],
)
@pytest.mark.parametrize("kind", ["pixels", "placed", "alone"])
def test_right_sets_are_told_nothing(names: tuple[str, ...], kind: str) -> None:
    """Zeros for what a set lacks were copies, joints that were not found, or people of 6 m."""
    places = LOCAL if kind == "pixels" else PLACES
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refine(*names, places=places, pixels=kind != "alone", placed=kind != "pixels")


@pytest.mark.parametrize(
    ("own", "mark"), [("r_elbo", "r_elbow"), ("l_kneee", "l_knee"), ("LKne", "l_knee")]
)
def test_names_that_are_nearly_landmarks_are_named(own: str, mark: str) -> None:
    names = tuple(own if name == mark else name for name in LANDMARKS)
    with pytest.warns(
        UserWarning, match=rf"{own} \(nearly {mark}\): these joints are left out"
    ) as said:
        PoseRefiner(TAKE.actor, JointSet("mine", names))
    assert said[0].filename == __file__


def test_zeros_of_joints_that_are_not_seen_are_missing() -> None:
    """As NaN are: bones of the limb led to the middle of the hips."""
    sure = torch.ones(PIXELS.shape[:-1], dtype=PIXELS.dtype)
    zeros, gone, mark = LOCAL.clone(), LOCAL.clone(), LANDMARKS.index("r_elbow")
    sure[3:6, :, mark], zeros[3:6, :, mark], gone[3:6, :, mark] = 0.0, 0.0, torch.nan
    layer = PoseRefiner(TAKE.actor).eval()
    found, true = (
        layer(TAKE.cameras, PIXELS, sure, joints3d=places).joints for places in (zeros, gone)
    )
    assert torch.equal(found, true)


def test_hips_that_are_misspelt_are_named() -> None:
    names = tuple("l_hipp" if name == "l_hip" else name for name in LANDMARKS)
    with pytest.raises(InputError, match=r"lacks l_hip, .* but has l_hipp \(nearly l_hip\)"):
        PoseRefiner(TAKE.actor, JointSet("mine", names))


def test_other_names_are_not_landmarks() -> None:
    """Joints of known sets, and such that are called something else than what is lacking."""
    own = {"r_wrist": "r_hand", "l_wrist": "l_hand", "r_ankle": "r_foot", "l_ankle": "l_foot"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for joint_set in JOINT_SETS:
            PoseRefiner(TAKE.actor, joint_set)
        more = ("r_toe_base", "l_knee_inner", "spine_1", "l_elbow_r")
        names = tuple(own.get(name, name) for name in LANDMARKS if "toe" not in name)
        PoseRefiner(TAKE.actor, JointSet("mine", (*names, *more)))


def test_jitter_is_that_of_the_joints_that_a_set_has() -> None:
    """Landmarks that do not count were taken for ones without noise."""
    generator = torch.Generator().manual_seed(0)
    noisy = LOCAL + 0.005 * torch.randn(LOCAL.shape, generator=generator, dtype=LOCAL.dtype)
    detections = replace(TAKE.detections, joints3d=noisy)
    lost = [n for n in LANDMARKS if not n.endswith(("hip", "shoulder", "ankle"))]
    found = []
    for names in ([], lost):
        config = without_missing(PoseConfig(), without(*names)[0])
        found.append(jitter(FrameProblem.of(TAKE.actor, TAKE.cameras, detections, config)))
    assert 0.5 < found[1] / found[0] < 2
