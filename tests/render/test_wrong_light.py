"""Light in bytes and lengths in millimetres, which were taken for what they are not."""

import pytest
import torch
from test_shading import BACKGROUND, front_camera, sphere, square

from perfcap.errors import InputError
from perfcap.render import (
    DAYLIGHT,
    Lighting,
    ProjectedMesh,
    Texture,
    Visibility,
    render,
    shade_ground,
)


def test_lights_are_no_bytes_and_have_a_direction() -> None:
    Lighting(sun=(3.0, 2.8, 2.5), towards_sun=(0.0, 0.0, 40.0))
    with pytest.raises(InputError, match="divide bytes by 255"):
        Lighting(sun=(255, 250, 240))
    with pytest.raises(InputError, match="direction"):
        Lighting(up=(0.0, 0.0, 0.0))


def test_levels_of_textures_are_light() -> None:
    _, faces, uv = square()
    Texture((torch.full((4, 4, 3), 0.5),), uv, faces)
    for level in (torch.full((4, 4, 3), 200.0), torch.full((4, 4, 3), 200, dtype=torch.uint8)):
        with pytest.raises(InputError, match="from_image"):
            Texture((level,), uv, faces)


def test_meshes_are_in_metres() -> None:
    vertices, faces = sphere()
    mesh = ProjectedMesh.seen_by(front_camera(), vertices, faces)
    with pytest.raises(InputError, match="millimetres"):
        ProjectedMesh.seen_by(front_camera(), 1000 * vertices, faces)
    share = torch.full((len(vertices),), 80.0)
    with pytest.raises(InputError, match="shares"):
        skin = Texture.plain((9, 9, 9), len(faces))
        render(mesh, skin, BACKGROUND, DAYLIGHT, Visibility(share, share))


def test_ground_is_below_the_mesh() -> None:
    vertices, faces = sphere()
    shade_ground(BACKGROUND, front_camera(), vertices, faces, DAYLIGHT, -0.8, 1, 1)
    with pytest.raises(InputError, match="ground is at"):
        shade_ground(BACKGROUND, front_camera(), vertices, faces, DAYLIGHT, 800.0, 1, 1)
