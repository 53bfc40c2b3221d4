"""Frames that are read again, or far apart: the same ones, with less decoding."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from video_files import make_video, number, picture, write_frames

from perfcap.io.clip import Clip
from perfcap.io.video import VideoFile

_FRAMES = 150


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One key frame, at the start."""
    options = {"crf": "5", "g": "1000", "sc_threshold": "0"}
    return _written(tmp_path_factory.mktemp("video") / "a.mp4", options)


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A key frame every 50 frames."""
    options = {"crf": "5", "g": "50", "keyint_min": "50", "sc_threshold": "0"}
    return _written(tmp_path_factory.mktemp("keyed") / "a.mp4", options)


def _written(path: Path, options: dict[str, str]) -> Path:
    frames = [(picture(i), i) for i in range(_FRAMES)]
    write_frames(path, frames, Fraction(1, 30), options)
    return path


def watch_seeks(source: VideoFile, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    seeks: list[int] = []
    seek = source._seek

    def noted(wanted: int) -> None:
        seeks.append(wanted)
        seek(wanted)

    monkeypatch.setattr(source, "_seek", noted)
    return seeks


def test_key_frames_are_known(video: Path, keyed: Path) -> None:
    assert VideoFile(video).index.keys == (0,)
    assert VideoFile(keyed).index.keys == (0, 50, 100)


def test_far_ahead_goes_on_where_a_seek_would_lead_back(
    video: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = VideoFile(video)
    seeks = watch_seeks(source, monkeypatch)
    found = [number(source.read(i, i + 1)[0]) for i in (3, 60, 149, 10)]
    assert found == [3, 60, 149, 10]
    assert seeks == [3, 10]


def test_far_ahead_seeks_where_a_key_frame_is_nearer(
    keyed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = VideoFile(keyed)
    seeks = watch_seeks(source, monkeypatch)
    wanted = (3, 30, 130, 148, 20)
    assert [number(source.read(i, i + 1)[0]) for i in wanted] == list(wanted)
    assert seeks == [3, 130, 20]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["video", "keyed"])
def test_any_order_gives_the_same_frames(
    name: str, seed: int, request: pytest.FixtureRequest
) -> None:
    path = request.getfixturevalue(name)
    whole, source = VideoFile(path).read(0, _FRAMES), VideoFile(path)
    order = np.random.default_rng(seed).integers(0, _FRAMES, 40).tolist()
    source.keep(order[::3])
    for frame in order:
        assert np.array_equal(source.read(frame, frame + 1)[0], whole[frame])


def test_held_frames_are_not_decoded_again(video: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = VideoFile(video)
    source.keep([0, 40, 149])
    whole = source.read(0, _FRAMES)
    monkeypatch.setattr(source, "_decoded", _refuse)
    for frame in (149, 0, 40):
        assert np.array_equal(source.read(frame, frame + 1)[0], whole[frame])
    with pytest.raises(AssertionError, match="decoded"):
        source.read(41, 42)


def test_held_frames_are_bounded_and_let_go(video: Path) -> None:
    source = VideoFile(video)
    each = 48 * 64 * 3 // 2  # bytes of a decoded frame, but for padding of its rows
    source.keep(range(_FRAMES), 20 * each)
    source.read(0, _FRAMES)
    assert 5 <= len(source._kept) <= 20
    source.keep(())
    assert not source._kept
    source.keep([5])
    source.read(0, 10)
    source.close()
    assert not source._kept
    assert number(source.read(5, 6)[0]) == 5


def test_a_part_of_a_clip_counts_from_its_first_frame(tmp_path: Path) -> None:
    clip = Clip.open(make_video(tmp_path / "a.mp4"), frames=slice(10, 60))
    clip.keep([0, 20])
    clip.read_view(0, 0, 50)
    (source,) = clip.sources
    assert isinstance(source, VideoFile)
    assert sorted(source._kept) == [10, 30]
    assert number(clip.read_view(0, 20, 21)[0]) == 30


def _refuse(wanted: int) -> Any:
    raise AssertionError(f"frame {wanted} is decoded")
