"""``perfcap actor build`` of a mesh says once what ``auto_rig`` and the folder say alike."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from runs import Command

from perfcap.app import actor_build, actor_sheet
from perfcap.io.body_model import load_body_model
from perfcap.rigging.auto_rig import rig_bare_mesh
from perfcap.rigging.fit_surface import FitSettings

QUICK = FitSettings(screened=1, first=2, rounds=7, samples=(250, 350), arms=(40.0,))
OVER_ALL = """
[[region]]
name = "skirt"
part = 0
bones = ["pelvis", "l_hip", "r_hip"]
"""


@pytest.mark.long
@pytest.mark.parametrize("over_all", [True, False])
def test_what_is_wrong_with_a_mesh_is_said_once(
    perfcap: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, over_all: bool
) -> None:
    """What was put right was printed and logged."""
    monkeypatch.setattr(actor_sheet, "_LARGE", 48)
    monkeypatch.setattr(actor_sheet, "_SMALL", 32)
    monkeypatch.setattr(actor_build, "rig_bare_mesh", partial(rig_bare_mesh, settings=QUICK))
    model = load_body_model()
    places = [f"v {x} {y} {z}" for x, y, z in model.surface.mean.tolist()]
    corners = [f"f {a} {b} {c}" for c, b, a in (np.asarray(model.rig.faces) + 1).tolist()]
    (tmp_path / "scan.obj").write_text("\n".join((*places, *corners)))
    (tmp_path / "regions.toml").write_text(OVER_ALL)
    regions = ["--overrides", tmp_path / "regions.toml"] if over_all else []
    done = perfcap(["actor", "build", tmp_path / "scan.obj", "--out", tmp_path / "out", *regions])
    assert done.code == 0
    said = " ".join((done.out + done.err).split())
    assert said.count("faced inwards") == 1, said
    assert not any("inwards" in each for each in done.notes)
    assert said.count("move no vertex") == over_all
    assert not any("no vertex" in each for each in done.notes)
