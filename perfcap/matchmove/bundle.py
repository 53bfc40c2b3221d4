"""Bundle adjustment: cameras, their lens, and points that stand still, from where these are seen.

A point p is a direction d from where the first camera stands, and how near it is, n: the inverse of
its distance (Civera et al. 2008). Camera f sees it along ``R_f d_p + n_p t_f``. Points far off need
no distance, and a camera that only turns needs none of any point. The lens is one for all frames.
Everything is held by weak Gaussians, and sightings count by a Geman-McClure kernel that narrows, so
that walls and floors find together before those that disagree are left out (graduated
non-convexity, Blake and Zisserman 1987).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from perfcap.matchmove.corner_tracks import Sightings

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

_BEHIND = 0.05  # of a ray's length, that a point must be in front of a camera
_WIDTHS = (32, 32, 16, 16, 8, 8, 8, 4, 4, 4, 2.5, 2.5, 2.5)  # of the kernel, while it narrows
_STEPS = 60
_ENOUGH = 1e-4  # of the cost, that a step must gain to go on
_DAMPING, _HARDEST = 1e-3, 1e8
_POSE = 6  # unknowns of a camera: turn, then shift


@dataclass(frozen=True)
class Prior:
    """Deviations of Gaussians.

    Attributes:
        log_focal: of the log focal length about the assumed one; 0 if it is known.
        speed: of a camera, m/s.
        nearness: of points about where they are supposed, 1/m.
    """

    log_focal: float = 0.35
    speed: float = 0.7
    nearness: float = 0.1


@dataclass(frozen=True)
class Bundle:
    """K cameras and P points.

    Attributes:
        rotation: world to camera, (K, 3, 3).
        translation: the same, (K, 3), m.
        direction: of points from the origin, unit vectors (P, 3).
        nearness: of points, (P,), 1/m.
        log_focal: log of the focal length by the assumed one.
    """

    rotation: Array
    translation: Array
    direction: Array
    nearness: Array
    log_focal: float = 0.0

    def seen(self, frame: Whole, point: Whole) -> Array:
        """Rays (N, 3) from cameras to points, in axes of the cameras, of any length."""
        turned = np.einsum("nij,nj->ni", self.rotation[frame], self.direction[point])
        rays: Array = turned + self.nearness[point, None] * self.translation[frame]
        return rays


@dataclass(frozen=True)
class Adjusted:
    """A minimum.

    Attributes:
        bundle: what it is.
        cost: half the sum of robust squares of pixels, and of what the Gaussians hold.
        errors: of the sightings, (N,) px.
        deviation: of the log focal length, by the sightings' own noise.
    """

    bundle: Bundle
    cost: float
    errors: Array
    deviation: float

    @property
    def noise(self) -> float:
        """Deviation of a coordinate of a sighting, px, from the median error."""
        return float(np.median(self.errors)) / math.sqrt(2 * math.log(2))


class Problem:
    """Sightings in K frames of P points, both counted from 0 without gaps, and a lens.

    Args:
        sightings: N.
        lens: assumed focal length and principal point x, y, px of the sightings' images.
        spacing: s between frames.
        start: what the Gaussians are about, too.
        prior: their deviations.
        size: of the kernel at last, px.
        moves: whether cameras do more than turn.
    """

    def __init__(
        self,
        sightings: Sightings,
        lens: tuple[float, float, float],
        spacing: float,
        start: Bundle,
        prior: Prior,
        size: float,
        moves: bool,
    ) -> None:
        self.sightings, self.start, self.prior, self._size = sightings, start, prior, size
        self.focal, self.middle = lens[0], np.array(lens[1:])
        count = len(start.rotation)
        steady = np.diff(np.eye(count), axis=0) / (prior.speed * spacing)
        shifts = sparse.kron(sparse.csr_array(steady.T @ steady), np.diag([0.0] * 3 + [1.0] * 3))
        known = prior.log_focal == 0
        held = sparse.csr_array([[0.0 if known else prior.log_focal**-2]])
        self.steady = sparse.csr_array(sparse.block_diag([shifts, held]))
        free = np.ones((count, _POSE), np.bool_)
        free[0] = False  # the world is the first camera's
        free[:, 3:] &= moves
        self.free = np.nonzero(np.append(free.ravel(), not known))[0]

    def solve(self, begin: Bundle | None = None) -> Adjusted:
        """A minimum by damped Gauss-Newton steps and the Schur complement.

        Args:
            begin: near a minimum; without one the kernel narrows from wide, from the start.
        """
        bundle, damping = begin or self.start, _DAMPING
        widths = () if begin is not None else _WIDTHS
        for step in range(_STEPS):
            size = self._size * (widths[step] if step < len(widths) else 1.0)
            before = self._cost(bundle, size)
            tried, cost, damping = self._descend(bundle, before, size, damping)
            if cost < before:
                bundle = tried
            if step >= len(widths) and before - cost < _ENOUGH * before:
                break
        _, errors = self.errors(bundle)
        lengths = np.linalg.norm(errors, axis=1)
        found = Adjusted(bundle, self._cost(bundle, self._size), lengths, 0.0)
        precision = _System(self, bundle, self._size).focal_precision(found.noise)
        return replace(found, deviation=precision**-0.5 if precision > 0 else 0.0)

    def _descend(
        self, bundle: Bundle, before: float, size: float, damping: float
    ) -> tuple[Bundle, float, float]:
        """A step that lowers the cost, if there is one, its cost, and the damping for the next."""
        system = _System(self, bundle, size)
        while True:
            tried = system.step(damping)
            cost = self._cost(tried, size)
            if cost < before:
                return tried, cost, max(damping / 4, 1e-7)
            if damping > _HARDEST:
                return bundle, before, _DAMPING
            damping *= 4

    def errors(self, bundle: Bundle) -> tuple[Array, Array]:
        """Rays (N, 3), and pixels between where they meet the image and the sightings (N, 2)."""
        rays = bundle.seen(self.sightings.frame, self.sightings.point)
        ahead = rays[:, 2:] > _BEHIND
        plane = rays[:, :2] / np.where(ahead, rays[:, 2:], 1.0)
        focal = self.focal * math.exp(bundle.log_focal)
        error = focal * plane + self.middle - self.sightings.pixels
        return rays, np.where(ahead, error, 50.0)

    def _cost(self, bundle: Bundle, size: float) -> float:
        _, error = self.errors(bundle)
        squared = np.square(error).sum(1)
        data = float((squared / (1 + squared / size**2)).sum())
        shared = _shared(bundle)
        near = (bundle.nearness - self.start.nearness) / self.prior.nearness
        held = float(shared @ (self.steady @ shared)) + float(near @ near)
        return 0.5 * (data + held)


class _System:
    """Normal equations at a bundle, points eliminated."""

    def __init__(self, problem: Problem, bundle: Bundle, size: float) -> None:
        self._bundle, self._free = bundle, problem.free
        seen, prior = problem.sightings, problem.prior
        _, error = problem.errors(bundle)
        root = 1 / (1 + np.square(error).sum(1) / size**2)  # of the kernel's weight
        cameras, points, self._basis = linearized(problem, bundle)
        cameras, points = cameras * root[:, None, None], points * root[:, None, None]
        error = error * root[:, None]
        count, many = len(bundle.rotation), len(bundle.nearness)
        frame, point = seen.frame, seen.point
        of_camera = np.column_stack(
            [_POSE * frame[:, None] + np.arange(_POSE), np.full(len(frame), _POSE * count)]
        )
        left = _sparse(cameras, of_camera, _POSE * count + 1)[:, self._free]
        right = _sparse(points, 3 * point[:, None] + np.arange(3), 3 * many)
        flat, held = error.ravel(), problem.steady
        shared = held @ _shared(bundle)
        self._hessian = sparse.csr_array(left.T @ left)
        self._held = sparse.csr_array(held[self._free][:, self._free])
        self._gradient = left.T @ flat + shared[self._free]
        blocks = np.zeros((many, 3, 3))
        np.add.at(blocks, point, np.einsum("nki,nkj->nij", points, points))
        blocks[:, 2, 2] += prior.nearness**-2
        self._blocks = blocks
        slopes = (right.T @ flat).reshape(many, 3)
        slopes[:, 2] += (bundle.nearness - problem.start.nearness) / prior.nearness**2
        self._slopes = slopes.ravel()
        self._mixed = sparse.csr_array(left.T @ right)

    def step(self, damping: float) -> Bundle:
        """The bundle that a damped step leads to."""
        inverse = self._inverse(damping)
        matrix = self._reduced(inverse)
        diagonal = self._hessian.diagonal() + self._held.diagonal()
        matrix = matrix + sparse.diags_array(damping * diagonal + 1e-9)
        right = self._mixed @ (inverse @ self._slopes) - self._gradient
        moved = splu(matrix.tocsc()).solve(right)
        shift = -(inverse @ (self._slopes + self._mixed.T @ moved)).reshape(-1, 3)
        return self._moved(moved, shift)

    def focal_precision(self, noise: float) -> float:
        """1 / variance of the log focal length, everything else unknown; 0 where it is known."""
        count = len(self._bundle.rotation)
        if self._free[-1] != _POSE * count:
            return 0.0
        matrix = self._reduced(self._inverse(0.0), noise).tocsc()
        end = np.zeros(len(self._free))
        end[-1] = 1.0
        return 1 / float(splu(matrix).solve(end)[-1])

    def _inverse(self, damping: float) -> sparse.bsr_array:
        """Of the points' own blocks."""
        blocks = self._blocks.copy()
        diagonal = np.arange(3)
        blocks[:, diagonal, diagonal] *= 1 + damping
        blocks[:, diagonal, diagonal] += 1e-9
        many = len(blocks)
        places = np.arange(many), np.arange(many + 1)
        return sparse.bsr_array((np.linalg.inv(blocks), *places), shape=(3 * many, 3 * many))

    def _reduced(self, inverse: sparse.bsr_array, noise: float = 1.0) -> sparse.csr_array:
        seen = self._hessian - self._mixed @ inverse @ self._mixed.T
        return sparse.csr_array(seen / noise**2 + self._held)

    def _moved(self, moved: Array, shift: Array) -> Bundle:
        bundle = self._bundle
        whole = np.zeros(_POSE * len(bundle.rotation) + 1)
        whole[self._free] = moved
        poses = whole[:-1].reshape(-1, _POSE)
        turned = Rotation.from_rotvec(poses[:, :3]).as_matrix() @ bundle.rotation
        direction = bundle.direction + np.einsum("pij,pj->pi", self._basis, shift[:, :2])
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return Bundle(
            turned,
            bundle.translation + poses[:, 3:],
            direction,
            bundle.nearness + shift[:, 2],
            bundle.log_focal + float(whole[-1]),
        )


def pixel_slope(rays: Array, focal: float) -> Array:
    """Derivative (N, 2, 3) of pixels in rays (N, 3)."""
    ahead = rays[:, 2] > _BEHIND
    depth = np.where(ahead, rays[:, 2], 1.0)
    slope = np.zeros((len(rays), 2, 3))
    slope[:, 0, 0] = slope[:, 1, 1] = 1 / depth
    slope[:, :, 2] = -rays[:, :2] / depth[:, None] ** 2
    slope[~ahead] = 0
    return focal * slope


def cross_matrix(vectors: Array) -> Array:
    """Matrices (N, 3, 3) that take a vector to its cross product with these (N, 3)."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    rows = [[none, -z, y], [z, none, -x], [-y, x, none]]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def linearized(problem: Problem, bundle: Bundle) -> tuple[Array, Array, Array]:
    """Derivatives of pixels.

    Returns:
        In a sighting's own camera, (N, 2, 7): a turn of its axes, its translation, the log focal
        length; in its own point, (N, 2, 3): along two tangents, and in its nearness; and these
        tangents of all points, (P, 3, 2).
    """
    seen = problem.sightings
    rays, error = problem.errors(bundle)
    slope = pixel_slope(rays, problem.focal * math.exp(bundle.log_focal))
    near = bundle.nearness[seen.point]
    shifts = bundle.translation[seen.frame]
    turned = rays - near[:, None] * shifts
    lens = (error + seen.pixels - problem.middle)[:, :, None]
    lens[rays[:, 2] <= _BEHIND] = 0
    cameras = np.concatenate((-slope @ cross_matrix(turned), near[:, None, None] * slope, lens), -1)
    basis = _tangents(bundle.direction)
    across = slope @ (bundle.rotation[seen.frame] @ basis[seen.point])
    return cameras, np.concatenate((across, slope @ shifts[:, :, None]), -1), basis


def _tangents(directions: Array) -> Array:
    """Two unit vectors square to each of (P, 3), as columns (P, 3, 2)."""
    other = np.where(np.abs(directions[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(directions, other)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack((first, np.cross(directions, first)), -1)


def _shared(bundle: Bundle) -> Array:
    """What the Gaussians of cameras and lens are of, (6 K + 1,)."""
    shifts = np.concatenate((np.zeros_like(bundle.translation), bundle.translation), 1)
    return np.append(shifts.ravel(), bundle.log_focal)


def _sparse(rows: Array, columns: Whole, width: int) -> sparse.csr_array:
    """Rows (N, 2, k) of pairs in columns (N, k) of a matrix (2 N, width)."""
    count, _, each = rows.shape
    places = np.repeat(columns[:, None], 2, 1).ravel()
    ends = np.arange(0, 2 * count * each + 1, each)
    return sparse.csr_array((rows.ravel(), places, ends), shape=(2 * count, width))
