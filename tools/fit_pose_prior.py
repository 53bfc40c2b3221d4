"""Fit the pose prior ``models/priors/cmu``: a mixture of Gaussians over the joint angles.

    python tools/fit_pose_prior.py LIBRARY models/priors/cmu

LIBRARY is a folder with ``clips.npz`` and ``clips.csv`` of recorded motion (mocap.cs.cmu.edu).
Every clip is retargeted to its subject's own bones within the limits of the joints; clips of people
named by ``--without`` are left out and scored instead; those of ``--apart`` are not looked at.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.special import logsumexp

sys.path.insert(0, str(Path(__file__).parents[1] / "experiments"))
import cmu
from fast_motion import HELD_OUT
from rig_fit import fit_rig
from window_problem import bare_actor

from perfcap.io.pose_prior import save_pose_prior

Floats = NDArray[np.float64]

# the rendered sequences and the demo were made from these
_RENDERED = (
    "02_01", "02_02", "02_04", "02_08", "05_01", "05_02", "05_07", "05_10", "06_12",
    "07_01", "07_02", "07_04", "07_10",
)  # fmt: skip


@dataclass(frozen=True)
class Fit:
    """What to fit."""

    library: tyro.conf.Positional[Path]
    """Folder with clips.npz."""
    out: tyro.conf.Positional[Path]
    """Folder for prior.npz."""
    components: int = 8
    """Gaussians."""
    without: tuple[str, ...] = ("06", "07")
    """People left out."""
    apart: tuple[str, ...] = tuple(sorted({*_RENDERED, *HELD_OUT}))
    """Clips left out."""
    step: int = 6
    """Frames of the library (60 Hz) from one pose to the next."""
    floor: float = 0.1
    """Deviation added to every angle, radians: recordings are few and smooth."""
    seed: int = 0
    """Of the first means."""


def main(config: Fit) -> None:
    """Fit, score, write."""
    names, poses = angles_of(config)
    own = [p for clip, p in poses.items() if clip[:2] not in config.without]
    rest = [p for clip, p in poses.items() if clip[:2] in config.without]
    known = np.concatenate(own)
    share, mean, covariance = expectation_maximization(known, config)
    for label, some in (("fitted to", known), ("left out", np.concatenate(rest))):
        print(f"{label}: {len(some)} poses, {score(some, share, mean, covariance):.2f} nats each")
    single = np.ones(1), known.mean(0)[None], np.cov(known.T)[None]
    print(f"one Gaussian, left out: {score(np.concatenate(rest), *single):.2f} nats each")
    config.out.mkdir(parents=True, exist_ok=True)
    precision = np.linalg.cholesky(np.linalg.inv(covariance))
    save_pose_prior(config.out / "prior.npz", names, share, mean, precision)


def angles_of(config: Fit) -> tuple[tuple[str, ...], dict[str, Floats]]:
    """Angles (F, A) of every clip, and their names."""
    found = {}
    names: tuple[str, ...] = ()
    for clip in cmu.clip_names(config.library):
        if clip in config.apart and clip[:2] not in config.without:
            continue
        actor = bare_actor(cmu.skeleton(config.library, clip))
        names = tuple(actor.skeleton.angle_names)
        truth = cmu.landmarks(config.library, clip, config.step)
        parts = [fit_rig(actor, part, 40).angles.numpy() for part in truth.split(400)]
        found[clip] = np.concatenate(parts)
    return names, found


def expectation_maximization(poses: Floats, config: Fit) -> tuple[Floats, Floats, Floats]:
    """Shares (K,), means (K, A) and covariances (K, A, A) of most likelihood."""
    rng = np.random.default_rng(config.seed)
    mean = poses[rng.choice(len(poses), config.components, replace=False)]
    ridge = config.floor**2 * np.eye(poses.shape[1])
    covariance = np.repeat(np.cov(poses.T)[None] + ridge, config.components, 0)
    share = np.full(config.components, 1 / config.components)
    for _ in range(100):
        each = log_densities(poses, share, mean, covariance)
        member = np.exp(each - logsumexp(each, axis=1, keepdims=True))
        count = member.sum(0) + 1e-9
        share, mean = count / count.sum(), (member.T @ poses) / count[:, None]
        for k in range(config.components):
            apart = poses - mean[k]
            covariance[k] = (member[:, k, None] * apart).T @ apart / count[k] + ridge
    return share, mean, covariance


def log_densities(poses: Floats, share: Floats, mean: Floats, covariance: Floats) -> Floats:
    """Log of share times density of each component, (N, K)."""
    columns = []
    for k in range(len(share)):
        factor = np.linalg.cholesky(covariance[k])
        white = np.linalg.solve(factor, (poses - mean[k]).T)
        scale = np.log(np.diagonal(factor)).sum() + 0.5 * len(factor) * np.log(2 * np.pi)
        columns.append(np.log(share[k]) - scale - 0.5 * (white**2).sum(0))
    return np.stack(columns, 1)


def score(poses: Floats, share: Floats, mean: Floats, covariance: Floats) -> float:
    """Mean log likelihood of a pose."""
    return float(logsumexp(log_densities(poses, share, mean, covariance), axis=1).mean())


if __name__ == "__main__":
    main(tyro.cli(Fit))
