"""What an actor's folder may lose when another actor takes its place."""

from pathlib import Path

import pytest
from foreign_rigs import MIXAMO, Rig
from test_actor_import import load_from

from perfcap.app.actor_build import spare_sources
from perfcap.errors import InputError
from perfcap.io.actor_folder import save_actor
from perfcap.io.actor_place import BESIDE

OWN = {"actor.glb", "manifest.toml"}


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def put(folder: Path) -> None:
    for name in (*BESIDE, "notes.txt"):
        (folder / name).write_bytes(b"x")


def test_what_tells_of_an_earlier_actor_goes_and_nothing_else(tmp_path: Path) -> None:
    actor = load_from(Rig(MIXAMO).template()).actor
    put(tmp_path)
    save_actor(actor, tmp_path)  # no actor was there: these files tell of something else
    assert files(tmp_path) == OWN | {*BESIDE, "notes.txt"}
    save_actor(actor, tmp_path)
    assert files(tmp_path) == OWN | {"notes.txt"}
    put(tmp_path)

    def beside(folder: Path) -> None:
        (folder / "fit.jpg").write_text("new")

    save_actor(actor, tmp_path, beside=beside)
    assert files(tmp_path) == OWN | {"notes.txt", "fit.jpg"}
    assert (tmp_path / "fit.jpg").read_text() == "new"


def test_the_body_of_a_capture_and_a_shape_space_stay(tmp_path: Path) -> None:
    actor = load_from(Rig(MIXAMO).template()).actor
    save_actor(actor, tmp_path)
    put(tmp_path)
    save_actor(actor, tmp_path, shape_space="fit.jpg")
    assert files(tmp_path) == OWN | {"notes.txt", "fit.jpg"}
    put(tmp_path)
    (tmp_path / "run.json").write_text("{}")
    save_actor(actor, tmp_path)
    assert files(tmp_path) == OWN | {"notes.txt", "body.npz", "measurements.json", "run.json"}


def test_nothing_changes_when_a_file_beside_cannot_be_made(tmp_path: Path) -> None:
    def fails(folder: Path) -> None:
        (folder / "body.npz").write_bytes(b"half")
        raise InputError(f"{folder / 'fit.jpg'}: cannot be written")

    actor = load_from(Rig(MIXAMO).template()).actor
    save_actor(actor, tmp_path)
    put(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(InputError) as caught:
        save_actor(actor, tmp_path, beside=fails)
    assert str(caught.value) == f"{tmp_path / 'fit.jpg'}: cannot be written"
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_what_an_actor_is_made_of_stays(tmp_path: Path) -> None:
    put(tmp_path)
    spare_sources(tmp_path, "ada", [tmp_path / "notes.txt"])
    for model in (tmp_path, tmp_path / "body.npz"):
        with pytest.raises(InputError, match=r"body\.npz of the actor would replace the input"):
            spare_sources(tmp_path, str(model))
    with pytest.raises(InputError, match=r"measurements\.json of the actor would replace"):
        spare_sources(tmp_path, "ada", [tmp_path / "measurements.json"])
