"""Motion that is of people only where a part of it is read otherwise is refused, and no other."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from motion_files import write_library

from perfcap.errors import InputError
from perfcap.train.motion_library import MotionLibrary

CMU = Path(__file__).parents[3] / "shared" / "data" / "mocap_cmu_library"
FRAMES = 360
Arrays = dict[str, np.ndarray]
Change = Callable[[np.ndarray], np.ndarray]


def turned(z: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rz Ry Rx (F, 3, 3) of degrees (F,)."""
    product = np.eye(3)
    for angle, (a, b) in ((z, (0, 1)), (y, (2, 0)), (x, (1, 2))):
        turn = np.tile(np.eye(3), (len(angle), 1, 1))
        cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        turn[:, a, a] = turn[:, b, b] = cosine
        turn[:, a, b], turn[:, b, a] = -sine, sine
        product = product @ turn
    return product


def standing(folder: Path) -> Arrays:
    """A library of people who turn on their left toes, the right foot in the air, arms down."""
    write_library(folder, people=2, clips=1, frames=FRAMES)
    with np.load(folder / "clips.npz") as file:
        arrays = {name: file[name] for name in file.files}
    names = arrays["joint_names"].tolist()
    held = {
        "LeftArm": (-75, 0, 0), "RightArm": (75, 0, 0), "LeftForeArm": (0, -20, 0),
        "RightForeArm": (0, 20, 0), "RightUpLeg": (0, 0, -50), "RightLeg": (0, 0, 60),
    }  # fmt: skip
    time = np.arange(FRAMES) / 60
    chain = [names.index(f"Left{name}") for name in ("UpLeg", "Leg", "Foot", "ToeBase")]
    for phase, clip in enumerate(("01_01", "02_01")):
        angles = np.zeros((FRAMES, len(names), 3))
        for name, values in held.items():
            sway = 5 * np.sin(2 * time) + 20 * phase
            angles[:, names.index(name)] = np.array(values) + sway[:, None] * [0, 0, 1]
        root = (8 * np.sin(time), 90 * np.sin(5 * time + phase), 8 * np.sin(2 * time + phase))
        angles[:, 0] = np.stack(root, 1)
        toe = turned(*root) @ arrays[f"{clip}/offsets_m"][chain].sum(0)
        arrays[f"{clip}/euler_zyx_deg"], arrays[f"{clip}/root_m"] = angles, [0, 0.1, 0] - toe
    return arrays


def read(folder: Path, arrays: Arrays) -> MotionLibrary:
    np.savez(folder / "clips.npz", **arrays)
    return MotionLibrary.read(folder)


def angles(change: Change, *ends: str) -> Callable[[Arrays], None]:
    """A change of the angles (F, n, 3) of joints whose names end so."""

    def spoil(arrays: Arrays) -> None:
        names = arrays["joint_names"].tolist()
        columns = [k for k, name in enumerate(names) if name.endswith(ends)]
        for key in arrays:
            if key.endswith("euler_zyx_deg"):
                arrays[key] = arrays[key].astype(float)
                arrays[key][:, columns] = change(arrays[key][:, columns])

    return spoil


def exchanged(*ends: str) -> Callable[[Arrays], None]:
    """Columns of left and right joints whose names end so."""

    def spoil(arrays: Arrays) -> None:
        names = arrays["joint_names"].tolist()
        pairs = [(names.index(f"Left{end}"), names.index(f"Right{end}")) for end in ends]
        order = list(range(len(names)))
        for left, right in pairs:
            order[left], order[right] = right, left
        for key in arrays:
            if key.endswith("euler_zyx_deg"):
                arrays[key] = arrays[key][:, order]

    return spoil


def scaled(part: str, change: Change) -> Callable[[Arrays], None]:
    def spoil(arrays: Arrays) -> None:
        for key in arrays:
            if key.endswith(part):
                arrays[key] = change(arrays[key].astype(float))

    return spoil


def shorter(offsets: np.ndarray) -> np.ndarray:
    """Offsets (19, 3) whose left forearm ends early."""
    return np.where((np.arange(len(offsets)) == 7)[:, None], 0.39, 1) * offsets


ARMS, LEGS = ("Arm", "ForeArm", "Hand"), ("UpLeg", "Leg", "Foot", "ToeBase")
MISTAKES: dict[str, tuple[Callable[[Arrays], None], str]] = {
    "root x y z": (angles(lambda a: a[..., ::-1], "Hips"), "the root are in columns x, y, z"),
    "root y z x": (angles(lambda a: a[..., [1, 0, 2]], "Hips"), "the root are in columns y, z, x"),
    "root negated": (angles(lambda a: -a, "Hips"), "m/s .* angles of the root are negated"),
    "root radians": (angles(np.radians, "Hips"), "m/s .* angles of the root are in radians"),
    "root places": (scaled("root_m", lambda a: a[:, [0, 2, 1]] * [1, -1, 1]), "root_m has z up"),
    "sides": (exchanged(*ARMS, *LEGS), "left and right are exchanged in columns of"),
    "sides of arms": (exchanged(*ARMS), "hang .* exchanged in columns of arms"),
    "arms x y z": (angles(lambda a: a[..., ::-1], "Arm"), "angles of arms are in columns x, y, z"),
    "arms radians": (angles(np.radians, *ARMS), "angles of arms are in radians"),
    "elbow negated": (
        angles(lambda a: -2 * a, "LeftForeArm"),
        "left elbows bend backwards.* LeftForeArm are negated",
    ),
}
BONES = (scaled("offsets_m", shorter), "the left forearm is .* m long, the right one .* in metres")


@pytest.mark.parametrize("name", [*MISTAKES, "bones"])
def test_wrong_parts_of_motion_are_refused(tmp_path: Path, name: str) -> None:
    spoil, words = MISTAKES.get(name, BONES)
    arrays = standing(tmp_path)
    assert not list(read(tmp_path, arrays).doubts(["01"]))
    spoil(arrays)
    with pytest.raises(InputError, match=words):
        read(tmp_path, arrays)


@pytest.mark.parametrize("name", ["root negated", "sides of arms"])
def test_one_wrong_person_among_others_is_named(tmp_path: Path, name: str) -> None:
    """As where a library is put together of several: medians of all people hardly know of one."""
    arrays = several(tmp_path)
    assert not list(read(tmp_path, arrays).doubts(["01"]))
    spoil, words = MISTAKES[name]
    wrong = {key: value for key, value in arrays.items() if "/" not in key or key[:2] == "02"}
    spoil(wrong)
    with pytest.raises(InputError, match=f"subject 02: .*{words}"):
        read(tmp_path, arrays | wrong)


def test_a_person_who_lies_slides_or_is_small_is_a_warning(tmp_path: Path) -> None:
    """Nothing is sure: so people crawl, skate, and are children."""
    arrays = several(tmp_path)
    small = {f"02_01/{part}": 0.45 * arrays[f"02_01/{part}"] for part in ("root_m", "offsets_m")}
    (doubt,) = read(tmp_path, arrays | small).doubts(["01"])
    assert (
        "subject 02: legs are 0.3" in doubt and "divide lengths of the CMU files by 0.45" in doubt
    )
    lying = arrays["02_01/euler_zyx_deg"].copy()
    lying[:, 0] = [0, 0, 90]
    (doubt,) = read(tmp_path, arrays | {"02_01/euler_zyx_deg": lying}).doubts(["01"])
    assert "subject 02 lies or stands on their head" in doubt


def several(folder: Path) -> Arrays:
    """Those of ``standing``, and two more like the first who bend their backs otherwise."""
    arrays = standing(folder)
    spine = arrays["joint_names"].tolist().index("Spine1")
    first = {key[6:]: value for key, value in arrays.items() if key.startswith("01_01/")}
    for number in (3, 4):
        bent = first["euler_zyx_deg"].copy()
        bent[:, spine, 2] += 5 * np.sin(np.arange(FRAMES) / (10 * number))
        more = first | {
            "euler_zyx_deg": bent,
            "offsets_m": (1 + 1e-3 * number) * first["offsets_m"],
        }
        arrays |= {f"0{number}_01/{part}": value for part, value in more.items()}
    with (folder / "clips.csv").open("w", newline="") as lines:
        writer = csv.writer(lines)
        writer.writerow(("clip", "subject"))
        writer.writerows((f"0{number}_01", f"0{number}") for number in (1, 2, 3, 4))
    return arrays


def test_sliding_without_another_reading_is_a_warning(tmp_path: Path) -> None:
    arrays = standing(tmp_path)
    for clip in ("01_01", "02_01"):
        arrays[f"{clip}/root_m"] = arrays[f"{clip}/root_m"] + np.linspace(0, 6, FRAMES)[:, None]
    doubts = list(read(tmp_path, arrays).doubts(["01"]))
    assert len(doubts) == 1 and "the lowest foot moves at" in doubts[0]


# --- recorded people ------------------------------------------------------------------------------


def recorded(folder: Path, clips: Sequence[str]) -> Arrays:
    """Some clips of the CMU library."""
    folder.mkdir(exist_ok=True)
    with np.load(CMU / "clips.npz") as file:
        arrays = {k: file[k] for k in file.files if "/" not in k or k.split("/")[0] in clips}
    with (folder / "clips.csv").open("w", newline="") as lines:
        writer = csv.writer(lines)
        writer.writerow(("clip", "subject"))
        writer.writerows((clip, clip.split("_")[0]) for clip in clips)
    return arrays


def clips_of_cmu() -> list[str]:
    with (CMU / "clips.csv").open() as lines:
        return [row["clip"] for row in csv.DictReader(lines) if "glitch" not in row["remark"]]


@pytest.mark.long
@pytest.mark.skipif(not CMU.is_dir(), reason="needs shared/data/mocap_cmu_library")
def test_recorded_people_are_accepted(tmp_path: Path) -> None:
    clips = clips_of_cmu()
    rng = np.random.default_rng(0)
    parts = [[c for c in clips if c.startswith(s)] for s in ("03", "06")]
    parts += [rng.choice(clips, 6, replace=False).tolist() for _ in range(4)]
    for part in parts:
        assert len(read(tmp_path, recorded(tmp_path, part)).recordings) == len(part)


@pytest.mark.long
@pytest.mark.skipif(not CMU.is_dir(), reason="needs shared/data/mocap_cmu_library")
@pytest.mark.parametrize("name", MISTAKES)
def test_wrong_parts_of_recorded_motion_are_refused(tmp_path: Path, name: str) -> None:
    spoil, words = MISTAKES[name]
    arrays = recorded(tmp_path, [clip for clip in clips_of_cmu() if clip.startswith("06")])
    spoil(arrays)
    if name == "root places":
        words += "|the root moves"
    with pytest.raises(InputError, match=words):
        read(tmp_path, arrays)


@pytest.mark.skipif(not CMU.is_dir(), reason="needs shared/data/mocap_cmu_library")
def test_a_spine_that_leans_back_is_refused(tmp_path: Path) -> None:
    arrays = recorded(tmp_path, [clip for clip in clips_of_cmu() if clip.startswith("06")])
    angles(lambda a: -a, "LowerBack", "Spine", "Spine1")(arrays)
    with pytest.raises(InputError, match=r"angles of the spine are negated"):
        read(tmp_path, arrays)


def test_frames_sorted_as_text_are_a_warning(tmp_path: Path) -> None:
    """As of a folder with a file for each frame: one step in ten was a leap."""
    arrays = standing(tmp_path)
    library = read(tmp_path, arrays)
    assert not [line for line in library.doubts(["02"]) if "follow" in line or "sorted" in line]
    order = sorted(range(FRAMES), key=str)
    for part in ("euler_zyx_deg", "root_m"):
        arrays[f"02_01/{part}"] = arrays[f"02_01/{part}"][order]
    told = [line for line in read(tmp_path, arrays).doubts(["02"]) if "sorted as text" in line]
    assert len(told) == 1 and told[0].startswith("subject 02: clip 02_01: frames look sorted")
