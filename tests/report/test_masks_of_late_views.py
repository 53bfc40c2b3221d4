"""Pages of captures whose views are late: masks are those of the frames that are shown."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reported import FRAMES, START, VIEWS

from perfcap.io.mask_files import view_folders
from perfcap.io.result import read_result
from perfcap.report.outlines import mask_outlines
from perfcap.report.sources import find_sources
from perfcap.report.views import build_views


def drawn(folder: Path) -> list[np.ndarray]:
    result, rows = read_result(folder), slice(0, FRAMES)
    views = build_views(result, rows, find_sources(result, rows), lambda *_: None, videos=False)
    names = [f"mask-{kind}-{view}" for view in (0, 1) for kind in ("rings", "lengths", "points")]
    return [views.arrays[name] for name in names]


def report(folder: Path, **more: Any) -> None:
    path = folder / "run.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **more}))


@pytest.mark.parametrize("late", [-2, 1])
def test_masks_of_a_late_view_are_drawn_in_their_frames(folder: Path, late: int) -> None:
    expected = drawn(folder)
    place = folder / "masks" / view_folders(list(VIEWS))[1]
    files = sorted(place.glob("*.png"), reverse=late > 0)
    assert len(files) == FRAMES
    for path in files:
        path.rename(place / f"{int(path.stem) + late:06d}.png")
    report(folder, late_frames={VIEWS[0]: 0, VIEWS[1]: late})
    for found, true in zip(drawn(folder), expected, strict=True):
        np.testing.assert_array_equal(found, true)


@pytest.mark.parametrize(
    "late", ["high", {VIEWS[1]: "x"}, {VIEWS[1]: None}, {VIEWS[1]: 10**30}, [1, 2]]
)
def test_what_cannot_be_read_is_left_out(folder: Path, late: Any) -> None:
    expected = drawn(folder)
    report(folder, late_frames=late)
    for found, true in zip(drawn(folder), expected, strict=True):
        np.testing.assert_array_equal(found, true)


def test_frames_before_the_first_of_a_view_have_no_mask(folder: Path) -> None:
    numbers = [-1, START]
    found = mask_outlines(folder, VIEWS, 1, numbers, (96, 128))
    assert found is not None and found.rings[0] == 0 and found.rings[1] > 0
