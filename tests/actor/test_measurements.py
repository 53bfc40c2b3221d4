"""Girths of solids with known perimeters, and of the shipped body."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import trimesh
from scipy.special import ellipe

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import girth, girth_rings, measure, section
from perfcap.io.body_model import load_body_model


@pytest.fixture(scope="module")
def model() -> BodyModel:
    return load_body_model()


def upright(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Turn z up into y up."""
    mesh.vertices = mesh.vertices[:, [1, 2, 0]]
    return mesh


def test_girth_of_a_cylinder() -> None:
    mesh = upright(trimesh.creation.cylinder(radius=0.15, height=1.0, sections=256))
    found = girth(mesh.vertices, mesh.faces, 0.1)
    assert found == pytest.approx(2 * math.pi * 0.15, rel=2e-4)


@pytest.mark.parametrize("level", [0.0, 0.11])
def test_girth_of_an_ellipsoid(level: float) -> None:
    a, b, half = 0.18, 0.12, 0.3
    mesh = trimesh.creation.icosphere(subdivisions=5)
    vertices = mesh.vertices * (a, half, b)
    scale = math.sqrt(1 - (level / half) ** 2)
    expected = 4 * a * scale * float(ellipe(1 - (b / a) ** 2))
    assert girth(vertices, mesh.faces, level) == pytest.approx(expected, rel=1e-3)


def test_a_tape_bridges_hollows() -> None:
    """Two legs side by side measure like their common hull."""
    legs = [trimesh.creation.cylinder(radius=0.08, height=1.0, sections=128) for _ in range(2)]
    legs[1].apply_translation((0.0, 0.2, 0.0))
    mesh = upright(trimesh.util.concatenate(legs))
    expected = 2 * math.pi * 0.08 + 2 * 0.2
    assert girth(mesh.vertices, mesh.faces, 0.0) == pytest.approx(expected, rel=5e-4)


def test_a_plane_beside_the_mesh_has_no_girth() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=1)
    assert girth(np.asarray(mesh.vertices), np.asarray(mesh.faces), 2.0) == 0.0


def test_sections_lie_in_their_plane() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    points = section(np.asarray(mesh.vertices), np.asarray(mesh.faces), 0.123)
    assert len(points) > 10
    assert np.allclose(points[:, 1], 0.123)


def test_the_mean_body_measures_like_a_person(model: BodyModel) -> None:
    found = measure(model.template(torch.zeros(model.components)))
    assert found.height == pytest.approx(1.73, abs=0.08)
    assert 0.42 < found.inseam / found.height < 0.52
    assert found.waist < found.chest < 1.2
    assert found.waist < found.hip < 1.2


def test_measurements_scale_with_the_body(model: BodyModel) -> None:
    from dataclasses import astuple, replace

    template = model.template(torch.zeros(model.components))
    rest = template.bone_rest.copy()
    rest[:, :3, 3] *= 1.1
    grown = measure(replace(template, vertices=1.1 * template.vertices, bone_rest=rest))
    for small, large in zip(astuple(measure(template)), astuple(grown), strict=True):
        assert large == pytest.approx(1.1 * small, abs=0.006)  # levels are tried in steps


@pytest.mark.slow
def test_against_the_anthropometry_of_anny() -> None:
    """Same bodies, their waist ring and height."""
    anny = pytest.importorskip("anny", reason="anny is not installed")
    from anny.anthropometry import Anthropometry

    ours = load_body_model()
    theirs = anny.Anny(topology="anny")
    random = torch.Generator().manual_seed(5)
    values = 0.25 + 0.5 * torch.rand(6, 4, generator=random)
    names = ("gender", "muscle", "weight", "height")
    people = {**dict(zip(names, values.T, strict=True)), "age": torch.full((6,), 0.75)}
    rest = theirs(phenotype_kwargs=people)["rest_vertices"]
    tape = Anthropometry(theirs)
    upright = torch.stack((rest[..., 0], rest[..., 2], -rest[..., 1]), -1).double()
    index = _correspondence(ours, upright[0])
    for person, height, waist in zip(
        upright, tape.height(rest), tape.waist_circumference(rest), strict=True
    ):
        lowest = person[:, 1].min()
        shape = ours.surface.coefficients(person[index] - torch.tensor([0.0, 1.0, 0.0]) * lowest)
        found = measure(ours.template(shape))
        assert found.height == pytest.approx(float(height), abs=0.01)
        assert found.waist == pytest.approx(float(waist), rel=0.12)


def _correspondence(ours: BodyModel, person: torch.Tensor) -> torch.Tensor:
    """Their vertex for each of ours, by alternating fit and nearest neighbours."""
    from scipy.spatial import cKDTree

    place = person - torch.tensor([0.0, 1.0, 0.0]) * person[:, 1].min()
    shape = torch.zeros(ours.components, dtype=torch.float64)
    for _ in range(40):
        at = cKDTree(place.numpy()).query(ours.vertices(shape).numpy())[1]
        shape = ours.surface.coefficients(place[at], ridge=1e-2)
    return torch.tensor(at)


def test_rings_are_where_girths_are_measured() -> None:
    template = load_body_model().template(torch.tensor([0.5, -0.7], dtype=torch.float64))
    sizes, rings = measure(template), girth_rings(template)
    assert list(rings) == ["chest", "waist", "hip"]
    for name, ring in rings.items():
        points = ring.on(template.vertices)
        assert np.ptp(points[:, 1]) < 1e-9  # level
        around = np.linalg.norm(points - np.roll(points, 1, 0), axis=1).sum()
        assert around == pytest.approx(getattr(sizes, name), rel=1e-9)
    moved = rings["hip"].on(np.stack((template.vertices, template.vertices + 1.0)))
    assert np.allclose(moved[1] - moved[0], 1.0)
