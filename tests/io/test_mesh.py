"""Meshes without bones."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from gltf_files import armature_file, one_pixel_png

from perfcap.errors import InputError
from perfcap.io.mesh import read_mesh

QUAD = """# a square of two materials
mtllib skin.mtl
v 0 0 0
v 1 0 0  # comment
v 1 1 0
v 0 1 0
v 9 9 9
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl skin
f 1/1 2/2 3/3 4/4
"""
LISTS = (  # a vertex whose first number is two
    b"ply\nformat ascii 1.0\nelement vertex 3\nproperty list uchar float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    b"2 5 0 0 0\n1 1 0 0\n1 1 1 0\n3 0 1 2\n"
)


def obj(folder: Path, text: str = QUAD, library: str = "newmtl skin\nmap_Kd skin.png\n") -> Path:
    (folder / "skin.mtl").write_text(library)
    (folder / "skin.png").write_bytes(one_pixel_png())
    path = folder / "a.obj"
    path.write_text(text)
    return path


def test_an_obj_keeps_its_order(tmp_path: Path) -> None:
    mesh = read_mesh(obj(tmp_path))
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(mesh.uv, [[0, 1], [1, 1], [1, 0], [0, 0]])
    assert mesh.texture == one_pixel_png()
    assert mesh.name == "a"


def test_seams_split_vertices(tmp_path: Path) -> None:
    mesh = read_mesh(obj(tmp_path, QUAD + "f 1/4 3/3 4/4\n"))
    assert len(mesh.vertices) == 5
    np.testing.assert_array_equal(mesh.vertices[0], mesh.vertices[1])


def test_indices_may_count_backwards_and_lack_textures(tmp_path: Path) -> None:
    mesh = read_mesh(obj(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nf 1//1 2//1 3//1\n"))
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 1, 2]])
    assert mesh.uv is None and mesh.texture is None


def test_colours_become_a_texture_beside_images(tmp_path: Path) -> None:
    text = QUAD + "usemtl red\nf 1/1 2/2 4/4\n"
    mesh = read_mesh(obj(tmp_path, text, "newmtl skin\nmap_Kd skin.png\nnewmtl red\nKd 1 0 0\n"))
    assert mesh.texture is not None and mesh.texture != one_pixel_png()
    assert len(mesh.vertices) == 7


@pytest.mark.parametrize(
    ("text", "library", "message"),
    [
        (QUAD, "newmtl skin\nmap_Kd ../secret.png", "outside its folder"),
        (QUAD, "newmtl skin\nmap_Kd /etc/hostname", "outside its folder"),
        (QUAD, "newmtl skin\nmap_Kd none.png", "none.png: no such file"),
        (QUAD, f"newmtl skin\nmap_Kd {'a' * 300}.png", "png: cannot be opened"),
        ("mtllib ../a.mtl\n" + QUAD, "", "outside its folder"),
        ("v 0 0 0\n", "", "has no faces"),
        ("v 0 0 0\nf 1 2 3\n", "", "line 2"),
        ("v 0 0 0\nf 0 1 1\n", "", "line 2"),
        ("v 0 0 0\nf 1 1\n", "", "line 2"),
        ("v 0 x 0\n", "", "line 1"),
        ("v 0 0\nv 0 0 0\nf 1 2 2\n", "", "fewer than three"),
        ("v nan 0 0\nf 1 1 1\n", "", "finite"),
        ("", "", "is empty"),
    ],
)
def test_bad_objs_are_refused(tmp_path: Path, text: str, library: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(obj(tmp_path, text, library))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["ply", "stl"])
def test_scans_are_read(tmp_path: Path, kind: str) -> None:
    box = trimesh.creation.box()
    path = tmp_path / f"scan.{kind}"
    box.export(path)
    mesh = read_mesh(path)
    assert len(mesh.vertices) == 8 and len(mesh.faces) == 12
    if kind == "ply":
        np.testing.assert_allclose(mesh.vertices, box.vertices)
        np.testing.assert_array_equal(mesh.faces, box.faces)


def test_colours_of_vertices_become_a_texture(tmp_path: Path) -> None:
    colors = np.array([[250, 40, 30], [20, 20, 120], [230, 220, 210], [128, 90, 110]], np.uint8)
    faces = [[0, 1, 2], [0, 2, 3]]
    places = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    solid = trimesh.Trimesh(places, faces, vertex_colors=colors, process=False)
    solid.export(tmp_path / "a.ply")
    mesh = read_mesh(tmp_path / "a.ply")
    np.testing.assert_array_equal(mesh.vertices, places)
    assert mesh.uv is not None and mesh.texture is not None
    image = cv2.imdecode(np.frombuffer(mesh.texture, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    column, row = np.floor(mesh.uv * 256).astype(int).T
    assert np.abs(image[row, column].astype(int) - colors).max() < 25  # off the nearest plane


def test_a_library_whose_name_no_file_can_have_is_missing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    obj(tmp_path, QUAD.replace("skin.mtl", "a" * 300 + ".mtl"))
    read_mesh(tmp_path / "a.obj")
    assert "is not beside the mesh" in caplog.text


def test_a_skinned_file_is_also_a_mesh(tmp_path: Path) -> None:
    mesh = read_mesh(armature_file().write_gltf(tmp_path / "a.gltf"))
    assert len(mesh.vertices) == 7
    np.testing.assert_allclose(mesh.vertices[3], [0.1, 0.5, 0], atol=1e-7)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\n", "cannot be read as PLY"),
        ("a.ply", b"\0" * 64, "cannot be read as PLY"),
        ("a.ply", LISTS, "cannot be read as PLY"),
        ("a.stl", b"\0" * 80 + struct.pack("<I", 10**9), "has no faces|cannot be read"),
        ("a.stl", b"solid x\nendsolid x\n", "has no faces|cannot be read"),
        ("a.zip", b"PK\3\4", "is no mesh that is read"),
        ("a.fbx", b"Kaydara", "expected .obj"),
        ("a.glb", b"glTF", "truncated"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_cloud_of_points_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    trimesh.PointCloud(np.zeros((3, 3))).export(path)
    with pytest.raises(InputError, match="cloud of points"):
        read_mesh(path)


def test_huge_files_are_refused_unread(tmp_path: Path) -> None:
    for name in ("a.obj", "a.glb", "a.stl"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(2 << 30)  # sparse: takes no space
        with pytest.raises(InputError, match=r"2048 MB|2147483648 bytes"):
            read_mesh(tmp_path / name)
