"""Several characters in one file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gltf_files import bar, played, random_motion, skinned

from perfcap.errors import InputError
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_merge import merge_characters
from perfcap.io.gltf_write import save_animation


def test_everybody_moves_as_in_their_own_file(tmp_path: Path) -> None:
    textured = bar()
    plain = replace(bar(5), uv=None, texture=None, name="plain")
    files = {}
    motions = []
    for number, template in enumerate((plain, textured, textured)):
        motion = random_motion(template, 6 + number)
        motion[:, :, 0, 3] += 3.0 * number
        motions.append((template, motion))
        files[f"person{number + 1}"] = tmp_path / f"{number}.glb"
        surface = [skinned(template, motion) + 0.01] if number == 1 else None
        save_animation(files[f"person{number + 1}"], template, motion, 30, surface)
    merge_characters(tmp_path / "scene.glb", files)
    for number, (template, motion) in enumerate(motions):
        found = played(tmp_path / "scene.glb", 3 / 30, number)
        np.testing.assert_allclose(found, skinned(template, motion)[3], atol=1e-5)
    document = open_document(tmp_path / "scene.glb")
    tops = [document.tree["nodes"][n]["name"] for n in document.tree["scenes"][0]["nodes"]]
    assert tops == list(files)
    assert [document.tree["meshes"][k]["primitives"][0]["material"] for k in range(3)] == [0, 1, 2]
    assert document.image(1) == textured.texture
    assert len(document.tree["animations"]) == 1


def test_nobody_who_moves(tmp_path: Path) -> None:
    still = np.tile(np.eye(4), (2, 4, 1, 1))
    for name in "ab":
        save_animation(tmp_path / f"{name}.glb", bar(), still, 30)
    merge_characters(tmp_path / "s.glb", {name: tmp_path / f"{name}.glb" for name in "ab"})
    tree = open_document(tmp_path / "s.glb").tree
    assert "animations" not in tree and len(tree["skins"]) == 2


def test_a_damaged_character(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(b"glTF")
    with pytest.raises(InputError, match=r"a\.glb"):
        merge_characters(tmp_path / "s.glb", {"a": tmp_path / "a.glb"})
