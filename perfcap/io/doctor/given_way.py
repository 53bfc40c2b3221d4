"""Whether a moving camera's video shows the way that its file states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.geometry.camera import Camera
from perfcap.io.clip import FrameReader
from perfcap.io.doctor.finding import Finding, Severity, ranges
from perfcap.io.doctor.rest import CONFIDENT, about_joints
from perfcap.matchmove import CornerTracks, Sightings, find_bars
from perfcap.matchmove.given_way import (
    Compared,
    GivenWaySettings,
    SeenWay,
    compare_way,
    off_way,
)

Array = NDArray[np.float64]
Joints = tuple[Array, Array]

_TRACKED = 15.0  # frames a second in which corners are followed
_LONGEST, _STRETCHES, _STRETCH = 20.0, 8, 2.5  # s that are followed whole; else so many of so long
_SAMPLES = 5  # frames in which bars beside the picture are looked for
_WINDOW, _WRONG = 5, 3  # pairs of frames, one after the other, and of these such as are wrong
# Of a clip too short for that, pairs are closer to each other: how many are wrong at least, in what
# share of them, and one by how much of the image; poses that tremble make some of them wrong
_DENSE, _FEW, _MOSTLY, _CLEAR = GivenWaySettings(every=0.1), 3, 0.6, 0.01
_LATE = 60  # frames by which poses may be early or late, and are said to be
_FITS, _BETTER = 0.002, 1 / 3  # of the image, and of what given poses are off, that others are


def examine_way(
    clip: FrameReader,
    names: Sequence[str],
    cameras: Camera,
    rate: float,
    seen: Joints | None = None,
    first: int = 0,
) -> list[Finding]:
    """Views in which what is behind people moves otherwise than poses and lens have it.

    Crowds and plain walls say nothing; neither does what all cameras would see alike, as the length
    of a way.

    Args:
        clip: C views.
        names: of the views, C.
        cameras: (F, C), moving, in pixels of the videos.
        rate: frames a second.
        seen: joints of people in pixels of the videos, (*P, F, C, 16, 2), and their confidence;
            None where they are not known.
        first: number of the first frame in the video.
    """
    if not cameras.moving:
        return []
    findings = []
    for view, name in enumerate(names):
        joints = None if seen is None else (seen[0][..., view, :, :], seen[1][..., view, :])
        way = _seen(clip, view, cameras.select([view]), rate, joints)
        compared = compare_way(way)
        if len(compared) < _WINDOW:
            compared = compare_way(way, _DENSE)
            wrong = _mostly(compared)
        else:
            wrong = _lasting(compared)
        if wrong:
            findings.append(_finding(name, way, compared, wrong, first))
        else:
            findings += _held(name, way, first)
    return findings


def _seen(
    clip: FrameReader, view: int, cameras: Camera, rate: float, joints: Joints | None
) -> SeenWay:
    """The way of one view, and corners that are followed through some of its frames."""
    count = min(len(clip), len(cameras.rotation))
    count = count if joints is None else min(count, joints[0].shape[-3])
    step = max(1, round(rate / _TRACKED))
    some = np.linspace(0, count - 1, min(_SAMPLES, count)).round().astype(int).tolist()
    bars = find_bars([clip.read_view(view, each, each + 1)[0] for each in some])
    parts = []
    for start, stop in _stretches(count, rate):
        tracks, frames = CornerTracks(), np.arange(start, stop, step)
        hidden = bars
        for frame in frames.tolist():
            if joints is not None:
                shown = _about(joints, frame, bars.shape)
                hidden = hidden if shown is None else shown | bars  # else where people were last
            tracks.add(clip.read_view(view, frame, frame + 1)[0], hidden)
        parts.append((frames, tracks.sightings()))
    sightings = _together(parts)
    focal = torch.linalg.det(cameras.intrinsics[:, 0, :2, :2]).abs().sqrt() / max(bars.shape)
    return SeenWay(
        sightings=sightings,
        plane=_on_plane(sightings, cameras),
        rotation=cameras.rotation[:, 0].double().numpy(),
        translation=cameras.translation[:, 0].double().numpy(),
        focal=focal.double().numpy(),
        rate=rate,
    )


def _stretches(count: int, rate: float) -> Iterator[tuple[int, int]]:
    """First and behind the last of the frames in which corners are followed: all, or some."""
    if count <= _LONGEST * rate:
        yield 0, count
        return
    long = round(_STRETCH * rate)
    for start in np.linspace(0, count - long, _STRETCHES).round().astype(int).tolist():
        yield start, start + long


def _about(joints: Joints, frame: int, size: tuple[int, ...]) -> NDArray[np.bool_] | None:
    """Where people may be in a frame; None where nobody is known."""
    places = joints[0].reshape(-1, *joints[0].shape[-3:])[:, frame]
    known = joints[1].reshape(-1, *joints[1].shape[-2:])[:, frame] > CONFIDENT
    if not known.any():
        return None
    boxes = [about_joints(at[now], size) for at, now in zip(places, known, strict=True)]
    return np.asarray(np.any(boxes, 0))


def _together(parts: Sequence[tuple[NDArray[np.int64], Sightings]]) -> Sightings:
    """Sightings of several stretches, whose frames are counted through."""
    frames, points, count = [], [], 0
    for frame, seen in parts:
        frames.append(frame[seen.frame])
        points.append(seen.point + count)
        count += int(seen.point.max(initial=-1)) + 1
    pixels = np.concatenate([seen.pixels for _, seen in parts])
    return Sightings(np.concatenate(frames), np.concatenate(points), pixels, parts[0][1].scale)


def _on_plane(seen: Sightings, cameras: Camera) -> Array:
    """Undistorted places on the plane z = 1 of one camera that moves, (N, 2)."""
    pixels = torch.from_numpy((seen.pixels + 0.5) / seen.scale - 0.5)
    plane = torch.zeros_like(pixels)
    for frame in np.unique(seen.frame).tolist():
        rows = torch.from_numpy(seen.frame == frame)
        one = cameras.frames(slice(frame, frame + 1)).to(pixels)
        plane[rows] = one.to_plane(pixels[rows][None, None])[0, 0]
    return plane.numpy()


def _lasting(compared: Sequence[Compared]) -> list[Compared]:
    """Pairs that are wrong, as most of those about them are; of a window of them or more."""
    wrong = np.array([each.wrong for each in compared])
    windows = np.lib.stride_tricks.sliding_window_view(wrong, _WINDOW).sum(1) >= _WRONG
    lasting = wrong & (np.convolve(windows, np.ones(_WINDOW)) > 0)
    return [compared[index] for index in np.flatnonzero(lasting).tolist()]


def _mostly(compared: Sequence[Compared]) -> list[Compared]:
    """Pairs of a short clip that are wrong, if most are, and one clearly."""
    wrong = [each for each in compared if each.wrong]
    if len(wrong) < max(_FEW, _MOSTLY * len(compared)):
        return []
    return wrong if max(each.off for each in wrong) > _CLEAR else []


def _held(name: str, way: SeenWay, first: int) -> Iterator[Finding]:
    """Poses that are the same for a while in which the camera moves, as where a tracker was lost.

    Pairs of all frames reach beyond such a while, to poses that are right: only its own are taken.
    """
    same = (np.diff(way.rotation, axis=0) == 0).all((1, 2))
    same &= (np.diff(way.translation, axis=0) == 0).all(1)
    edges = np.diff(np.r_[0, same.astype(int), 0])
    for start, stop in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
        inside = (way.sightings.frame >= start) & (way.sightings.frame <= stop)
        part = replace(way, sightings=way.sightings.part(inside), plane=way.plane[inside])
        wrong = _mostly(compare_way(part, _DENSE))
        if wrong:
            off = float(np.median([each.off for each in wrong]))
            yield Finding(
                Severity.WARNING,
                name,
                f"the camera's poses in frames {ranges(range(first + start, first + stop + 1))} "
                f"are the same, while what is behind people moves by {off:.1%} of the image",
                "solve the camera there again, or leave these frames out",
            )


def _finding(
    name: str, way: SeenWay, compared: Sequence[Compared], wrong: Sequence[Compared], first: int
) -> Finding:
    frames = {k for each in wrong for k in range(each.pair.first, each.pair.second + 1)}
    off = float(np.median([each.off for each in wrong]))
    what = (
        "what is behind people moves otherwise than the camera's poses and lens have it, by "
        f"{off:.1%} of the image within a second, in frames "
        f"{ranges([first + frame for frame in sorted(frames)])}"
    )
    late = _late(way, compared)
    if late:
        what += f"; it moves as poses of {abs(late)} frames {'later' if late > 0 else 'before'} do"
        remedy = "give poses of this very video, the first of its first frame, at its rate"
    elif _backwards(way, compared):
        what += "; it moves as the poses do in reverse"
        remedy = "give the first frame's pose first"
    else:
        remedy = (
            "give poses of this very video, and K of every frame if the lens zooms; if they are "
            "such, solve the camera again there"
        )
    return Finding(Severity.WARNING, name, what, remedy)


def _late(way: SeenWay, compared: Sequence[Compared]) -> int:
    """By how many frames later poses fit as right ones do; 0 if none do."""
    scores = {}
    for shift in range(-_LATE, _LATE + 1):
        low, high = -shift, len(way.rotation) - shift
        inside = [
            each.pair for each in compared if low <= each.pair.first < each.pair.second < high
        ]
        if 2 * len(inside) >= len(compared):
            scores[shift] = float(np.median([off_way(way, pair, shift) for pair in inside]))
    best = min(scores, key=scores.__getitem__)
    return best if _fits(scores[best], scores[0]) else 0


def _backwards(way: SeenWay, compared: Sequence[Compared]) -> bool:
    """Whether the way fits from its end to its beginning."""
    turned = replace(way, rotation=way.rotation[::-1], translation=way.translation[::-1])
    scores = [np.median([off_way(one, each.pair) for each in compared]) for one in (turned, way)]
    return _fits(*map(float, scores))


def _fits(off: float, given: float) -> bool:
    return off < min(_FITS, _BETTER * given)
