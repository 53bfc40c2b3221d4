"""glTF characters: foreign files in, valid animated files out, damaged ones refused."""

import json
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_files import ROOT, armature_file, bar, played, random_motion, skinned
from scipy.spatial.transform import Rotation

from perfcap.errors import InputError
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import load_template
from perfcap.io.gltf_write import save_animation

SHARED = ROOT / "../shared/data/rendered"


def test_a_scaled_and_turned_armature_comes_out_in_metres_y_up(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    template = load_template(armature_file().write_gltf(tmp_path / "a.gltf"))
    assert caplog.text == ""
    expected = [[0, 0, 0], [0.1, 0, 0], [0, 0.5, 0], [0.1, 0.5, 0]]
    np.testing.assert_allclose(template.vertices[:4], expected, atol=1e-7)
    assert template.bone_names == ("hips", "chest")
    assert template.bone_parents.tolist() == [-1, 0]
    np.testing.assert_allclose(template.bone_rest[:, :3, 3], [[0, 0, 0], [0, 0.5, 0]], atol=1e-7)
    assert template.faces.tolist() == [[0, 1, 2], [1, 3, 2], [4, 5, 6]]
    shares = template.dense_weights()[[0, 2, 4]]
    np.testing.assert_allclose(shares, [[1, 0], [0.2, 0.8], [0, 1]], atol=1e-7)


def test_external_buffer_reads_like_an_embedded_one(tmp_path: Path) -> None:
    one = load_template(armature_file().write_gltf(tmp_path / "a.gltf"))
    two = load_template(armature_file().write_gltf(tmp_path / "b.gltf", embed=False))
    np.testing.assert_array_equal(one.vertices, two.vertices)


def test_a_mirrored_armature_keeps_its_outside_outside(tmp_path: Path) -> None:
    builder = armature_file()
    builder.tree["nodes"][4]["scale"] = [-0.01, 0.01, 0.01]
    template = load_template(builder.write_gltf(tmp_path / "a.gltf"))
    assert template.faces[0].tolist() == [2, 1, 0]


def test_posed_nodes_do_not_change_the_rest_pose(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    straight = load_template(armature_file().write_gltf(tmp_path / "a.gltf"))
    builder = armature_file()
    builder.tree["nodes"][0]["rotation"] = [0.6, 0, 0, 0.8]
    bent = load_template(builder.write_gltf(tmp_path / "a.gltf"))
    assert "posed" in caplog.text
    np.testing.assert_allclose(bent.vertices, straight.vertices, atol=1e-9)
    np.testing.assert_allclose(bent.bone_rest, straight.bone_rest, atol=1e-9)


def test_vertices_without_weights_follow_a_joint(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    builder = armature_file()
    builder.data[builder.tree["bufferViews"][2]["byteOffset"]] = 0
    template = load_template(builder.write_gltf(tmp_path / "a.gltf"))
    assert "1 vertices without weights" in caplog.text
    np.testing.assert_allclose(template.weights.sum(1), 1)


def spoil(path: str, value: object) -> Any:
    """A change of one entry of the JSON tree, such as ``skins.0.joints``."""

    def change(tree: dict[str, Any]) -> None:
        *parents, last = [int(key) if key.isdigit() else key for key in path.split("/")]
        target: Any = tree
        for key in parents:
            target = target[key]
        if value is None:
            del target[last]
        else:
            target[last] = value

    return pytest.param(change, id=f"{path}={value!r:.30}")


@pytest.mark.parametrize(
    "change",
    [
        spoil("skins", None),
        spoil("nodes/1/skin", None),
        spoil("nodes/1/skin", 3),
        spoil("nodes/1/mesh", "body"),
        spoil("nodes", "none"),
        spoil("nodes", [None]),
        spoil("nodes/3/children", [4]),
        spoil("nodes/3/children", [2, 2]),
        spoil("nodes/3/children", [True]),
        spoil("nodes/4/scale", [0, 0, 0]),
        spoil("nodes/4/scale", [1, 1]),
        spoil("nodes/4/rotation", [0, 0, 0, 0]),
        spoil("nodes/4/translation", [0, 0, float("nan")]),
        spoil("nodes/4/matrix", [1] * 15),
        spoil("skins/0/joints", []),
        spoil("skins/0/joints", [0]),
        spoil("skins/0/joints", [0, 0]),
        spoil("skins/0/joints", [0, 99]),
        spoil("skins/0/inverseBindMatrices", None),
        spoil("skins/0/inverseBindMatrices", 0),
        spoil("meshes/0/primitives", []),
        spoil("meshes/0/primitives/0", "triangle"),
        spoil("meshes/0/primitives/0/mode", 5),
        spoil("meshes/0/primitives/0/indices", 1),
        spoil("meshes/0/primitives/0/attributes/WEIGHTS_0", None),
        spoil("meshes/0/primitives/0/attributes/POSITION", -1),
        spoil("meshes/0/primitives/0/attributes/JOINTS_0", 0),
        spoil("meshes/0/primitives/0/material", 0),
        spoil("accessors/0/count", 10**9),
        spoil("accessors/0/count", 0),
        spoil("accessors/0/count", 3),
        spoil("accessors/0/type", "VEC2"),
        spoil("accessors/0/componentType", 5124),
        spoil("accessors/0/byteOffset", 44),
        spoil("accessors/0/byteOffset", -4),
        spoil("accessors/0/bufferView", None),
        spoil("accessors/0/sparse", {"count": 1}),
        spoil("bufferViews/0/byteLength", 10**8),
        spoil("bufferViews/0/byteOffset", 10**8),
        spoil("bufferViews/0/buffer", 1),
        spoil("bufferViews/0/byteStride", "wide"),
        spoil("buffers/0/byteLength", 10**6),
        spoil("buffers/0/uri", "data:;base64,@@@"),
        spoil("buffers/0/uri", "../secret.bin"),
        spoil("buffers/0/uri", "/etc/hostname"),
        spoil("buffers/0/uri", "https://example.org/mesh.bin"),
        spoil("buffers/0/uri", "no\0name"),
        spoil("buffers/0/uri", 5),
        spoil("buffers", None),
        spoil("asset/version", "1.0"),
        spoil("asset", None),
        spoil("extensionsRequired", ["KHR_draco_mesh_compression"]),
        spoil("extensionsRequired", [{}]),
    ],
)
def test_a_damaged_tree_is_refused_in_one_line(change: Any, tmp_path: Path) -> None:
    path = armature_file().write_gltf(tmp_path / "a.gltf")
    (tmp_path.parent / "secret.bin").write_bytes(bytes(10**5))
    tree = json.loads(path.read_text())
    change(tree)
    path.write_text(json.dumps(tree))
    with pytest.raises(InputError, match=r"a\.gltf") as caught:
        load_template(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0",
        b"glTF",
        b"[]",
        b"null",
        b"not a model",
        b"[" * 100_000,
        bytes(64),
        struct.pack("<4sII", b"glTF", 2, 10**6) + bytes(64),
        struct.pack("<4sIIII", b"glTF", 2, 24, 10**9, 0x4E4F534A) + bytes(4),
        struct.pack("<4sIIII", b"glTF", 2, 24, 4, 0) + bytes(4),
    ],
)
def test_foreign_bytes_are_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.glb"):
        load_template(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none.glb", tmp_path):
        with pytest.raises(InputError, match="cannot be read"):
            load_template(path)


def test_every_truncation_of_a_good_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    save_animation(path, bar(), np.tile(np.eye(4), (1, 4, 1, 1)), 30)
    data = path.read_bytes()
    for length in np.linspace(0, len(data) - 1, 60).astype(int):
        path.write_bytes(data[:length])
        with pytest.raises(InputError):
            load_template(path)


def test_random_damage_never_ends_in_another_error(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    save_animation(path, bar(3), np.tile(np.eye(4), (1, 4, 1, 1)), 30)
    data = path.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(300):
        damaged = bytearray(data)
        for place in rng.integers(0, len(data), 4):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            load_template(path)
        except InputError:
            refused += 1
    assert refused > 100


def test_what_is_saved_is_what_was_given(tmp_path: Path) -> None:
    template, path = bar(), tmp_path / "a.glb"
    save_animation(path, template, random_motion(template, 5), 30)
    back = load_template(path)
    np.testing.assert_allclose(back.vertices, template.vertices, atol=1e-6)
    np.testing.assert_allclose(back.bone_rest, template.bone_rest, atol=1e-6)
    np.testing.assert_allclose(back.dense_weights(), template.dense_weights(), atol=1e-6)
    np.testing.assert_allclose(back.uv, template.uv, atol=1e-6)  # type: ignore[arg-type]
    np.testing.assert_array_equal(back.faces, template.faces)
    assert back.bone_names == template.bone_names
    assert back.texture == template.texture
    (sampler,) = open_document(path).tree["samplers"]
    assert sampler["wrapS"] == sampler["wrapT"] == 10497  # repeated, as perfcap draws them


def test_the_file_plays_the_motion(tmp_path: Path) -> None:
    template, path = bar(), tmp_path / "a.glb"
    transforms = random_motion(template, 12)
    save_animation(path, template, transforms, 24.0)
    expected = skinned(template, transforms)
    for frame in (0, 3, 7, 11):
        np.testing.assert_allclose(played(path, frame / 24), expected[frame], atol=1e-5)


def test_quaternions_are_unit_and_do_not_flip(tmp_path: Path) -> None:
    template, path = bar(), tmp_path / "a.glb"
    turn = np.tile(np.eye(4), (90, 4, 1, 1))
    angles = np.linspace(0, 4 * np.pi, 90)
    turn[:, :, :3, :3] = Rotation.from_rotvec(angles[:, None] * [0, 1, 0]).as_matrix()[:, None]
    save_animation(path, template, turn, 30)
    document = open_document(path)
    (channel,) = document.tree["animations"][0]["channels"]  # a rigid turn: the root alone moves
    assert channel["target"] == {"node": 0, "path": "rotation"}
    output = document.tree["animations"][0]["samplers"][0]["output"]
    values = document.accessor(output, "VEC4")
    np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1, atol=1e-6)
    assert (values[1:] * values[:-1]).sum(1).min() > 0.9


def test_weights_sum_to_exactly_one(tmp_path: Path) -> None:
    template, path = bar(), tmp_path / "a.glb"
    save_animation(path, template, np.tile(np.eye(4), (1, 4, 1, 1)), 30)
    document = open_document(path)
    attributes = document.tree["meshes"][0]["primitives"][0]["attributes"]
    weights = document.accessor(attributes["WEIGHTS_0"], "VEC4")
    assert weights.dtype == np.float32
    assert set(weights.sum(1).tolist()) == {1.0}
    assert "animations" not in document.tree  # nothing moved


@pytest.mark.parametrize(
    ("transforms", "fps"),
    [
        (np.tile(np.eye(4), (4, 1, 1)), 30),
        (np.tile(np.eye(4), (1, 3, 1, 1)), 30),
        (np.tile(np.eye(4), (0, 4, 1, 1)), 30),
        (np.tile(np.eye(4), (1, 4, 1, 1)) * np.nan, 30),
        (np.tile(2 * np.eye(4), (1, 4, 1, 1)), 30),
        (np.tile(np.diag([-1.0, 1, 1, 1]), (1, 4, 1, 1)), 30),
        (np.tile(np.eye(4) + np.outer(np.eye(4)[3], (1, 2, 3, 0)), (1, 4, 1, 1)), 30),
        (np.tile(np.eye(4), (1, 4, 1, 1)), 0),
        (np.tile(np.eye(4), (1, 4, 1, 1)), float("nan")),
    ],
)
def test_bad_motion_is_refused_and_leaves_no_file(
    transforms: np.ndarray, fps: float, tmp_path: Path
) -> None:
    with pytest.raises(InputError):
        save_animation(tmp_path / "a.glb", bar(), transforms, fps)
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_place_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        save_animation(tmp_path / "no/a.glb", bar(), np.tile(np.eye(4), (1, 4, 1, 1)), 30)


@pytest.mark.parametrize("sequence", ["dev_tight", "dev_skirt"])
def test_recorded_templates_keep_their_posed_surface(sequence: str, tmp_path: Path) -> None:
    source = SHARED / sequence / "template.glb"
    if not source.exists():
        pytest.skip("the rendered development sequences are not beside the checkout")
    template, path = load_template(source), tmp_path / "a.glb"
    assert template.bone_names[:4] == ("pelvis", "spine", "neck", "head")  # the skin's order
    assert template.bone_names[-3:] == ("head_top", "l_toe", "r_toe")
    transforms = random_motion(template, 2)
    save_animation(path, template, transforms, 30)
    np.testing.assert_allclose(
        skinned(load_template(path), transforms), skinned(template, transforms), atol=1e-5
    )
    np.testing.assert_allclose(played(path, 1 / 30), skinned(template, transforms)[1], atol=1e-5)


def test_khronos_validator_finds_nothing(tmp_path: Path) -> None:
    modules = [folder / "node_modules/gltf-validator" for folder in (Path.cwd(), ROOT)]
    found = next((module.parents[1] for module in modules if module.exists()), None)
    if shutil.which("node") is None or found is None:
        pytest.skip("needs node and `npm install gltf-validator` in the current folder")
    template = bar()
    plain = replace(template, uv=None, texture=None)
    paths = [tmp_path / "textured.glb", tmp_path / "plain.glb", tmp_path / "still.glb"]
    save_animation(paths[0], template, random_motion(template, 9), 30)
    save_animation(paths[1], plain, random_motion(plain, 1), 30)
    save_animation(paths[2], plain, np.tile(np.eye(4), (3, 4, 1, 1)), 30)
    command = ["node", str(ROOT / "tools/validate_glb.mjs"), *map(str, paths)]
    result = subprocess.run(command, cwd=found, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
