"""The mixture of poses: derivatives, its least component, names of angles, files."""

from pathlib import Path

import numpy as np
import pytest
import torch
from checks import check_energy
from synthetic import actor, random_motion

from perfcap.actor.motion import Motion
from perfcap.actor.pose_statistics import Mixture
from perfcap.energy import PoseMixture
from perfcap.errors import InputError
from perfcap.io.pose_prior import load_pose_prior, save_pose_prior

F64 = torch.float64
ACTOR = actor()
NAMES = tuple(ACTOR.skeleton.angle_names)


def mixture(components: int = 3) -> Mixture:
    random = torch.Generator().manual_seed(5)
    count = len(NAMES)
    mean = torch.randn(components, count, generator=random, dtype=F64)
    root = 0.2 * torch.randn(components, count, count, generator=random, dtype=F64)
    precision = torch.linalg.cholesky(root @ root.mT + torch.eye(count, dtype=F64))
    share = torch.tensor([0.5, 0.3, 0.2], dtype=F64)[:components]
    return Mixture(NAMES, share / share.sum(), mean, precision)


def test_derivatives_are_those_of_differences() -> None:
    term = PoseMixture(mixture(), 0.4)
    state = random_motion(ACTOR.skeleton, 4, batch=(2,))

    def pick(index: int) -> tuple[PoseMixture, Motion]:
        parts = state.translation[index], state.rotation[index], state.angles[index]
        return term, Motion(*parts)

    check_energy(term, state, pick=pick)


def test_it_is_the_log_density_of_the_likeliest_component() -> None:
    known = mixture()
    state = random_motion(ACTOR.skeleton, 5)
    normal = [
        torch.distributions.MultivariateNormal(m, precision_matrix=p @ p.mT)
        for m, p in zip(known.mean, known.precision, strict=True)
    ]
    each = torch.stack([n.log_prob(state.angles) for n in normal], -1) + known.share.log()
    value = PoseMixture(known).residual(state).squared_norm()[..., 0]
    expected = -2 * each.amax(-1)
    assert torch.allclose(value - value[0], expected - expected[0], atol=1e-9)


def test_angles_may_come_in_another_order() -> None:
    known = mixture()
    state = random_motion(ACTOR.skeleton, 3)
    turned = Mixture(NAMES[::-1], known.share, *_reversed(known))
    here, there = (PoseMixture(m)(state) for m in (known, turned.ordered(NAMES)))
    assert torch.allclose(here, there)
    with pytest.raises(InputError, match="those of the actor"):
        known.ordered((*NAMES[1:], "tail"))


def _reversed(known: Mixture) -> tuple[torch.Tensor, torch.Tensor]:
    inverse = (known.precision @ known.precision.mT).flip(-1, -2)
    return known.mean.flip(-1), torch.linalg.cholesky(inverse)


def test_shipped_prior_prefers_people(tmp_path: Path) -> None:
    shipped = load_pose_prior().ordered(NAMES)
    term = PoseMixture(shipped)
    stand = ACTOR.skeleton.rest_motion(1)
    odd = random_motion(ACTOR.skeleton, 20)
    assert float(term(stand)) < 0.3 * float(term(odd)) / 20
    path = tmp_path / "prior.npz"
    parts = (x.numpy() for x in (shipped.share, shipped.mean, shipped.precision))
    save_pose_prior(path, NAMES, *parts)
    again = load_pose_prior(path)
    assert torch.allclose(again.mean, shipped.mean, atol=1e-6) and again.names == NAMES


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mean": np.zeros(3)}, "expected finite"),
        ({"share": np.array([0.5, 0.2])}, "sum to one"),
        ({"precision": np.full((2, 3, 3), np.nan)}, "expected finite"),
        ({"angle_names": np.array(["a"])}, "1 names"),
        ({"share": None}, "lacks share"),
    ],
)
def test_other_files_are_refused(
    tmp_path: Path, change: dict[str, np.ndarray | None], words: str
) -> None:
    arrays: dict[str, np.ndarray | None] = {
        "angle_names": np.array(["a", "b", "c"]),
        "share": np.array([0.5, 0.5]),
        "mean": np.zeros((2, 3)),
        "precision": np.tile(np.eye(3), (2, 1, 1)),
    } | change
    np.savez(tmp_path / "p.npz", **{k: v for k, v in arrays.items() if v is not None})
    with pytest.raises(InputError) as error:
        load_pose_prior(tmp_path / "p.npz")
    assert words in str(error.value)


def test_unknown_names_are_told() -> None:
    with pytest.raises(InputError, match="no such file"):
        load_pose_prior("nobody")
