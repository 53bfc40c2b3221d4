"""Simulated detections of 2D and 3D joint networks: jitter, swaps, outliers, depth flips.

Follows the noise model that the rendered sequences document, so that settings can be tried on any
motion without touching those sequences. One unit is 1 % of the person's median height in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import PARENTS

_FACTOR_2D = np.array([1, 0.8, 1, 1.2, 1.6, 1, 1.2, 1.6, 1.2, 1, 1, 1.9, 1.2, 1, 1, 1.9])
_FACTOR_3D = np.array([1, 0.6, 0.8, 1.2, 1.9, 0.8, 1.2, 1.9, 0.35, 1, 1.5, 1.7, 0.35, 1, 1.5, 1.7])
_LEGS, _ARMS = ((8, 12), (9, 13), (10, 14), (11, 15)), ((2, 5), (3, 6), (4, 7))
_CHAINS = ((4,), (3, 4), (7,), (6, 7), (10, 11), (9, 10, 11), (14, 15), (13, 14, 15))
# the average skeleton of the simulated 3D network, metres from the parent
_AVERAGE = {"head_top": .215, "neck": .495, "shoulder": .165, "elbow": .29, "wrist": .255,
            "hip": .115, "knee": .415, "ankle": .405, "toe": .175}  # fmt: skip


@dataclass(frozen=True)
class Noise:
    """Strength of each kind of error; zero switches it off."""

    jitter: float = 1.0
    swaps: float = 1.0
    outliers: float = 1.0
    flips: float = 1.0
    wrong: float = 1.0


def detect(
    truth: np.ndarray, rng: np.random.Generator, project: object, noise: Noise | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Simulate detections of one view.

    Args:
        truth: landmarks in camera coordinates, (F, 16, 3), metres.
        rng: the generator.
        project: function of camera points (F, 16, 3) to pixels (F, 16, 2).
        noise: what to simulate.

    Returns:
        joints2d (F, 16, 2) px, confidence2d (F, 16), joints3d (F, 16, 3) m relative to the root.
    """
    noise = noise or Noise()
    pixels = project(truth)  # type: ignore[operator]
    height = np.median(np.ptp(pixels[..., 1], axis=1))
    joints2d, confidence = _detect2d(pixels, 0.01 * height, rng, noise)
    return joints2d, confidence, _detect3d(truth, rng, noise)


def _detect2d(
    pixels: np.ndarray, unit: float, rng: np.random.Generator, noise: Noise
) -> tuple[np.ndarray, np.ndarray]:
    frames = len(pixels)
    shape = pixels.shape
    fast = 0.55 * _ar1(shape, 0.7, rng) + 0.85 * rng.standard_t(3, shape) / 3**0.5
    slow = 0.45 * _ar1(shape, 0.97, rng)
    error = noise.jitter * unit * (0.75 * _FACTOR_2D[:, None] * fast + slow)
    result = pixels + error
    swapped = np.zeros(shape[:2], bool)
    for rate, pairs in ((0.02, _LEGS), (0.014, _ARMS), (0.004, _LEGS + _ARMS)):
        for frame in _runs(frames, noise.swaps * rate, (1, 4), rng):
            for a, b in pairs:
                result[frame, [a, b]] = result[frame, [b, a]]
                swapped[frame, [a, b]] = True
    out = rng.random(shape[:2]) < 0.012 * noise.outliers
    low, high = pixels.min(1, keepdims=True), pixels.max(1, keepdims=True)
    result = np.where(out[..., None], low + (high - low) * rng.random(shape), result)
    distance = np.linalg.norm(result - pixels, axis=-1)
    confidence = np.exp(-distance / (9 * unit)) * rng.beta(9, 1.6, shape[:2])
    confidence = np.where(swapped, rng.uniform(0.35, 0.85, shape[:2]), confidence)
    random = rng.random(shape[:2]) < 0.04
    return result, np.where(random, rng.random(shape[:2]), confidence)


def _detect3d(truth: np.ndarray, rng: np.random.Generator, noise: Noise) -> np.ndarray:
    frames = len(truth)
    lengths = [next(v for k, v in _AVERAGE.items() if name.endswith(k)) for name in LANDMARKS]
    joints = _rebuild(truth, np.array(lengths))
    spread = np.array([0.017, 0.017, 0.034]) * _FACTOR_3D[:, None]
    wobble = 0.75 * _ar1(truth.shape, 0.8, rng) + 0.45 * rng.standard_t(4, truth.shape) / 2**0.5
    joints = joints + noise.jitter * spread * wobble
    angles = noise.jitter * np.radians([3.0, 4.0, 2.0]) * _ar1((frames, 3), 0.95, rng)
    joints = np.einsum("fij,fkj->fki", _rotations(angles), joints)
    for chain in _CHAINS:
        parent = PARENTS[chain[0]]
        for frame in _runs(frames, 0.01 * noise.flips, (2, 7), rng):
            for joint in chain:
                joints[frame, joint, 2] = 2 * joints[frame, parent, 2] - joints[frame, joint, 2]
    for frame in _runs(frames, 0.025 * noise.wrong, (1, 3), rng):
        turn = _rotations(np.array([[0.0, np.radians(rng.uniform(70, 290)), 0.0]]))[0]
        joints[frame] = joints[rng.integers(frames)] @ turn.T + rng.normal(0, 0.06, (16, 3))
    moved: np.ndarray = joints
    return moved


def _rebuild(points: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    root = 0.5 * (points[:, 8] + points[:, 12])
    result = np.zeros_like(points)
    for joint in (8, 12, 1, 0, 2, 5, 3, 6, 9, 13, 4, 7, 10, 14, 11, 15):
        parent = PARENTS[joint]
        bone = points[:, joint] - (root if parent < 0 else points[:, parent])
        bone = bone / np.linalg.norm(bone, axis=-1, keepdims=True)
        result[:, joint] = (0 if parent < 0 else result[:, parent]) + lengths[joint] * bone
    return result


def _ar1(shape: tuple[int, ...], rho: float, rng: np.random.Generator) -> np.ndarray:
    """First-order autoregression along the first axis with unit variance."""
    values = rng.normal(size=shape)
    for frame in range(1, shape[0]):
        values[frame] = rho * values[frame - 1] + (1 - rho**2) ** 0.5 * values[frame]
    return values


def _runs(frames: int, rate: float, span: tuple[int, int], rng: np.random.Generator) -> list[int]:
    """Frames inside events that start at a rate and last a uniform number of frames."""
    inside: set[int] = set()
    for start in np.flatnonzero(rng.random(frames) < rate):
        stop = int(start + rng.integers(span[0], span[1] + 1))
        inside.update(range(int(start), min(frames, stop)))
    return sorted(inside)


def _rotations(vectors: np.ndarray) -> np.ndarray:
    import torch

    from perfcap.geometry.rotation import rotvec_to_matrix

    matrices: np.ndarray = rotvec_to_matrix(torch.tensor(vectors)).numpy()
    return matrices
