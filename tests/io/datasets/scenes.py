"""A person and cameras whose truth is known, to be written in the layout of a data set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from synthetic import cameras as circle

from perfcap.app.truth_people import match_truths, read_truths
from perfcap.detect.joint_set import LANDMARKS, JointSet
from perfcap.geometry.camera import Camera

Floats = NDArray[np.float64]
FRAMES = 5


def person(joint_set: JointSet, frames: int = FRAMES, seed: int = 0) -> Floats:
    """Joints of a set, (F, J, 3), metres: within a metre of the origin, each its own."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, (frames, len(joint_set), 3))


def cameras(views: int = 2, size: int = 600) -> Camera:
    """Fixed cameras around the origin, float64."""
    return circle(max(views, 3), size=size).select(list(range(views)))


def landmark(points: Floats, joint_set: JointSet, name: str) -> Floats:
    """What a landmark should be, (F, 3): the joint of its name."""
    return points[:, joint_set.joints.index(name)]


def assert_landmarks(found: torch.Tensor, points: Floats, joint_set: JointSet) -> None:
    """Landmarks of the set are its joints, or what they are made of; others are NaN."""
    for index, name in enumerate(LANDMARKS):
        sources = joint_set.sources(name, measured=True)
        if sources:
            np.testing.assert_allclose(found[..., index, :], points[..., list(sources), :].mean(-2))
        else:
            assert found[..., index, :].isnan().all(), name


def assert_everybody(folder: Path, dataset: str, name: str, people: tuple[str, ...]) -> None:
    """``NAME`` stands for these people, whose results, in the opposite order, find them again."""
    truths = read_truths(folder, dataset, name)
    assert tuple(truth.sequence.name for truth in truths) == people
    results = []
    for number, truth in enumerate(reversed(truths), 1):
        assert truth.sequence.joints3d is not None
        results.append(folder / f"result/person{number}")
        results[-1].mkdir(parents=True)
        joints = truth.sequence.joints3d.nan_to_num(0.3).numpy() + 0.01
        np.savez(results[-1] / "motion.npz", joints3d=joints, frames=truth.sequence.frames.numpy())
    found = match_truths(results, truths)
    assert tuple(truth.sequence.name for truth in found) == people[::-1]
