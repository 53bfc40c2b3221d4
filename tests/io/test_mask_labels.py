"""Hand-drawn outlines."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.mask_files import fill, read_labels

SIZE = (40, 30)
SQUARE = [[5.0, 5], [15, 5], [15, 25], [5, 25]]
HOLE = [[8.0, 8], [12, 8], [12, 12], [8, 12]]


def write(path: Path, **content: Any) -> Path:
    path.write_text(json.dumps({"video": "a.mp4", "size": list(SIZE), **content}))
    return path


def test_outlines_and_holes(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", frames={"0": [SQUARE, HOLE], "7": []})
    labels = read_labels(path, SIZE)
    assert sorted(labels) == [0, 7]
    mask = fill(labels[0], SIZE)
    assert mask.shape == SIZE
    assert mask[20, 10] and mask[6, 6] and not mask[10, 10] and not mask[20, 20]
    assert abs(mask.sum() - (10 * 20 - 16)) <= 31 + 10  # centres on an edge may count either way
    assert not fill(labels[7], SIZE).any()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"size": [30, 40], "frames": {}}, "expected \\[40, 30\\]"),
        ({"frames": [1]}, "'frames' object"),
        ({"frames": {"one": []}}, "'frames' object"),
        ({"frames": {"3": [[[1, 2], [3, 4]]]}}, "frame 3"),
        ({"frames": {"3": [[[1, 2], [3, float("nan")], [5, 6]]]}}, "frame 3"),
        ({"frames": {"3": [["x"]]}}, "frame 3"),
    ],
)
def test_bad_labels(tmp_path: Path, content: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_labels(write(tmp_path / "a.json", **content), SIZE)


def test_a_filled_outline_is_its_area() -> None:
    turn = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    disc = np.stack((14.3 + 10.2 * np.cos(turn), 19.8 + 10.2 * np.sin(turn)), -1)
    area = fill([disc], SIZE).sum()
    assert area == pytest.approx(np.pi * 10.2**2, rel=0.01)
