"""The shipped actor is what its manifest and card say."""

import hashlib
import tomllib
from pathlib import Path

import numpy as np
import pytest

from perfcap.actor.template import Template
from perfcap.io.actor_import import import_actor
from perfcap.io.doctor import Severity
from perfcap.io.gltf_read import load_template

FOLDER = Path(__file__).parents[2] / "models/actors/sam"
SIDES = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe")
CENTRE = ("pelvis", "spine", "neck", "head", "head_top")


@pytest.fixture(scope="module")
def actor() -> Template:
    return load_template(FOLDER / "actor.glb")


def test_manifest_names_every_byte() -> None:
    (entry,) = tomllib.loads((FOLDER / "manifest.toml").read_text())["file"]
    data = (FOLDER / entry["name"]).read_bytes()
    assert len(data) == entry["size"]
    assert hashlib.sha256(data).hexdigest() == entry["sha256"]
    assert sum(file.stat().st_size for file in FOLDER.iterdir()) < 4_000_000


def test_rig_has_the_joints_and_landmarks(actor: Template) -> None:
    assert set(actor.bone_names) == {*CENTRE, *(f"{s}_{n}" for s in "lr" for n in SIDES)}
    assert np.count_nonzero(actor.bone_parents < 0) == 1
    unweighted = {actor.bone_names[b] for b in np.flatnonzero(actor.dense_weights().sum(0) == 0)}
    assert unweighted == {"head_top", "l_toe", "r_toe"}


def test_stands_on_the_floor_facing_forward(actor: Template) -> None:
    place = dict(zip(actor.bone_names, actor.bone_rest[:, :3, 3], strict=True))
    assert actor.vertices[:, 1].min() == pytest.approx(0, abs=1e-6)
    assert 1.7 < actor.vertices[:, 1].max() < 1.9
    assert place["l_wrist"][0] > 0.3
    assert place["l_toe"][2] > place["l_ankle"][2] + 0.1
    for name in SIDES:
        mirrored = place[f"r_{name}"] * (-1, 1, 1)
        np.testing.assert_allclose(place[f"l_{name}"], mirrored, atol=1e-3)
    for name in CENTRE:
        assert place[name][0] == pytest.approx(0, abs=1e-3)


def test_surface_is_closed_where_it_is_seen(actor: Template) -> None:
    """Only eyes, lips and what clothes cover may be open, and no triangle is degenerate."""
    index, representative = actor.weld()
    faces = index[actor.faces]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    assert count.max() == 2
    open_heights = actor.vertices[representative[unique[count == 1]]][..., 1]
    assert np.all((open_heights > 1.5) | (open_heights < 0.1))
    corners = actor.vertices[actor.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(area, axis=1).min() > 0


def test_triangles_face_outwards(actor: Template) -> None:
    corners = actor.vertices[actor.faces]
    volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert 0.05 < volume < 0.12  # cubic metres of a clothed adult


def test_no_piece_is_inside_out() -> None:
    findings = import_actor(FOLDER / "actor.glb").findings
    assert {finding.severity for finding in findings} <= {Severity.INFO}
