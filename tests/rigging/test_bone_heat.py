"""Automatic weights: what is a share of bones on any mesh, and what carried parts follow."""

from __future__ import annotations

import limbs
import numpy as np
import pytest
import synthetic
import trimesh
from scipy.spatial import cKDTree

from perfcap.errors import InputError
from perfcap.rigging.bone_heat import bone_heat_weights, fewest
from perfcap.rigging.overrides import Override


def share(weights: np.ndarray, *names: str) -> np.ndarray:
    index = [limbs.bones().names.index(name) for name in names]
    return weights[:, index].sum(1)


def check(weights: np.ndarray) -> None:
    assert (weights >= 0).all()
    assert np.allclose(weights.sum(1), 1)


@pytest.mark.long
def test_weights_change_over_at_the_joint() -> None:
    at = limbs.positions()
    hip, knee, ankle = at["l_hip"], at["l_knee"], at["l_ankle"]
    whole = trimesh.creation.cylinder(radius=0.06, segment=np.stack((hip, ankle)), sections=16)
    vertices, faces = limbs.arrays(whole.subdivide_to_size(0.03))
    weights, report = bone_heat_weights(vertices, faces, limbs.bones())
    check(weights)
    assert report.seen > 0.9
    up = (knee - vertices) @ (ankle - hip) / np.linalg.norm(ankle - hip)
    middle = np.linalg.norm(hip - ankle) / 5
    thigh, shank = (up > 0.08) & (up < middle), (up < -0.08) & (up > -middle)
    assert share(weights, "l_hip")[thigh].min() > 0.7
    assert share(weights, "l_knee")[shank].min() > 0.7
    near = np.abs(up) < 0.01
    assert share(weights, "l_hip", "l_knee")[near].min() > 0.9
    assert share(weights, "l_hip")[near].mean() == pytest.approx(0.5, abs=0.2)


def test_mirrored_mesh_has_mirrored_weights() -> None:
    template = synthetic.template()
    bones = limbs.bones()
    names = list(bones.names)
    flip = [
        names.index({"l": "r", "r": "l"}.get(n[0], n[0]) + n[1:] if n[1] == "_" else n)
        for n in names
    ]
    vertices, faces = template.vertices, template.faces
    weights, _ = bone_heat_weights(vertices, faces, bones)
    mirrored, _ = bone_heat_weights(vertices * (-1, 1, 1), faces[:, ::-1].copy(), bones)
    check(weights)
    assert np.allclose(mirrored[:, flip], weights, atol=1e-6)


def test_holes_seams_and_loose_vertices_do_not_matter() -> None:
    vertices, faces = limbs.arrays(limbs.tube("l_hip", "l_knee"))
    whole, _ = bone_heat_weights(vertices, faces, limbs.bones())
    # each corner a vertex of its own, a few triangles missing, one vertex of no triangle
    split = np.concatenate((vertices[faces].reshape(-1, 3), vertices[:1] + 0.001))
    corners = np.arange(faces.size).reshape(-1, 3)
    keep = np.random.default_rng(1).uniform(size=len(faces)) > 0.02
    weights, report = bone_heat_weights(split, corners[keep], limbs.bones())
    check(weights)
    assert report.parts < 4 and report.loose > 0
    assert np.abs(weights[:-1] - whole[faces.ravel()]).mean() < 0.02


def test_a_garment_moves_with_the_body_beneath() -> None:
    body = limbs.tube("l_hip", "l_knee", 0.05)
    skirt = limbs.sleeve("l_hip", "l_knee", 0.055)
    vertices, faces = limbs.arrays(trimesh.util.concatenate((body, skirt)))
    weights, report = bone_heat_weights(vertices, faces, limbs.bones())
    check(weights)
    assert (report.parts, report.carried) == (2, 1)
    count = len(body.vertices)
    nearest = cKDTree(vertices[:count]).query(vertices[count:])[1]
    assert np.abs(weights[nearest] - weights[count:]).mean() < 0.02


def test_non_manifold_fins_are_rigged() -> None:
    vertices, faces = limbs.arrays(limbs.tube("l_hip", "l_knee"))
    fin = len(vertices)
    vertices = np.concatenate((vertices, vertices[faces[:5, 0]] + (0, 0, 0.03)))
    extra = np.stack((faces[:5, 0], faces[:5, 1], np.arange(fin, fin + 5)), 1)
    needle = faces[:1, [0, 1, 1]]
    weights, _ = bone_heat_weights(vertices, np.concatenate((faces, extra, needle)), limbs.bones())
    check(weights)


def test_an_override_decides_who_moves_a_part() -> None:
    body = limbs.tube("l_hip", "l_knee", 0.05)
    skirt = limbs.sleeve("l_hip", "l_knee", 0.08)
    vertices, faces = limbs.arrays(trimesh.util.concatenate((body, skirt)))
    rule = Override("skirt", ("pelvis",), part=0, blend=0.0)
    weights, _ = bone_heat_weights(vertices, faces, limbs.bones(), (rule,))
    check(weights)
    outer = np.arange(len(vertices)) >= len(body.vertices)
    assert share(weights, "pelvis")[outer].min() > 0.999
    assert share(weights, "l_hip")[~outer].mean() > 0.8


def test_a_region_blends_into_its_surroundings() -> None:
    vertices, faces = limbs.arrays(limbs.tube("l_hip", "l_knee"))
    middle = float(vertices[:, 1].mean())
    box = ((-1.0, middle, -1.0), (1.0, 3.0, 1.0))
    rule = Override("top", ("pelvis",), box=box, blend=0.03)
    weights, _ = bone_heat_weights(vertices, faces, limbs.bones(), (rule,))
    check(weights)
    pelvis = share(weights, "pelvis")
    assert pelvis[vertices[:, 1] > middle + 0.1].min() > 0.9
    assert 0.1 < pelvis[np.abs(vertices[:, 1] - middle) < 0.01].mean() < 0.9


def test_an_override_of_nothing_is_an_error() -> None:
    vertices, faces = limbs.arrays(limbs.tube("l_hip", "l_knee"))
    with pytest.raises(InputError, match="covers no vertex"):
        bone_heat_weights(vertices, faces, limbs.bones(), (Override("bag", ("spine",), part=7),))


def test_a_mesh_without_area_is_an_error() -> None:
    with pytest.raises(InputError, match="no triangle"):
        bone_heat_weights(np.zeros((3, 3)), np.array([[0, 1, 2]]), limbs.bones())


def test_few_influences_without_jumps() -> None:
    random = np.random.default_rng(2)
    weights = random.dirichlet(np.full(7, 0.7), 50)
    few = fewest(weights, 4)
    check(few)
    assert ((few > 0).sum(1) <= 4).all()
    moved = weights + 1e-7 * random.normal(size=weights.shape)
    assert np.abs(fewest(moved / moved.sum(1, keepdims=True), 4) - few).max() < 1e-4
    assert np.array_equal(few.argmax(1), weights.argmax(1))


def test_equal_shares_of_many_bones_stay_weights() -> None:
    few = fewest(np.full((3, 8), 1 / 8), 4)
    check(few)
    assert ((few > 0).sum(1) == 4).all()
    assert np.array_equal(fewest(few[:, :4], 4), few[:, :4])


@pytest.mark.parametrize("influences", [1, 2, 3, 6])
def test_any_number_of_influences(influences: int) -> None:
    weights = np.random.default_rng(4).dirichlet(np.full(7, 0.7), 50)
    few = fewest(weights, influences)
    check(few)
    assert ((few > 0).sum(1) == influences).all()
