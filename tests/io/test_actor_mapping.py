"""Mapping files."""

from pathlib import Path

import pytest

from perfcap.errors import InputError
from perfcap.io.actor_import import ActorMapping, read_mapping
from perfcap.io.files import read_toml


def test_lines_name_bones(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text('pelvis = "Bip01 Pelvis"  # the hips\nl_toe = "x"\nmetres_per_unit = 0.01\n')
    assert read_mapping(path) == ActorMapping({"pelvis": "Bip01 Pelvis", "l_toe": "x"}, 0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pelvis = Hips", "is not TOML"),
        ("pelvis = 3", "pelvis is 3"),
        ('hips = "Hips"', "'hips' is no joint"),
        ("metres_per_unit = 0", "metres_per_unit is 0"),
        ("metres_per_unit = nan", "metres_per_unit is nan"),
        ('metres_per_unit = "cm"', "metres_per_unit is 'cm'"),
        ("", "is empty"),
    ],
)
def test_other_lines_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_mapping(path)
    assert "map.toml" in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_that_is_missing_is_not_called_no_toml(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file") as caught:
        read_toml(tmp_path / "none.toml", "a mapping file")
    assert "is not TOML" not in str(caught.value)
