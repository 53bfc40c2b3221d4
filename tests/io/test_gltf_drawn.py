"""What of a character's file programs draw: its own scene, shown nodes, faces that are opaque."""

from __future__ import annotations

import base64
from pathlib import Path

import cv2
import numpy as np
import pytest
from gltf_files import Builder, armature_file

from perfcap.errors import InputError
from perfcap.io import gltf_alpha
from perfcap.io.doctor.finding import Severity
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import Character, read_character
from perfcap.io.mesh import read_mesh


def character(builder: Builder, folder: Path) -> Character:
    return read_character(open_document(builder.write_gltf(folder / "a.gltf")))


def dressed(scenes: list[list[int]], **tree: object) -> Builder:
    """The file of an armature with a costume beside the body, on the same bones."""
    builder = armature_file()
    builder.tree["nodes"].append({"name": "costume", "mesh": 0, "skin": 0})
    builder.tree |= {"scenes": [{"nodes": nodes} for nodes in scenes], **tree}
    return builder


@pytest.mark.parametrize(
    ("scenes", "tree", "count"),
    [
        ([[4, 5]], {}, 14),
        ([], {}, 14),
        ([[4], [5]], {}, 7),
        ([[4]], {}, 7),
        ([[5], [4]], {"scene": 1}, 7),
        ([[]], {}, 14),  # a scene of nothing is none
    ],
)
def test_meshes_of_the_files_own_scene_are_taken(
    tmp_path: Path, scenes: list[list[int]], tree: dict[str, object], count: int
) -> None:
    found = character(dressed(scenes, **tree), tmp_path)
    assert len(found.template.vertices) == count
    said = [(each.subject, each.severity) for each in found.findings]
    assert said == ([("costume", Severity.WARNING)] if count == 7 else [])


def test_hidden_meshes_and_those_below_hidden_nodes_are_left_out(tmp_path: Path) -> None:
    hidden = {"KHR_node_visibility": {"visible": False}}
    builder = dressed([[4, 5]])
    builder.tree["nodes"][5]["extensions"] = hidden
    assert len(character(builder, tmp_path).template.vertices) == 7
    builder = dressed([[4, 6]])
    builder.tree["nodes"].append({"name": "wardrobe", "children": [5], "extensions": hidden})
    assert len(character(builder, tmp_path).template.vertices) == 7
    builder.tree["nodes"][6]["extensions"] = {"KHR_node_visibility": {"visible": True}}
    assert len(character(builder, tmp_path).template.vertices) == 14


@pytest.mark.parametrize("scene", [7, -1, "x"])
def test_scenes_that_are_not_there_are_refused(tmp_path: Path, scene: object) -> None:
    with pytest.raises(InputError, match="index into scenes"):
        character(dressed([[4, 5]], scene=scene), tmp_path)
    with pytest.raises(InputError, match=r"scene\.nodes"):
        character(dressed([[4, 99]]), tmp_path)


def painted(alpha: int, mode: str | None, factor: float = 1.0) -> Builder:
    """Both primitives with an image of which the right half has so much alpha."""
    image = np.full((8, 8, 4), 255, np.uint8)
    image[:, 4:, 3] = alpha
    data = base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode()
    builder = armature_file()
    surface = {"baseColorFactor": [1, 1, 1, factor], "baseColorTexture": {"index": 0}}
    material = {"pbrMetallicRoughness": surface} | ({} if mode is None else {"alphaMode": mode})
    builder.tree |= {
        "images": [{"uri": f"data:image/png;base64,{data}"}],
        "textures": [{"source": 0}],
        "materials": [material],
    }
    for primitive in builder.tree["meshes"][0]["primitives"]:
        count = 4 if "indices" in primitive else 3
        corners = [[0.0, 0.0], [0.999, 0.0], [0.0, 0.999], [0.999, 0.999]]
        primitive["attributes"]["TEXCOORD_0"] = builder.add(corners[:count])
        primitive["material"] = 0
    return builder


@pytest.mark.parametrize(
    ("alpha", "mode", "factor", "named"),
    [
        (0, "MASK", 1.0, True),
        (100, "BLEND", 1.0, True),
        (255, "BLEND", 0.2, True),
        (200, "MASK", 1.0, False),
        (255, "BLEND", 1.0, False),
        (0, "OPAQUE", 1.0, False),
        (0, None, 0.2, False),
    ],
)
def test_faces_that_are_see_through_are_named(
    tmp_path: Path, alpha: int, mode: str | None, factor: float, named: bool
) -> None:
    found = character(painted(alpha, mode, factor), tmp_path)
    said = [each for each in found.findings if "transparent, and count as solid" in each.what]
    assert len(said) == (2 if named else 0)
    assert all(each.severity is Severity.WARNING for each in said)
    # of a rectangle of 10 by 50 cm, a half, or all
    area = 0.025 if factor == 1.0 else 0.05
    assert not named or f"{area:.2g} m²" in said[0].what


def test_meshes_without_bones_say_the_same(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("WARNING"):
        read_mesh(painted(0, "MASK").write_gltf(tmp_path / "a.gltf"))
        assert "transparent, and count as solid" in caplog.text and "m²" not in caplog.text
        mesh = read_mesh(dressed([[4], [5]]).write_gltf(tmp_path / "b.gltf"))
        assert len(mesh.vertices) == 7
        assert "costume: is hidden, or in another scene" in caplog.text


def test_a_cutoff_of_their_own_counts(tmp_path: Path) -> None:
    builder = painted(100, "MASK")
    builder.tree["materials"][0]["alphaCutoff"] = 0.3
    assert not [e for e in character(builder, tmp_path).findings if "transparent" in e.what]
    builder.tree["materials"][0]["alphaMode"] = "BLEND"  # which has no cutoff
    assert [e for e in character(builder, tmp_path).findings if "transparent" in e.what]
    builder.tree["materials"][0] |= {"alphaMode": "MASK", "alphaCutoff": "much"}
    with pytest.raises(InputError, match="alphaCutoff"):
        character(builder, tmp_path)


def test_an_image_of_several_parts_is_decoded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a small file of many parts would take hours."""
    calls: list[bytes] = []
    decode = gltf_alpha._alpha
    monkeypatch.setattr(gltf_alpha, "_alpha", lambda data: (calls.append(data), decode(data))[1])
    found = character(painted(0, "MASK"), tmp_path)
    assert len(found.parts) == 2 and len(calls) == 1
