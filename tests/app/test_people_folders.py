"""Folders of people that contradict what lies in them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from perfcap.app.capture_folder import named_people
from perfcap.errors import InputError


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    for number in (1, 2):
        place = tmp_path / f"person{number}"
        place.mkdir()
        (place / "run.json").write_text(json.dumps({"person": number}))
    listed = [{"folder": "person1"}, {"folder": "person2"}]
    (tmp_path / "people.json").write_text(json.dumps({"people": listed}))
    (tmp_path / "run.json").write_text("{}")
    return tmp_path


def test_folders_that_are_as_they_were(pair: Path) -> None:
    assert [name for _, name in named_people(pair)] == ["person1", "person2"]


def test_folders_that_were_renamed_to_each_other(pair: Path) -> None:
    (pair / "person1").rename(pair / "other")
    (pair / "person2").rename(pair / "person1")
    (pair / "other").rename(pair / "person2")
    with pytest.raises(InputError, match=r"person1: is person 2 of the capture; call its folder"):
        list(named_people(pair))
