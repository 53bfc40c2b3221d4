"""Painted videos: every frame once and in order, and the same bytes after an interruption."""

from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from takes import write_video

from perfcap.io.clip import Clip
from perfcap.pipeline import footage
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.footage import Image, Painter, write_footage

FRAMES = 83  # two segments of one view, the last batch is a part


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], Clip]:
    folder = tmp_path_factory.mktemp("clips")
    paths = [folder / f"{view}.mp4" for view in range(2)]
    for path in paths:
        write_video(path, FRAMES, (48, 64), half=10)
    return lambda views: Clip.open(paths[:views])


def stripes(stop_at: int = FRAMES) -> Callable[[slice], Painter]:
    """Painters that write a frame's number into its brightness, 3 grey levels apart."""

    def prepare(span: slice) -> Painter:
        if span.start >= stop_at:
            raise KeyboardInterrupt

        def paint(frame: int, view: int, image: Image) -> Image:
            return np.full_like(image, 3 * (span.start + frame) if view == 0 else 255)

        return paint

    return prepare


def shown(path: Path) -> np.ndarray:
    """The number that each picture carries, at its time."""
    with av.open(str(path)) as container:
        pictures = list(container.decode(video=0))
    assert np.all(np.diff([picture.time for picture in pictures]) > 0)
    grey = [picture.to_ndarray(format="rgb24")[:40, :40].mean() for picture in pictures]
    return np.array(grey).round() / 3


@pytest.mark.long
@pytest.mark.parametrize("views", [1, 2])
def test_every_frame_once_and_in_order(
    tmp_path: Path, clips: Callable[[int], Clip], views: int
) -> None:
    done: list[tuple[int, int]] = []
    write_footage(
        tmp_path / "a.mp4",
        clips(views),
        FRAMES,
        stripes(),
        lambda at, total: done.append((at, total)),
    )
    np.testing.assert_allclose(shown(tmp_path / "a.mp4"), np.arange(FRAMES), atol=0.7)
    assert done[-1] == (FRAMES, FRAMES)
    assert done == sorted(done)


def test_a_part_of_the_clip(tmp_path: Path, clips: Callable[[int], Clip]) -> None:
    write_footage(tmp_path / "a.mp4", clips(1), 65, stripes())
    assert len(shown(tmp_path / "a.mp4")) == 65


@pytest.mark.long
@pytest.mark.parametrize("stop_at", [0, 48, 64, 80])
def test_interrupted_and_gone_on_with(
    tmp_path: Path, clips: Callable[[int], Clip], stop_at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_footage(tmp_path / "whole.mp4", clips(1), FRAMES, stripes())
    kept = Checkpoint(tmp_path).kept("overlay")
    with pytest.raises(KeyboardInterrupt):
        write_footage(tmp_path / "again.mp4", clips(1), FRAMES, stripes(stop_at), kept=kept)
    assert not (tmp_path / "again.mp4").exists()
    starts: list[int] = []

    def counted(span: slice) -> Painter:
        starts.append(span.start)
        return stripes()(span)

    write_footage(tmp_path / "again.mp4", clips(1), FRAMES, counted, kept=kept)
    assert (tmp_path / "again.mp4").read_bytes() == (tmp_path / "whole.mp4").read_bytes()
    assert starts[0] == stop_at // footage._SEGMENT * footage._SEGMENT
