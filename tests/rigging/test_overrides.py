"""Files of regions and their bones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.rigging.overrides import read_overrides

GOOD = """
[[region]]
name = "skirt"
part = 1
bones = ["pelvis", "l_hip", "r_hip"]

[[region]]
box = [[-0.5, 0, -0.5], [0.5, 1.0, 0.5]]
bones = ["spine"]
blend = 0.1
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "weights.toml"
    path.write_text(text)
    return path


def test_regions_are_read(tmp_path: Path) -> None:
    skirt, box = read_overrides(write(tmp_path, GOOD))
    assert (skirt.name, skirt.part, skirt.box) == ("skirt", 1, None)
    assert box.blend == 0.1 and box.bones == ("spine",)
    places = np.array([[0.0, 0.5, 0.0], [0.0, 2.0, 0.0]])
    assert box.covers(places, np.array([0, 0])).tolist() == [True, False]
    assert skirt.covers(places, np.array([1, 0])).tolist() == [True, False]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[[region", "is not TOML"),
        ("other = 1", "no .*region"),
        ("region = 3", "no .*region"),
        ("[[region]]\npart = 1", "expected bones"),
        ('[[region]]\npart = 1\nbones = ["tail"]', "tail"),
        ('[[region]]\nbones = ["spine"]', "neither part nor box"),
        ('[[region]]\npart = "x"\nbones = ["spine"]', "expected part"),
        ('[[region]]\nbox = [[1, 1, 1], [0, 0, 0]]\nbones = ["spine"]', "lowest corner first"),
        ('[[region]]\npart = 1\nbones = ["spine"]\nblend = -1', "blend"),
        ('[[region]]\npart = 1\nbones = ["spine"]\ncolour = 3', "expected bones"),
        ("[[region]]\npart = 1\nbones = 3", "expected part"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(InputError, match=words) as caught:
        read_overrides(path)
    assert "\n" not in str(caught.value)
