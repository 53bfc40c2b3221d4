"""Loose parts that are measured with a person are named."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from perfcap.actor.bare_mesh import BareMesh
from perfcap.io.body_model import load_body_model
from perfcap.rigging.auto_rig import auto_rig
from perfcap.rigging.fit_surface import FitSettings
from perfcap.rigging.loose_parts import height_doubt

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

QUICK = FitSettings(screened=1, first=2, rounds=7, samples=(250, 350), arms=(40.0,))


def box(low: float, high: float) -> tuple[Floats, Integers]:
    """A closed box between two heights."""
    import trimesh

    mesh = trimesh.creation.box(bounds=[[0, low, 0], [0.1, high, 0.1]])
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def joined(*parts: tuple[Floats, Integers]) -> tuple[Floats, Integers]:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [f + start for (_, f), start in zip(parts, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (((0.3, 1.8), (0.0, 0.1)), "a loose part below it, 0.00 to 0.10 m above the lowest point"),
        (((0.0, 1.5), (1.7, 1.8)), "a loose part above it, 1.70 to 1.80 m"),
        (((0.3, 1.8), (0.2, 0.25), (0.0, 0.1)), "below it, 0.00 to 0.10 m"),  # the farthest
        (((0.3, 1.8), (0.0, 0.31)), "a loose part below it, 0.00 to 0.31 m"),  # no slit
        (((0.3, 1.8), (0.0, 1.8)), "no loose part is above or below it"),  # a pole
    ],
)
def test_what_was_measured_too_is_named(
    parts: tuple[tuple[float, float], ...], message: str
) -> None:
    mesh = joined(*(box(*part) for part in parts))
    doubt = height_doubt(*mesh, box(*parts[0])[0], 1.5, 1.8)
    assert doubt is not None and message in doubt
    assert "the person in it is 1.50 m tall, but the height given is 1.80 m" in doubt


def test_a_body_that_was_fitted_to_a_loose_part_too_hides_nothing() -> None:
    mesh = joined(box(0.0, 1.5), box(1.7, 1.8))
    doubt = height_doubt(*mesh, box(0.0, 1.75)[0], 1.75, 1.8)
    assert doubt is not None and "a loose part above it, 1.70 to 1.80 m" in doubt
    near = joined(box(0.06, 1.8), box(0.0, 0.01))
    doubt = height_doubt(*near, box(0.0, 1.75)[0], 1.75, 1.8)
    assert doubt is not None and "a loose part below it, 0.00 to 0.01 m" in doubt
    whole = joined(box(0.1, 1.5), box(0.0, 0.15), box(1.52, 1.8))  # shoes, and a head of its own
    assert height_doubt(*whole, box(0.0, 1.75)[0], 1.75, 1.8) is None


def test_shoes_and_hair_are_no_doubt() -> None:
    mesh = box(0.0, 1.8)
    assert height_doubt(*mesh, mesh[0], 1.65, 1.8) is None
    assert height_doubt(*mesh, mesh[0], 1.85, 1.8) is None


@pytest.mark.long
@pytest.mark.parametrize("ball", [True, False])
def test_a_ball_below_the_soles_makes_a_person_smaller(ball: bool) -> None:
    model = load_body_model()
    body = (model.surface.mean.numpy(), np.asarray(model.rig.faces, np.int64))
    sole = float(body[0][:, 1].min())
    parts = joined(body, box(sole - 0.3, sole - 0.2)) if ball else body
    height = float(np.ptp(body[0][:, 1]))
    report = auto_rig(BareMesh(*parts, name="scan"), model, height, settings=QUICK)[1]
    said = [line for line in report.warnings if "is measured too" in line]
    assert len(said) == ball and all("a loose part below it, 0.00 to 0.09 m" in s for s in said)
