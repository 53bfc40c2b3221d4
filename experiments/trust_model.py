"""What experiments with the trust in frames share: what is bad, and how weights are fitted."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.geometry.alignment import procrustes
from perfcap.metrics.alignment import root_aligned
from perfcap.pipeline.trust import THRESHOLD, judge_frames
from perfcap.pipeline.trust_weights import FEATURES

FAR, OFF = 0.12, 0.3  # m, of the mean error and of the largest, from which a frame is bad
# groups of landmarks that are hidden together, the last of them all
LIMBS = ((8, 9, 10, 11), (12, 13, 14, 15), (2, 3, 4), (5, 6, 7), tuple(range(16)))
_UNKNOWN = np.log(0.15)  # log m, of deviations that nothing says: a constant is no feature

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Judged:
    """A capture: what is known of each frame, and its errors in metres.

    Attributes:
        evidence: of ``frame_evidence``, (F, 10).
        error: the mean over joints after a similarity, (F,).
        worst: of the joint that is farthest off, (F,).
    """

    name: str
    evidence: Tensor
    error: Tensor
    worst: Tensor

    @property
    def bad(self) -> Tensor:
        """Frames, (F,), bool."""
        return (self.error > FAR) | (self.worst > OFF)

    @property
    def named(self) -> Tensor:
        """Frames that the weights of the package name, (F,), bool."""
        return judge_frames(self.evidence).value < THRESHOLD


@dataclass(frozen=True)
class Fit:
    """How weights are fitted."""

    named: float
    """Share of the good frames that may be named by mistake."""
    ridge: float
    """Penalty on weights of scaled features, in parts of the frames."""

    def bad(self, made: Sequence[Judged]) -> Floats:
        """Weights of the features and of the constant, (11,), by logistic ridge regression.

        The constant is moved so that the given share of the good frames is named.
        """
        rows, mean, spread = _scaled(made)
        bad = torch.cat([each.bad for each in made]).numpy()
        ridge, found = self._penalty(rows), np.zeros(rows.shape[1])
        for _ in range(50):  # Newton's method
            odds = 1 / (1 + np.exp(-rows @ found))
            hessian = (rows * (odds * (1 - odds))[:, None]).T @ rows + ridge
            found = found - np.linalg.solve(hessian, rows.T @ (odds - bad) + ridge @ found)
        good = np.quantile((rows @ found)[~bad], 1 - self.named)
        found[-1] += _log_odds(1 - THRESHOLD) - good
        return _unscaled(found, mean, spread)

    def error(self, made: Sequence[Judged]) -> Floats:
        """Weights (11,) of the log error in millimetres, by linear ridge regression."""
        rows, mean, spread = _scaled(made)
        logs = np.log(1e3 * torch.cat([each.error for each in made]).numpy())
        found = np.linalg.solve(rows.T @ rows + self._penalty(rows), rows.T @ logs)
        return _unscaled(np.asarray(found, np.float64), mean, spread)

    def _penalty(self, rows: Floats) -> Floats:
        most = rows.shape[1] - 1
        made: Floats = self.ridge * len(rows) * np.diag([*[1.0] * most, 0.0])
        return made + 1e-9 * np.eye(most + 1)

    def left_out(self, made: Sequence[Judged], groups: Sequence[Hashable]) -> list[Tensor]:
        """Frames (F,) of each capture that weights fitted to the other groups name."""
        weights = {
            group: self.bad([m for m, at in zip(made, groups, strict=True) if at != group])
            for group in dict.fromkeys(groups)
        }
        return [
            torch.from_numpy(_rows([m]) @ weights[group] > _log_odds(1 - THRESHOLD))
            for m, group in zip(made, groups, strict=True)
        ]


def weight_rows(bad: Floats, error: Floats) -> tuple[tuple[object, ...], ...]:
    """A table's rows: feature, log odds of a bad frame, log error."""
    return tuple(
        (name, float(one), float(other))
        for name, one, other in zip((*FEATURES, "constant"), bad, error, strict=True)
    )


def errors(joints: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
    """Errors of joints (F, 16, 3) in metres, each (F,).

    The mean after a similarity, and the largest beside the middle of the hips. Joints without a
    truth in some frame do not count.
    """
    truth = truth[: len(joints)]
    known = truth.isfinite().all(-1).all(0)
    worst = (root_aligned(joints) - root_aligned(truth)).norm(dim=-1)[:, known].amax(-1)
    joints, truth = joints[:, known], truth[:, known]
    mean = (procrustes(joints, truth, scale=True).apply(joints) - truth).norm(dim=-1).mean(-1)
    return mean, worst


def bad_frames(joints: Tensor, truth: Tensor) -> Tensor:
    """Frames (F,) with a mean error above ``FAR`` or a largest one above ``OFF``."""
    mean, worst = errors(joints, truth)
    return (mean > FAR) | (worst > OFF)


def shares(bad: Tensor, named: Tensor) -> tuple[int, int, float, float]:
    """Frames, bad ones, and percent of bad and of good ones that are named; masks of (F,)."""
    bad, named = bad.bool(), named.bool()
    return (
        len(bad),
        int(bad.sum()),
        100 * float(named[bad].double().mean()),
        100 * float(named[~bad].double().mean()),
    )


def _rows(made: Sequence[Judged]) -> Floats:
    evidence = torch.cat([each.evidence for each in made]).nan_to_num(_UNKNOWN).numpy()
    return np.concatenate((evidence, np.ones((len(evidence), 1))), 1)


def _scaled(made: Sequence[Judged]) -> tuple[Floats, Floats, Floats]:
    """Rows (N, 11) of features of unit spread, their means and spreads (10,)."""
    rows = _rows(made)
    mean, spread = rows[:, :-1].mean(0), rows[:, :-1].std(0)
    spread = np.where(spread > 1e-6, spread, np.inf)  # a constant says nothing
    return np.concatenate(((rows[:, :-1] - mean) / spread, rows[:, -1:]), 1), mean, spread


def _unscaled(found: Floats, mean: Floats, spread: Floats) -> Floats:
    weights = found[:-1] / spread
    return np.append(weights, found[-1] - weights @ mean)


def _log_odds(probability: float) -> float:
    return float(np.log(probability / (1 - probability)))
