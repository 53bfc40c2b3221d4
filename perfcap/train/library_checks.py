"""Whether a library of recorded motion is what it says: its units, axes, rates and people."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.doctor.order import examine_order, examine_shuffled
from perfcap.io.doctor.repeated import examine_held
from perfcap.io.doctor.sides import examine_sides
from perfcap.io.files import MEBIBYTE, read_text

_INDEX = "a CSV of clips with the columns clip and subject"
_INDEX_LIMIT = 16 * MEBIBYTE
_SIZE = (0.5, 3.5)  # m, of the box around a person's joints
_FASTEST = 12.5  # m/s, of hips
_USUALLY = 0.5  # share of the frames
_FULL_TURN = 6.3  # degrees that no motion stays below, radians that all do but for headings
_RATE, _RATE_SLACK = 60.0, 0.05  # Hz, and share
_BENT = 0.7  # sine of a knee
_ACROSS = 0.4  # share of bends about the line of the hips; of real motion it is 0.79 and more
_OFTEN = 0.02  # knees a frame that bend that far
_LOOKED_AT = 2000  # frames of a library
_EVERY, _SHARED = 10, 3  # frames that are compared with all others, and how many are too many
_SAME_BONES = 1e-4  # m; those of two people differ by millimetres
_SIDES_BONES = 1.3  # times the same bone of the other side; of the CMU library at most 1.12
_SORT = "sort their files by the numbers in the names"
_BONES = (
    ("upper arm", "shoulder", "elbow"), ("forearm", "elbow", "wrist"),
    ("thigh", "hip", "knee"), ("shank", "knee", "ankle"),
)  # fmt: skip
_ANKLES = [LANDMARKS.index(name) for name in ("r_ankle", "l_ankle")]


def read_index(path: Path) -> list[dict[str, str]]:
    """Lines of the index by column, without clips that are marked as glitches.

    Raises:
        InputError: it lacks a column or a name, or names a clip twice.
    """
    lines = csv.DictReader(read_text(path, _INDEX, _INDEX_LIMIT).splitlines())
    lacking = [name for name in ("clip", "subject") if name not in (lines.fieldnames or ())]
    if lacking:
        raise InputError(f"{path}: has no column {' and '.join(lacking)}; expected {_INDEX}")
    cells = [{key: (row[key] or "").strip() for key in lines.fieldnames or ()} for row in lines]
    rows = [row for row in cells if "glitch" not in row.get("remark", "").lower()]
    seen: set[str] = set()
    for row in rows:
        if not row["clip"] or not row["subject"]:
            raise InputError(f"{path}: a line lacks its clip or its subject; expected {_INDEX}")
        if row["clip"] in seen:
            raise InputError(
                f"{path}: clip {row['clip']} is listed twice; list it once, as one person's"
            )
        seen.add(row["clip"])
    if not rows:
        raise InputError(f"{path}: lists no clips; expected {_INDEX}")
    return rows


def require_skeleton(
    path: Path, data: Mapping[str, NDArray[Any]], wanted: Sequence[str]
) -> list[str]:
    """Names of a library's joints.

    Raises:
        InputError: joints are missing, or parents are not one a joint, each before its children.
    """
    if "joint_names" not in data or "parents" not in data:
        raise InputError(f"{path}: lacks joint_names or parents; expected those of all clips")
    names, parents = [str(name) for name in data["joint_names"]], data["parents"]
    lacking = [name for name in wanted if name not in names]
    if lacking:
        raise InputError(
            f"{path}: has no joints {', '.join(lacking)} among {', '.join(names[:8])}, ...; call "
            "joints as the CMU library does"
        )
    if twice := [name for name in wanted if names.count(name) > 1]:
        raise InputError(f"{path}: names {', '.join(twice)} twice; expected each once: rename one")
    before = len(parents) == len(names) and all(-1 <= p < k for k, p in enumerate(parents))
    if not before or parents[0] != -1:
        raise InputError(
            f"{path}: parents are {parents.tolist()[:8]}, ...; expected one a joint, -1 for the "
            "first, and each before its children"
        )
    return names


def require_shapes(
    path: Path, row: Mapping[str, str], clip: Mapping[str, NDArray[Any]], joints: int
) -> None:
    """Refuse a clip whose arrays are not (F, J, 3), (F, 3) and (J, 3), of as many frames as said.

    Raises:
        InputError: they are not.
    """
    frames = len(clip["root_m"]) if clip["root_m"].ndim else 0
    expected = {
        "euler_zyx_deg": (frames, joints, 3),
        "root_m": (frames, 3),
        "offsets_m": (joints, 3),
    }
    found = {name: clip[name].shape for name in expected}
    if found != expected or not frames:
        raise InputError(
            f"{path}: clip {row['clip']} has {found}, expected {expected}, of one frame or more"
        )
    said = row.get("frames_60hz") or str(frames)
    if said != str(frames):
        raise InputError(
            f"{path}: clip {row['clip']} has {frames} frames, the index says {said} "
            "(frames_60hz); expected 60 a second"
        )
    try:
        rate = frames / float(row.get("seconds") or frames / _RATE)
    except (ValueError, ZeroDivisionError):
        return
    if abs(rate / _RATE - 1) > _RATE_SLACK and frames > _RATE:  # seconds may be rounded
        raise InputError(
            f"{path}: clip {row['clip']} has {frames} frames, the index says {row['seconds']} "
            f"seconds, which is {rate:.3g} a second; expected 60: resample it"
        )


def require_motion(path: Path, clips: Mapping[str, Tensor], root: Mapping[str, Tensor]) -> None:
    """Refuse motion of no person: other units or axes.

    Args:
        path: of the library, for messages.
        clips: landmarks (F, 16, 3) by name.
        root: (F, 3) metres at 60 Hz by name.

    Raises:
        InputError: says which clip, and what it looks like.
    """
    for name, points in clips.items():
        size = float((points.amax(1) - points.amin(1)).norm(dim=-1).median())
        if not _SIZE[0] < size < _SIZE[1]:
            raise InputError(
                f"{path}: clip {name}: joints span {size:.3g} m, expected {_SIZE[0]} to "
                f"{_SIZE[1]}; give offsets_m in metres"
            )
        lengths = bone_lengths(points)
        for bone, _, _ in _BONES:
            left, right = lengths[f"left {bone}"], max(lengths[f"right {bone}"], 1e-6)
            if not 1 / _SIDES_BONES < left / right < _SIDES_BONES:
                raise InputError(
                    f"{path}: clip {name}: the left {bone} is {left:.3g} m long, the right one "
                    f"{right:.3g}; give all offsets_m in metres, each joint's in its own row"
                )
        speed = 60 * root[name].diff(dim=0).norm(dim=-1)
        if len(speed) and float(speed.median()) > _FASTEST:
            raise InputError(
                f"{path}: clip {name}: the root moves at {float(speed.median()):.3g} m/s, expected "
                f"{_FASTEST} at most; give root_m in metres, 60 frames a second"
            )
    if not usually_upright(clips.values()):
        raise InputError(
            f"{path}: people lie or stand on their heads in most frames; expected y up, angles "
            "about z, y, x in this order, and parents of these joints"
        )


def usually_upright(clips: Iterable[Tensor]) -> bool:
    """Whether necks are above ankles in most frames of landmarks (F, 16, 3) of clips."""
    points = _some(clips)
    up = points[:, LANDMARKS.index("neck"), 1] - points[:, _ANKLES, 1].mean(1)
    tall = (points.amax(1) - points.amin(1)).norm(dim=-1)
    return float((up > 0.3 * tall).double().mean()) >= _USUALLY


def order_doubts(names: Sequence[str], clips: Sequence[Tensor]) -> Iterator[str]:
    """Clips with landmarks (F, 16, 3) whose frames do not follow one another.

    And what speaks against 60 of them a second: repeated ones.
    """
    for name, points in zip(names, clips, strict=True):
        sure = torch.ones_like(points[..., 0])
        for found in examine_order("", points, sure) or examine_shuffled("", points, sure):
            yield f"clip {name}: {found.what}; expected frames one after another: {_SORT}"
    told = [examine_held("", points, torch.ones_like(points[..., 0]), "joints") for points in clips]
    held = [finding.what for findings in told for finding in findings]
    if len(held) > _USUALLY * len(clips):  # a person may stand quite still in single ones
        yield (
            f"in {len(held)} of {len(clips)} clips frames are there twice, {held[0]}; if motion of "
            "another rate was filled up to 60 a second so, resample it: the lifter learns to jerk"
        )


def require_sides(path: Path | str, clips: Iterable[Tensor]) -> None:
    """Refuse motion whose sides are exchanged, or whose knees bend sideways.

    Args:
        path: of the library, or who in it, for messages.
        clips: landmarks (F, 16, 3).

    Raises:
        InputError: they are, they do.
    """
    fault = side_fault(clips)
    if fault is not None:
        raise InputError(f"{path}: {fault}")


def side_fault(clips: Iterable[Tensor]) -> str | None:
    """Sides of landmarks (F, 16, 3) of clips that are exchanged, or knees that bend sideways."""
    points = _some(clips)
    for finding in examine_sides("", points):
        return f"{finding.what}; {finding.remedy}"
    across = _bends_across(points)
    if across is None or across >= _ACROSS:
        return None
    return (
        f"knees bend sideways ({across:.0%} of their bends are about the line through the hips); "
        "expected angles about z, y and x in this order, each column its axis: sort or convert "
        "euler_zyx_deg"
    )


def _some(clips: Iterable[Tensor]) -> Tensor:
    """Some frames, (N, 16, 3), of all clips."""
    points = torch.cat(list(clips))
    return points[:: max(1, len(points) // _LOOKED_AT)].double()


def bone_lengths(points: Tensor) -> dict[str, float]:
    """Lengths of the bones of arms and legs of a clip (F, 16, 3), metres, by side and name."""
    at = {name: points[0, k] for k, name in enumerate(LANDMARKS)}
    return {
        f"{side} {bone}": float((at[f"{side[0]}_{start}"] - at[f"{side[0]}_{end}"]).norm())
        for bone, start, end in _BONES
        for side in ("left", "right")
    }


def _bends_across(points: Tensor) -> float | None:
    """Share of the bends of knees (F, 16, 3) about the hips' line, -1 to 1; None if few bend."""
    place = {name: points[:, k] for k, name in enumerate(LANDMARKS)}
    hips = torch.nn.functional.normalize(place["l_hip"] - place["r_hip"], dim=-1)
    shares, bends = [], []
    for side in "lr":
        thigh, shank = (
            torch.nn.functional.normalize(place[f"{side}_{b}"] - place[f"{side}_{a}"], dim=-1)
            for a, b in (("hip", "knee"), ("knee", "ankle"))
        )
        normal = torch.linalg.cross(thigh, shank)
        bend = normal.norm(dim=-1)
        shares.append(((normal * hips).sum(-1))[bend > _BENT])
        bends.append(bend[bend > _BENT])
    total = torch.cat(bends)
    if len(total) < _OFTEN * len(points):
        return None
    return float(torch.cat(shares).sum() / total.sum())


def require_degrees(path: Path, angles: Mapping[str, NDArray[np.float64]]) -> None:
    """Refuse clips whose angles (F, J, 3) are those of radians, but for the first joint's.

    That one's is a heading, which grows from turn to turn.

    Raises:
        InputError: they are, and something turns at all.
    """
    for name, values in angles.items():
        largest = float(np.median(np.abs(values[:, 1:]).max((1, 2)))) if values.shape[1] > 1 else 0
        if 0 < largest < _FULL_TURN:
            raise InputError(
                f"{path}: clip {name}: angles are up to {largest:.3g} degrees in most frames; they "
                "look like radians: multiply euler_zyx_deg by 57.2958"
            )


def require_own_motion(
    path: Path, clips: Mapping[str, NDArray[np.float64]], people: Mapping[str, str]
) -> None:
    """Refuse one motion, or a part of one, under two people, of whom one could be held out.

    Args:
        path: of the library, for messages.
        clips: angles of the joints but the first, which are the same wherever somebody goes and
            however long their bones are, (F, ...) by name.
        people: subjects by name.

    Raises:
        InputError: names the clips.
    """
    known: dict[bytes, str] = {}
    for name, points in clips.items():
        for frame in _hashed(points[::_EVERY]):
            known.setdefault(frame, name)
    for name, points in clips.items():
        met: dict[str, set[bytes]] = {}
        for frame in _hashed(points):
            first = known.get(frame)
            if first is not None and people[first] != people[name]:
                met.setdefault(first, set()).add(frame)
        for first, frames in met.items():
            # a pose that is held is one frame, as that in which recordings of all people begin
            if len(frames) >= min(_SHARED, len(clips[first][::_EVERY])):
                one, other = sorted((first, name))
                raise InputError(
                    f"{path}: clips {one} and {other} are the same motion, or parts of it, under "
                    f"the subjects {people[one]} and {people[other]}; list it once, or nobody can "
                    "be held out"
                )


def shared_bodies(
    clips: Mapping[str, Sequence[Tensor]], kept: Sequence[str]
) -> list[tuple[str, str]]:
    """People with the bones of one who is kept from training, who may be that person.

    None where all people have the same bones: then motion was put on a common skeleton.

    Args:
        clips: landmarks (F, 16, 3) of each person's clips.
        kept: people who are held out.
    """
    place = LANDMARKS.index
    pairs = [(place(f"{side}_{a}"), place(f"{side}_{b}")) for side in "lr" for _, a, b in _BONES]
    bones = {
        name: torch.stack([(part[0][0][a] - part[0][0][b]).norm() for a, b in pairs])
        for name, part in clips.items()
    }

    def alike(one: str, other: str) -> bool:
        return bool((bones[one] - bones[other]).abs().max() < _SAME_BONES)

    others = [name for name in bones if name not in kept]
    if all(alike(name, kept[0]) for name in bones):
        return []
    return [(one, other) for one in kept for other in others if alike(one, other)]


def _hashed(angles: NDArray[np.float64]) -> list[bytes]:
    """Frames (F, ...) of degrees to a hundredth, a few bytes each."""
    rounded = np.rint(1e2 * angles).astype(np.int32)
    return [hashlib.blake2b(frame.tobytes(), digest_size=12).digest() for frame in rounded]
