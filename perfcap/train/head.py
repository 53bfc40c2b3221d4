"""A linear head that moves the joints of a frozen network, and its fit to a solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from perfcap.detect.joint_set import LANDMARKS, JointSet
from perfcap.geometry.alignment import procrustes

_MARKS = len(LANDMARKS)
_FAR = 0.15  # m, mean distance of a pose from which it teaches less: one of the two is wrong
_FLOOR = 0.1  # of the mean variance of features, added to that of each
_ROUNDS = 3  # of weights that follow these distances
HIPS = (LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip"))


class Head(nn.Module):
    """Moves the 16 landmarks in 2D and in 3D by a linear map of a network's features.

    It is zero at first, so that the network says what it says without it.

    Args:
        mean: of the features, (D,).
        scale: of each, (D,), which brings them to a length of about one.
        size: width of the crops, pixels: moves in 2D are shares of it.
        joints: of the network. Landmarks that are made of joints move as these can move them.
    """

    mean: Tensor
    scale: Tensor
    lift: Tensor
    effect: Tensor

    def __init__(self, mean: Tensor, scale: Tensor, size: int, joints: JointSet) -> None:
        super().__init__()
        made = landmark_map(joints)
        lift = torch.linalg.pinv(made)  # the least moves of joints that move landmarks so
        self.register_buffer("mean", mean.clone())
        self.register_buffer("scale", scale.clone())
        self.register_buffer("lift", lift)
        self.register_buffer("effect", made @ lift)
        self.size = size
        self.weight = nn.Parameter(mean.new_zeros(len(mean), 5 * _MARKS))
        self.offset = nn.Parameter(mean.new_zeros(5 * _MARKS))

    @classmethod
    def of(cls, features: Tensor, size: int, joints: JointSet) -> Head:
        """A head for features like these, (N, D)."""
        mean = features.mean(0)
        variance = (features - mean).square().mean(0)
        # those that hardly change in these crops may change a lot in others: they count less
        scale = (variance + _FLOOR * variance.mean()).clamp(min=1e-12).sqrt()
        return cls(mean, scale * len(mean) ** 0.5, size, joints)

    def scaled(self, features: Tensor) -> Tensor:
        """Features (*b, D) of a length of about one."""
        found: Tensor = (features - self.mean) / self.scale
        return found

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Moves (*b, 16, 2) in pixels of the crop and (*b, 16, 3) in metres, along its axes."""
        moves = self.scaled(features) @ self.weight + self.offset
        moves = self.effect @ _by_landmark(moves)
        return self.size * moves[..., :2], moves[..., 2:]

    @torch.no_grad()
    def layer(self) -> tuple[Tensor, Tensor]:
        """From plain features to moves of J joints, pixels and metres: (D, J, 5) and (J, 5)."""
        units = self.weight.new_tensor([self.size, self.size, 1, 1, 1]).double()
        weight = self.weight.double() / self.scale[:, None]
        offset = self.offset.double() - self.mean.double() @ weight
        lift = self.lift.double()
        return (
            lift @ _by_landmark(weight) * units,
            lift @ _by_landmark(offset) * units,
        )


def _by_landmark(values: Tensor) -> Tensor:
    """Values (*b, 80) as (*b, 16, 5)."""
    return values.reshape(*values.shape[:-1], _MARKS, 5)


def landmark_map(joints: JointSet) -> Tensor:
    """The map from the joints of a set to the landmarks, (16, J); zero rows where it has none."""
    found = torch.zeros(_MARKS, len(joints))
    for row, mark in enumerate(LANDMARKS):
        for joint, share in zip(joints.sources(mark), joints.shares(mark), strict=True):
            found[row, joint] = share
    return found


@dataclass(frozen=True)
class Lesson:
    """Crops with what a network says of them and what a solution of all views says.

    Attributes:
        features: (N, D).
        seen: landmarks as the network sees them, 2D in shares of the crop and 3D in metres
            relative to the middle of the hips, (N, 16, 5).
        known: the same of the solution.
        weight: how far the solution is believed, (N,), 0 to 1.
    """

    features: Tensor
    seen: Tensor
    known: Tensor
    weight: Tensor

    def __getitem__(self, rows: Tensor) -> Lesson:
        """Some of the crops."""
        return Lesson(self.features[rows], self.seen[rows], self.known[rows], self.weight[rows])


def rooted(landmarks: Tensor) -> Tensor:
    """Landmarks (*b, 16, 3) relative to the middle of the hips."""
    root: Tensor = landmarks[..., list(HIPS), :].mean(-2, keepdim=True)
    return landmarks - root


def pose_error(found: Tensor, known: Tensor) -> Tensor:
    """PA-MPJPE of poses (*b, 16, 3), (*b,), in their unit."""
    fit = procrustes(found, known, scale=True)
    error: Tensor = (fit.apply(found) - known).norm(dim=-1).mean(-1)
    return error


@torch.no_grad()
def fit_directly(head: Head, lesson: Lesson, decay: float) -> None:
    """Set a head to the ridge regression of what a solution says against what the network says.

    Poses that stay far from the solution count less (iteratively reweighted least squares).

    Args:
        head: is changed.
        lesson: to learn from.
        decay: of the weights, against the mean square of what is left.
    """
    rows = head.scaled(lesson.features).double()
    rows = torch.cat((rows, torch.ones_like(rows[:, :1])), -1)
    target, weight = (lesson.known - lesson.seen).double(), lesson.weight.double()
    for _ in range(_ROUNDS):
        found = _ridge(rows, target.flatten(1), weight, decay)
        left = (target - _by_landmark(rows @ found))[..., 2:]
        far = left.norm(dim=-1).mean(-1)
        weight = lesson.weight.double() / (1 + (far / _FAR).square()).square()
    head.weight.copy_(found[:-1])
    head.offset.copy_(found[-1])


def best_decay(head: Head, lesson: Lesson, decays: Sequence[float], test: Lesson) -> float:
    """The decay whose fit has the least PA-MPJPE on other crops; the head is left with it."""
    errors = []
    for decay in decays:
        fit_directly(head, lesson, decay)
        errors.append((score_directly(head, test), decay))
    best = min(errors)[1]
    fit_directly(head, lesson, best)
    return best


def _ridge(rows: Tensor, target: Tensor, weight: Tensor, decay: float) -> Tensor:
    """Least squares (D + 1, M) with a penalty on all but the last row, the offset."""
    weighted = weight[:, None] * rows
    penalty = rows.new_full((rows.shape[1],), decay * float(weight.sum()))
    penalty[-1] = 1e-9 * float(weight.sum())
    square = rows.mT @ weighted + torch.diag(penalty)
    return torch.cholesky_solve(weighted.mT @ target, torch.linalg.cholesky(square))


@torch.no_grad()
def score_directly(head: Head, lesson: Lesson) -> float:
    """Mean PA-MPJPE of a head's poses against a solution's, metres."""
    poses = lesson.seen[..., 2:] + head(lesson.features)[1]
    weight = lesson.weight / lesson.weight.sum().clamp(min=1e-9)
    return float((weight * pose_error(poses, lesson.known[..., 2:])).sum())
