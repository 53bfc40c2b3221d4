"""Videos that are written whole, or not at all."""

from pathlib import Path

import numpy as np
import pytest
from video_files import make_video, number, picture

from perfcap.errors import InputError
from perfcap.io.video import VideoFile
from perfcap.io.video_writer import VideoWriter


def test_odd_sizes_are_padded(tmp_path: Path) -> None:
    assert VideoFile(make_video(tmp_path / "odd.mp4", 3, (47, 63))).size == (48, 64)


def test_a_colon_in_a_relative_path_is_no_protocol(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(VideoFile(make_video(Path("take:2.mp4"), 3))) == 3


def test_nothing_half_written_under_the_final_name(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    with pytest.raises(RuntimeError, match="stop"), VideoWriter(path, 30) as writer:
        writer.write(picture(0))
        assert not path.exists()
        raise RuntimeError("stop")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ValueError, match="no frames"), VideoWriter(path, 30):
        pass
    assert list(tmp_path.iterdir()) == []


def test_writer_into_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        make_video(tmp_path / "nowhere" / "a.mp4", 2)


def test_writer_refuses_what_is_no_frame(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="fps is 0"):
        VideoWriter(tmp_path / "a.mp4", 0)
    writer = VideoWriter(tmp_path / "a.mp4", 30)
    with pytest.raises(ValueError, match="expected uint8"):
        writer.write(np.zeros((4, 4, 3), np.float32))  # type: ignore[arg-type]
    writer.write(picture(0))
    with pytest.raises(ValueError, match="the first had"):
        writer.write(picture(0, 32))
    writer.discard()
    assert list(tmp_path.iterdir()) == []


def test_segments_are_the_frames(tmp_path: Path) -> None:
    """Of one frame, of two and of many, between frames that are written one by one."""
    frames = [picture(place) for place in range(40)]
    with VideoWriter(tmp_path / "a.mp4", 30, crf=5) as writer:
        for part in (slice(0, 1), slice(1, 3), slice(3, 20)):
            writer.append(writer.encoding.segment(frames[part]))
        for frame in frames[20:25]:
            writer.write(frame)
        writer.append(writer.encoding.segment(frames[25:]))
    video = VideoFile(tmp_path / "a.mp4")
    assert (len(video), video.fps) == (40, 30)
    assert [number(frame) for frame in video.read(0, 40)] == list(range(40))
    with (
        pytest.raises(ValueError, match="a segment has frames"),
        VideoWriter(tmp_path / "b.mp4", 30) as writer,
    ):
        writer.write(picture(0))
        writer.append(writer.encoding.segment([picture(0, 32)]))
    with pytest.raises(ValueError, match="no frames to encode"):
        writer.encoding.segment([])


def test_equal_frames_make_equal_files(tmp_path: Path) -> None:
    """Also where memory was used by others before."""
    rng = np.random.default_rng(0)
    smooth = rng.random((5, 20, 20, 3)).repeat(8, 1).repeat(8, 2)
    frames = (255 * smooth).astype(np.uint8)
    made, used = set(), []
    for turn in range(12):
        with VideoWriter(tmp_path / "a.mp4", 30) as writer:
            for frame in frames:
                writer.write(frame)
        made.add((tmp_path / "a.mp4").read_bytes())
        used.append(np.full(40_000 * (turn % 5 + 1), turn, np.uint8))
        used = used[turn % 3 :]
    assert len(made) == 1
