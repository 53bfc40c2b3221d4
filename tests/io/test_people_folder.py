"""The folder of several people: put into place together, or not at all."""

import json
from pathlib import Path

import pytest

from perfcap.errors import InputError
from perfcap.io.result_folder import finish, is_several, locked, people_of, replacing, write_people

REPORT = "run.json"


def write(folder: Path, files: dict[str, str]) -> None:
    """A result of these files."""
    with locked(folder), replacing(folder, last=True) as scratch:
        for name, content in files.items():
            (scratch / name).parent.mkdir(exist_ok=True, parents=True)
            (scratch / name).write_text(content)


def pair(text: str = "new", people: int = 2) -> dict[str, str]:
    folders = [{"folder": f"person{k}"} for k in range(1, people + 1)]
    files = {"people.json": json.dumps({"people": folders}), REPORT: text, "scene.glb": text}
    for k in range(1, people + 1):
        files |= {f"person{k}/motion.npz": text, f"person{k}/{REPORT}": text}
        files |= {f"person{k}/masks/left/000000.png": text}
    return files


def everything(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}


def test_people_replace_one_and_one_replaces_people(tmp_path: Path) -> None:
    write(tmp_path, {"motion.npz": "old", REPORT: "old", "overlay.mp4": "old"})
    assert people_of(tmp_path) == (tmp_path,) and not is_several(tmp_path)
    write(tmp_path, pair(people=3))
    assert everything(tmp_path) == set(pair(people=3)) and is_several(tmp_path)
    assert [place.name for place in people_of(tmp_path)] == ["person1", "person2", "person3"]
    (tmp_path / "person3/masks/left/note.txt").write_text("mine")
    write(tmp_path, pair())
    assert everything(tmp_path) == {*pair(), "person3/masks/left/note.txt"}
    write(tmp_path, {"motion.npz": "one", REPORT: "one"})
    assert everything(tmp_path) == {"motion.npz", REPORT, "person3/masks/left/note.txt"}


def test_an_interrupted_replacement_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, pair("old"))
    from perfcap.io import result_folder as module

    moved: list[str] = []
    genuine = module.os.replace

    def stop(source: Path, target: Path) -> None:
        if Path(target).suffix == ".npz" and moved:
            raise KeyboardInterrupt
        moved.append(str(target))
        genuine(source, target)

    monkeypatch.setattr(module.os, "replace", stop)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path, pair("new"))
    monkeypatch.undo()
    assert not (tmp_path / REPORT).exists()  # nothing vouches for half of it
    with locked(tmp_path):
        finish(tmp_path)
    assert everything(tmp_path) == set(pair())
    assert all((tmp_path / name).read_text() == text for name, text in pair("new").items())


@pytest.mark.parametrize("place", ["person2", "person1/masks", "person1/masks/left"])
def test_links_are_not_followed(tmp_path: Path, place: str) -> None:
    outside, folder = tmp_path / "outside", tmp_path / "out"
    outside.mkdir()
    (folder / place).parent.mkdir(parents=True)
    (folder / place).symlink_to(outside)
    with pytest.raises(InputError, match="expected a folder"):
        write(folder, pair())
    assert not list(outside.iterdir())


@pytest.mark.parametrize("name", ["person1/../../x", "person1/other.txt", "person0/motion.npz"])
def test_plans_do_not_lead_elsewhere(tmp_path: Path, name: str) -> None:
    work = tmp_path / ".perfcap"
    (work / "next").mkdir(parents=True)
    (work / "publish.json").write_text(json.dumps({"names": [name], "older": False, "last": True}))
    with pytest.raises(InputError, match="is damaged"):
        finish(tmp_path)


@pytest.mark.parametrize(
    "content",
    [
        '{"people": []}',
        "[]",
        '{"people": [{"folder": "../x"}]}',
        '{"people": [{}]}',
        '{"people": 3}',
    ],
)
def test_damaged_lists_of_people(tmp_path: Path, content: str) -> None:
    (tmp_path / "people.json").write_text(content)
    with pytest.raises(InputError, match="names no folders of people"):
        people_of(tmp_path)


def test_nobody_is_listed_twice(tmp_path: Path) -> None:
    (tmp_path / "people.json").write_text(json.dumps({"people": [{"folder": "person1"}] * 2}))
    with pytest.raises(InputError, match="names person1 twice"):
        people_of(tmp_path)


def test_people_are_listed_in_order(tmp_path: Path) -> None:
    write_people(tmp_path, [{"actor": "a"}, {"actor": "b"}])
    listed = json.loads((tmp_path / "people.json").read_text())
    assert listed["K"] == 2
    assert listed["people"] == [
        {"folder": "person1", "actor": "a"}, {"folder": "person2", "actor": "b"}
    ]  # fmt: skip


def test_people_lie_in_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    write(folder, pair())
    (folder / "person2").rename(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"person2: is no folder of a person"):
        people_of(folder)
    (folder / "person2").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"person2: is no folder of a person"):
        people_of(folder)
