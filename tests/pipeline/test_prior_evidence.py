"""A second solve whose prior and weights come from the first."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.energy.trajectory import Trajectory
from perfcap.pipeline.adapt import adapted, calibrated, gain, variance
from perfcap.pipeline.clip_problem import ClipProblem, FirstSolve, WindowData
from perfcap.pipeline.config import MONOPERFCAP_POSE, EvidenceConfig, PoseConfig
from perfcap.pipeline.objective import FrameProblem, trajectory_prior
from perfcap.pipeline.pose_refiner import PoseRefiner
from perfcap.pipeline.prior_evidence import _likelihood, _maximize
from perfcap.pipeline.track_twice import track_twice
from perfcap.temporal.subspace import dct_basis
from perfcap.temporal.window import Window

F64 = torch.float64
COSINES, FEATURES = 50, 7 + 4


def normal(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=F64)


def problem(config: PoseConfig | None = None) -> ClipProblem:
    take = make_take(60)
    frames = FrameProblem.of(take.actor, take.cameras, take.detections, config)
    return ClipProblem.of(frames, take.rate)


@pytest.mark.parametrize("stiff", [0.1, 1.0])
def test_evidence_finds_the_stiffness_that_made_a_motion(stiff: float) -> None:
    """Within a factor of two from ten times off, also of features seen through others."""
    penalty = torch.linspace(0, 3, COSINES, dtype=F64)[None] ** 2
    factor = stiff * torch.tensor([1, 1, 1, 3, 3, 3, 3, 1, 10, 0.1, 1], dtype=F64)
    mix = normal(40, FEATURES, seed=1)
    curvature = mix.mT @ mix
    y = normal(64, COSINES, FEATURES) / (factor * penalty.clamp(min=1e-3)[..., None]).sqrt()
    noise = normal(64, COSINES, 40, seed=2) @ mix
    told = y @ curvature + noise
    found = _maximize(curvature.expand(64, -1, -1), told, penalty, 1.0, 1.0)
    expected = factor[[0, 3, 7, 8, 9, 10]]
    assert ((found.log().mean(0) - expected.log()).abs() < 0.7).all()


def test_what_data_say_does_not_depend_on_where_they_are_asked() -> None:
    """``B y - g`` is that of the data's own minimum, from near it as from there."""
    truth = make_take(60).truth[slice(0, 50)]
    own = problem()
    objective = own.objective_of(WindowData.stack([own.at(Window(0, 50))]))
    trajectory = objective.energies["trajectory"]
    assert isinstance(trajectory, Trajectory)
    away = replace(truth, angles=truth.angles + 1e-4 * normal(*truth.angles.shape))
    (there, curvature), (here, _) = (
        _likelihood(objective, trajectory, Motion.stack([each]))[::-1] for each in (truth, away)
    )
    basis = dct_basis(50, dtype=F64, device=torch.device("cpu"))
    features = [trajectory.linearize_features(each)[0] for each in (truth, away)]
    moved = basis @ (features[1] - features[0]) @ curvature[0]
    assert (here - there).norm() < 0.6 * moved.norm()  # curvature is a mean over frames


def test_a_fast_limb_gets_a_weaker_prior_than_a_calm_one() -> None:
    curvature = 100 * torch.eye(FEATURES, dtype=F64)[None]
    y = 0.01 * normal(1, COSINES, FEATURES)
    y[..., 8] *= 100
    penalty = torch.ones(1, COSINES, dtype=F64)
    found = _maximize(curvature, y @ curvature, penalty, 1.0, 1.0)[0]
    assert found[3] < 0.1 * found[2]


@pytest.mark.parametrize("size", [0.5, 3.0])
def test_confidences_become_reciprocal_variances(size: float) -> None:
    """Whatever power of a deviation a detector calls confidence."""
    deviation = 0.2 * 5 ** torch.rand(4000, generator=torch.Generator().manual_seed(1)).to(F64)
    squared = (deviation[:, None] * normal(4000, 2)).square().sum(-1)
    found = calibrated(deviation**-size / 5, squared)
    ratio = found * deviation.square()
    assert ratio.quantile(0.9) / ratio.quantile(0.1) < 1.6


def test_gross_errors_do_not_change_sizes() -> None:
    squared = normal(4000, 2).square().sum(-1)
    seen = torch.ones(4000, dtype=torch.bool)
    spoiled = squared.clone()
    spoiled[::12] = 1e4
    assert variance(spoiled, seen, 2) == pytest.approx(1, abs=0.2)


def test_only_small_errors_change_the_mean_weight() -> None:
    squared = normal(4000, 2).square().sum(-1)
    seen = torch.ones(4000, dtype=torch.bool)
    assert gain(squared, seen, 2) == 1
    assert gain(0.01 * squared, seen, 2) == pytest.approx(43, rel=0.1)
    assert gain(0 * squared, seen, 2) == 100


def test_an_unseen_joint_stays_unseen() -> None:
    confidence = torch.rand(40, 16, generator=torch.Generator().manual_seed(0)).to(F64)
    confidence[:, 3] = 0
    found = calibrated(confidence, normal(40, 16, 2).square().sum(-1))
    assert (found[:, 3] == 0).all() and (found[:, :3] > 0).all()


def test_windows_get_their_own_prior() -> None:
    own = problem()
    stiffness = torch.arange(2.0 * (2 + len(own.actor.skeleton.lower))).reshape(2, -1)
    known = replace(own, first=FirstSolve((0, 10), stiffness, 1.0, 1.0))
    windows = [known.at(Window(start, start + 50)) for start in (10, 0)]
    assert torch.equal(WindowData.stack(windows).stiffness, stiffness.flip(0))


def test_stiffness_multiplies_the_weight_of_its_features() -> None:
    take, config = make_take(60), PoseConfig().trajectory
    part = take.truth[slice(0, 50)]
    stiffness = torch.ones(2 + part.angles.shape[-1], dtype=F64)
    plain, same = (trajectory_prior(config, 50, 30.0, s)(part) for s in (None, stiffness))
    torch.testing.assert_close(same, plain)
    four = trajectory_prior(config, 50, 30.0, 4 * stiffness)(part)
    torch.testing.assert_close(four, 4 * plain)


@pytest.mark.long
def test_exact_detections_are_followed_closer() -> None:
    """The prior lets go: less than half of the error of one solve is left."""
    start = make_take(60).truth
    errors = []
    for enabled in (False, True):
        own = problem(replace(PoseConfig(), evidence=EvidenceConfig(enabled)))
        found, _, _ = track_twice(own, start)
        apart = own.actor.joints(found) - own.actor.joints(start)
        errors.append(float(apart.norm(dim=-1).mean()))
    assert errors[1] < 0.5 * errors[0]


def test_published_settings_are_solved_once() -> None:
    own = problem(MONOPERFCAP_POSE)
    assert track_twice(own, make_take(60).truth)[2] is own


def test_one_view_without_depth_is_solved_once() -> None:
    own = problem()
    flat = replace(own.detections, joints3d=None).select([0])
    single = replace(
        own, detections=flat, cameras=own.cameras.select([0]), pixel_unit=own.pixel_unit[:1]
    )
    assert track_twice(single, make_take(60).truth)[2] is single


def test_adapting_changes_what_it_says() -> None:
    own = problem()
    known = adapted(own, make_take(60).truth)
    assert known.first is not None and known.first.starts == (0, 10)
    assert known.first.stiffness.shape == (2, 2 + len(own.actor.skeleton.lower))
    assert (known.first.stiffness > 0).all()
    assert known.trajectory.rank == own.config.evidence.rank != own.trajectory.rank


def refined(confidence: Tensor) -> Tensor:
    take = make_take(12)
    layer = PoseRefiner(take.actor, config=PoseConfig(max_steps=8))
    joints: Tensor = layer(take.cameras, take.detections.joints2d, confidence).joints
    return joints


def test_gradients_of_a_layer_reach_every_confidence() -> None:
    """Also where residuals say that they tell nothing."""
    shape = make_take(12).detections.confidence2d.shape
    random = torch.Generator().manual_seed(2)
    confidence = (0.2 + 0.8 * torch.rand(shape, generator=random)).to(F64).requires_grad_()
    weights = normal(12, 16, 3)
    (gradient,) = torch.autograd.grad((refined(confidence) * weights).sum(), confidence)
    assert (gradient != 0).all()


def test_second_derivatives_of_a_layer_are_refused() -> None:
    confidence = make_take(12).detections.confidence2d.clone().requires_grad_()
    with pytest.raises(RuntimeError, match="second derivatives"):
        torch.autograd.grad(refined(confidence).sum(), confidence, create_graph=True)
