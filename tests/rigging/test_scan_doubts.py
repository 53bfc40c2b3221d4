"""Scans that lack a crown, soles or a part of a limb, or raise their hands, are named."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from perfcap.actor.actor import Actor
from perfcap.actor.bare_mesh import BareMesh
from perfcap.actor.body_model import BodyModel
from perfcap.io.body_model import load_body_model
from perfcap.rigging.auto_rig import RigReport, auto_rig
from perfcap.rigging.fit_surface import FitSettings

QUICK = FitSettings(screened=1, first=2, rounds=7, samples=(250, 350), arms=(40.0,))


def said_of(model: BodyModel, kept: NDArray[np.bool_], height: float | None) -> list[str]:
    """What is said of the mean body where only some of its vertices were scanned."""
    vertices, faces = model.surface.mean.numpy(), np.asarray(model.rig.faces, np.int64)
    numbers = np.cumsum(kept) - 1
    mesh = BareMesh(vertices[kept], numbers[faces[kept[faces].all(-1)]], name="scan")
    return doubts(auto_rig(mesh, model, height, settings=QUICK)[1])


def doubts(report: RigReport) -> list[str]:
    parts = ("the crown", "goes no deeper", "the mesh has", "higher than the head")
    return [line for line in report.warnings if any(part in line for part in parts)]


@pytest.mark.long
@pytest.mark.parametrize(("crown", "soles"), [(0.0, 0.0), (0.05, 0.0), (0.0, 0.04)])
def test_what_was_cut_off_makes_a_person_larger(crown: float, soles: float) -> None:
    model = load_body_model()
    up = model.surface.mean[:, 1].numpy()
    up, height = up - up.min(), float(np.ptp(up))
    said = said_of(model, (up >= soles) & (up <= height - crown), height)
    expected = ["the crown of the body"] * (crown > 0) + ["the mesh goes no deeper"] * (soles > 0)
    assert len(said) == len(expected)
    for line, start in zip(said, expected, strict=True):
        assert line.startswith(start) and "the height given makes all the rest too large" in line


@pytest.mark.long
@pytest.mark.parametrize(("beyond", "words"), [(0.6, "left forearm"), (0.86, "left hand")])
def test_a_limb_that_is_not_all_there_is_unlike_the_other(beyond: float, words: str) -> None:
    model = load_body_model()
    left = model.surface.mean[:, 0].numpy()
    (line,) = said_of(model, left < beyond * left.max(), None)
    assert words in line and "as where a limb is not all there" in line and "height" not in line


@pytest.mark.long
@pytest.mark.parametrize(("degrees", "told"), [(0.0, False), (90.0, True)])
def test_raised_hands_make_a_person_smaller(degrees: float, told: bool) -> None:
    model = load_body_model()
    actor = Actor(model.template(torch.zeros(0)))
    motion = actor.skeleton.rest_motion(1)
    raised = [hinge.name.endswith("shoulder_elevation") for hinge in actor.skeleton.rig.hinges]
    angles = motion.angles + math.radians(degrees) * torch.tensor(raised)
    vertices = actor.surface(replace(motion, angles=angles))[0].numpy()
    mesh = BareMesh(vertices, actor.template.faces, name="scan")
    said = doubts(auto_rig(mesh, model, float(np.ptp(vertices[:, 1])))[1])
    assert len(said) == told and all("makes all the rest too small" in line for line in said)
