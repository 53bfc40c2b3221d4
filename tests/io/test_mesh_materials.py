"""Images and colours of meshes without bones."""

import logging
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from gltf_files import one_pixel_png

from perfcap.actor.bare_mesh import BareMesh
from perfcap.errors import InputError
from perfcap.io.mesh import read_mesh
from perfcap.io.mesh_images import MeshImages
from perfcap.io.texture_file import encoded_image
from perfcap.io.vertex_colors import as_bytes, colors_to_texture

SQUARE = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0"]
CORNERS = ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
# in one plane, which is what a texture made of colours of vertices keeps
COLORS = np.array([[200, 40, 30], [120, 60, 60], [60, 120, 90], [140, 100, 60]])


def picture() -> bytes:
    """Four quarters: red, green above blue, white."""
    image = np.zeros((64, 64, 3), np.uint8)
    image[:32, :32, 2] = image[:32, 32:, 1] = image[32:, :32, 0] = image[32:, 32:] = 255
    return bytes(cv2.imencode(".png", image)[1])


def obj(folder: Path, lines: list[str], library: str = "") -> BareMesh:
    (folder / "a.png").write_bytes(picture())
    if library:
        (folder / "a.mtl").write_text(library)
    (folder / "a.obj").write_text("\n".join(["mtllib a.mtl", *lines]) + "\n")
    return read_mesh(folder / "a.obj")


def seen(mesh: BareMesh) -> np.ndarray:
    """RGB of the texture at each vertex."""
    assert mesh.uv is not None and mesh.texture is not None
    image = cv2.imdecode(np.frombuffer(mesh.texture, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    height, width = image.shape[:2]
    column, row = np.floor(mesh.uv * (width, height)).astype(int).T
    return np.asarray(image[row % height, column % width, ::-1], int)


@pytest.mark.parametrize(
    ("options", "uv"),
    [
        ("", [[0, 1], [1, 1], [1, 0], [0, 0]]),
        ("-blendu on -mm 0 1 -texres 512", [[0, 1], [1, 1], [1, 0], [0, 0]]),
        ("-s 0.5 0.25 1", [[0, 1], [0.5, 1], [0.5, 0.75], [0, 0.75]]),
        ("-s 0.5", [[0, 1], [0.5, 1], [0.5, 0], [0, 0]]),
        ("-o 0.5 0.25 0 -s .5 .5 1", [[0.5, 0.75], [1, 0.75], [1, 0.25], [0.5, 0.25]]),
        ("-o 0.5 -clamp on", [[0.5, 1], [511 / 512, 1], [511 / 512, 0], [0.5, 0]]),
    ],
)
@pytest.mark.parametrize("name", ["a.png", "a b.png"])
def test_options_place_an_image(
    options: str, uv: list[list[float]], name: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(picture())
    lines = [*SQUARE, *CORNERS, "usemtl skin", "f 1/1 2/2 3/3 4/4"]
    mesh = obj(tmp_path, lines, f"newmtl skin\nmap_Kd {options} {name}\n")
    assert mesh.uv is not None
    np.testing.assert_allclose(mesh.uv, np.array(uv))
    assert mesh.texture == picture()


def test_photographs_are_read_as_their_pixels_are_stored(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    code = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (8, 24, 3), np.uint8))
    data = code[1].tobytes()
    for turn in (1, 6):
        tags = struct.pack(">2sHIHHHIHHI", b"MM", 42, 8, 1, 0x0112, 3, 1, turn, 0, 0)
        exif = b"Exif\0\0" + tags
        photograph = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
        (tmp_path / "p.jpg").write_bytes(photograph)
        lines = [*SQUARE, *CORNERS, "usemtl skin", "f 1/1 2/2 3/3 4/4"]
        with caplog.at_level(logging.WARNING):
            mesh = obj(tmp_path, lines, "newmtl skin\nmap_Kd p.jpg\n")
        assert mesh.texture == (photograph if turn == 1 else data)
        assert ("its EXIF orientation is left out" in caplog.text) == (turn == 6)


def test_marks_of_the_byte_order_and_other_cases_of_letters(tmp_path: Path) -> None:
    lines = [*SQUARE, *CORNERS, "usemtl skin", "f 1/1 2/2 3/3 4/4"]
    mesh = obj(tmp_path, lines, "\ufeffnewmtl skin\nmap_kd a.png\n")
    assert mesh.texture == picture()
    (tmp_path / "a.obj").write_text("\ufeff" + "\n".join(["mtllib a.mtl", *lines]))
    assert read_mesh(tmp_path / "a.obj").texture == picture()


def test_an_unknown_option_leaves_the_name(tmp_path: Path) -> None:
    lines = [*SQUARE, *CORNERS, "usemtl skin", "f 1/1 2/2 3/3 4/4"]
    mesh = obj(tmp_path, lines, "newmtl skin\nmap_Kd -what 3 4 a.png\n")
    assert mesh.texture == picture()


def test_each_piece_of_an_obj_finds_its_copy_of_an_image(tmp_path: Path) -> None:
    places = [*SQUARE, "v 2 0 0", "v 3 0 0", "v 3 1 0", "v 2 1 0"]
    corners = ["vt 0.1 0.6", "vt 0.4 0.6", "vt 0.4 0.9", "vt 0.1 0.9"]
    corners += ["vt 1.6 0.6", "vt 1.9 0.6", "vt 1.9 0.9", "vt 1.6 0.9"]
    faces = ["usemtl skin", "f 1/1 2/2 3/3 4/4", "f 5/5 6/6 7/7 8/8", "usemtl grey", "f 1 2 3"]
    library = "newmtl skin\nmap_Kd a.png\nnewmtl grey\nKd 0.5\n"
    mesh = obj(tmp_path, [*places, *corners, *faces], library)
    at = {
        tuple(place): color for place, color in zip(mesh.vertices.tolist(), seen(mesh), strict=True)
    }
    np.testing.assert_array_equal(at[3, 1, 0], [0, 255, 0])
    np.testing.assert_array_equal(at[2, 0, 0], [0, 255, 0])
    np.testing.assert_array_equal(at[0, 1, 0], [255, 0, 0])
    np.testing.assert_allclose(at[1, 1, 0], [188, 188, 188])  # sRGB of half the light


def test_faces_without_coordinates_keep_the_image_of_the_others(tmp_path: Path) -> None:
    lines = [*SQUARE, *CORNERS, "usemtl skin", "f 1/1 2/2 3/3", "f 1 3 4"]
    mesh = obj(tmp_path, lines, "newmtl skin\nKd 0 0 1\nmap_Kd a.png\n")
    at = [tuple(color) for color in seen(mesh)]
    assert at.count((0, 0, 255)) >= 3  # those of the second face
    assert (0, 255, 0) in at


@pytest.mark.parametrize(
    ("library", "message"),
    [
        ("", "a.mtl' is not beside"),
        ("newmtl other\nKd 1 0 0\n", "'skin' are in no material library"),
        ("newmtl skin\nmap_Kd a.tga\n", "neither JPEG nor PNG"),
    ],
)
def test_what_is_missing_is_said(
    library: str, message: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "a.tga").write_bytes(bytes(64))
    lines = [*SQUARE, *CORNERS, "usemtl skin", "f 1/1 2/2 3/3 4/4"]
    with caplog.at_level(logging.WARNING):
        mesh = obj(tmp_path, lines, library)
    assert mesh.texture is None
    assert message in caplog.text


def test_nothing_is_said_of_a_mesh_without_materials(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "a.obj").write_text("\n".join([*SQUARE, "usemtl skin", "f 1 2 3 4"]))
    with caplog.at_level(logging.WARNING):
        assert read_mesh(tmp_path / "a.obj").texture is None
    assert not caplog.text


@pytest.mark.parametrize("white", [1, 255, 65535])
def test_colours_of_the_vertices_of_an_obj(white: int, tmp_path: Path) -> None:
    values = COLORS / 255 * white
    lines = [f"{v} {r:.6f} {g:.6f} {b:.6f}" for v, (r, g, b) in zip(SQUARE, values, strict=True)]
    mesh = obj(tmp_path, [*lines, "f 1 2 3 4"], "newmtl none\n")
    assert np.abs(seen(mesh) - COLORS).max() <= 2


@pytest.mark.parametrize("white", [False, True])
def test_colours_of_vertices_count_before_a_plain_colour(white: bool, tmp_path: Path) -> None:
    values = np.full((4, 3), 255) if white else COLORS
    lines = [f"{v} {r} {g} {b}" for v, (r, g, b) in zip(SQUARE, values / 255, strict=True)]
    mesh = obj(tmp_path, [*lines, "usemtl skin", "f 1 2 3 4"], "newmtl skin\nKd 1 0 0\n")
    expected = np.tile([255, 0, 0], (4, 1)) if white else COLORS
    assert np.abs(seen(mesh) - expected).max() <= 2


def ply(folder: Path, kind: str, values: np.ndarray, *more: str) -> BareMesh:
    head = ["ply", "format ascii 1.0", *more, "element vertex 4"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"property {kind} {name}" for name in ("red", "green", "blue")]
    head += ["property float s", "property float t"]
    head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    rows = [
        f"{place[2:]} {' '.join(map(str, color))} {corner[3:]}"
        for place, color, corner in zip(SQUARE, values.tolist(), CORNERS, strict=True)
    ]
    (folder / "a.ply").write_text("\n".join([*head, *rows, "4 0 1 2 3"]) + "\n")
    (folder / "a b.png").write_bytes(picture())
    return read_mesh(folder / "a.ply")


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("uchar", COLORS),
        ("int", COLORS),
        ("ushort", COLORS * 257),
        ("float", COLORS / 255),
        ("float", COLORS * 1.0),
    ],
)
def test_colours_of_a_ply_in_any_range(kind: str, values: np.ndarray, tmp_path: Path) -> None:
    mesh = ply(tmp_path, kind, values)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [2, 3, 0]])
    assert np.abs(seen(mesh) - COLORS).max() <= 2


def test_a_ply_has_the_image_that_it_names(tmp_path: Path) -> None:
    mesh = ply(tmp_path, "uchar", COLORS, "comment made by hand", "comment TextureFile a b.png")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.uv, [[0, 1], [1, 1], [1, 0], [0, 0]])
    assert mesh.texture == picture()


def test_corners_of_a_ply_with_coordinates_of_their_own(tmp_path: Path) -> None:
    head = ["ply", "format ascii 1.0", "comment TextureFile a.png", "element vertex 4"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"property uchar {name}" for name in ("red", "green", "blue")]
    head += ["element face 2", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord", "end_header"]
    faces = ["3 0 1 2 6 0.1 0.6 0.4 0.6 0.4 0.9", "3 0 2 3 6 0.6 0.1 0.9 0.4 0.6 0.4"]
    (tmp_path / "a.png").write_bytes(one_pixel_png())
    text = "\n".join([*head, *(f"{line[2:]} 9 9 9" for line in SQUARE), *faces]) + "\n"
    (tmp_path / "a.ply").write_text(text)
    mesh = read_mesh(tmp_path / "a.ply")
    assert mesh.uv is not None and mesh.texture == one_pixel_png()
    places = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], places)
    expected = [[[0.1, 0.4], [0.4, 0.4], [0.4, 0.1]], [[0.6, 0.9], [0.9, 0.6], [0.6, 0.6]]]
    np.testing.assert_allclose(mesh.uv[mesh.faces], expected, atol=1e-6)


def test_several_images_of_a_ply_are_said_to_be_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    names = ("comment TextureFile a.png", "comment TextureFile b.png")
    with caplog.at_level(logging.WARNING):
        mesh = ply(tmp_path, "uchar", COLORS, *names)
    assert "names 2 images" in caplog.text
    assert np.abs(seen(mesh) - COLORS).max() <= 2  # those of the vertices


def test_lists_are_no_colours(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read as PLY"):
        ply(tmp_path, "list uchar float", COLORS)


def test_two_numbers_are_no_colour(tmp_path: Path) -> None:
    head = ["ply", "format ascii 1.0", f"element vertex {len(SQUARE)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"property {kind}" for kind in ("uchar green", "uchar blue", "list uchar float alpha")]
    head += ["element face 1"]
    head += ["property list uchar int vertex_indices", "end_header"]
    rows = [f"{line[2:]} 9 9 0" for line in SQUARE]  # lists without a number
    (tmp_path / "a.ply").write_text("\n".join([*head, *rows, "3 0 1 2"]) + "\n")
    with pytest.raises(InputError, match=r"cannot be read as PLY .*colours are"):
        read_mesh(tmp_path / "a.ply")


def test_a_vertex_alone_has_a_colour() -> None:
    uv, texture = colors_to_texture(np.array([[10, 200, 30]], np.uint8))
    image = cv2.imdecode(np.frombuffer(texture, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    column, row = np.floor(uv * 256).astype(int)[0]
    np.testing.assert_array_equal(image[row, column], [10, 200, 30])


def test_a_texture_whose_chunks_promise_more_is_damaged(tmp_path: Path) -> None:
    """OpenCV makes room for what a chunk says that it has, before it reads that."""
    whole = picture()
    at = whole.index(b"IDAT") - 4
    spoilt = whole[:at] + struct.pack(">I", 1 << 30) + whole[at + 4 :]
    for data, damaged in ((whole, False), (spoilt, True)):
        (tmp_path / "a.png").write_bytes(data)
        source = MeshImages(tmp_path / "a.obj", ("a.png",))
        if damaged:
            with pytest.raises(InputError, match="image 0 is damaged"):
                encoded_image(source, 0, [])
        else:
            assert encoded_image(source, 0, []) == data


def test_images_of_a_ply_stay_in_its_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="outside its folder"):
        ply(tmp_path, "uchar", COLORS, "comment TextureFile ../a.png")


@pytest.mark.parametrize("value", [np.nan, np.inf, -3.0, 70000.0])
def test_impossible_colours_are_refused(value: float) -> None:
    with pytest.raises(InputError, match="it says"):
        as_bytes(np.array([[0.5, value, 0.5]]), "it says")


def test_colours_a_little_beyond_white_and_black_are_cut_off() -> None:
    found = as_bytes(np.array([[1.02, -1e-6, 0.5, 1.0]]), "it says")
    np.testing.assert_array_equal(found, [[255, 0, 128]])
