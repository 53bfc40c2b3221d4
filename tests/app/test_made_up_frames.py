"""Frames without a capture, one or several, in words."""

from types import SimpleNamespace
from typing import Any

import pytest

from perfcap.app.capture_checks import made_up


@pytest.mark.parametrize(
    ("gap", "said"),
    [
        ((5, 6), "frame 25: no person is detected; it is interpolated"),
        ((5, 8), "frames 25 to 27: no person is detected; they are interpolated"),
    ],
)
def test_gaps(gap: tuple[int, int], said: str) -> None:
    performance: Any = SimpleNamespace(gaps=(gap,), lost=0, frames=20)
    assert list(made_up(performance, 20)) == [said]


@pytest.mark.parametrize(("lost", "said"), [(1, "frame 40: it is"), (3, "frames 40 to 42: they")])
def test_frames_at_the_end(lost: int, said: str) -> None:
    performance: Any = SimpleNamespace(gaps=(), lost=lost, frames=20)
    (line,) = made_up(performance, 20)
    assert line.startswith(said) and line.endswith("missing in the video or its detections")
