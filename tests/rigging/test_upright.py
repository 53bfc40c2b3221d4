"""Meshes in any unit and direction are stood up."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from perfcap.errors import InputError
from perfcap.io.body_model import load_body_model
from perfcap.rigging.upright import stand_up


@pytest.fixture(scope="module")
def person() -> np.ndarray:
    model = load_body_model()
    return model.template(torch.zeros(model.components)).vertices[::9]


@pytest.mark.parametrize(
    ("turn", "scale", "unit"),
    [
        ((0, 0, 0), 1.0, "metres"),
        ((90, 0, 0), 100.0, "centimetres"),
        ((0, 0, 180), 1000.0, "millimetres"),
        ((0, 90, 90), 1.0, "metres"),
        ((0, 180, 0), 1 / 0.0254, "inches"),
        ((20, 10, -15), 1.0, "metres"),
        ((0, 0, 0), 5e-6, "unknown"),
    ],
)
def test_a_turned_person_is_stood_up(
    person: np.ndarray, turn: tuple[float, ...], scale: float, unit: str
) -> None:
    rotation = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    moved = scale * person @ rotation.T + scale * np.array([3.0, -1.0, 0.5])
    # front and back look alike: one of the candidates is right
    found = stand_up(moved, [person])
    angles = [np.trace(candidate.rotation @ rotation) for candidate in found]
    best = found[int(np.argmax(angles))]
    assert max(angles) > 2.95
    assert best.unit == unit
    upright = best.apply(moved)
    assert upright[:, 1].min() == pytest.approx(0.0, abs=1e-9)
    if unit != "unknown":
        assert np.abs(np.ptp(upright, 0) - np.ptp(person, 0)).max() < 0.12


def test_a_given_height_is_the_height(person: np.ndarray) -> None:
    upright = stand_up(person * 7.0, [person], height=1.9)[0].apply(person * 7.0)
    assert np.ptp(upright[:, 1]) == pytest.approx(1.9)


def test_rotations_are_proper(person: np.ndarray) -> None:
    for candidate in stand_up(person, [person]):
        assert np.allclose(candidate.rotation @ candidate.rotation.T, np.eye(3))
        assert np.linalg.det(candidate.rotation) == pytest.approx(1.0)


def test_a_point_is_no_mesh() -> None:
    with pytest.raises(InputError, match="no extent"):
        stand_up(np.zeros((5, 3)), [np.eye(3)])
