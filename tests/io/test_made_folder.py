"""Folders that a command makes: held while it runs, and gone where nothing came of it."""

import os
from pathlib import Path

import pytest

from perfcap.errors import InputError
from perfcap.io.made_folder import made_folder
from perfcap.io.result_folder import locked


def test_folders_made_for_nothing_are_removed(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(InputError, match="no video"), made_folder(tmp_path / "there" / "a" / "b"):
        raise InputError("no video")
    assert [*tmp_path.rglob("*")] == [tmp_path / "there"]
    with pytest.raises(InputError, match="no video"), made_folder(tmp_path / "there"):
        raise InputError("no video")
    assert (tmp_path / "there").is_dir()  # made by the user


def test_what_holds_something_stays(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="late"), made_folder(tmp_path / "a" / "b") as folder:
        (folder / "kept").write_text("x")
        raise InputError("late")
    assert (tmp_path / "a" / "b" / "kept").read_text() == "x"


def test_one_process_writes_at_a_time(tmp_path: Path) -> None:
    with made_folder(tmp_path / "a") as folder:
        with pytest.raises(InputError, match="another perfcap"), locked(folder):
            pass
        with pytest.raises(InputError, match="another perfcap"), made_folder(folder):
            pass
        assert folder.is_dir()


def test_places_that_refuse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("x")
    for place in (tmp_path / "file", tmp_path / "file" / "inside", f"{tmp_path}/a\0b", "a" * 300):
        with pytest.raises(InputError, match="cannot be written"), made_folder(place):
            pass
    with pytest.raises(InputError, match="is empty"), made_folder(""):
        pass
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match="not writable"), made_folder(tmp_path / "new"):
        pass
    assert [*tmp_path.iterdir()] == [tmp_path / "file"]
