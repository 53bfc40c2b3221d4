"""Where exports go, and what things in them are called."""

from pathlib import Path

import pytest

from perfcap.errors import InputError
from perfcap.io.export import publishing
from perfcap.io.export.names import ascii_label, identifier, unique_names, word


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
