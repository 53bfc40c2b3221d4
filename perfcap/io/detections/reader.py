"""Which detections file is which, and views put together: of one person, or of all candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.io.clip import END_SLACK
from perfcap.io.detections.keypoint_json import read_keypoint_json
from perfcap.io.detections.keypoint_npy import read_keypoint_npy
from perfcap.io.detections.listing import Listing, everybody, followed, in_pixels, slots_of
from perfcap.io.detections.network import PICKLES, holds_network, read_network_npz
from perfcap.io.detections.npz import read_npz
from perfcap.io.detections.openpose import read_openpose
from perfcap.io.detections.track import LandmarkTrack, Track, to_landmarks
from perfcap.io.detections.yolo_txt import labels_in, read_labels
from perfcap.io.view_names import match_views

_TABLES = frozenset({".csv", ".h5", ".hdf5", ".slp", ".xlsx", ".parquet", ".mat"})
EXPECTED = (
    "detections.npz, a folder of OpenPose JSON, keypoint JSON (AlphaPose, COCO, MMPose, "
    "MediaPipe), keypoints as .npy, or joints of SAM 3D Body, GVHMR or WHAM as .npz"
)

CROWDED = (
    "the most prominent person of one view may be another one in the next; --people 1 "
    "follows the same person in all views, --people auto everybody"
)
"""What is said where one of several people is followed in several views."""


def read_detections(
    paths: str | Path | Sequence[str | Path],
    *,
    views: Sequence[str] | int = 1,
    pixel_offset: float = 0.0,
    frames: int | None = None,
    used: int | None = None,
    total: int | None = None,
    sizes: Sequence[tuple[int, int]] | None = None,
    images: Sequence[Sequence[str]] = (),
) -> tuple[Detections, list[str]]:
    """Read the joints of one person, seen in C views.

    Args:
        paths: one file or folder a view, or one npz of all views. Files named after views
            (see ``match_views``) go to these, others are in the order of the cameras.
        views: the cameras' names or their number C.
        pixel_offset: added to pixel coordinates: ``CameraRig.pixel_offset``.
        frames: frames of the video, where known.
        used: of these the first that matter, where those behind them do not: all of the video
            should then have been detected nevertheless, or just these, and nothing is cut.
        total: frames that the video promises, where some of them may be broken: detections that
            say how long their video was may be of either number.
        sizes: height and width of each view's images, for files that hold shares of them.
        images: names of each view's images, without ending, where it is a folder of them: what is
            called so is of that frame.

    Returns:
        Detections in float64, F frames of the shortest view (of the video, if shorter and all of
        it matters), and warnings for the user.

    Raises:
        InputError: files that cannot be read, or do not fit the views and frames.
    """
    names, found = _read_views(paths, views, frames, sizes, images, pixel_offset)
    tracks = [followed(view) for view in found]
    mapped = [to_landmarks(track, pixel_offset) for track in tracks]
    _require_somebody(names, mapped)
    shortest, note = _shared_length(tracks, frames, used, total)
    warnings = [warning for track in mapped for warning in track.warnings]
    crowded = [view for view in found if slots_of(view) > 1]
    if len(found) > 1 and crowded:
        note.append(CROWDED)
    return _stack(mapped, shortest), warnings + note


def read_candidates(
    paths: str | Path | Sequence[str | Path],
    *,
    views: Sequence[str] | int = 1,
    pixel_offset: float = 0.0,
    frames: int | None = None,
    used: int | None = None,
    total: int | None = None,
    sizes: Sequence[tuple[int, int]] | None = None,
    images: Sequence[Sequence[str]] = (),
) -> tuple[Detections, list[str]]:
    """Read the joints of everybody who was detected in C views, before anybody says who is who.

    Args:
        paths: as of ``read_detections``, and so are the others.
        views: the cameras' names or their number C.
        pixel_offset: added to pixel coordinates.
        frames: frames of the video, where known.
        used: of these the first that matter.
        total: frames that the video promises.
        sizes: height and width of each view's images.
        images: as of ``read_detections``.

    Returns:
        Detections (P, F, C, 16), where P is the most people of a frame and view: those of one
        batch element have nothing to do with each other, and where fewer people were found, the
        rest have confidence 0. And warnings for the user.

    Raises:
        InputError: files that cannot be read, or do not fit the views and frames.
    """
    names, found = _read_views(paths, views, frames, sizes, images, pixel_offset)
    slots = max(slots_of(view) for view in found)
    rows = [everybody(view, slots) for view in found]
    mapped = [to_landmarks(track, pixel_offset) for track in rows]
    _require_somebody(names, mapped)
    each = [replace(track, joints2d=track.joints2d[::slots]) for track in rows]
    shortest, note = _shared_length(each, frames, used, total)
    warnings = [warning for track in mapped for warning in track.warnings]
    flat = _stack(mapped, shortest * slots)
    return flat.map(lambda t: t.unflatten(0, (shortest, slots)).movedim(1, 0)), warnings + note


def _read_views(
    paths: str | Path | Sequence[str | Path],
    views: Sequence[str] | int,
    frames: int | None,
    sizes: Sequence[tuple[int, int]] | None,
    images: Sequence[Sequence[str]],
    pixel_offset: float,
) -> tuple[str, list[Track | Listing]]:
    """One track or listing a view, in the order of the views, and the names of the files."""
    several = [Path(paths)] if isinstance(paths, str | Path) else [Path(path) for path in paths]
    names = None if isinstance(views, int) else list(views)
    count = views if isinstance(views, int) else len(views)
    several = _by_name(several, names)
    shown = images if len(several) == len(images) == count else [()] * len(several)
    pairs = zip(several, shown, strict=True)
    found = [view for path, own in pairs for view in _read(path, names, frames, own)]
    listed = ", ".join(map(str, several))
    if len(found) != count:
        raise InputError(
            f"--detections: {listed} hold {len(found)} views, the cameras are {count}; expected "
            "one file a view, or one npz of all"
        )
    known = [None] * count if sizes is None or len(sizes) != count else list(sizes)
    return listed, [in_pixels(*each, pixel_offset) for each in zip(found, known, strict=True)]


def _require_somebody(names: str, tracks: Sequence[LandmarkTrack]) -> None:
    if not any((track.confidence > 0).any() for track in tracks):
        raise InputError(
            f"--detections: nobody is detected in any frame of {names}; expected a visible person"
        )


def _shared_length(
    tracks: Sequence[Track], frames: int | None, used: int | None, total: int | None
) -> tuple[int, list[str]]:
    """The frames that all have and that matter, with notes."""
    shortest, note = _common_length(tracks, frames if used is None else None)
    if frames is None:
        return shortest, note
    if used is None:
        _check_whole(tracks, frames, total)
        return shortest, note
    return shortest, note + _check_part(tracks, frames, used)


def _read(
    path: Path, views: list[str] | None, frames: int | None, images: Sequence[str]
) -> Sequence[Track | Listing]:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; expected {EXPECTED}")
    if path.is_dir() and (labels := labels_in(path)) is not None:
        return [read_labels(labels, frames, images)]
    if path.is_dir():
        return [read_openpose(path, frames, images)]
    if path.suffix.lower() == ".npz":
        if holds_network(path):
            return [read_network_npz(path, frames)]
        return read_npz(path, views)
    if path.suffix.lower() == ".npy":
        return read_keypoint_npy(path)
    if path.suffix.lower() == ".json":
        return [read_keypoint_json(path, frames, images)]
    if path.suffix.lower() in PICKLES:
        raise InputError(
            f"{path}: is a pickle, which could run any code when it is read; write its joints as "
            ".npz in the program's own environment, three lines in docs/coming_from.md"
        )
    if path.suffix.lower() in _TABLES:
        raise InputError(
            f"{path}: is not a detections file I know, but a table, as DeepLabCut and SLEAP write "
            "them; write x, y and likelihood of a person's joints, in the order of COCO's 17, as "
            ".npy [F,17,3], or with their names as .npz (joints2d, confidence2d, joint_names)"
        )
    raise InputError(f"{path}: is not a detections file I know; expected {EXPECTED}")


def _by_name(paths: list[Path], views: Sequence[str] | None) -> list[Path]:
    """One file a view in the order of the views, where names of files or their folders tell."""
    if views is None or len(paths) != len(views):
        return paths
    stems = [path.stem for path in paths]
    names = stems if len(set(stems)) == len(stems) else [path.parent.name for path in paths]
    order = match_views(names, views)
    if order is None:
        return paths
    return [paths[order.index(view)] for view in range(len(views))]


def _common_length(tracks: Sequence[Track], frames: int | None) -> tuple[int, list[str]]:
    """The frames all have; a few missing at the end are cut, more are an error."""
    lengths = {track.where: len(track.joints2d) for track in tracks}
    if len(set(lengths.values())) == 1:
        lengths = {"every view of --detections": len(tracks[0].joints2d)}
    if frames is not None:
        lengths["the video"] = frames
    shortest, longest = min(lengths.values()), max(lengths.values())
    if shortest == longest:
        return shortest, []
    listing = ", ".join(f"{name} has {length}" for name, length in lengths.items())
    if longest - shortest > END_SLACK:
        raise InputError(
            f"--detections: numbers of frames differ ({listing}); expected one detection a video "
            "frame and view"
        )
    return shortest, [f"numbers of frames differ ({listing}); the first {shortest} are used"]


def _check_whole(tracks: Sequence[Track], frames: int, total: int | None) -> None:
    """Detections are of this video, where they say how long theirs was.

    As many rows as the video has frames may be of a part of a longer one.
    """
    for track in tracks:
        of, known = track.video_frames, (frames, frames if total is None else total)
        if of is not None and all(abs(of - one) > END_SLACK for one in known):
            raise InputError(
                f"--detections: numbers of frames differ ({track.where} is of {of}, the video has "
                f"{frames}); expected detections of this video: is it a part of the one that was "
                "detected?"
            )


def _check_part(tracks: Sequence[Track], frames: int, used: int) -> list[str]:
    """Detections are of the video, although only a part of it matters: as long, or made for it."""
    notes = []
    for track in tracks:
        found = len(track.joints2d)
        if abs((track.video_frames or found) - frames) <= END_SLACK:
            continue
        has = f"has {found}" if track.video_frames is None else f"is of {track.video_frames}"
        differ = f"numbers of frames differ ({track.where} {has}, the video has {frames})"
        if track.video_frames is None and found == used:
            notes.append(f"{differ}; they are taken for its first {found} frames")
            continue
        first = f"; if they are of its first {found} frames, let --frames end there"
        raise InputError(
            f"--detections: {differ}; expected one detection a video frame and view"
            f"{first if track.video_frames is None and found < frames else ''}"
        )
    return notes


def _stack(tracks: Sequence[LandmarkTrack], frames: int) -> Detections:
    """Views side by side; a view without 3D is not trusted there."""
    poses = [track.joints3d for track in tracks]
    zeros = torch.zeros(frames, tracks[0].joints2d.shape[-2], 3, dtype=torch.float64)
    joints3d = None
    if any(pose is not None for pose in poses):
        joints3d = torch.stack([zeros if pose is None else pose[:frames] for pose in poses], 1)
    return Detections(
        torch.stack([track.joints2d[:frames] for track in tracks], 1),
        torch.stack([track.confidence[:frames] for track in tracks], 1),
        joints3d,
        torch.stack([track.trusted3d[:frames] for track in tracks], 1),
    )
