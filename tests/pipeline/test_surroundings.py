"""Up, ahead and the ground, from nothing but the capture."""

import pytest
import torch
from synthetic import actor
from takes import sway
from torch import Tensor

from perfcap.errors import InputError
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface
from perfcap.pipeline.surroundings import Surroundings, axis, daylight, facing, upright

PERSON = actor()
MOTION = sway(PERSON, 40)
AXES = ("x", "y", "z", "-x", "-y", "-z")


def turned(points: Tensor, up: str) -> Tensor:
    """Points of a world with y up in one with another axis up."""
    to = axis(up)
    side = torch.linalg.cross(to, torch.roll(to.abs(), 1))
    rotation = torch.stack([side, to, torch.linalg.cross(side, to)], -1)
    assert float(torch.linalg.det(rotation)) == pytest.approx(1)
    return points @ rotation.T


@pytest.mark.parametrize("up", AXES)
def test_any_axis_may_be_up(up: str) -> None:
    joints = turned(PERSON.joints(MOTION), up)
    vertices = turned(SkinnedSurface(PERSON, MOTION)[:], up)
    scene = Surroundings.around(joints, StoredSurface(vertices))
    assert scene.up.tolist() == axis(up).tolist()
    torch.testing.assert_close(scene.ahead, turned(facing(PERSON.joints(MOTION)[0], axis("y")), up))
    lowest = (vertices @ scene.up).amin(-1)
    assert lowest.min() <= scene.ground <= lowest.median()


def test_a_person_faces_forward_at_rest() -> None:
    joints = PERSON.joints(PERSON.skeleton.rest_motion())[0]
    torch.testing.assert_close(facing(joints, axis("y")), axis("z"), atol=1e-6, rtol=0)


def test_a_known_direction_is_kept() -> None:
    scene = Surroundings.around(PERSON.joints(MOTION), SkinnedSurface(PERSON, MOTION), axis("-z"))
    assert scene.up.tolist() == [0, 0, -1]


@pytest.mark.parametrize("up", AXES)
def test_nobody_in_particular_still_gives_level_unit_directions(up: str) -> None:
    level = facing(torch.zeros(16, 3, dtype=torch.float64), axis(up))
    assert float(level @ axis(up)) == pytest.approx(0) and float(level.norm()) == pytest.approx(1)
    assert torch.isfinite(upright(torch.zeros(2, 16, 3))).all()
    light = daylight(axis(up))
    assert light.up == tuple(axis(up).tolist())
    assert torch.tensor(light.towards_sun).double() @ axis(up) > 0.5


def test_light_comes_from_ahead() -> None:
    scene = Surroundings.around(PERSON.joints(MOTION), SkinnedSurface(PERSON, MOTION))
    assert torch.tensor(scene.lighting.towards_sun).double() @ scene.ahead > 0.3


@pytest.mark.parametrize("name", ["", "w", "xy", "--x", "+-y", "1"])
def test_directions_by_name(name: str) -> None:
    assert axis("+y").tolist() == [0, 1, 0]
    with pytest.raises(InputError, match="--up"):
        axis(name)
