"""Reports of views that are late, and of one person of files that list everybody."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from reported import FRAMES, START, VIEWS

from perfcap.detect.detections import at_clock
from perfcap.io.detections import read_detections, save_detections
from perfcap.io.result import read_result
from perfcap.report.sources import Sources, find_sources

ROWS = slice(2, 7)


def clocks(*values: Any, deviation: Any = 0.05) -> dict[str, Any]:
    pairs = zip(VIEWS, values, strict=False)
    return {"clock_frames": {n: {"value": v, "deviation": deviation} for n, v in pairs}}


def sources_of(folder: Path, request: dict[str, Any] | None = None, **more: Any) -> Sources:
    path = folder / "run.json"
    report = json.loads(path.read_text())
    report["request"] |= request or {}
    path.write_text(json.dumps({**report, **more}))
    return find_sources(read_result(folder), ROWS)


@pytest.mark.parametrize(("clock", "late"), [(2.04, 2), (-1.98, -2), (1.4, 1), (7.0, 7)])
def test_late_views_are_shown_when_the_capture_saw_them(
    folder: Path, clock: float, late: int
) -> None:
    plain = find_sources(read_result(folder), slice(0, FRAMES))
    assert plain.clip is not None and plain.detections is not None
    found = sources_of(folder, view_errors=clocks(0.0, clock))
    assert found.clip is not None and found.detections is not None and not found.notes
    all_own = plain.clip.sources[1].read(0, START + FRAMES)
    shown = START + np.arange(ROWS.start, ROWS.stop)
    # the first or the last one, where there is none
    ends = np.clip(shown + late, 0, START + FRAMES - 1)
    np.testing.assert_array_equal(found.clip.read_view(1, 0, len(found.clip)), all_own[ends])
    assert len(found.clip) == len(shown)
    np.testing.assert_array_equal(
        found.clip.read_view(0, 0, len(found.clip)), plain.clip.read_view(0, ROWS.start, ROWS.stop)
    )
    read = float(late) if abs(clock - late) < 0.1 else clock
    moved = at_clock(plain.detections, torch.tensor([0.0, read], dtype=torch.float64))
    wanted = moved.frames(ROWS)
    assert torch.equal(found.detections.confidence2d, wanted.confidence2d)
    seen = wanted.confidence2d > 0
    torch.testing.assert_close(found.detections.joints2d[seen], wanted.joints2d[seen])


@pytest.mark.parametrize(
    "damaged", [clocks(0.0), clocks(0.0, "2"), clocks(0.0, None), clocks(0.0, 2.0, deviation=None)]
)
def test_clocks_that_cannot_be_read_are_said(folder: Path, damaged: dict[str, Any]) -> None:
    found = sources_of(folder, view_errors=damaged)
    assert "By how much views are later cannot be read." in found.notes
    assert found.clip is not None and found.detections is not None


def test_one_of_everybody_is_who_was_captured(folder: Path) -> None:
    """The files that were given list people whom the capture did not follow."""
    missing = sources_of(folder, {"people": 1})
    assert missing.detections is None
    assert "Detected joints are not shown: there are none in the folder." in missing.notes
    given = json.loads((folder / "run.json").read_text())["request"]["detections"][0]
    seen, _ = read_detections(given, views=VIEWS)
    own = seen.frames(slice(START, START + FRAMES))
    own.joints2d[:] += 5.0
    save_detections(folder / "detections.npz", own, VIEWS, start=START)
    # joints that were given in the pixels of the videos are kept in those of the cameras
    found = sources_of(folder, {"people": 1, "detections_in": "video"})
    assert found.detections is not None and not found.notes
    torch.testing.assert_close(found.detections.joints2d, own.frames(ROWS).joints2d)
