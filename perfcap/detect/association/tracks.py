"""Groups of frame after frame that are of one person, and people who come back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from perfcap.detect.association.grouping import Groups, Indices
from perfcap.detect.association.sightings import AssociationConfig
from perfcap.detect.joint_set import LANDMARKS

# --- Bone lengths of people, by which they are known again ----------------------------------------

_PAIRS = {
    "shoulders": (("l_shoulder", "r_shoulder"),),
    "hips": (("l_hip", "r_hip"),),
    "upper_arms": (("l_shoulder", "l_elbow"), ("r_shoulder", "r_elbow")),
    "forearms": (("l_elbow", "l_wrist"), ("r_elbow", "r_wrist")),
    "sides": (("l_shoulder", "l_hip"), ("r_shoulder", "r_hip")),
    "thighs": (("l_hip", "l_knee"), ("r_hip", "r_knee")),
    "shanks": (("l_knee", "l_ankle"), ("r_knee", "r_ankle")),
}
BONE_NAMES = tuple(_PAIRS)
"""What is measured, left and right together."""

_SHORT = 0.02  # m; nobody has shorter ones, and logarithms are taken


def bone_lengths(points: Tensor) -> Tensor:
    """Lengths (..., 7) m of the bones of landmarks (..., 16, 3), means of left and right."""
    lengths = []
    for pairs in _PAIRS.values():
        ends = [[LANDMARKS.index(joint) for joint in pair] for pair in pairs]
        each = [(points[..., a, :] - points[..., b, :]).norm(dim=-1) for a, b in ends]
        lengths.append(torch.stack(each, -1).nanmean(-1))
    return torch.stack(lengths, -1)


def tracked_bones(points: Tensor) -> Tensor:
    """Median lengths (..., 7) over the frames of landmarks (..., F, 16, 3); NaN where unknown."""
    return bone_lengths(points).nanmedian(-2).values


def bone_difference(one: Tensor, other: Tensor) -> Tensor:
    """Root-mean-square difference of log lengths (..., 7), over those that both have.

    Infinite where they have less than half of them in common.
    """
    squared = (one.clamp(min=_SHORT).log() - other.clamp(min=_SHORT).log()).square()
    common = squared.isfinite().sum(-1)
    rms = squared.nanmean(-1).sqrt()
    return torch.where(2 * common >= len(BONE_NAMES), rms, torch.inf)


# --- Groups of frame after frame that are of one person, and people who come back -----------------

Floats = NDArray[np.float64]

_SEEN = 0.02  # m that a group gains with each view: of two in one place, the better seen one
_NOBODY = 0.3  # m that it costs to leave somebody who is here without a track, or one without them
_ENDS = 3  # frames of a track that its end is judged by
_COAST = 0.3  # s for which somebody unseen goes on as before


@dataclass
class Track:
    """One person's groups.

    Attributes:
        rows: of the groups by frame.
        last: latest place of each joint, (J, 3).
        velocity: m a frame, (3,).
    """

    rows: dict[int, int] = field(default_factory=dict)
    last: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    velocity: Floats = field(default_factory=lambda: np.zeros(3))

    @property
    def first(self) -> int:
        """The first frame."""
        return min(self.rows)

    @property
    def end(self) -> int:
        """The last frame."""
        return max(self.rows)

    def add(self, frame: int, row: int, points: Floats) -> None:
        """Go on to a frame."""
        if self.rows:
            step = points - self.last
            known = np.isfinite(step).all(-1)
            if known.any():
                moved = np.median(step[known], 0) / (frame - self.end)
                self.velocity = 0.5 * (self.velocity + moved)
            points = np.where(np.isfinite(points), points, self.last)
        self.last = points
        self.rows[frame] = row

    def expected(self, frame: int, rate: float) -> Floats:
        """Where the joints should be in a later frame, (J, 3)."""
        ahead = min(frame - self.end, _COAST * rate)
        return self.last + ahead * self.velocity


def link(groups: Groups, rate: float, config: AssociationConfig) -> list[Track]:
    """Tracks of groups: in each frame everybody is looked for where they should be."""
    tracks: list[Track] = []
    for frame in np.unique(groups.frames).tolist():
        rows = groups.of(frame)
        near = [t for t in tracks if frame - t.end <= max(1, config.memory * rate)]
        taken = _match(groups, rows, near, frame, rate, config)
        known = [row for row, track in zip(rows, taken, strict=True) if track is not None]
        for row, track in sorted(
            zip(rows.tolist(), taken, strict=True), key=lambda pair: -groups.support[pair[0]]
        ):
            if track is None:
                if _beside(groups, row, known, config):
                    continue
                known.append(row)
                track = Track()
                tracks.append(track)
            track.add(frame, row, groups.points[row])
    return tracks


def _beside(groups: Groups, row: int, known: list[int], config: AssociationConfig) -> bool:
    """Whether somebody is there already: views of one person that do not agree are no second."""
    others = torch.from_numpy(groups.points[known])
    apart = _distance(torch.from_numpy(groups.points[row]), others)
    return bool((apart < config.beside).any())


def _match(
    groups: Groups,
    rows: Indices,
    tracks: list[Track],
    frame: int,
    rate: float,
    config: AssociationConfig,
) -> list[Track | None]:
    """The track of each group; None for somebody new."""
    if not tracks:
        return [None] * len(rows)
    places = np.stack([track.expected(frame, rate) for track in tracks])
    apart = _distance(torch.from_numpy(places)[:, None], torch.from_numpy(groups.points[rows]))
    support = groups.support[rows]
    gaps = np.array([frame - track.end for track in tracks]) / rate
    gate = (config.stray + config.speed * np.minimum(gaps, _COAST))[:, None]
    # a price, not a wall: else everybody is shifted by one rather than one track left without
    cost = np.where(apart < gate, apart - _SEEN * support, _NOBODY)
    taken: list[Track | None] = [None] * len(rows)
    for i, j in zip(*linear_sum_assignment(cost), strict=True):
        if apart[i, j] < gate[i, 0]:
            taken[j] = tracks[i]
    return taken


def rejoin(
    tracks: list[Track], groups: Groups, rate: float, config: AssociationConfig
) -> tuple[list[Track], list[tuple[int, int, float]]]:
    """Tracks of people who were away and came back, joined by their bone lengths.

    Returns:
        The tracks, and for each long absence the last frame before, the first after, and how much
        the bone lengths differ.
    """
    tracks = [track for track in tracks if len(track.rows) >= 3]
    joins: list[tuple[int, int, float]] = []
    while True:
        bones = [_bones(track, groups) for track in tracks]
        best: tuple[float, int, int] | None = None
        for i, one in enumerate(tracks):
            for j, other in enumerate(tracks):
                if i == j or not _may_be_one(one, other, groups, rate, config):
                    continue
                off = float(bone_difference(bones[i], bones[j]))
                if off < (config.bones if best is None else best[0]):
                    best = (off, i, j)
        if best is None:
            return tracks, joins
        off, i, j = best
        if tracks[j].first - tracks[i].end > config.memory * rate:
            joins.append((tracks[i].end, tracks[j].first, off))
        tracks[i] = _joined(tracks[i], tracks[j], groups)
        del tracks[j]


def places(track: Track, groups: Groups, frames: int) -> Tensor:
    """Joints of a track, (F, J, 3), NaN where unknown."""
    points = np.full((frames, *groups.points.shape[1:]), np.nan)
    points[list(track.rows)] = groups.points[list(track.rows.values())]
    return torch.from_numpy(points)


def _bones(track: Track, groups: Groups) -> Tensor:
    return tracked_bones(torch.from_numpy(groups.points[list(track.rows.values())]))


def _may_be_one(
    one: Track, other: Track, groups: Groups, rate: float, config: AssociationConfig
) -> bool:
    """Whether two tracks can be of one person: one after the other, and within reach.

    Or beside each other, now one and now the other: views of a person that fall apart in two.
    """
    common = sorted(one.rows.keys() & other.rows.keys())
    if common:
        apart = np.median(_distance(*(_points(track, groups, common) for track in (one, other))))
        few = len(common) <= config.torn * min(len(one.rows), len(other.rows))
        return few and float(apart) < 2 * config.stray
    if other.first <= one.end:
        return False
    last = _points(one, groups, sorted(one.rows)[-_ENDS:])
    first = _points(other, groups, sorted(other.rows)[:_ENDS])
    nearest = float(_distance(last[:, None], first).min())  # of groups at ends, one may be wrong
    return nearest < config.stray + config.speed * (other.first - one.end) / rate


def _joined(one: Track, other: Track, groups: Groups) -> Track:
    """Both as one; where both know a frame, the one that more views show."""
    rows = dict(one.rows)
    for frame, row in other.rows.items():
        if frame not in rows or groups.support[row] > groups.support[rows[frame]]:
            rows[frame] = row
    return Track(rows, (one if one.end > other.end else other).last)


def _points(track: Track, groups: Groups, frames: list[int]) -> Tensor:
    return torch.from_numpy(groups.points[[track.rows[frame] for frame in frames]])


def _distance(one: Tensor, other: Tensor) -> Floats:
    """Median distance of the joints that both know; infinite if there are none."""
    apart = (one - other).norm(dim=-1).nanmedian(-1).values
    found: Floats = apart.nan_to_num(nan=torch.inf).numpy()
    return found
