"""Refinement as a layer: better joints, exact gradients, and what torch users expect."""

from __future__ import annotations

import copy
import math
import warnings
from dataclasses import replace

import pytest
import torch
from synthetic import actor, cameras
from torch import Tensor, nn

from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import COCO17, LANDMARKS, JointSet
from perfcap.detect.retarget import mid_hip
from perfcap.errors import InputError
from perfcap.metrics import acceleration_error
from perfcap.pipeline import pose_refiner
from perfcap.pipeline.adapt import adapted
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import EvidenceConfig, PoseConfig
from perfcap.pipeline.pose_refiner import PoseRefiner
from perfcap.solve import Implicit, Status, Unrolled
from perfcap.temporal.subspace import dct_basis

F64 = torch.float64
ACTOR = actor()
FRAMES = 14
CONFIG = PoseConfig(window=10, overlap=4, max_steps=20)
VIEWS = cameras(3).select([0, 1])


def normal(*shape: int, seed: int = 1) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=F64)


def motion(frames: int = FRAMES, seed: int = 0) -> Motion:
    """Slow waving near the neutral pose."""
    skeleton = ACTOR.skeleton
    count = len(skeleton.lower)
    curve = dct_basis(frames, 3, dtype=F64).mT * math.sqrt(frames / 3)
    angles = skeleton.rest_angles + 0.15 * (curve @ normal(3, count, seed=seed))
    return Motion(
        0.1 * curve @ normal(3, 3, seed=seed + 1),
        0.1 * curve @ normal(3, 3, seed=seed + 2),
        angles.clamp(skeleton.lower, skeleton.upper),
    )


def observed(truth: Motion, noise: float = 1.5) -> tuple[Tensor, Tensor, Tensor]:
    """Landmarks in the world, pixels with noise, and 3D joints with noise in camera axes."""
    joints = ACTOR.joints(truth)
    pixels = VIEWS.project(joints)
    local = VIEWS.to_camera(joints)
    root = 0.5 * (local[..., 8:9, :] + local[..., 12:13, :])
    return (
        joints,
        pixels + noise * normal(*pixels.shape, seed=7),
        local - root + 0.01 * noise * normal(*local.shape, seed=8),
    )


def refiner(**settings: object) -> PoseRefiner:
    return PoseRefiner(actor(), **({"config": CONFIG} | settings))  # type: ignore[arg-type]


TRUTH = motion()
JOINTS, PIXELS, LOCAL = observed(TRUTH)


def error(joints: Tensor, truth: Tensor = JOINTS) -> float:
    return float((joints - truth).norm(dim=-1).mean().detach())


def test_refines_pixels_of_several_views() -> None:
    refined = refiner().eval()(VIEWS, PIXELS)
    assert error(refined.joints) < 0.03
    assert refined.status == Status.CONVERGED
    assert refined.valid.all() and refined.joints.shape == (FRAMES, 16, 3)
    lower, upper = ACTOR.skeleton.lower, ACTOR.skeleton.upper
    assert ((refined.motion.angles >= lower) & (refined.motion.angles <= upper)).all()


def test_refines_places_alone() -> None:
    """A third of the error and more, most of the jitter; also where the root is the origin."""
    places = VIEWS.select([0]).to_camera(JOINTS) + 0.04 * normal(FRAMES, 1, 16, 3)
    front = VIEWS.select([0])
    world = (places[:, 0] - front.translation[0]) @ front.rotation[0]
    refined = refiner().eval()(front, joints3d=places).joints
    assert error(refined) < 0.7 * error(world)
    jitter = [float(acceleration_error(each, JOINTS).mean()) for each in (refined, world)]
    assert jitter[0] < 0.4 * jitter[1]
    root = places - 0.5 * (places[..., 8:9, :] + places[..., 12:13, :])
    about = refiner().eval()(front, joints3d=root)
    assert about.joints.isfinite().all()
    assert about.joints.norm(dim=-1).amax() < 8  # the camera is five metres away


def test_confidence_weighs_places_where_there_are_no_pixels() -> None:
    front = VIEWS.select([0])
    places = front.to_camera(JOINTS)
    wrong, sure = places.clone(), torch.ones(places.shape[:-1], dtype=F64)
    wrist = LANDMARKS.index("r_wrist")
    wrong[..., wrist, 1] -= 0.3
    sure[..., wrist] = 0
    layer = refiner().eval()
    believed, doubted, unseen = (
        layer(front, confidence2d=c, joints3d=p).joints
        for c, p in ((None, wrong), (sure, wrong), (sure, places))
    )
    torch.testing.assert_close(doubted, unseen)
    assert error(doubted) < 0.5 * error(believed)


def test_pixels_and_poses_of_one_view() -> None:
    front = VIEWS.select([0])
    both = refiner().eval()(front, PIXELS[:, :1], joints3d=LOCAL[:, :1])
    placed = VIEWS.to_camera(JOINTS)[:, :1] + 0.04 * normal(FRAMES, 1, 16, 3)
    known = refiner().eval()(front, PIXELS[:, :1], joints3d=placed, placed=True)
    assert error(known.joints) < error(both.joints) < 0.3
    for root in (placed[..., :1, :], mid_hip(placed).unsqueeze(-2) + 0.05):
        with pytest.raises(InputError, match="they look relative to a root"):
            refiner().eval()(front, PIXELS[:, :1], joints3d=placed - root, placed=True)


def test_mistakes_of_another_clip_of_the_batch_name_it() -> None:
    with pytest.warns(UserWarning, match="PoseRefiner: clip 1: .* if x and y were exchanged"):
        refiner().eval()(VIEWS, torch.stack((PIXELS, PIXELS.flip(-1))))


def test_mistakes_that_the_first_clip_shows_are_told_once() -> None:
    layer = refiner().eval()
    flipped = torch.stack((PIXELS[..., 0], 400 - PIXELS[..., 1]), -1)
    with pytest.warns(UserWarning, match="PoseRefiner: .*(exchanged|upside down|y up|axes)"):
        layer(VIEWS, flipped)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        layer(VIEWS, flipped)
        refiner().eval()(VIEWS, PIXELS)
        copy.deepcopy(layer)(VIEWS, flipped)


def test_batch_equals_loop() -> None:
    """Clips of different lengths, padded or in a list, with cameras of their own."""
    short = observed(motion(8, seed=5))[1]
    far = replace(VIEWS, translation=VIEWS.translation + torch.tensor([0.0, 0.0, 0.5]))
    layer = refiner().eval()
    alone = [layer(VIEWS, PIXELS).joints, layer(far, short).joints]
    listed = layer([VIEWS, far], [PIXELS, short])
    padded = torch.full((2, FRAMES, 2, 16, 2), math.nan, dtype=F64)
    padded[0], padded[1, :8] = PIXELS, short
    stacked = layer([VIEWS, far], padded, lengths=[FRAMES, 8])
    assert listed.valid.sum(-1).tolist() == [FRAMES, 8]
    for found in (listed, stacked):
        for (_, joints), expected in zip(found.clips(), alone, strict=True):
            torch.testing.assert_close(joints, expected, rtol=0, atol=1e-7)
    assert torch.equal(listed.joints[1, 8:], listed.joints[1, 7:8].expand(FRAMES - 8, -1, -1))


@pytest.mark.parametrize("twice", [False, True])
def test_gradients_agree_with_differences(twice: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through initialisation, windows of a batch, blending and kinematics.

    What the first solve tells the second is a constant of the gradient, and is held.
    """
    tight = replace(CONFIG, max_steps=200, tolerance=1e-13, evidence=EvidenceConfig(twice))
    layer = refiner(config=tight).train()
    told: list[ClipProblem] = []

    def held(clip: ClipProblem, motion: Motion) -> ClipProblem:
        if not told:
            told.append(adapted(clip, motion))
        confidence = told[0].detections.confidence2d.detach()
        seen = replace(clip.detections, confidence2d=confidence)
        return replace(clip, detections=seen, first=told[0].first)

    monkeypatch.setattr(pose_refiner, "adapted", held)
    leaf = PIXELS.clone().requires_grad_()
    weights = normal(FRAMES, 16, 3, seed=3)
    refined = layer(VIEWS, leaf)
    (gradient,) = torch.autograd.grad((refined.joints * weights).sum(), leaf)
    move = normal(*PIXELS.shape, seed=4)
    move[..., 1] = 0  # the person's height in the image, the unit of pixels, is a constant
    assert len(told) == twice
    layer.eval()
    ends = [(layer(VIEWS, PIXELS + s * 0.02 * move).joints * weights).sum() for s in (1, -1)]
    numeric = float((ends[0] - ends[1]) / 0.04)
    assert float((gradient * move).sum()) == pytest.approx(numeric, rel=2e-3)


def test_train_and_eval() -> None:
    leaf = PIXELS.clone().requires_grad_()
    layer = refiner()
    assert layer.training
    trained = layer(VIEWS, leaf)
    assert trained.joints.requires_grad
    layer.eval()
    with pytest.warns(UserWarning, match="in eval mode, in which joints .* get none"):
        assert not layer(VIEWS, leaf).joints.requires_grad
    for training in (False, True):
        with torch.no_grad():
            assert not layer.train(training)(VIEWS, leaf).joints.requires_grad
    torch.testing.assert_close(layer(VIEWS, PIXELS).joints, trained.joints.detach())


@pytest.mark.parametrize("adjoint", [Implicit("gauss_newton"), Unrolled(2)])
def test_other_adjoints(adjoint: Implicit | Unrolled) -> None:
    leaf = PIXELS.clone().requires_grad_()
    joints = refiner(adjoint=adjoint)(VIEWS, leaf).joints
    (gradient,) = torch.autograd.grad((joints - JOINTS).square().sum(), leaf)
    assert gradient.isfinite().all() and gradient.any()


def test_weights_are_learned() -> None:
    layer = refiner(learn_weights=True)
    assert [name for name, p in layer.named_parameters() if p.requires_grad] == ["log_weights"]
    assert not any(p.requires_grad for p in refiner().parameters())
    optimizer = torch.optim.Adam(layer.parameters(), lr=0.3)
    losses = []
    for _ in range(4):
        optimizer.zero_grad()
        losses.append((layer(VIEWS, PIXELS).joints - JOINTS).norm(dim=-1).mean())
        losses[-1].backward()
        optimizer.step()
    assert losses[-1] < losses[0]
    gradient = layer.log_weights.grad
    assert gradient is not None and gradient.isfinite().all()
    # joints2d, trajectory, prior; terms that a batch does not have get zero
    assert (gradient != 0).tolist() == [True, False, False, True, True]


def test_state_dict_and_copies() -> None:
    layer = refiner(learn_weights=True).eval()
    with torch.no_grad():
        layer.log_weights += torch.linspace(-1, 1, 5, dtype=F64)
    other = refiner(learn_weights=True).eval()
    other.load_state_dict(layer.state_dict())
    expected = layer(VIEWS, PIXELS).joints
    assert torch.equal(other(VIEWS, PIXELS).joints, expected)
    assert torch.equal(copy.deepcopy(layer)(VIEWS, PIXELS).joints, expected)


@pytest.mark.long
def test_precision_follows_the_module() -> None:
    layer = refiner().eval()
    expected = layer(VIEWS, PIXELS).joints
    single = layer.to(torch.float32)(VIEWS, PIXELS).joints
    assert single.dtype == torch.float32
    assert error(single.double(), expected) < 2e-3
    with pytest.raises(InputError, match="keep it float32 or float64"):
        layer.half()(VIEWS, PIXELS)


def test_autocast_and_half_inputs() -> None:
    layer = refiner()
    small = PIXELS.to(torch.float16)
    plain = layer(VIEWS, small).joints
    leaf = small.clone().requires_grad_()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        joints = layer(VIEWS, leaf).joints
        loss = (joints - JOINTS).square().mean()
    loss.backward()
    torch.testing.assert_close(joints.detach(), plain, rtol=0, atol=1e-9)
    assert leaf.grad is not None and leaf.grad.dtype == torch.float16
    assert leaf.grad.isfinite().all()


def test_missing_joints() -> None:
    """Joints that are not finite or have no confidence say nothing, and poison nothing."""
    seen = torch.ones(FRAMES, 2, 16, dtype=F64)
    seen[3:6, :, 4] = 0
    broken = PIXELS.clone()
    broken[3:6, :, 4] = math.nan
    leaf = broken.requires_grad_()
    refined = refiner()(VIEWS, leaf, seen)
    assert error(refined.joints) < 0.04
    (gradient,) = torch.autograd.grad(refined.joints.sum(), leaf)
    assert gradient.isfinite().all()
    assert not gradient[3:6, :, 4].any() and gradient[2, :, 4].any()


def test_other_joint_sets() -> None:
    """COCO has no toes and no crown; its neck is the middle of the shoulders."""
    columns = [LANDMARKS.index(j) if j in LANDMARKS else 0 for j in COCO17.joints]
    pixels, places = PIXELS[..., columns, :], LOCAL[..., columns, :]
    for name in ("coco-17", COCO17):
        refined = refiner(joint_set=name).eval()(VIEWS, pixels, joints3d=places)
        limbs = [LANDMARKS.index(j) for j in LANDMARKS if j.endswith(("wrist", "ankle", "knee"))]
        assert error(refined.joints[:, limbs], JOINTS[:, limbs]) < 0.04


@pytest.mark.long
def test_a_detector_is_trained_through_it() -> None:
    """A planted offset is found from joints in space alone."""
    offset = nn.Parameter(torch.zeros(16, 2, dtype=F64))
    planted = torch.zeros(16, 2, dtype=F64)
    planted[4] = torch.tensor([12.0, -6.0])
    layer = refiner()
    optimizer = torch.optim.Adam([offset], lr=2.0)
    for _ in range(12):
        optimizer.zero_grad()
        joints = layer(VIEWS, VIEWS.project(JOINTS) + planted + offset).joints
        (joints - JOINTS).norm(dim=-1).mean().backward()
        optimizer.step()
    assert (planted + offset).norm(dim=-1)[4] < 0.5 * planted.norm()


def test_wrong_input_is_named() -> None:
    layer = refiner()
    with pytest.raises(InputError, match="neither joints2d nor joints3d"):
        layer(VIEWS)
    with pytest.raises(InputError, match="add the view axis, or name the joint set"):
        layer(VIEWS, PIXELS[:, :, :12])
    with pytest.raises(InputError, match=r"joints2d has clips of shape"):
        layer(VIEWS, PIXELS[:, 0])
    with pytest.raises(InputError, match="different numbers of clips"):
        layer(VIEWS, [PIXELS], joints3d=[LOCAL, LOCAL])
    with pytest.raises(InputError, match="3 cameras for 1 clips"):
        layer([VIEWS] * 3, [PIXELS])
    with pytest.raises(InputError, match="lengths are"):
        layer(VIEWS, PIXELS[None], lengths=[FRAMES + 1])
    many = VIEWS.map(lambda part: part.expand(FRAMES, *part.shape))
    with pytest.raises(InputError, match="a list with one Camera for each clip"):
        layer(many, PIXELS.expand(FRAMES, *PIXELS.shape))
    for odd in (torch.ones(1, FRAMES, dtype=torch.bool), torch.tensor([4.0]), torch.tensor(4)):
        with pytest.raises(InputError, match=r"a whole number of frames a clip, \(B,\)"):
            layer(VIEWS, PIXELS[None], lengths=odd)
    for factor, unit in ((1000, "millimetres"), (1e-3, "another unit"), (39.4, "another unit")):
        with pytest.raises(InputError, match=f"expected metres; they look like {unit}"):
            layer(VIEWS, joints3d=factor * LOCAL)
    with pytest.raises(InputError, match="in no frame"):
        layer(VIEWS, torch.full_like(PIXELS, math.nan))
    with pytest.raises(InputError, match="is not known"):
        refiner(joint_set="COCO-99")
    with pytest.raises(InputError, match="lacks l_hip, r_hip"):
        refiner(joint_set=JointSet("hands", ("l_wrist", "r_wrist", "l_shoulder", "r_shoulder")))
    moving = replace(
        VIEWS,
        intrinsics=VIEWS.intrinsics.expand(3, -1, -1, -1),
        rotation=VIEWS.rotation.expand(3, -1, -1, -1),
        translation=VIEWS.translation.expand(3, -1, -1),
    )
    with pytest.raises(InputError, match="moving cameras have 3 frames"):
        layer(moving, PIXELS)
    with pytest.raises(InputError, match="a rotation that is none"):
        layer(replace(VIEWS, rotation=-VIEWS.rotation), PIXELS)
    with pytest.raises(InputError, match="rate is inf"):
        layer(VIEWS, PIXELS, rate=math.inf)
