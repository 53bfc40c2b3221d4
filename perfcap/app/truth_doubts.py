"""What a truth shows to be wrong with itself, or with what it is compared with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from perfcap.app.truth import FoundJoints, Truth, match_frames
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.datasets import SurfaceTruth
from perfcap.io.doctor.body_size import body_size
from perfcap.io.doctor.doubled import examine_doubled
from perfcap.io.doctor.sparse import detected_period
from perfcap.io.doctor.straight import examine_straight
from perfcap.io.surface_file import SurfaceFile
from perfcap.metrics import (
    Alignment,
    aligned_distances,
    counted_joints,
    mismatches,
    pixel_mismatches,
    surface_distance,
    surface_mismatches,
)
from perfcap.metrics.lags import in_words

_FAR, _NEARER = 0.1, 0.5  # m off, and share of it that another person leaves
_NOISE = 0.01  # m by which poses of both may fit equally well
_TALL = 500.0  # px, of a person in the images for which interpolation is looked for
_SPREAD = 5  # joints of a frame, or frames, that show it
_FLAT = 0.005  # m; no person is as thin
_MIDDLE = 0.001  # m; right knees and elbows bend, and are not half-way
_LOOKED, _LATE = 4, 3  # frames whose true surfaces are looked at, and frames around each
_LARGER = 1.4  # than the surface of the result
_LEFT, _NEAREST = 0.7, 3.0  # share of the distance that other frames leave; mm that they gain
_AROUND, _MOST = 10, 200  # frames before and after those that are compared; and of a surface


def joint_doubts(found: FoundJoints, truth: Truth) -> list[str]:
    """Mistakes in the truth that its joints show; see ``mismatches``."""
    if truth.sequence.joints3d is None:
        return []
    rows, others = match_frames(found.frames, truth, str(found.path))
    estimate, true = found.joints[rows], truth.scored(truth.sequence.joints3d[others])
    valid = counted_joints(estimate, true, partial=True)
    if bool(valid.any()) and torch.equal(estimate[valid], true[valid]):
        return [
            f"{truth.sequence.folder}: has the joints of the result itself, to the last bit, so "
            "that nothing is measured; give the truth"
        ]
    nearer = list(_others(estimate, true, valid, truth, others))
    if nearer:
        return nearer
    numbers = found.frames[rows].tolist()
    order = LANDMARKS16.mirrored()
    told = mismatches(
        estimate,
        true,
        valid,
        order,
        frames=numbers,
        joints=LANDMARKS,
        whole=truth.scored(truth.sequence.joints3d),
        whole_frames=truth.sequence.frames.tolist(),
    )
    return [*told, *_made_up(true, valid)]


def _others(
    estimate: Tensor, true: Tensor, valid: Tensor, truth: Truth, rows: list[int]
) -> Iterator[str]:
    """That another person of the recording is the one whom a result shows, the nearest first."""
    option = "--truth" if truth.sequence.dataset == "file" else "--sequence"
    found = []
    for name, joints in truth.sequence.others.items():
        other = truth.scored(joints[rows])
        both = valid & other.isfinite().all(-1)
        if 2 * int(both.sum()) < int(valid.sum()):
            continue
        own, left = (float((estimate - each)[both].norm(dim=-1).mean()) for each in (true, other))
        if own <= _FAR or left >= _NEARER * own:
            continue
        # in a world that is turned about the people, another one is where this one should be
        pose, theirs = (_posed(estimate, each, both) for each in (true, other))
        if theirs < pose + max(_NOISE, 0.2 * pose) or math.isnan(pose):
            found.append((left / own, name))
    for share, name in sorted(found):
        yield (
            f"{name} of the same recording is nearer to the result: {share:.0%} of the "
            f"error is left; {option} {name} compares with that person"
        )


def _posed(estimate: Tensor, truth: Tensor, valid: Tensor) -> float:
    """Mean distance of joints after a similarity of each frame, m; NaN where too few count."""
    apart = aligned_distances(estimate, truth, valid, Alignment.SIMILARITY)
    return 0.001 * float(apart.nanmean())


def _made_up(true: Tensor, valid: Tensor) -> Iterator[str]:
    """That joints of a truth are copies of others, or were put in between for some frames."""
    yield from _flat(true, valid)
    yield from _halfway(true, valid)
    for copied in examine_doubled("", true, valid, true=True):
        yield (
            f"the truth: {copied.what}, and its error says nothing; give the places that were "
            "measured, or look at per_joint_mm alone"
        )
    size = body_size(true, valid)
    said = [finding.what for finding in examine_straight("", 0, true, valid, "its joints")]
    if not said and size is not None and (period := detected_period(_TALL * true / size, valid)):
        said = [f"one in {period} frames was measured, it seems, and the others lie on curves"]
    for what in said:
        yield (
            f"the truth: {what}; errors there are those of what was put in between, give what was "
            "measured in every frame"
        )


def _flat(true: Tensor, valid: Tensor) -> Iterator[str]:
    """Joints in one plane, as of a program that finds them in images alone."""
    known = torch.where(valid[..., None], true, torch.nan)
    apart = (known - known.nanmean(1, keepdim=True)).nan_to_num()
    enough = valid.sum(-1) >= _SPREAD
    if not bool(enough.any()):
        return
    thin = torch.linalg.svdvals(apart[enough])[:, -1] / valid[enough].sum(-1).sqrt()
    if float(thin.median()) < _FLAT:
        yield (
            "the joints of each frame of the truth lie in one plane, as those of a program that "
            "finds them in images; give places in space"
        )


def _halfway(true: Tensor, valid: Tensor) -> Iterator[str]:
    """Knees and elbows that were put in the middle of their neighbours."""
    for first, middle, last in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")):
        for side in "rl":
            rows = [LANDMARKS.index(f"{side}_{name}") for name in (first, middle, last)]
            seen = valid[:, rows].all(-1)
            if int(seen.sum()) < _SPREAD:
                continue
            start, joint, end = true[seen][:, rows].unbind(1)
            off = (joint - 0.5 * (start + end)).norm(dim=-1)
            if float(off.quantile(0.9)) < _MIDDLE:
                yield (
                    f"{side}_{middle} of the truth lies in the middle between {first} and {last}, "
                    "as if it was not measured; give the places that were, or leave it out"
                )


def image_doubts(found: FoundJoints, truth: Truth) -> list[str]:
    """That joints annotated in the images are not those that the cameras of the truth see."""
    sequence = truth.sequence
    if sequence.rig is None or sequence.pixels is None or sequence.joints3d is None:
        return []
    _, rows = match_frames(found.frames, truth, str(found.path))
    span = _span(rows, len(sequence.frames))
    joints = truth.scored(sequence.joints3d[span])
    seen = sequence.rig.cameras.frames(span).project(joints)
    order, names, numbers = LANDMARKS16.mirrored(), sequence.rig.names, sequence.frames[span]
    said = pixel_mismatches(seen, sequence.pixels[span], order, names, numbers.tolist())
    return [f"{sequence.folder}: {what}" for what in said]


def surface_doubts(true: SurfaceTruth, truth: Truth, rows: list[int]) -> list[str]:
    """That the true surface is not one of the true joints.

    Args:
        true: the surface.
        truth: what it belongs to, of which some frames are compared.
        rows: these.
    """
    joints = truth.sequence.joints3d
    if joints is None or not rows or len(joints) != len(true.vertices):
        return []
    span = _span(rows, len(joints))
    span = slice(span.start, min(span.stop, span.start + _MOST))
    found = surface_mismatches(torch.from_numpy(true.vertices[span].astype(float)), joints[span])
    return [f"{truth.sequence.folder}: {what}" for what in found]


def mesh_doubts(
    surface: SurfaceFile, truth: Truth, pairs: Sequence[tuple[int, int]]
) -> Iterator[str]:
    """That true surfaces with vertices of their own are of another unit, or of other frames.

    Args:
        surface: of a result.
        truth: whose surfaces are compared with it.
        pairs: rows of both.
    """
    looked = [pairs[i] for i in np.unique(np.linspace(0, len(pairs) - 1, _LOOKED).astype(int))]
    numbers = truth.sequence.frames.tolist()
    rows = {number: row for row, number in enumerate(numbers)}
    apart: dict[int, list[float]] = {lag: [] for lag in range(-_LATE, _LATE + 1)}
    sizes = []
    for row, other in looked:
        vertices = surface.read(slice(row, row + 1))[0].astype(float)
        for lag, found in apart.items():
            beside = rows.get(numbers[other] + lag)
            if beside is None:
                found.append(np.nan)
                continue
            true, faces = truth.sequence.mesh(beside)
            if lag == 0:
                sizes.append(np.ptp(true[faces], (0, 1)).max() / np.ptp(vertices, 0).max())
            rng = np.random.default_rng(0)
            found.append(
                surface_distance(
                    vertices, surface.faces, true, faces, rng, 9000, 900, translated=True
                )
            )
    where, larger = truth.sequence.folder, float(np.median(sizes))
    if not 1 / _LARGER < larger < _LARGER:
        yield (
            f"{where}: true surfaces are {larger:.2g} times as large as that of the result; check "
            "their unit"
        )
        return
    now = np.array(apart[0])
    gains = {
        lag: float(np.nanmean(np.array(found) - now) / max(np.mean(now), 1e-9))
        for lag, found in apart.items()
        if lag != 0 and 2 * np.isfinite(found).sum() >= len(looked)
    }
    lag = min(gains, key=lambda each: gains[each], default=0)
    if lag and 1 + gains[lag] < _LEFT and -gains[lag] * np.mean(now) > _NEAREST:
        yield (
            f"{where}: with the true surfaces of {in_words(lag)} {1 + gains[lag]:.0%} of their "
            "distance is left; check the numbers of their files"
        )


def _span(rows: list[int], count: int) -> slice:
    return slice(max(min(rows) - _AROUND, 0), min(max(rows) + _AROUND + 1, count))
