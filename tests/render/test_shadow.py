from __future__ import annotations

import math

import pytest
import torch
import trimesh
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera, look_at
from perfcap.render.lighting import Lighting
from perfcap.render.shadow import cone, cosine_hemisphere, shade_ground, visibility

UP = torch.tensor([0.0, 1, 0], dtype=torch.float64)
SIZE = (81, 101)


def sphere(height: float, radius: float = 0.3) -> tuple[Tensor, Tensor]:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    middle = torch.tensor([0.0, height, 0], dtype=torch.float64)
    return torch.tensor(mesh.vertices.copy()) + middle, torch.tensor(mesh.faces.copy())


def view_from_above() -> Camera:
    eye, target, up = torch.tensor([[0.0, 9, 0], [0, 0, 0], [0, 0, -1]]).double()
    rotation, translation = look_at(eye, target, up)
    intrinsics = torch.tensor([[180.0, 0, 50], [0, 180, 40], [0, 0, 1]]).double()
    return Camera(intrinsics[None], rotation[None], translation[None], None, (SIZE,))


@pytest.mark.parametrize("axis", [[0.0, 1, 0], [0.6, -0.8, 0], [0.0, 0, 1]])
def test_directions_are_unit_and_spread_about_their_axis(axis: list[float]) -> None:
    middle = torch.tensor(axis, dtype=torch.float64)
    narrow, sphere_, dome = (
        cone(middle, 0.1, 50),
        cone(middle, math.pi, 400),
        cosine_hemisphere(middle, 400),
    )
    for directions in (narrow, sphere_, dome):
        torch.testing.assert_close(directions.norm(dim=-1), torch.ones(len(directions)).double())
    assert (narrow @ middle).min() >= math.cos(0.1)
    assert sphere_.mean(0).norm() < 0.01
    assert (dome @ middle).mean().item() == pytest.approx(2 / 3, abs=0.01)
    assert (dome.mean(0) - 2 / 3 * middle).norm() < 0.01


def test_a_ball_sees_all_the_light_it_faces() -> None:
    vertices, faces = sphere(1.0)
    reached = visibility(vertices, faces, Lighting(towards_sun=(0.0, 1.0, 0.0)))
    assert reached.sky.min() > 0.85
    assert (reached.sun[vertices[:, 1] > 1.05] == 1).all()
    assert (reached.sun[vertices[:, 1] < 0.9] == 0).all()


def test_a_roof_takes_the_light() -> None:
    vertices, faces = sphere(0.3)
    roof = torch.tensor([[-2.0, 1, -2], [2, 1, -2], [2, 1, 2], [-2, 1, 2]]).double()
    roof_faces = torch.tensor([[0, 2, 1], [0, 3, 2]]) + len(vertices)
    scene = torch.cat([vertices, roof]), torch.cat([faces, roof_faces])
    light = Lighting(towards_sun=(0.0, 1.0, 0.0))
    below = visibility(*scene, light)
    top = vertices[:, 1].argmax()
    assert below.sun[top] == 0
    assert below.sky[top] < 0.4 < visibility(vertices, faces, light).sky[top]


def test_a_shadow_falls_where_the_light_throws_it() -> None:
    vertices, faces = sphere(1.0)
    image = torch.full((*SIZE, 3), 150, dtype=torch.uint8)
    light = Lighting(towards_sun=(-1.0, 1.0, 0.0))
    shaded = shade_ground(image, view_from_above(), vertices, faces, light)
    row, column = 40, 50 + 20  # a metre to the right, 20 px
    assert shaded[row, column, 0] < 115
    assert shaded[row, 50 - 20, 0] > 140  # only a little sky is missing on the other side
    assert torch.equal(shaded[0, 0], image[0, 0])
    assert (shaded <= image).all()


def test_a_shadow_is_sharper_and_darker_near_the_ground() -> None:
    image = torch.full((*SIZE, 3), 150, dtype=torch.uint8)
    light = Lighting(sun=(0.0, 0.0, 0.0))
    low, high = (
        shade_ground(image, view_from_above(), *sphere(height), light)[40, 50, 0]
        for height in (0.3, 2.0)
    )
    assert low < high - 30


def test_a_body_below_the_ground_throws_no_shadow_beside_itself() -> None:
    vertices, faces = sphere(-0.3)
    image = torch.full((*SIZE, 3), 150, dtype=torch.uint8)
    shaded = shade_ground(image, view_from_above(), vertices, faces, Lighting())
    changed = torch.nonzero((shaded != image).any(-1)) - torch.tensor([40, 50])
    assert changed.double().norm(dim=-1).max() < 11


def test_bad_input_is_named() -> None:
    vertices, faces = sphere(1.0)
    with pytest.raises(InputError, match="image"):
        image = torch.zeros(4, 4, 3, dtype=torch.uint8)
        shade_ground(image, view_from_above(), vertices, faces, Lighting())
    with pytest.raises(InputError, match="vertices"):
        visibility(vertices * torch.nan, faces, Lighting())
