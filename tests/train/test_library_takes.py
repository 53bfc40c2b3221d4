"""Single takes of a person that are in other units, axes or sides than the others are named."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from test_library_trials import (
    CMU,
    MISTAKES,
    Arrays,
    angles,
    clips_of_cmu,
    read,
    recorded,
    standing,
)

MANY = tuple(f"01_0{number}" for number in range(1, 9))


def takes(folder: Path) -> Arrays:
    """Eight takes of one person, and one of another."""
    arrays = standing(folder)
    for clip in MANY:
        for part in ("euler_zyx_deg", "root_m", "offsets_m"):
            arrays[f"{clip}/{part}"] = arrays[f"01_01/{part}"]
    with (folder / "clips.csv").open("w", newline="") as lines:
        writer = csv.writer(lines)
        writer.writerow(("clip", "subject"))
        writer.writerows([*((clip, "01") for clip in MANY), ("02_01", "02")])
    return arrays


def scaled(factor: float) -> Callable[[Arrays], None]:
    """Places and bones in another unit."""

    def spoil(arrays: Arrays) -> None:
        for key in arrays:
            if key.endswith(("root_m", "offsets_m")):
                arrays[key] = factor * arrays[key]

    return spoil


def mirrored(arrays: Arrays) -> None:
    """Bones of axes of which one runs the other way."""
    for key in arrays:
        if key.endswith("offsets_m"):
            arrays[key] = arrays[key] * [-1, 1, 1]


def z_up(arrays: Arrays) -> None:
    """A root that stands along z, and goes along y; angles of people who hardly turn."""
    angles(lambda a: np.broadcast_to([0.0, 0.0, 90.0], a.shape), "Hips")(arrays)
    for key in arrays:
        if key.endswith("root_m"):
            walk = np.linspace(0, 2, len(arrays[key]))
            arrays[key] = np.stack((0 * walk, walk, 0 * walk + 0.9), 1)


WRONG = {
    "unit": (scaled(0.45), "bones are 0.45 times as long as this person's usually are"),
    "size": (scaled(1.2), "bones are 1.2 times as long"),
    "mirrored": (mirrored, "left and right are exchanged"),
    "z up": (z_up, "not on the floor of the other clips"),
    "sides": MISTAKES["sides"],
    "root negated": MISTAKES["root negated"],
    "sides of arms": MISTAKES["sides of arms"],
}


@pytest.mark.parametrize(("name", "wrong"), [("unit", MANY[0]), *((n, MANY[4]) for n in WRONG)])
def test_one_wrong_take_is_named(tmp_path: Path, name: str, wrong: str) -> None:
    arrays = takes(tmp_path)
    assert not list(read(tmp_path, arrays).doubts(["02"]))
    spoil, words = WRONG[name]
    one = {key: value for key, value in arrays.items() if "/" not in key or key[:5] == wrong}
    spoil(one)
    (doubt,) = read(tmp_path, arrays | one).doubts(["02"])
    assert doubt.startswith(f"subject 01: clip {wrong}: ")
    assert re.search(words, doubt), doubt


def test_most_takes_in_another_unit_are_named_too(tmp_path: Path) -> None:
    arrays = takes(tmp_path)
    for clip in MANY[1:]:
        for part in ("root_m", "offsets_m"):
            arrays[f"{clip}/{part}"] = 0.45 * arrays[f"{clip}/{part}"]
    legs, first = read(tmp_path, arrays).doubts(["02"])
    assert "legs are 0.3" in legs
    assert first.startswith("subject 01: clip 01_01: bones are 2.2 times as long")


def test_takes_that_are_wrong_alike_share_a_sentence(tmp_path: Path) -> None:
    arrays = takes(tmp_path)
    for clip in MANY[2:4]:
        arrays[f"{clip}/offsets_m"] = arrays[f"{clip}/offsets_m"] * np.array([-1, 1, 1])
    (doubt,) = read(tmp_path, arrays).doubts(["02"])
    assert doubt.startswith("subject 01: clips 01_03, 01_04: ")


def test_who_lies_on_the_floor_is_not_named(tmp_path: Path) -> None:
    """Of a floor that is not at zero, and of another take with bones fitted anew."""
    arrays = takes(tmp_path)
    for clip in (*MANY, "02_01"):
        arrays[f"{clip}/root_m"] = arrays[f"{clip}/root_m"] + np.array([0, 1.5, 0])
    lying = {key: value.copy() for key, value in arrays.items() if key.startswith("01_04/")}
    lying["01_04/euler_zyx_deg"][:, 0] = [0, 0, -90]
    lying["01_04/root_m"][:] = [0, 1.65, 0]
    lying["01_04/offsets_m"] *= 1.05
    assert not list(read(tmp_path, arrays | lying).doubts(["02"]))
    lying["01_04/root_m"][:] = [0, 2.65, 0]
    (doubt,) = read(tmp_path, arrays | lying).doubts(["02"])
    assert "clip 01_04: who lies there" in doubt


@pytest.mark.long
@pytest.mark.skipif(not CMU.is_dir(), reason="needs shared/data/mocap_cmu_library")
def test_takes_of_recorded_people_are_not_named(tmp_path: Path) -> None:
    """Each against all others of its person: who climbs, dances, or does cartwheels among them."""
    doubts = list(read(tmp_path, recorded(tmp_path, clips_of_cmu())).doubts(["01"]))
    assert not [doubt for doubt in doubts if " clip" in doubt]


@pytest.mark.long
@pytest.mark.skipif(not CMU.is_dir(), reason="needs shared/data/mocap_cmu_library")
@pytest.mark.parametrize("name", ["unit", "mirrored"])
def test_a_wrong_take_of_recorded_people_is_named(tmp_path: Path, name: str) -> None:
    clips = [clip for clip in clips_of_cmu() if clip.startswith(("02", "06"))]
    arrays = recorded(tmp_path, clips)
    one = {key: value for key, value in arrays.items() if "/" not in key or key[:5] == "02_03"}
    WRONG[name][0](one)
    doubts = [line for line in read(tmp_path, arrays | one).doubts(["06"]) if " clip" in line]
    assert len(doubts) == 1 and doubts[0].startswith("subject 02: clip 02_03: ")
