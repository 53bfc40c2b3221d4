"""What hangs on a skeleton, and what only seems to."""

import base64
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from gltf_files import Builder, armature_file, one_pixel_png

from perfcap.errors import InputError
from perfcap.io.actor_import import require_sound
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_part import Part, _normalized
from perfcap.io.gltf_read import Character, read_character
from perfcap.io.gltf_texture import Material


def character(builder: Builder, folder: Path) -> Character:
    return read_character(open_document(builder.write_gltf(folder / "a.gltf")))


def add_node(builder: Builder, points: object, parent: int | None, **node: Any) -> None:
    """A triangle in a mesh of its own."""
    tree = builder.tree
    mesh = {"name": "hat", "primitives": [{"attributes": {"POSITION": builder.add(points)}}]}
    tree["meshes"].append(mesh)
    tree["nodes"].append({"mesh": len(tree["meshes"]) - 1, **node})
    if parent is not None:
        tree["nodes"][parent].setdefault("children", []).append(len(tree["nodes"]) - 1)


TRIANGLE = [[0.0, 0, 0], [5, 0, 0], [0, 0, 5]]


def test_a_hat_on_a_bone_goes_with_it(tmp_path: Path) -> None:
    builder = armature_file()
    add_node(builder, TRIANGLE, 0, translation=[0, 0, 10])
    found = character(builder, tmp_path)
    template = found.template
    np.testing.assert_allclose(
        template.vertices[-3:], [[0, 0.6, 0], [0.05, 0.6, 0], [0, 0.65, 0]], atol=1e-7
    )
    np.testing.assert_array_equal(template.dense_weights()[-3:], [[0, 1]] * 3)
    assert found.parts[-1] == ("hat", 3) and not found.findings


def test_a_hat_on_a_posed_bone_is_put_where_the_rest_pose_has_it(tmp_path: Path) -> None:
    builder = armature_file()
    builder.tree["nodes"][0]["rotation"] = [0.6, 0, 0, 0.8]
    add_node(builder, TRIANGLE, 0, translation=[0, 0, 10])
    template = character(builder, tmp_path).template
    np.testing.assert_allclose(template.vertices[-3], [0, 0.6, 0], atol=1e-6)


def test_a_forgotten_part_is_an_error_and_a_floor_is_not(tmp_path: Path) -> None:
    builder = armature_file()
    struct.pack_into("<f", builder.data, 3 * 12 + 4, 10.0)  # so that the body is not flat
    small = 0.002 * np.array(TRIANGLE)
    add_node(builder, small, None, translation=[0.05, 0.25, -0.05])
    add_node(builder, 10 * np.array(TRIANGLE), None)
    found = character(builder, tmp_path)
    assert len(found.template.vertices) == 7
    forgotten, floor = found.findings
    assert forgotten.severity is Severity.ERROR and "has no weights" in forgotten.what
    assert floor.severity is Severity.WARNING and "left out" in floor.what


def test_rough_weights_are_scaled_and_told(tmp_path: Path) -> None:
    builder = armature_file()
    start = builder.tree["bufferViews"][2]["byteOffset"]
    builder.data[start] = 200  # of 255
    found = character(builder, tmp_path)
    assert "weights of 1 vertices sum to 0.784" in found.findings[0].what
    np.testing.assert_allclose(found.template.weights.sum(1), 1)


def test_a_bare_piece_is_an_error_and_a_bare_vertex_is_not(tmp_path: Path) -> None:
    builder = armature_file()
    start = builder.tree["bufferViews"][2]["byteOffset"]
    builder.data[start] = 0
    (finding,) = character(builder, tmp_path).findings
    assert finding.severity is Severity.WARNING
    for vertex in range(4):
        builder.data[start + 4 * vertex : start + 4 * vertex + 4] = bytes(4)
    more = builder.tree["bufferViews"][4]["byteOffset"]
    builder.data[more : more + 16] = bytes(16)
    found = character(builder, tmp_path)
    assert "whole pieces" in found.findings[0].what
    with pytest.raises(InputError, match="without weights"):
        require_sound(tmp_path / "a.gltf", found.findings)


@pytest.mark.parametrize(("bare", "severity"), [(40, Severity.WARNING), (90, Severity.ERROR)])
def test_a_large_bare_region_of_a_piece_is_a_forgotten_part(bare: int, severity: Severity) -> None:
    rows, columns = np.divmod(np.arange(400), 20)
    vertices = np.stack((rows, columns, 0 * rows), 1).astype(float)
    corner = np.arange(400).reshape(20, 20)[:-1, :-1].ravel()
    faces = np.concatenate(
        [
            np.stack((corner, corner + 1, corner + 20), 1),
            np.stack((corner + 1, corner + 21, corner + 20), 1),
        ]
    )
    weights = np.ones((400, 1))
    weights[:bare] = 0
    nodes = (np.arange(400) // 200)[:, None]
    notes: list[Finding] = []
    part = Part("coat", vertices, faces, nodes, weights, None, Material(None, (1.0, 1.0, 1.0)))
    found = _normalized(part, notes)
    assert [note.severity for note in notes] == [severity]
    assert f"{bare} vertices without weights" in notes[0].what
    np.testing.assert_array_equal(found.weights, 1)


def test_a_primitive_without_weights_is_an_error(tmp_path: Path) -> None:
    builder = armature_file()
    del builder.tree["meshes"][0]["primitives"][1]["attributes"]["JOINTS_0"]
    (finding,) = character(builder, tmp_path).findings
    assert finding.severity is Severity.ERROR and "without weights" in finding.what


def painted(**material: Any) -> Builder:
    """A file with two sets of coordinates, an image, and a material."""
    builder = armature_file()
    uv = np.array([[0, 0], [1, 0], [0, 1], [1, 1.0]])
    tree = builder.tree
    tree["meshes"][0]["primitives"] = tree["meshes"][0]["primitives"][:1]
    (primitive,) = tree["meshes"][0]["primitives"]
    primitive["attributes"] |= {"TEXCOORD_0": builder.add(uv), "TEXCOORD_1": builder.add(uv / 2)}
    png = "data:image/png;base64,"
    tree["images"] = [{"uri": png + base64.b64encode(one_pixel_png()).decode()}]
    tree["textures"] = [{"source": 0}]
    tree["materials"] = [material]
    primitive["material"] = 0
    return builder


def based(**reference: Any) -> Builder:
    return painted(pbrMetallicRoughness={"baseColorTexture": {"index": 0, **reference}})


def test_texture_coordinates_are_transformed(tmp_path: Path) -> None:
    moved = {"offset": [0.5, 0.25], "scale": [0.5, 0.5], "rotation": np.pi / 2}
    builder = based(extensions={"KHR_texture_transform": moved})
    found = character(builder, tmp_path).template
    # the matrix of the extension's text: translation * rotation * scale
    expected = [[0.5, 0.25], [0.5, -0.25], [1.0, 0.25], [1.0, -0.25]]
    np.testing.assert_allclose(found.uv, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("wraps", "expected"),
    [
        ({}, [[1.25, -0.25], [2.25, -0.25], [1.25, 0.75], [2.25, 0.75]]),
        (
            {"wrapS": 10497, "wrapT": 33071},
            [[1.25, 1 / 512], [2.25, 1 / 512], [1.25, 0.75], [2.25, 0.75]],
        ),
        (
            {"wrapS": 33071},
            [[511 / 512, -0.25], [511 / 512, -0.25], [511 / 512, 0.75], [511 / 512, 0.75]],
        ),
        ({"wrapS": 33648}, [[0.75, -0.25], [0.25, -0.25], [0.75, 0.75], [0.25, 0.75]]),
        (
            {"wrapS": 33648, "wrapT": 33648},
            [[0.75, 0.25], [0.25, 0.25], [0.75, 0.75], [0.25, 0.75]],
        ),
    ],
)
def test_images_that_end_or_repeat_in_a_mirror_are_as_in_every_viewer(
    tmp_path: Path, wraps: dict[str, int], expected: list[list[float]]
) -> None:
    builder = based(extensions={"KHR_texture_transform": {"offset": [1.25, -0.25]}})
    builder.tree["samplers"] = [wraps]
    builder.tree["textures"][0]["sampler"] = 0
    found = character(builder, tmp_path).template
    np.testing.assert_allclose(found.uv, expected, atol=1e-6)


def test_a_transform_names_coordinates_of_its_own(tmp_path: Path) -> None:
    builder = based(extensions={"KHR_texture_transform": {"texCoord": 1}})
    found = character(builder, tmp_path).template
    np.testing.assert_allclose(found.uv, [[0, 0], [0.5, 0], [0, 0.5], [0.5, 0.5]], atol=1e-6)


@pytest.mark.parametrize(
    "material",
    [
        {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": {"index": 0}}}},
        {
            "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]},
            "emissiveTexture": {"index": 0},
            "emissiveFactor": [1, 1, 1],
        },
    ],
    ids=["glossiness", "emission"],
)
def test_images_of_other_materials_are_taken(tmp_path: Path, material: dict[str, Any]) -> None:
    assert character(painted(**material), tmp_path).template.texture == one_pixel_png()


@pytest.mark.parametrize(
    ("colors", "expected"),
    [
        ([[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]], None),  # as of what was never painted
        ([[1, 0, 0], [1, 0, 0]], [[255, 0, 0], [255, 0, 0]]),
        ([[1, 1, 1], [0, 0, 0]], [[255, 255, 255], [0, 0, 0]]),
        ([[0, 1, 0], [0, 0, 1]], [[0, 255, 0], [0, 0, 255]]),
    ],
)
def test_colours_alone_are_a_texture(
    tmp_path: Path, colors: list[list[float]], expected: list[list[int]] | None
) -> None:
    builder = armature_file()
    builder.tree["materials"] = [
        {"pbrMetallicRoughness": {"baseColorFactor": [*color, 1]}} for color in colors
    ]
    primitives = builder.tree["meshes"][0]["primitives"]
    for number, primitive in enumerate(primitives):
        primitive["material"] = number
    found = character(builder, tmp_path).template
    if expected is None:
        assert found.texture is None
        return
    assert found.texture is not None and found.uv is not None
    image = cv2.imdecode(np.frombuffer(found.texture, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    height, width = image.shape[:2]
    column, row = np.floor(found.uv * (width, height)).astype(int).T
    seen = image[row, column, ::-1]
    np.testing.assert_array_equal(seen[0], expected[0])
    np.testing.assert_array_equal(seen[-1], expected[1])


def test_an_image_in_an_extension_s_format_is_named(tmp_path: Path) -> None:
    builder = based()
    webp = base64.b64encode(b"RIFF\0\0\0\0WEBP").decode()
    builder.tree["images"] = [{"uri": f"data:image/webp;base64,{webp}"}]
    builder.tree["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
    (finding,) = character(builder, tmp_path).findings
    assert finding.severity is Severity.WARNING and "neither JPEG nor PNG" in finding.what
