"""Deforming surfaces as morph targets: what a viewer computes is what was captured."""

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_files import ROOT, bar, played, random_motion, skinned
from scipy.spatial.transform import Rotation

from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.io import gltf_morph
from perfcap.io.gltf_document import Document, open_document
from perfcap.io.gltf_morph import blended, displacement
from perfcap.io.gltf_read import load_template
from perfcap.io.gltf_write import save_animation


def gentle_motion(template: Template, frames: int) -> np.ndarray:
    """A chain that every fourth frame bends by 80 degrees at each joint, and rests in between."""
    posed = np.tile(np.eye(4), (frames, len(template.bone_names), 1, 1))
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("x", 80, degrees=True).as_matrix()
    for bone in range(1, len(template.bone_names)):
        pivot = template.bone_rest[bone, :3, 3]
        turn[:3, 3] = pivot - turn[:3, :3] @ pivot
        posed[3::4, bone] = posed[3::4, bone - 1] @ turn
    return posed


def rippled(template: Template, transforms: np.ndarray) -> np.ndarray:
    """The skinned surface with waves of its own, (F, V, 3)."""
    surface = skinned(template, transforms)
    phase = 9 * template.vertices + np.arange(len(surface))[:, None, None]
    return surface + 0.02 * np.sin(phase)


def targets(document: Document) -> np.ndarray:
    """Displacements (F, V, 3) from the raw JSON and bytes, by the rules of the specification."""
    tree = document.tree
    (primitive,) = tree["meshes"][0]["primitives"]
    return np.stack([accessor(document, t["POSITION"]) for t in primitive["targets"]])


def accessor(document: Document, index: int) -> np.ndarray:
    """A VEC3 accessor, sparse or not."""
    entry = document.tree["accessors"][index]
    values = np.zeros((entry["count"], 3), np.float32)
    if "bufferView" in entry:
        values[:] = np.frombuffer(document.view(entry["bufferView"])[0], "<f4").reshape(-1, 3)
    if "sparse" in entry:
        sparse = entry["sparse"]
        kind = {5123: "<u2", 5125: "<u4"}[sparse["indices"]["componentType"]]
        rows = np.frombuffer(document.view(sparse["indices"]["bufferView"])[0], kind)
        stored = np.frombuffer(document.view(sparse["values"]["bufferView"])[0], "<f4")
        assert len(rows) == sparse["count"] and (np.diff(rows.astype(int)) > 0).all()
        values[rows] = stored.reshape(-1, 3)
    np.testing.assert_array_equal(values.min(0), np.float32(entry["min"]))
    np.testing.assert_array_equal(values.max(0), np.float32(entry["max"]))
    return values


def weights(document: Document, time: float) -> np.ndarray:
    """Weights of the targets at a time."""
    (animation,) = document.tree["animations"]
    (channel,) = [c for c in animation["channels"] if c["target"]["path"] == "weights"]
    assert "mesh" in document.tree["nodes"][channel["target"]["node"]]
    sampler = animation["samplers"][channel["sampler"]]
    assert sampler["interpolation"] == "LINEAR"
    keys = document.accessor(sampler["input"], "SCALAR")[:, 0]
    values = document.accessor(sampler["output"], "SCALAR").reshape(len(keys), -1)
    return np.array([np.interp(time, keys, values[:, i]) for i in range(values.shape[1])])


def shown(path: Path, template: Template, transforms: np.ndarray, frame: int, fps: float) -> Any:
    """Vertices a viewer shows at a key, by an own skinning of rest plus weighted targets."""
    document = open_document(path)
    offset = np.einsum("f,fvi->vi", weights(document, frame / fps), targets(document))
    moved = np.c_[template.vertices + offset, np.ones(len(offset))]
    matrices = np.einsum("vb,bij->vij", template.dense_weights(), transforms[frame])
    return np.einsum("vij,vj->vi", matrices, moved)[:, :3]


def test_rest_plus_target_skinned_is_the_surface(tmp_path: Path) -> None:
    template, path = bar(), tmp_path / "a.glb"
    transforms = gentle_motion(template, 9)
    surface = rippled(template, transforms)
    assert save_animation(path, template, transforms, 24.0, [surface[:4], surface[4:]])
    for frame in range(9):
        found = shown(path, template, transforms, frame, 24)
        np.testing.assert_allclose(found, surface[frame], atol=1e-6)


def test_the_skeleton_of_the_file_still_moves(tmp_path: Path) -> None:
    """The same file with and without its weights: channels of bones are those of the plain one."""
    template, path = bar(), tmp_path / "a.glb"
    transforms = random_motion(template, 5)
    save_animation(path, template, transforms, 30, [rippled(template, transforms)])
    document = open_document(path)
    document.tree["animations"][0]["channels"].pop()  # the weights
    save_animation(tmp_path / "b.glb", template, transforms, 30)
    plain = open_document(tmp_path / "b.glb")
    assert document.tree["animations"][0]["channels"] == plain.tree["animations"][0]["channels"]
    np.testing.assert_allclose(
        played(tmp_path / "b.glb", 0.1), skinned(template, transforms)[3], atol=1e-5
    )
    assert load_template(path).bone_names == template.bone_names


def test_vertices_that_only_skinning_moves_cost_nothing(tmp_path: Path) -> None:
    template = bar()
    transforms = gentle_motion(template, 6)
    surface = skinned(template, transforms)
    moved = surface.copy()
    moved[:, 5] += 0.1
    sizes = []
    for values in (surface, moved, rippled(template, transforms)):
        save_animation(tmp_path / "a.glb", template, transforms, 30, [values])
        sizes.append((tmp_path / "a.glb").stat().st_size)
        for frame in (0, 3, 5):
            found = shown(tmp_path / "a.glb", template, transforms, frame, 30)
            np.testing.assert_allclose(found, values[frame], atol=1e-5)
    assert sizes[1] - sizes[0] < 500
    assert sizes[2] - sizes[0] > 6 * len(template.vertices) * 10


def test_half_turns_stay_bounded_and_hurt_no_other_vertex() -> None:
    template = bar()
    transforms = gentle_motion(template, 4)[3].copy()
    # the neck follows the chest, turned half round its axis
    transforms[2] = transforms[1] @ np.diag([-1.0, 1, -1, 1])
    matrices = blended(template.weight_bones, template.weights, transforms)
    captured = np.einsum("vij,vj->vi", matrices[..., :3], template.vertices) + matrices[..., 3]
    captured = captured + 0.03 * np.sin(9 * template.vertices)
    offset = displacement(template.vertices, matrices, captured)
    found = np.einsum("vij,vj->vi", matrices[..., :3], template.vertices + offset)
    found += matrices[..., 3]
    open_ = np.linalg.svd(matrices[..., :3], compute_uv=False)[:, -1] > 0.03
    assert 0 < open_.sum() < len(open_)
    np.testing.assert_allclose(found[open_], captured[open_], atol=1e-9)
    assert np.abs(offset).max() < 0.06 / 0.02
    assert np.abs(found - captured).max() < 0.06


def test_what_viewers_refuse_is_left_out_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    template = bar()

    def untouched() -> Iterator[np.ndarray]:
        pytest.fail("the surface was read")
        yield

    many = np.tile(np.eye(4), (gltf_morph.MAX_TARGETS + 1, 4, 1, 1))
    assert not save_animation(tmp_path / "a.glb", template, many, 30, untouched())
    assert "targets" not in open_document(tmp_path / "a.glb").tree["meshes"][0]["primitives"][0]
    monkeypatch.setattr(gltf_morph, "MAX_TARGET_BYTES", 12 * len(template.vertices))
    assert save_animation(tmp_path / "a.glb", template, many[:1], 30, [template.vertices[None]])
    assert not save_animation(tmp_path / "a.glb", template, many[:2], 30, untouched())
    assert save_animation(tmp_path / "a.glb", template, many[:2], 30)  # all that was given


@pytest.mark.parametrize("change", ["fewer", "more", "vertices", "nan", "flat"])
def test_a_surface_that_does_not_fit_is_refused(change: str, tmp_path: Path) -> None:
    template = bar()
    surface = np.tile(template.vertices, (3, 1, 1))
    wrong = {
        "fewer": surface[:2],
        "more": np.tile(surface, (2, 1, 1)),
        "vertices": surface[:, 1:],
        "nan": surface * np.nan,
        "flat": surface[0],
    }[change]
    with pytest.raises(InputError, match="surface has"):
        save_animation(tmp_path / "a.glb", template, np.tile(np.eye(4), (3, 4, 1, 1)), 30, [wrong])
    assert list(tmp_path.iterdir()) == []


def test_khronos_validator_finds_nothing(tmp_path: Path) -> None:
    modules = [folder / "node_modules/gltf-validator" for folder in (Path.cwd(), ROOT)]
    found = next((module.parents[1] for module in modules if module.exists()), None)
    if shutil.which("node") is None or found is None:
        pytest.skip("needs node and `npm install gltf-validator` in the current folder")
    template = bar()
    transforms = random_motion(template, 9)
    still = np.tile(np.eye(4), (3, 4, 1, 1))
    takes = {
        "dense": (transforms, rippled(template, transforms)),
        "sparse": (transforms, skinned(template, transforms)),
        "still bones": (still, rippled(template, still)),
        "one": (still[:1], rippled(template, still)[:1]),
    }
    paths = []
    for name, (motion, surface) in takes.items():
        paths.append(str(tmp_path / f"{name}.glb"))
        save_animation(paths[-1], template, motion, 30, [surface])
    command = ["node", str(ROOT / "tools/validate_glb.mjs"), *paths]
    result = subprocess.run(command, cwd=found, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
