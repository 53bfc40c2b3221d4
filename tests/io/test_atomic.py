"""Files appear complete or not at all, and a place that refuses is said in one line."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.video_writer import VideoWriter


def test_the_name_appears_when_the_content_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    with writing(path) as file:
        file.write(b"1234")
        assert not path.exists()
    assert path.read_bytes() == b"1234"
    assert [p.name for p in tmp_path.iterdir()] == ["a.bin"]


@pytest.mark.parametrize("error", [ValueError("x"), KeyboardInterrupt(), SystemExit(1)])
def test_what_was_there_survives_a_failure(tmp_path: Path, error: BaseException) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    with pytest.raises(type(error)), writing(path) as file:
        file.write(b"new")
        raise error
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.bin"]


def test_a_full_disk(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match="No space left") as caught,
        writing(tmp_path / "a") as file,
    ):
        file.write(b"some")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert "\n" not in str(caught.value) and "a:" in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_an_error_without_words_still_has_some(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="OSError"), writing(tmp_path / "a"):
        raise OSError


@pytest.mark.parametrize("place", ["missing/a", "file/a", "folder"])
def test_places_that_cannot_hold_the_file(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_bytes(b"x")
    (tmp_path / "folder").mkdir()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match="cannot be written"), writing(tmp_path / place) as file:
        file.write(b"1")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("place", ["missing/a.mp4", "file/a.mp4"])
def test_videos_too(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_bytes(b"x")
    with (
        pytest.raises(InputError, match="cannot be written"),
        VideoWriter(tmp_path / place, 30) as writer,
    ):
        writer.write(np.zeros((32, 32, 3), np.uint8))
