"""Where exports go, and what things in them are called."""

import errno
import os
from pathlib import Path
from typing import Any

import pytest

from perfcap.errors import InputError
from perfcap.io.export import publishing
from perfcap.io.export.options import ascii_label, identifier, unique_names, word


def test_names_become_what_formats_take_and_stay_different() -> None:
    names = ("a b", "a_b", "a\tb", "mixamorig:Hips", "{}", "1/ü", "")
    assert unique_names(names, word)[:3] == ("a_b", "a_b_2", "a_b_3")
    assert identifier("mixamorig:Hips") == "mixamorig_Hips" and identifier("1/ü") == "_1__"
    assert ascii_label("ü x") == "__x"
    for clean in (word, identifier, ascii_label):
        found = unique_names(names, clean)
        assert len(set(found)) == len(names) and all(found)


@pytest.mark.parametrize("error", [InputError("x"), OSError(28, "No space left"), KeyError("x")])
def test_nothing_of_a_failed_export_stays(error: Exception, tmp_path: Path) -> None:
    target = tmp_path / "new" / "out"
    expected = InputError if isinstance(error, OSError) else type(error)
    with pytest.raises(expected) as caught, publishing(target) as scratch:
        (scratch / "a.bin").write_bytes(b"1")
        (scratch / "inside").mkdir()
        raise error
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_messages_name_the_folder_that_users_know(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught, publishing(tmp_path) as scratch:
        raise InputError(f"{scratch / 'a.glb'}: cannot be written")
    assert str(caught.value) == f"{tmp_path / 'a.glb'}: cannot be written"


def test_an_export_replaces_an_older_one_and_nothing_else(tmp_path: Path) -> None:
    for content in ("one", "two"):
        with publishing(tmp_path) as scratch:
            (scratch / "seq").mkdir()
            (scratch / "seq" / f"{content}.obj").write_text(content)
            (scratch / "a.glb").write_text(content)
    assert [p.name for p in (tmp_path / "seq").iterdir()] == ["two.obj"]
    assert (tmp_path / "a.glb").read_text() == "two"
    (tmp_path / "seq" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match=r"holds letter.txt"), publishing(tmp_path) as scratch:
        (scratch / "seq").mkdir()
        (scratch / "seq" / "three.obj").write_text("three")
        (scratch / "a.glb").write_text("three")
    assert (tmp_path / "a.glb").read_text() == "two"
    assert (tmp_path / "seq" / "letter.txt").exists()
    with pytest.raises(InputError, match="is a folder already"), publishing(tmp_path) as scratch:
        (scratch / "seq").write_text("x")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.glb", "seq"]


def contents(folder: Path) -> dict[str, str]:
    """Files by their names, hidden ones too."""
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


OLD = {"a.glb": "old", "about.txt": "old", "more.txt": "old", "seq/1.obj": "old"}
NEW = {"a.glb": "new", "more.txt": "new", "seq/1.obj": "new"}


def put(folder: Path, content: str) -> None:
    """Files, of which some tell of the others: new ones lack one of these."""
    with publishing(folder, lambda _: ("about.txt", "more.txt")) as scratch:
        (scratch / "a.glb").write_text(content)
        (scratch / "more.txt").write_text(content)
        if content == "old":
            (scratch / "about.txt").write_text(content)
        (scratch / "seq").mkdir()
        (scratch / "seq" / "1.obj").write_text(content)


def test_a_kill_at_any_change_leaves_the_old_or_the_new(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the next call finds after every call that changes a folder was the last."""

    class Killed(BaseException):
        pass

    calls = 0
    real = {name: getattr(os, name) for name in ("replace", "mkdir", "unlink", "rmdir", "fsync")}

    def dying(name: str, last: int) -> Any:
        def call(*args: Any, **kwargs: Any) -> Any:
            nonlocal calls
            calls += 1
            if calls >= last:  # nothing works any more, cleaning up neither
                raise Killed
            return real[name](*args, **kwargs)

        return call

    ends = set()
    for last in range(1, 60):
        folder = tmp_path / str(last)
        put(folder, "old")
        calls = 0
        with monkeypatch.context() as patch:
            for name in real:
                patch.setattr(os, name, dying(name, last))
            try:
                put(folder, "new")
            except Killed:
                pass
            else:
                break
        with publishing(folder):
            pass
        found = contents(folder)
        assert found in (OLD, NEW), (last, found)
        ends.add(found["a.glb"])
    assert ends == {"old", "new"} and last > 8


def test_a_refusing_disk_leaves_the_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every call that takes space is refused in turn: the old stays, and is what is read."""
    refused = 0
    real = {name: getattr(os, name) for name in ("mkdir", "fsync", "open")}
    for at in range(1, 40):
        folder = tmp_path / str(at)
        put(folder, "old")
        calls = 0

        def full(name: str, at: int = at) -> Any:
            def call(*args: Any, **kwargs: Any) -> Any:
                nonlocal calls
                calls += 1
                if calls == at:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                return real[name](*args, **kwargs)

            return call

        with monkeypatch.context() as patch:
            for name in real:
                patch.setattr(os, name, full(name))
            try:
                put(folder, "new")
            except (InputError, OSError):
                refused += 1
        assert contents(folder) in (OLD, NEW), at
        if calls < at:
            break
    assert refused > 3


def test_one_at_a_time(tmp_path: Path) -> None:
    with (
        publishing(tmp_path),
        pytest.raises(InputError, match="another perfcap"),
        publishing(tmp_path),
    ):
        pass


def test_only_files_that_are_named_go(tmp_path: Path) -> None:
    (tmp_path / "about.txt").mkdir()
    (tmp_path / "notes.txt").write_text("mine")
    put(tmp_path, "new")
    assert contents(tmp_path) == {**NEW, "notes.txt": "mine"} and (tmp_path / "about.txt").is_dir()


def test_what_an_older_version_was_about_to_publish_is_published(tmp_path: Path) -> None:
    (tmp_path / ".perfcap-new" / "new").mkdir(parents=True)
    (tmp_path / ".perfcap-new" / "new" / "a.glb").write_text("new")
    (tmp_path / ".perfcap-new" / "publish.json").write_text('["a.glb"]')
    with publishing(tmp_path):
        assert (tmp_path / "a.glb").read_text() == "new"


PLANS = ('["../x"]', "[1]", '{"a": 1}', '["a/b"]', '{"names": [], "gone": ["../x"]}')


@pytest.mark.parametrize("plan", PLANS)
def test_damaged_plans_move_nothing(plan: str, tmp_path: Path) -> None:
    work = tmp_path / "out" / ".perfcap-new"
    (work / "new").mkdir(parents=True)
    (work / "publish.json").write_text(plan)
    with pytest.raises(InputError, match="is damaged"), publishing(tmp_path / "out"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
