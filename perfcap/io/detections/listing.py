"""Everybody a detector found in the frames of one view: one of them followed, or all of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from perfcap.detect.joint_set import BLAZEPOSE33, JointSet
from perfcap.errors import InputError
from perfcap.io.detections.track import Array, Track

# --- Following one person through frames in which a detector found several ------------------------

# How far a person's joints may move from frame to frame, as a share of their own size, and how
# much more for every frame in which they were not seen.
STEP = 0.5
STEP_PER_GAP = 0.1


def follow(frames: Sequence[Sequence[Array]]) -> Array:
    """The joints (F, J, 3) of one person; zeros in frames where they were not detected.

    Starts at the largest, most confident person of the clip and follows them both ways: in each
    frame the nearest candidate, unless even that one is too far away to be the same person.

    Args:
        frames: per frame the candidates, each (J, 3): x, y, confidence; at least one in all.
    """
    scores = [[prominence(person) for person in people] for people in frames]
    best = [max(people, default=-np.inf) for people in scores]
    start = int(np.argmax(best))
    first = frames[start][int(np.argmax(scores[start]))]
    chosen = np.zeros((len(frames), *first.shape))
    chosen[start] = first
    _walk(frames, chosen, first, range(start + 1, len(frames)))
    _walk(frames, chosen, first, range(start - 1, -1, -1))
    return chosen


def _walk(
    frames: Sequence[Sequence[Array]], chosen: Array, last: Array, order: Iterable[int]
) -> None:
    gap = 0
    for f in order:
        distances = [_distance(person, last) for person in frames[f]]
        nearest = int(np.argmin(distances)) if distances else -1
        if nearest >= 0 and distances[nearest] < STEP + STEP_PER_GAP * gap:
            last = chosen[f] = frames[f][nearest]
            gap = 0
        else:
            gap += 1


def _seen(person: Array) -> Array:
    finite = np.where(np.isfinite(person), person, 0)
    points: Array = finite[finite[:, 2] > 0]
    return points


def _extent(person: Array) -> float:
    points = _seen(person)[:, :2]
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def prominence(person: Array) -> float:
    """Size times summed confidence of a person (J, 3): large and well seen."""
    points = _seen(person)
    return _extent(person) * float(points[:, 2].sum()) if len(points) else 0.0


def _distance(person: Array, other: Array) -> float:
    """Median distance of the joints both have, as a share of the other's size."""
    both = np.isfinite(person).all(-1) & np.isfinite(other).all(-1)
    both &= (person[:, 2] > 0) & (other[:, 2] > 0)
    size = _extent(other)
    if not both.any() or size == 0:
        return float("inf")
    steps = np.linalg.norm(person[both, :2] - other[both, :2], axis=-1)
    return float(np.median(steps)) / size


# --------------------------------------------------------------------------------------------------
# Everybody a detector found in the frames of one view: one of them followed, or all of them.

_ORIGIN = 0.01  # m; of a share, that is the outermost hundredth of the image
_SHARE = 3.0  # images; joints that are guessed lie somewhat outside
MOST_CANDIDATES = 32  # in a frame and view; further ones are passers-by in the distance


@dataclass(frozen=True)
class Listing:
    """People found in the frames of a view, in no order.

    Attributes:
        where: the file or folder, for messages.
        joint_set: names of the J joints.
        frames: the people of each frame, each (J, 3): x, y in pixels of the file, confidence.
        warnings: what a user should know about how the file was read.
        video_frames: of the video these were detected in, where the file says so.
        shares: whether x and y are shares of the image's width and height.
    """

    where: str
    joint_set: JointSet
    frames: Sequence[Sequence[Array]]
    warnings: tuple[str, ...] = ()
    video_frames: int | None = None
    shares: bool = False

    @property
    def most(self) -> int:
        """Number of people in the fullest frame."""
        return max((len(people) for people in self.frames), default=0)


def are_shares(frames: Sequence[Sequence[Array]]) -> bool:
    """Whether coordinates are shares of the image: nobody is seen within three pixels."""
    places = [person[person[:, 2] > 0, :2] for people in frames for person in people]
    largest = [np.abs(place[np.isfinite(place)]).max(initial=0.0) for place in places if len(place)]
    return bool(largest) and float(np.median(largest)) < _SHARE


def in_pixels(
    view: Track | Listing, size: tuple[int, int] | None, pixel_offset: float = 0.0
) -> Track | Listing:
    """A view in pixels of its file; shares of the image become such.

    Args:
        view: as read.
        size: height and width of its images.
        pixel_offset: what makes centres of these pixels integers.

    Raises:
        InputError: shares of an image whose size is not known.
    """
    if isinstance(view, Track) or not view.shares:
        return view
    if _about_hips(view):
        raise InputError(
            f"{view.where}: the middle of the hips is at x = 0, y = 0 in every frame: these are "
            "places in the world, as MediaPipe's pose_world_landmarks; give pose_landmarks, which "
            "are in the image"
        )
    if size is None:
        raise InputError(
            f"{view.where}: holds shares of the image instead of pixels, and the size of the image "
            "is not known; give the video as well, or write pixels"
        )
    scale, offset = (
        np.array([size[1], size[0], 1.0]),
        np.array([1.0, 1.0, 0.0]) * (0.5 + pixel_offset),
    )
    frames = [[person * scale - offset for person in people] for people in view.frames]
    return replace(view, frames=frames, shares=False)


def _about_hips(view: Listing) -> bool:
    """Whether coordinates are metres about the hips: nobody stands in a corner all the time."""
    if view.joint_set is not BLAZEPOSE33:
        return False
    hips = [view.joint_set.joints.index(hip) for hip in ("l_hip", "r_hip")]
    places = [np.nan_to_num(person[:, :2]) for row in view.frames for person in row]
    middles = [np.abs(place[hips].mean(0)).max() for place in places if place.any()]
    return bool(middles) and float(np.median(middles)) < _ORIGIN


def followed(view: Track | Listing) -> Track:
    """One person of a view: the most prominent one of a listing, with a note on the others."""
    if isinstance(view, Track):
        return view
    shape = (len(view.frames), len(view.joint_set), 3)
    chosen = follow(view.frames) if any(view.frames) else np.zeros(shape)
    return _track(view, chosen, _note(view, "the most prominent one is followed"))


def slots_of(view: Track | Listing) -> int:
    """The most people of a frame and view that ``everybody`` keeps."""
    return 1 if isinstance(view, Track) else max(1, min(view.most, MOST_CANDIDATES))


def everybody(view: Track | Listing, slots: int) -> Track:
    """All people of a view, ``slots`` rows a frame, (F x slots, J); rows of nobody are zero."""
    if isinstance(view, Track):
        return replace(
            view,
            joints2d=_spread(view.joints2d, slots),
            confidence=_spread(view.confidence, slots),
            joints3d=None if view.joints3d is None else _spread(view.joints3d, slots),
        )
    values = np.zeros((len(view.frames), slots, len(view.joint_set), 3))
    for frame, people in enumerate(view.frames):
        kept = people
        if len(people) > slots:
            kept = sorted(people, key=prominence, reverse=True)[:slots]
        for slot, person in enumerate(kept):
            values[frame, slot] = person
    note = f"the {slots} most prominent are looked at" if view.most > slots else ""
    return _track(view, values.reshape(-1, *values.shape[2:]), _note(view, note))


def _spread(values: Array, slots: int) -> Array:
    """Values of one person (F, ...) in the first of several rows a frame, (F x slots, ...)."""
    spread = np.zeros((len(values), slots, *values.shape[1:]))
    spread[:, 0] = values
    return spread.reshape(-1, *values.shape[1:])


def _note(view: Listing, what: str) -> tuple[str, ...]:
    if view.most < 2 or not what:
        return ()
    return (f"{view.where}: up to {view.most} people in a frame; {what}",)


def _track(view: Listing, values: Array, notes: tuple[str, ...]) -> Track:
    track = Track(view.where, view.joint_set, values[..., :2], values[..., 2], None, view.warnings)
    return replace(track, warnings=(*view.warnings, *notes), video_frames=view.video_frames)
