"""Files and folders that are given as an actor and hold no character: what to do with them."""

from pathlib import Path

import pytest

from perfcap.errors import InputError
from perfcap.io.actor import find_actor


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("scan.obj", "is a mesh without bones; perfcap actor build "),
        ("scan.PLY", "is a mesh without bones; perfcap actor build "),
        ("walk.bvh", "is a motion without a body"),
    ],
)
def test_files_without_a_character(name: str, said: str, tmp_path: Path) -> None:
    (tmp_path / name).touch()
    with pytest.raises(InputError, match=said):
        find_actor(tmp_path / name)


def test_a_folder_without_an_actor_is_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no such file as actor\.glb, and no shipped"):
        find_actor(tmp_path)
    with pytest.raises(InputError, match="no such file, and no shipped actor has that name"):
        find_actor(tmp_path / "hero")
