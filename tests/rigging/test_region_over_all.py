"""A region that takes the whole body from its bones is named, in Python and by the command."""

from __future__ import annotations

import numpy as np
import pytest

from perfcap.actor.bare_mesh import BareMesh
from perfcap.io.body_model import load_body_model
from perfcap.io.doctor.finding import Severity
from perfcap.rigging.auto_rig import RigReport, auto_rig
from perfcap.rigging.fit_surface import FitSettings
from perfcap.rigging.overrides import Override

QUICK = FitSettings(screened=1, first=2, rounds=7, samples=(250, 350), arms=(40.0,))
SKIRT = ("pelvis", "l_hip", "r_hip")


def dressed() -> BareMesh:
    """The mean body, and a sheet in front of its hips as another part."""
    model = load_body_model()
    body = model.surface.mean.numpy()
    hips = np.abs(body[:, 1] - body[:, 1].min() - 0.85)
    ahead = float(body[hips < 0.1, 2].max()) + 0.03
    across, up = np.meshgrid(np.linspace(-0.15, 0.15, 4), np.linspace(0.7, 0.95, 4))
    sheet = np.stack((across, up + body[:, 1].min(), np.full_like(up, ahead)), -1).reshape(-1, 3)
    corner = np.arange(16).reshape(4, 4)[:3, :3].reshape(-1, 1)
    squares = np.hstack((corner, corner + 1, corner + 5, corner, corner + 5, corner + 4))
    faces = np.vstack((model.rig.faces, squares.reshape(-1, 3) + len(body)))
    return BareMesh(np.vstack((body, sheet)), faces, name="scan")


def rigged(*overrides: Override) -> RigReport:
    return auto_rig(dressed(), load_body_model(), overrides=overrides, settings=QUICK)[1]


@pytest.mark.long
def test_a_region_over_the_whole_body_is_named(caplog: pytest.LogCaptureFixture) -> None:
    """A skirt of part 0, which is the body, hung head and hands on the hips without a word."""
    report = rigged(Override("skirt", SKIRT, part=0))
    still, astray = report.warnings
    assert still.startswith("warning: weights: spine, neck, l_shoulder") and "no vertex" in still
    assert "l_hip moves what lies about l_knee" in astray
    assert caplog.messages == [f"scan: {line}" for line in report.warnings]
    assert {*report.warnings} <= {str(finding) for finding in report.about_actor}


@pytest.mark.long
@pytest.mark.parametrize("overrides", [(), (Override("skirt", SKIRT, part=1),)])
def test_a_region_over_a_skirt_is_right(
    overrides: tuple[Override, ...], caplog: pytest.LogCaptureFixture
) -> None:
    report = rigged(*overrides)
    assert not report.warnings and not caplog.messages
    assert {finding.severity for finding in report.about_actor} <= {Severity.INFO}
