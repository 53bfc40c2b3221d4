"""Polygons of masks: the same area, holes, and nothing lost on the way."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from takes import make_take

from perfcap.report.outlines import SUBPIXEL, Outlines, mask_outlines, shown_cameras, trace


def disc(radius: float = 30, hole: float = 0) -> np.ndarray:
    y, x = np.mgrid[:100, :120] - np.array([50, 60])[:, None, None]
    away = np.hypot(x, y)
    return (away <= radius) & (away >= hole)


def filled(rings: list[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """What a browser fills by the even-odd rule, pixel by pixel."""
    count = np.zeros(size, int)
    for ring in rings:
        one = np.zeros(size, np.uint8)
        cv2.fillPoly(one, [np.rint(ring / SUBPIXEL - 0.5).astype(np.int32)], 1)
        count += one
    return count % 2 == 1


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def test_a_traced_mask_is_the_mask() -> None:
    mask = disc()
    rings = trace(mask)
    assert len(rings) == 1 and len(rings[0]) < 60
    assert overlap(filled(rings, mask.shape), mask) > 0.97


def test_holes_stay_open() -> None:
    mask = disc(40, 20)
    rings = trace(mask)
    assert len(rings) == 2
    assert overlap(filled(rings, mask.shape), mask) > 0.93


def test_larger_and_smaller_pictures() -> None:
    twice = trace(disc(), 2.0)[0] / SUBPIXEL
    np.testing.assert_allclose(np.ptp(twice, axis=0), 2 * 60, atol=1)
    np.testing.assert_allclose(twice.mean(0), [2 * 60.5, 2 * 50.5], atol=1)


def test_frames_come_back() -> None:
    frames = [trace(disc(30)), [], trace(disc(40, 20)), trace(disc(10))]
    packed = Outlines.collect(frames)
    assert packed.rings.tolist() == [1, 0, 2, 1]
    for found, true in zip(packed.frames(), frames, strict=True):
        assert len(found) == len(true)
        for ring, expected in zip(found, true, strict=True):
            np.testing.assert_array_equal(ring, expected)
    assert len(Outlines.collect([[], []]).points) == 0


def test_masks_that_are_missing_or_damaged_are_empty(tmp_path: Path) -> None:
    (tmp_path / "masks" / "one").mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "masks" / "one" / "000004.png"), disc().astype(np.uint8))
    (tmp_path / "masks" / "one" / "000005.png").write_bytes(b"no picture")
    cv2.imwrite(
        str(tmp_path / "masks" / "one" / "000006.png"), np.ones((100, 10), np.uint8)
    )  # odd shape
    found = mask_outlines(tmp_path, ["one", "two"], 0, [3, 4, 5, 6], (50, 60))
    assert found is not None and found.rings.tolist() == [0, 1, 0, 0]
    assert mask_outlines(tmp_path, ["one", "two"], 1, [4], (50, 60)) is None
    assert mask_outlines(tmp_path, ["one", "two"], 0, [7], (50, 60)) is None


def test_cameras_of_smaller_pictures() -> None:
    """Corners of images stay corners: pixel centres move by half a pixel more or less."""
    take = make_take(4, views=2, moving=True)
    points = take.actor.joints(take.truth)
    height, width = take.cameras.size[0]
    small = shown_cameras(take.cameras, [(height // 2, width // 4)] * 2)
    full, shown = take.cameras.project(points), small.project(points)
    factor = torch.tensor([0.25, 0.5], dtype=full.dtype)
    torch.testing.assert_close(shown + 0.5, (full + 0.5) * factor)
    assert small.size == ((height // 2, width // 4),) * 2


@pytest.mark.parametrize("size", [(1, 1), (3, 200)])
def test_masks_too_thin_for_an_outline(size: tuple[int, int]) -> None:
    mask = np.zeros(size, bool)
    mask[0, 0] = True
    assert trace(mask) == []
