"""A JSON file that is missing is missing, and no unusable JSON."""

from pathlib import Path

import pytest

from perfcap.errors import InputError
from perfcap.io.files import read_json


def test_a_missing_file_is_told_once(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read_json(tmp_path / "map.json", "a map")
    assert str(error.value) == f"{tmp_path / 'map.json'}: no such file; expected a map"


def test_numbers_of_thousands_of_digits(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("9" * 5000)
    with pytest.raises(InputError, match="is not usable JSON"):
        read_json(path, "a map")
