"""Morph targets at their default weights are part of a body; damaged ones are refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_files import Builder, armature_file, bar, random_motion, skinned

from perfcap.errors import InputError
from perfcap.io import gltf_shape_keys
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import load_template
from perfcap.io.gltf_write import save_animation, write_glb
from perfcap.io.mesh import read_mesh

WIDER = [[0.0, 0, 0], [5, 0, 0], [0, 0, 0], [5, 0, 0]]  # cm, of the first primitive
LOWER = [[0.0, 0, -10]] * 4


def with_targets(*offsets: object, weights: object = None, node: object = None) -> Builder:
    """An armature whose first primitive has these targets, as the second has in its first rows."""
    builder = armature_file()
    mesh = builder.tree["meshes"][0]
    for primitive, rows in zip(mesh["primitives"], (4, 3), strict=True):
        arrays = [np.array(each)[:rows] for each in offsets]
        primitive["targets"] = [{"POSITION": builder.add(each)} for each in arrays]
    if weights is not None:
        mesh["weights"] = weights
    if node is not None:
        builder.tree["nodes"][1]["weights"] = node
    return builder


def vertices(builder: Builder, folder: Path) -> np.ndarray:
    return load_template(builder.write_gltf(folder / "a.gltf")).vertices


def targets(builder: Builder) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = builder.tree["meshes"][0]["primitives"][0]["targets"]
    return found


@pytest.mark.parametrize(
    ("weights", "node", "wider", "lower"),
    [
        ([1.0, 0.0], None, 1.0, 0.0),
        ([0.5, 2], None, 0.5, 2.0),
        ([1, 1], [0.0, 0.25], 0.0, 0.25),  # the node's go first
        (None, [-1.0, 0.0], -1.0, 0.0),
        ([0.0, 0.0], None, 0.0, 0.0),
        ([1.0, 1.0], [0.0, 0.0], 0.0, 0.0),
        (None, None, 0.0, 0.0),
    ],
)
def test_default_weights_shape_the_body(
    tmp_path: Path, weights: object, node: object, wider: float, lower: float
) -> None:
    plain = load_template(armature_file().write_gltf(tmp_path / "plain.gltf"))
    shaped = with_targets(WIDER, LOWER, weights=weights, node=node).write_gltf(tmp_path / "a.gltf")
    template = load_template(shaped)
    # the armature lies on its back, in centimetres
    moved = np.array([[0.05 * wider, 0, 0]]) * np.array([[0, 1, 0, 1, 0, 1, 0]]).T
    moved[:, 1] -= 0.1 * lower
    np.testing.assert_allclose(template.vertices - plain.vertices, moved, atol=1e-7)
    np.testing.assert_array_equal(template.weights, plain.weights)
    np.testing.assert_array_equal(template.bone_rest, plain.bone_rest)
    bare = read_mesh(shaped).vertices - read_mesh(tmp_path / "plain.gltf").vertices
    np.testing.assert_allclose(bare, moved, atol=1e-7)


def test_targets_that_are_off_are_not_looked_at(tmp_path: Path) -> None:
    builder = with_targets(WIDER, LOWER, weights=[0.0, 1.0])
    expected = vertices(builder, tmp_path)
    targets(builder)[0]["POSITION"] = 999
    np.testing.assert_array_equal(vertices(builder, tmp_path), expected)
    builder.tree["meshes"][0]["weights"] = [0, 0, 0]
    targets(builder)[1]["POSITION"] = 999
    assert len(vertices(builder, tmp_path)) == 7


def test_a_target_without_positions_and_a_primitive_without_targets(tmp_path: Path) -> None:
    plain = vertices(armature_file(), tmp_path)
    builder = with_targets(WIDER, weights=[1.0])
    targets(builder)[0] = {"NORMAL": 0}
    del builder.tree["meshes"][0]["primitives"][1]["targets"]
    np.testing.assert_array_equal(vertices(builder, tmp_path), plain)


def sparse(builder: Builder, base: object = None) -> dict[str, Any]:
    """WIDER as Blender writes it: the rows that move, others zero or those of ``base``."""
    places, rows = builder.add([1, 3], "u2"), builder.add([[5.0, 0, 0]] * 2)
    views = [builder.tree["accessors"][each]["bufferView"] for each in (places, rows)]
    entry = {"type": "VEC3", "componentType": 5126, "count": 4}
    if base is not None:
        entry["bufferView"] = builder.tree["accessors"][builder.add(base)]["bufferView"]
    indices = {"bufferView": views[0], "componentType": 5123}
    entry["sparse"] = {"count": 2, "indices": indices, "values": {"bufferView": views[1]}}
    builder.tree["accessors"].append(entry)
    targets(builder)[0]["POSITION"] = len(builder.tree["accessors"]) - 1
    return entry


@pytest.mark.parametrize("base", [None, LOWER])
def test_sparse_targets_read_like_full_ones(tmp_path: Path, base: object) -> None:
    full = np.array(WIDER) if base is None else np.where(np.array(WIDER) != 0, WIDER, base)
    if base is not None:
        full[[1, 3]] = (5, 0, 0)
    expected = vertices(with_targets(full, weights=[0.5]), tmp_path)
    builder = with_targets(full, weights=[0.5])
    sparse(builder, base)
    np.testing.assert_allclose(vertices(builder, tmp_path), expected, atol=1e-9)


def test_targets_of_a_capture_are_its_surface(tmp_path: Path) -> None:
    """What the exporter writes, read by the rules of the format."""
    template = bar()
    motion = random_motion(template, 3)
    surface = skinned(template, motion)
    surface[:, ::3] += 0.02
    path = tmp_path / "capture.glb"
    save_animation(path, template, motion, 30.0, [surface])
    document = open_document(path)
    document.tree["meshes"][0]["weights"] = [0.0, 1.0, 0.0]
    write_glb(path, document.tree, bytearray(document.buffers[0]))
    shown = replace(template, vertices=load_template(path).vertices)
    np.testing.assert_allclose(skinned(shown, motion)[1], surface[1], atol=1e-6)


def test_a_target_that_holds_nothing_is_zero(tmp_path: Path) -> None:
    builder = with_targets(WIDER, weights=[1.0])
    expected = vertices(builder, tmp_path)[4:]
    del sparse(builder)["sparse"]
    found = vertices(builder, tmp_path)
    np.testing.assert_array_equal(found[:4], vertices(armature_file(), tmp_path)[:4])
    np.testing.assert_array_equal(found[4:], expected)


# --- Damage ---------------------------------------------------------------------------------------


def weigh(value: object) -> Callable[[Builder], None]:
    return lambda builder: builder.tree["meshes"][0].update(weights=value)


def aim(value: object) -> Callable[[Builder], None]:
    return lambda builder: targets(builder)[0].update(POSITION=value)


def spoil(**changes: object) -> Callable[[Builder], None]:
    return lambda builder: sparse(builder)["sparse"].update(changes)


def exchange(value: object) -> Callable[[Builder], None]:
    return lambda builder: builder.tree["meshes"][0]["primitives"][0].update(targets=value)


def of_three(builder: Builder) -> None:
    targets(builder)[0]["POSITION"] = builder.add(WIDER[:3])


def of_far(builder: Builder) -> None:
    targets(builder)[0]["POSITION"] = builder.add([[np.nan] * 3] * 4)


def of_pairs(builder: Builder) -> None:
    targets(builder)[0]["POSITION"] = builder.add(np.ones((4, 2)))


def huge(builder: Builder) -> None:
    entry = sparse(builder)
    entry["count"] = 1 << 29  # 12 GB of zeros of a file of 2 kB


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (weigh("1"), "weights of morph targets are not a list"),
        (weigh([1.0, 0.0]), "2 weights for 1 morph targets"),
        (weigh([float("nan")]), "NaN or infinity"),
        (weigh([10**400]), "NaN or infinity"),
        (weigh([1e308]), "take vertices to NaN or infinity"),
        (weigh([[1.0]]), "not a list of 1 numbers"),
        (weigh([True]), "not a list of 1 numbers"),
        (weigh([1.0] * 5000), "at most 4096"),
        (aim(None), "index into accessors"),
        (aim(1000), "index into accessors"),
        (aim({"a": 1}), "index into accessors"),
        (exchange({"a": 1}), "no list of morph targets"),
        (exchange([3]), "is not an object"),
        (of_three, "has 3 rows for 4 vertices"),
        (of_far, "take vertices to NaN or infinity"),
        (of_pairs, "expected VEC3"),
        (huge, "536870912 rows for 4 vertices"),
        (spoil(count=5), "sparse count is 5"),
        (spoil(count=None), "sparse count"),
        (spoil(indices=None), "no sparse indices"),
        (spoil(values=[1]), "no sparse indices"),
        (spoil(indices={"bufferView": 0, "componentType": 5126}), "names vertex"),
        (spoil(indices={"bufferView": 2, "componentType": 5121}), "names vertex 255 of 4"),
        (spoil(values={"bufferView": 999}), "index into bufferViews"),
        (lambda builder: sparse(builder).update(sparse=7), "no sparse indices"),
    ],
)
def test_damaged_targets_are_refused_in_one_line(
    tmp_path: Path, change: Callable[[Builder], None], words: str
) -> None:
    builder = with_targets(WIDER, weights=[1.0])
    change(builder)
    path = builder.write_gltf(tmp_path / "a.gltf")
    with pytest.raises(InputError) as refused:
        load_template(path)
    message = str(refused.value)
    assert words in message and message.startswith(f"{path}: ") and "\n" not in message


def test_targets_that_are_read_over_and_over_are_bounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small file may name the same offsets for thousands of targets and nodes."""
    builder = with_targets(*[WIDER] * 50, weights=[0.01] * 50)
    path = builder.write_gltf(tmp_path / "a.gltf")
    monkeypatch.setattr(gltf_shape_keys, "_MOST_OFFSETS", 50 * (4 + 3 + 2))
    assert len(load_template(path).vertices) == 7
    monkeypatch.setattr(gltf_shape_keys, "_MOST_OFFSETS", 50 * (4 + 3 + 2) - 1)
    with pytest.raises(InputError, match="more than 449 offsets"):
        load_template(path)
