"""Reports of captures that found cameras to stand elsewhere: outlines go where these see them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from reported import FRAMES

from perfcap.io.result import read_result
from perfcap.report.sources import Sources, find_sources

BY_JOINTS = [[0.01, 0.0, -0.02, 0.03, 0.01, 0.0], [0.0, 0.02, 0.01, 0.0, -0.04, 0.02]]
BY_MASKS = [[0.0, 0.003, 0.0, 0.0, 0.01, 0.0], [0.001, 0.0, 0.002, -0.01, 0.0, 0.0]]


def found(steps: Any) -> dict[str, Any]:
    pairs = zip("ab", steps, strict=False)
    return {"camera_turn_shift": {n: {"value": s, "deviation": [1e-3] * 6} for n, s in pairs}}


def sources_of(folder: Path, **more: Any) -> Sources:
    path = folder / "run.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **more}))
    return find_sources(read_result(folder), slice(0, FRAMES))


def test_cameras_stand_where_joints_and_silhouettes_put_them(folder: Path) -> None:
    stated = sources_of(folder).cameras
    assert stated is not None
    joints = stated.nudged(torch.tensor(BY_JOINTS, dtype=torch.float64))
    one = sources_of(folder, view_errors=found(BY_JOINTS)).cameras
    assert one is not None and torch.allclose(one.rotation, joints.rotation)
    assert torch.allclose(one.translation, joints.translation)
    assert not torch.allclose(one.rotation, stated.rotation)
    both = sources_of(folder, refinement={"cameras": found(BY_MASKS)}).cameras
    masks = joints.nudged(torch.tensor(BY_MASKS, dtype=torch.float64))
    assert both is not None and torch.allclose(both.rotation, masks.rotation)
    assert torch.allclose(both.translation, masks.translation)


@pytest.mark.parametrize(
    "steps", [BY_JOINTS[:1], [[0.0] * 5, [0.0] * 6], [["0"] * 6, [0.0] * 6], [None, [0.0] * 6]]
)
def test_what_cannot_be_read_is_said(folder: Path, steps: Any) -> None:
    stated = sources_of(folder)
    damaged = sources_of(folder, view_errors=found(steps))
    assert stated.cameras is not None and damaged.cameras is not None
    assert torch.equal(damaged.cameras.rotation, stated.cameras.rotation)
    line = "Where the cameras were found to stand cannot be read."
    assert line in damaged.notes and line not in stated.notes
