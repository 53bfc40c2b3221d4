"""Bones that are not those of a mesh are refused, and regions that leave joints nothing named."""

from __future__ import annotations

from itertools import pairwise

import limbs
import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.rigging.bone_heat import bone_heat_weights
from perfcap.rigging.bones import skeleton_bones
from perfcap.rigging.overrides import Override

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def body() -> tuple[limbs.Floats, limbs.Integers]:
    """Tubes around all limbs and the trunk."""
    pairs = [("pelvis", "neck"), ("neck", "head_top")]
    for side in "lr":
        names = [f"{side}_{name}" for name in ("hip", "knee", "ankle", "toe")]
        arms = [f"{side}_{name}" for name in ("shoulder", "elbow", "wrist")]
        pairs += [*pairwise(names), *pairwise(arms)]
    parts = [limbs.arrays(limbs.tube(*pair)) for pair in pairs]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [each + start for (_, each), start in zip(parts, starts, strict=False)]
    return np.vstack([vertices for vertices, _ in parts]), np.vstack(faces)


@pytest.mark.parametrize(("joints", "mesh"), [(100.0, 1.0), (1.0, 100.0), (1000.0, 1.0)])
def test_another_unit_is_refused(joints: float, mesh: float) -> None:
    """A mesh in centimetres hung on the head, joints in centimetres on the ankles."""
    vertices, faces = body()
    bones = skeleton_bones({name: joints * place for name, place in limbs.positions().items()})
    with pytest.raises(InputError, match="bones are not those of the mesh"):
        bone_heat_weights(mesh * vertices, faces, bones)


def test_another_axis_up_is_refused() -> None:
    vertices, faces = body()
    with pytest.raises(InputError, match="with the same axis up"):
        bone_heat_weights(vertices @ Z_UP.T, faces, limbs.bones())


def test_a_part_of_a_body_is_right() -> None:
    """A glove, which is small, lies on its bones."""
    vertices, faces = limbs.arrays(limbs.tube("l_elbow", "l_wrist"))
    weights, _ = bone_heat_weights(vertices, faces, limbs.bones())
    assert np.allclose(weights.sum(1), 1)


@pytest.mark.parametrize(
    ("box", "told"), [(((-9.0,) * 3, (9.0,) * 3), True), (((-0.1, 0.8, -9), (0.1, 1, 9)), False)]
)
def test_joints_that_a_region_leaves_nothing_are_named(
    box: tuple[tuple[float, float, float], tuple[float, float, float]],
    told: bool,
    caplog: pytest.LogCaptureFixture,
) -> None:
    overrides = (Override("skirt", ("pelvis", "l_hip", "r_hip"), box=box),)
    bone_heat_weights(*body(), limbs.bones(), overrides)
    assert ["spine, neck" in line for line in caplog.messages] == [True] * told


@pytest.mark.parametrize(
    ("place", "words"),
    [(None, "joints lack l_toe"), ([0.0, 1.0], "array"), ([np.nan, 0.0, 0.0], "l_toe is at")],
)
def test_places_that_are_none_are_refused(place: list[float] | None, words: str) -> None:
    joints = {name: value for name, value in limbs.positions().items() if name != "l_toe"}
    joints |= {} if place is None else {"l_toe": np.array(place)}
    with pytest.raises(InputError, match=words):
        skeleton_bones(joints)
