"""Colours that a glTF file has at its vertices or for a whole material, as a texture."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from gltf_files import Builder, armature_file, one_pixel_png

from perfcap.errors import InputError
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import load_template, read_character
from perfcap.io.mesh import read_mesh
from perfcap.io.vertex_colors import to_linear, to_srgb

COLORS = np.array([[1.0, 0, 0], [0.5, 0, 0.1], [0.2, 0, 0.2], [0, 0, 1]])
SHOWN = [[255, 0, 0], [188, 0, 89], [124, 0, 124], [0, 0, 255]]  # as sRGB


def bare(folder: Path, colors: object, dtype: str = "f4", **extra: object) -> Path:
    """Two triangles without a skin."""
    builder = Builder()
    corners = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    attributes = {"POSITION": builder.add(corners)}
    attributes["COLOR_0"] = builder.add(colors, dtype, **extra)
    primitive = {"attributes": attributes, "indices": builder.add([0, 1, 2, 0, 2, 3], "u2")}
    builder.tree |= {"nodes": [{"mesh": 0}], "meshes": [{"primitives": [primitive]}]}
    return builder.write_gltf(folder / "a.gltf")


def seen(texture: bytes | None, uv: np.ndarray | None) -> np.ndarray:
    assert texture is not None and uv is not None
    image = cv2.imdecode(np.frombuffer(texture, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    column, row = np.floor(uv * 256).astype(int).T
    return image[row, column].astype(int)


def test_shades_come_back() -> None:
    shades = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(to_srgb(to_linear(shades)), shades)


@pytest.mark.parametrize(("dtype", "largest"), [("f4", 1), ("u1", 255), ("u2", 65535)])
@pytest.mark.parametrize("alpha", [False, True])
def test_a_scan_wears_the_colours_of_its_vertices(
    dtype: str, largest: int, alpha: bool, tmp_path: Path
) -> None:
    values = np.c_[COLORS, np.full(4, 0.5)] if alpha else COLORS
    extra = {} if dtype == "f4" else {"normalized": True}
    mesh = read_mesh(bare(tmp_path, np.round(values * largest, 6), dtype, **extra))
    assert np.abs(seen(mesh.texture, mesh.uv) - SHOWN).max() <= 4


def test_a_character_wears_them_too_times_its_colour(tmp_path: Path) -> None:
    builder = armature_file()
    first, second = builder.tree["meshes"][0]["primitives"]
    first["attributes"]["COLOR_0"] = builder.add(2 * COLORS)  # more than white is white
    second["attributes"]["COLOR_0"] = builder.add(np.ones((3, 3)))
    surface = {"baseColorFactor": [1.0, 1.0, 0.0, 1.0]}
    builder.tree["materials"] = [{"pbrMetallicRoughness": surface}]
    first["material"] = second["material"] = 0
    template = load_template(builder.write_gltf(tmp_path / "a.gltf"))
    image = cv2.imdecode(np.frombuffer(template.texture or b"", np.uint8), cv2.IMREAD_COLOR)
    height, width = image.shape[:2]
    assert template.uv is not None
    column, row = np.floor(template.uv * (width, height)).astype(int).T
    shown = image[row, column, ::-1].astype(int)
    assert np.abs(shown[:4] - [[255, 0, 0], [255, 0, 0], [170, 0, 0], [0, 0, 0]]).max() <= 4
    np.testing.assert_array_equal(shown[4:], [[255, 255, 0]] * 3)


def test_white_is_no_texture(tmp_path: Path) -> None:
    assert read_mesh(bare(tmp_path, np.ones((4, 4)))).texture is None


def test_a_base_colour_beside_an_image(tmp_path: Path) -> None:
    """The image is white, and so are none of its vertices, which count where there is none."""
    builder = armature_file()
    primitive = builder.tree["meshes"][0]["primitives"].pop(0)
    builder.tree["meshes"][0]["primitives"] = [primitive]
    primitive["attributes"]["TEXCOORD_0"] = builder.add(np.full((4, 2), 0.5))
    primitive["attributes"]["COLOR_0"] = builder.add(COLORS)
    primitive["material"] = 0
    (tmp_path / "white.png").write_bytes(
        cv2.imencode(".png", np.full((2, 2, 3), 255, np.uint8))[1].tobytes()
    )
    surface = {"baseColorFactor": [0.5, 0.1, 2.0, 1.0], "baseColorTexture": {"index": 0}}
    builder.tree |= {
        "materials": [{"pbrMetallicRoughness": surface}],
        "textures": [{"source": 0}],
        "images": [{"uri": "white.png"}],
    }
    found = read_character(open_document(builder.write_gltf(tmp_path / "a.gltf")))
    assert (seen_at_once(found.template.texture) == [188, 89, 255]).all()
    assert any("multiplied by the base colours" in each.what for each in found.findings)
    (tmp_path / "white.png").write_bytes(one_pixel_png())
    surface["baseColorFactor"] = [1.0, 1.0, 1.0, 1.0]
    found = read_character(open_document(builder.write_gltf(tmp_path / "a.gltf")))
    assert found.template.texture == one_pixel_png() and not found.findings


def seen_at_once(texture: bytes | None) -> np.ndarray:
    assert texture is not None
    return cv2.imdecode(np.frombuffer(texture, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


@pytest.mark.parametrize(
    ("colors", "dtype", "message"),
    [
        (COLORS[:3], "f4", "3 colours for 4 vertices"),
        (COLORS[:, :2], "f4", "have type 'VEC2'; expected VEC3 or VEC4"),
        (255 * COLORS, "u1", "uint8 that are not normalized"),
        (np.full((4, 3), np.nan), "f4", "NaN or infinity"),
    ],
)
def test_damaged_colours_are_refused(
    colors: np.ndarray, dtype: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=rf"a\.gltf: .*{message}"):
        read_mesh(bare(tmp_path, colors, dtype))
