from __future__ import annotations

import pytest
import torch
import trimesh
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera, look_at
from perfcap.render.lighting import FLAT, Lighting
from perfcap.render.projected_mesh import ProjectedMesh, vertex_normals
from perfcap.render.shading import _gather, _gather_compiled, render
from perfcap.render.shadow import Visibility
from perfcap.render.texture import Texture, to_linear, to_srgb

SIZE = (40, 56)
BACKGROUND = torch.randint(
    0, 256, (*SIZE, 3), dtype=torch.uint8, generator=torch.Generator().manual_seed(0)
)


def front_camera(distance: float = 5.0, focal: float = 100.0) -> Camera:
    eye, origin, up = torch.tensor([[0.0, 0, distance], [0, 0, 0], [0, 1, 0]]).double()
    rotation, translation = look_at(eye, origin, up)
    middle = torch.tensor([[focal, 0, 27.5], [0, focal, 19.5], [0, 0, 1]]).double()
    return Camera(middle[None], rotation[None], translation[None], None, (SIZE,))


def sphere() -> tuple[Tensor, Tensor]:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.7)
    return torch.tensor(mesh.vertices.copy()), torch.tensor(mesh.faces.copy())


def square() -> tuple[Tensor, Tensor, Tensor]:
    """A unit square that faces the camera: vertices, faces, uv with the origin at the top left."""
    vertices = torch.tensor([[-1.0, 0.7, 0], [1, 0.7, 0], [1, -0.7, 0], [-1, -0.7, 0]]).double()
    uv = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    return vertices, torch.tensor([[0, 2, 1], [0, 3, 2]]), uv


@pytest.mark.parametrize("supersampling", [1, 2, 3])
def test_constant_texture_under_flat_light_keeps_its_colour(supersampling: int) -> None:
    vertices, faces = sphere()
    mesh = ProjectedMesh.seen_by(front_camera(), vertices, faces)
    texture = Texture.plain((200, 13, 90), len(faces))
    picture = render(mesh, texture, BACKGROUND, FLAT, supersampling=supersampling)
    inside = picture.coverage == 1
    assert inside.sum() > 300
    assert (picture.image[inside] == torch.tensor([200, 13, 90], dtype=torch.uint8)).all()
    assert torch.equal(picture.image[picture.coverage == 0], BACKGROUND[picture.coverage == 0])


def test_supersampling_leaves_the_silhouette_in_place() -> None:
    vertices, faces = sphere()
    mesh = ProjectedMesh.seen_by(front_camera(), vertices, faces)
    texture = Texture.plain((9, 9, 9), len(faces))
    coarse, fine = (
        render(mesh, texture, BACKGROUND, FLAT, supersampling=n).coverage for n in (1, 4)
    )
    assert torch.equal(fine, fine.flip(0))
    assert torch.equal(fine, fine.flip(1))
    assert fine.sum() == pytest.approx(coarse.sum().item(), rel=0.01)
    assert ((fine > 0) & (fine < 1)).sum() > 50


def test_texture_is_upright_and_not_mirrored() -> None:
    vertices, faces, uv = square()
    corners = torch.tensor(
        [[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], dtype=torch.uint8
    )
    image = corners.repeat_interleave(20, 0).repeat_interleave(20, 1)
    mesh = ProjectedMesh.seen_by(front_camera(), vertices, faces)
    seen = render(mesh, Texture.from_image(image, uv, faces), BACKGROUND, FLAT).image
    for row, column, color in ((9, 13, 0), (9, 42, 1), (30, 13, 2), (30, 42, 3)):
        assert torch.equal(seen[row, column], corners.view(4, 3)[color])


def test_texture_is_perspective_correct() -> None:
    vertices, faces, uv = square()
    vertices = vertices.clone()
    vertices[:, 2] = 2 * vertices[:, 0]  # the right side comes 4 m nearer
    camera = front_camera()
    mesh = ProjectedMesh.seen_by(camera, vertices, faces)
    ramp = torch.arange(256, dtype=torch.uint8).expand(256, 256)[..., None].expand(-1, -1, 3)
    picture = render(mesh, Texture.from_image(ramp, uv, faces), BACKGROUND, FLAT, supersampling=1)
    points = torch.stack([torch.linspace(-0.9, 0.4, 9)] * 3, -1).double()
    points[:, 1], points[:, 2] = 0, 2 * points[:, 0]
    where = camera.project(points[None])[0, 0].round().long()
    rays = (where[:, 0] - 27.5) / 100  # x = ray * (5 - 2 x)
    exact = ((5 * rays / (1 + 2 * rays) + 1) / 2 * 255).double()
    found = picture.image[where[:, 1], where[:, 0], 0].double()
    torch.testing.assert_close(found, exact, rtol=0, atol=2.5)


def test_a_surface_facing_the_sun_is_brighter() -> None:
    vertices, faces = sphere()
    mesh = ProjectedMesh.seen_by(front_camera(), vertices, faces)
    light = Lighting(towards_sun=(1.0, 0.0, 0.2), sky=(0.0, 0.0, 0.0))
    image = render(mesh, Texture.plain((128, 128, 128), len(faces)), BACKGROUND, light).image
    assert image[20, 37, 0] > image[20, 28, 0] > image[20, 18, 0]


def test_cloth_is_lit_alike_on_both_sides() -> None:
    vertices, faces, _ = square()
    light = Lighting(towards_sun=(0.0, 0.0, 1.0))
    front, back = (
        render(
            ProjectedMesh.seen_by(front_camera(), vertices, winding),
            Texture.plain((99, 99, 99), 2),
            BACKGROUND,
            light,
        ).image[20, 28]
        for winding in (faces, faces.flip(-1))
    )
    assert torch.equal(front, back)


def test_minified_texture_is_averaged() -> None:
    vertices, faces, uv = square()
    checker = (torch.arange(1024)[:, None] + torch.arange(1024)) % 2 * 255
    image = checker.to(torch.uint8)[..., None].expand(-1, -1, 3)
    mesh = ProjectedMesh.seen_by(front_camera(), vertices, faces)
    seen = render(mesh, Texture.from_image(image, uv, faces), BACKGROUND, FLAT).image
    assert (seen[10:30, 14:42].int() - 188).abs().max() <= 1  # half the light is sRGB 188


def test_srgb_round_trip() -> None:
    every = torch.arange(256, dtype=torch.uint8)
    assert torch.equal(to_srgb(to_linear(every)), every)
    assert to_srgb(torch.tensor([-1.0, 7.0])).tolist() == [0, 255]


def test_normals_of_a_sphere_point_outwards() -> None:
    vertices, faces = sphere()
    normals = vertex_normals(vertices, faces)
    assert ((normals * vertices).sum(-1) / vertices.norm(dim=-1)).min() > 0.999


def test_a_vertex_without_a_face_has_no_normal() -> None:
    vertices, faces, _ = square()
    lonely = torch.cat([vertices, torch.ones(1, 3).double()])
    assert not vertex_normals(lonely, faces)[-1].any()


def test_a_lost_vertex_leaves_the_rest_of_the_picture() -> None:
    vertices, faces = sphere()
    lost = vertices.clone()
    lost[3] = torch.nan
    texture = Texture.plain((200, 13, 90), len(faces))
    whole, torn = (
        render(ProjectedMesh.seen_by(front_camera(), points, faces), texture, BACKGROUND, FLAT)
        for points in (vertices, lost)
    )
    same = torn.coverage == whole.coverage
    assert same.double().mean() > 0.95
    assert torch.equal(torn.image[same], whole.image[same])


def test_an_empty_view_shows_the_background() -> None:
    vertices, faces = sphere()
    mesh = ProjectedMesh.seen_by(front_camera(), vertices + 100, faces)
    picture = render(mesh, Texture.plain((1, 2, 3), len(faces)), BACKGROUND)
    assert torch.equal(picture.image, BACKGROUND)


def test_bad_input_is_named() -> None:
    vertices, faces, uv = square()
    mesh = ProjectedMesh.seen_by(front_camera(), vertices, faces)
    texture = Texture.plain((1, 2, 3), 2)
    with pytest.raises(InputError, match="background"):
        render(mesh, texture, BACKGROUND[1:])
    with pytest.raises(InputError, match="supersampling"):
        render(mesh, texture, BACKGROUND, supersampling=0)
    with pytest.raises(InputError, match="texture"):
        Texture.from_image(torch.zeros(4, 4, 3), uv, faces)
    with pytest.raises(InputError, match="texture"):
        render(mesh, Texture.plain((1, 2, 3), 5), BACKGROUND)
    two = Camera(*(torch.eye(3).expand(2, 3, 3),) * 2, torch.zeros(2, 3), None, (SIZE, SIZE))
    with pytest.raises(InputError, match="camera"):
        ProjectedMesh.seen_by(two, vertices.float(), faces)


@pytest.mark.parametrize("step", [1, 2, 3])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_compiled_shading_equals_its_twin(step: int, dtype: torch.dtype) -> None:
    random = torch.Generator().manual_seed(step)
    vertices, faces = sphere()
    vertices = (vertices + 0.05 * torch.randn(vertices.shape, generator=random)).to(dtype)
    image = torch.randint(0, 256, (70, 90, 3), dtype=torch.uint8, generator=random)
    uv = 3 * torch.rand(len(vertices), 2, generator=random) - 1  # repeats, on both sides of zero
    texture = Texture.from_image(image, uv, faces)
    reached = Visibility(*torch.rand(2, len(vertices), generator=random).to(dtype))
    fine = ProjectedMesh.seen_by(front_camera(3.5), vertices, faces).enlarged(step)
    for arrived in (reached, None):
        light, coverage = _gather_compiled(fine, texture, Lighting(), arrived, step)
        expected, share = _gather(fine, texture, Lighting(), arrived, step)
        torch.testing.assert_close(coverage, share, atol=1e-6, rtol=0)
        torch.testing.assert_close(light, expected.float(), atol=2e-4, rtol=0)
        assert 0 < coverage.mean() < 1


def test_a_mesh_out_of_sight_leaves_the_background() -> None:
    vertices, faces = sphere()
    texture = Texture.plain((1, 2, 3), len(faces))
    for away in ((0.0, 0.0, 9.0), (50.0, 0.0, 0.0), (torch.nan, 0.0, 0.0)):
        mesh = ProjectedMesh.seen_by(front_camera(), vertices + vertices.new_tensor(away), faces)
        picture = render(mesh, texture, BACKGROUND)
        assert torch.equal(picture.image, BACKGROUND) and not picture.coverage.any()


@pytest.mark.parametrize("corner", [-1, 3])
def test_texture_faces_that_index_no_corner(corner: int) -> None:
    image = torch.zeros(4, 4, 3, dtype=torch.uint8)
    with pytest.raises(InputError, match="texture faces names uv"):
        Texture.from_image(image, torch.zeros(3, 2), torch.tensor([[0, 1, corner]]))


@pytest.mark.parametrize("far", [torch.nan, torch.inf, 1e30])
def test_uv_that_are_nowhere_are_refused(far: float) -> None:
    """Compiled loops looked for texels there, and the process died."""
    image, faces = torch.zeros(64, 64, 3, dtype=torch.uint8), torch.tensor([[0, 1, 2]])
    with pytest.raises(InputError, match="not numbers or beyond a million"):
        Texture.from_image(image, torch.full((3, 2), far), faces)
    Texture.from_image(image, torch.tensor([[0.0, 0], [1, 0], [1, 1], [far, 0]]), faces)


def test_textures_of_other_shapes_are_refused() -> None:
    level, uv, faces = torch.zeros(8, 8, 3), torch.zeros(3, 2), torch.tensor([[0, 1, 2]])
    for given, message in (
        (((level,), uv, faces - 1), "texture faces names uv -1 to 1"),
        (((level,), uv, faces[:, :2]), "texture faces has shape"),
        (((level[..., :1],), uv, faces), "texture level has shape"),
        (((), uv, faces), "texture has no image"),
    ):
        with pytest.raises(InputError, match=message):
            Texture(*given)


def test_light_at_other_vertices_is_refused() -> None:
    vertices, faces = sphere()
    mesh = ProjectedMesh.seen_by(front_camera(), vertices, faces)
    few, texture = Visibility(torch.ones(1), torch.ones(1)), Texture.plain((9, 9, 9), len(faces))
    with pytest.raises(InputError, match="reached sun has shape"):
        render(mesh, texture, BACKGROUND, reached=few)


def test_fractions_are_no_srgb_values() -> None:
    """They were all black."""
    with pytest.raises(InputError, match=r"^color is torch.float32, expected uint8"):
        to_linear(torch.rand(2, 2, 3))
