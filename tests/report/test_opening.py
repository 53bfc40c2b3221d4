"""The frame that a page opens with."""

from __future__ import annotations

from typing import Any

import numpy as np

from perfcap.report.content import opening_frame
from perfcap.report.marks import Mark

VIEW = {"height": 100, "width": 200}
RNG = np.random.default_rng(0)


def person(frames: int, size: float = 20, at: tuple[float, float] = (100, 50)) -> np.ndarray:
    """Joints of a person that fills a square of that size, (F, 16, 2)."""
    shape = RNG.uniform(-0.5, 0.5, (16, 2))
    shape = (shape - shape.min(0)) / np.ptp(shape, axis=0) - 0.5
    return np.tile(size * shape + np.array(at), (frames, 1, 1))


def opened(pixels: list[np.ndarray], trust: Any = None, marks: Any = (), first: int = 0) -> int:
    arrays = {f"joints2d-{k}": each for k, each in enumerate(pixels)}
    frames = len(trust) if trust is not None else len(pixels[0])
    known = None if trust is None else np.asarray(trust, float)
    return opening_frame(frames, known, arrays, [VIEW] * len(pixels), marks, first)


def test_the_most_trusted_frame() -> None:
    assert opened([], [0.3, 0.5, 0.9, 0.6]) == 2
    assert opened([person(4)], [0.3, 0.5, 0.9, 0.6]) == 2


def test_of_equally_trusted_frames_the_one_with_the_largest_person() -> None:
    pixels = person(5)
    pixels[3] = person(1, 60)[0]
    assert opened([pixels], [0.9, 0.905, 0.9, 0.895, 0.91]) == 3


def test_people_that_leave_the_image_do_not_open_a_page() -> None:
    pixels = np.concatenate([person(2, 90, (195, 50)), person(2, 20), person(1, 90, (900, 900))])
    assert opened([pixels]) in (2, 3)
    far = [person(5, at=(-500, 0)), pixels]
    assert opened(far) in (2, 3)


def test_frames_that_were_not_captured_come_last() -> None:
    trust = [0.5, 0.99, 0.98, 0.4]
    assert opened([], trust, [Mark(11, 13, "bad", "not captured")], first=10) == 0
    assert opened([], trust, [Mark(11, 13, "odd", "doubtful mask")], first=10) == 1


def test_without_knowledge_it_is_the_first() -> None:
    assert opening_frame(6, None, {}, [], [], 0) == 0
    assert opened([], [np.nan] * 4) == 0
    assert opened([np.full((3, 16, 2), np.nan)]) == 0
