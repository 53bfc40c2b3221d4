"""Libraries of recorded motion that are not what they say are refused, each in a line."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from motion_files import write_library

from perfcap.errors import InputError
from perfcap.train.motion_library import MotionLibrary

Arrays = dict[str, np.ndarray]
Rows = list[dict[str, str]]


def spoiled(folder: Path, spoil: Callable[[Arrays, Rows], object]) -> Path:
    """A library of two people, changed."""
    write_library(folder, people=2, clips=1, frames=40)
    with np.load(folder / "clips.npz") as file:
        arrays = {name: file[name] for name in file.files}
    with (folder / "clips.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    spoil(arrays, rows)
    np.savez(folder / "clips.npz", **arrays)
    with (folder / "clips.csv").open("w", newline="") as lines:
        writer = csv.DictWriter(lines, list(rows[0]), extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    return folder


def scaled(part: str, factor: float) -> Callable[[Arrays, Rows], None]:
    def spoil(arrays: Arrays, _: Rows) -> None:
        for name in arrays:
            if name.endswith(part):
                arrays[name] = arrays[name] * factor

    return spoil


def upended(arrays: Arrays, _: Rows) -> None:
    """Offsets with z up."""
    for name in arrays:
        if name.endswith("offsets_m"):
            x, y, z = arrays[name].T
            arrays[name] = np.stack((x, -z, y), 1)


def stretched(joint: str, factor: float) -> Callable[[Arrays, Rows], None]:
    """A bone of both sides of another length, of skeletons without the joint at its end."""

    def spoil(arrays: Arrays, _: Rows) -> None:
        names = arrays["joint_names"].tolist()
        for name in arrays:
            if name.endswith("offsets_m"):
                for side in ("Left", "Right"):
                    arrays[name][names.index(side + joint)] *= factor

    return spoil


def forgotten(*joints: str) -> Callable[[Arrays, Rows], None]:
    """Joints whose angles nobody filled in, as those of another name."""

    def spoil(arrays: Arrays, _: Rows) -> None:
        names = arrays["joint_names"].tolist()
        for name in arrays:
            if name.endswith("euler_zyx_deg"):
                arrays[name][:, [names.index(joint) for joint in joints]] = 0.0

    return spoil


def mirrored(arrays: Arrays, _: Rows) -> None:
    swap = {"L": "Right", "R": "Left"}
    arrays["joint_names"] = np.array(
        [
            swap[name[0]] + name.removeprefix("Left").removeprefix("Right")
            if name.startswith(("Left", "Right"))
            else name
            for name in arrays["joint_names"].tolist()
        ]
    )


def cut(arrays: Arrays, rows: Rows) -> None:
    """A clip of one person without its first frames, as another's."""
    for part in ("euler_zyx_deg", "root_m"):
        arrays[f"02_01/{part}"] = arrays[f"01_01/{part}"][7:]
    arrays["02_01/offsets_m"] = arrays["01_01/offsets_m"]
    row = next(row for row in rows if row["clip"] == "02_01")
    row["frames_60hz"] = str(len(arrays["02_01/root_m"]))


def copied(arrays: Arrays, rows: Rows) -> None:
    for part in ("euler_zyx_deg", "root_m", "offsets_m"):
        arrays[f"02_01/{part}"] = arrays[f"01_01/{part}"]


def setter(key: str, change: Callable[[np.ndarray], Any]) -> Callable[[Arrays, Rows], None]:
    def spoil(arrays: Arrays, _: Rows) -> None:
        arrays[key] = change(arrays[key])

    return spoil


def without_subject(_: Arrays, rows: Rows) -> None:
    for row in rows:
        del row["subject"]


def half_rate(arrays: Arrays, _: Rows) -> None:
    for name in arrays:
        if name.endswith(("euler_zyx_deg", "root_m")):
            arrays[name] = arrays[name][::2]


def half_rate_as_counted(arrays: Arrays, rows: Rows) -> None:
    """Two seconds at 30 Hz, which the index has right."""
    for name in arrays:
        if name.endswith(("euler_zyx_deg", "root_m")):
            arrays[name] = np.tile(arrays[name], (2, *[1] * (arrays[name].ndim - 1)))
    for row in rows:
        row.update(frames_60hz="80", seconds="2.67")


def radians_that_turn(arrays: Arrays, _: Rows) -> None:
    """Radians, of a person who turned twice."""
    for name in arrays:
        if name.endswith("euler_zyx_deg"):
            arrays[name] = np.radians(arrays[name])
            arrays[name][:, 0, 1] += 4 * np.pi


def carried(arrays: Arrays, rows: Rows) -> None:
    """One person's motion elsewhere, by a taller body, as another's."""
    copied(arrays, rows)
    arrays["02_01/root_m"] = 1.1 * arrays["02_01/root_m"] + np.float32([2, 0, 1])
    arrays["02_01/offsets_m"] = 1.1 * arrays["02_01/offsets_m"]


def crouching(arrays: Arrays, order: tuple[int, ...] = (0, 1, 2)) -> None:
    """Knees that bend, columns of angles in another order."""
    names = arrays["joint_names"].tolist()
    for clip in ("01_01", "02_01"):
        angles = arrays[f"{clip}/euler_zyx_deg"]
        for side in ("Left", "Right"):
            angles[:, names.index(f"{side}Leg"), 2] += 60.0
        arrays[f"{clip}/euler_zyx_deg"] = angles[..., list(order)]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (half_rate_as_counted, "has 80 frames, the index says 2.67 seconds, which is 30 a second"),
        (radians_that_turn, "they look like radians"),
        (carried, "clips 01_01 and 02_01 are the same motion"),
        (lambda arrays, _: crouching(arrays, (2, 1, 0)), "knees bend sideways"),
        (scaled("offsets_m", 100), "joints span .* give offsets_m in metres"),
        (scaled("offsets_m", 0.01), "joints span .* give offsets_m in metres"),
        (scaled("root_m", 1000), "the root moves at .* give root_m in metres"),
        (scaled("euler_zyx_deg", np.pi / 180), "they look like radians"),
        (stretched("ToeBase", 0.0), r"a foot \(ankle to toe\) is 0 m long, .* a lifter learns"),
        (stretched("Hand", 1.8), r"a forearm \(elbow to wrist\) is .* to 1\.2: give offsets_m"),
        (forgotten("LeftArm", "RightArm"), "LeftArm, RightArm have the same angles in every frame"),
        (forgotten("RightForeArm"), "RightForeArm have the same angles in every frame"),
        (upended, "people lie or stand on their heads"),
        (mirrored, "left and right look exchanged"),
        (cut, "clips 01_01 and 02_01 are the same motion, or parts of it"),
        (copied, "clips 01_01 and 02_01 are the same motion, .* under the subjects 01 and 02"),
        (half_rate, "has 20 frames, the index says 40"),
        (lambda _, rows: rows.append(dict(rows[0])), "clip 01_01 is listed twice"),
        (lambda _, rows: rows[0].update(subject=""), "lacks its clip or its subject"),
        (without_subject, "has no column subject"),
        (setter("joint_names", lambda a: np.char.add("x:", a)), "has no joints"),
        (setter("joint_names", lambda a: np.where(a == "Neck1", "Head", a)), "names Head twice"),
        (setter("parents", lambda a: a[::-1]), "each before its children"),
        (setter("01_01/root_m", lambda a: a[:9]), "clip 01_01 has .* expected"),
        (setter("01_01/root_m", lambda a: a[:0]), "of one frame or more"),
        (setter("joint_names", lambda a: a.astype(object)), "not a readable npz archive"),
    ],
)
def test_lies_are_refused(
    tmp_path: Path, spoil: Callable[[Arrays, Rows], object], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        MotionLibrary.read(spoiled(tmp_path, spoil))


def test_remarks_and_counts_may_be_missing(tmp_path: Path) -> None:
    def spare(_: Arrays, rows: Rows) -> None:
        rows.pop()  # the glitch
        for row in rows:
            del row["remark"], row["frames_60hz"], row["seconds"]

    assert MotionLibrary.read(spoiled(tmp_path, spare)).subjects == ("01", "02")


def test_people_with_blanks_about_their_names_are_the_same(tmp_path: Path) -> None:
    def spaced(arrays: Arrays, rows: Rows) -> None:
        crouching(arrays)
        rows[0].update(subject=" 01 ")

    assert MotionLibrary.read(spoiled(tmp_path, spaced)).subjects == ("01", "02")


@pytest.mark.parametrize("same", [(), ("03",), ("02", "03")])
def test_people_with_the_bones_of_one_who_is_held_out(tmp_path: Path, same: tuple[str]) -> None:
    write_library(tmp_path, people=3, clips=1, frames=40)
    with np.load(tmp_path / "clips.npz") as file:
        arrays = {name: file[name] for name in file.files}
    for person in same:
        arrays[f"{person}_01/offsets_m"] = arrays["01_01/offsets_m"]
    np.savez(tmp_path / "clips.npz", **arrays)
    found = list(MotionLibrary.read(tmp_path).doubts(["01"]))
    if len(same) != 1:  # all the same: a skeleton that all motion was put on
        assert not found
        return
    assert len(found) == 1 and "the subjects 01 and 03 have the same bones" in found[0]
    assert not list(MotionLibrary.read(tmp_path).doubts(["02"]))


@pytest.mark.long
def test_frames_that_are_there_twice(tmp_path: Path) -> None:
    """As of 30 a second that were filled up to 60; of one clip of several nothing is said."""
    write_library(tmp_path)
    library = MotionLibrary.read(tmp_path)
    told = []
    for count in (1, 2):
        recordings = list(library.recordings)
        for k, each in enumerate(recordings[:count]):
            twice = torch.arange(len(each.landmarks)) // 2 * 2
            recordings[k] = replace(each, landmarks=each.landmarks[twice])
        lines = replace(library, recordings=tuple(recordings)).doubts(["01"])
        told.append([line for line in lines if "lowest foot" not in line])
    assert len(told[1]) == 1 and not told[0]
    assert "subject 01: in 2 of 2 clips frames are there twice, 120 of 239 frames" in told[1][0]
