"""Units and axes of files, and how they are put right."""

import numpy as np
import pytest
from foreign_rigs import MIXAMO, Z_UP, Rig, person, transformed

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_correction import UNITS, Correction, find_correction, unit_of
from perfcap.actor.bone_space import BoneSpace, is_similarity
from perfcap.errors import InputError

HERE = {name: number for number, name in enumerate(JOINTS)}


@pytest.mark.parametrize("metres", UNITS.values())
@pytest.mark.parametrize("height", [1.25, 1.7, 2.25])
def test_units_are_guessed_from_the_height(metres: float, height: float) -> None:
    assert unit_of("x", height / metres) == metres


def test_children_are_believed_and_buildings_are_not() -> None:
    assert unit_of("x", 0.9) == unit_of("x", 2.6) == 1.0
    with pytest.raises(InputError, match="metres_per_unit"):
        unit_of("x", 30.0)


def test_the_correction_undoes_what_the_file_did() -> None:
    template = person()
    raw = transformed(template, Z_UP / 0.01, np.array([0.0, 0.0, 0.0]))
    correction = find_correction(raw, HERE)
    assert (correction.scale, correction.up, correction.ahead) == (0.01, "z", "-y")
    back = correction.apply(raw)
    np.testing.assert_allclose(back.vertices, template.vertices, atol=1e-6)
    np.testing.assert_allclose(back.bone_rest, template.bone_rest, atol=1e-9)
    assert back.space is not None
    local = np.linalg.inv(back.space.frame) @ back.bone_frames()
    np.testing.assert_allclose(local, raw.bone_rest, atol=1e-9)  # the file's own numbers
    assert find_correction(back, HERE).apply(back) is back


def test_landmarks_and_earlier_spaces_move_along() -> None:
    template = Rig(MIXAMO, 0.5, armature=True).template()
    assert template.space is not None
    correction = Correction(2.0, Z_UP.T, np.array([1.0, 2.0, 3.0]))
    moved = correction.apply(template)
    assert moved.space is not None
    np.testing.assert_allclose(moved.space.units, 2 * template.space.units)
    np.testing.assert_allclose(moved.space.frame, correction.matrix @ template.space.frame)


def test_only_similarities_are_spaces() -> None:
    assert is_similarity(np.diag([2.0, 2, 2, 1]))
    assert not is_similarity(np.diag([2.0, 2, 1, 1]))
    assert not is_similarity(np.diag([-1.0, 1, 1, 1]))
    for units, frame in ((np.array([0.0]), np.eye(4)), (np.ones(1), np.diag([1.0, 2, 1, 1]))):
        with pytest.raises(InputError):
            BoneSpace(units, frame)
    assert BoneSpace(np.ones(2), np.eye(4)).is_plain()
