"""Files appear complete or not at all, and a place that refuses is said in one line."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.atomic import partial_path, writing
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


def test_what_a_killed_writer_left_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    partial_path(path).write_bytes(b"what was written before the kill")
    with writing(path) as file:
        file.write(b"new")
    assert path.read_bytes() == b"new" and [p.name for p in tmp_path.iterdir()] == ["a.bin"]
    partial_path(tmp_path / "a.mp4").write_bytes(b"half")
    with VideoWriter(tmp_path / "a.mp4", 30) as writer:
        writer.write(np.zeros((32, 32, 3), np.uint8))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.bin", "a.mp4"]


def test_one_writer_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    with writing(path) as file:
        file.write(b"first")
        with pytest.raises(InputError, match="another perfcap writes it"), writing(path) as other:
            other.write(b"second")
        file.write(b", whole")
    assert path.read_bytes() == b"first, whole"


def test_a_link_in_the_way_is_not_written_through(tmp_path: Path) -> None:
    (tmp_path / "precious").write_bytes(b"mine")
    partial_path(tmp_path / "a").symlink_to(tmp_path / "precious")
    with pytest.raises(InputError, match="cannot be written"), writing(tmp_path / "a") as file:
        file.write(b"x")
    os.mkfifo(partial_path(tmp_path / "b"))
    with pytest.raises(InputError, match="cannot be written"), writing(tmp_path / "b") as file:
        file.write(b"x")
    assert (tmp_path / "precious").read_bytes() == b"mine"


def test_content_is_on_the_disk_before_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []
    sync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda fd: (seen.append("sync"), sync(fd)))
    monkeypatch.setattr(os, "replace", lambda a, b: (seen.append("name"), replace(a, b)))
    with writing(tmp_path / "a") as file:
        file.write(b"x")
    assert seen == ["sync", "name"]
