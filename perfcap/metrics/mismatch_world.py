"""Truths of other worlds, or relative to a place in the body, and what is left without that."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

from torch import Tensor

from perfcap.geometry.alignment import Similarity, procrustes
from perfcap.geometry.rotation import matrix_to_rotvec
from perfcap.metrics.alignment import HIPS, NECK, root_of
from perfcap.metrics.mismatch_frames import Recorded, error

_LEFT = 0.4  # share of the error that a rotation may leave
_TURN = 10.0  # degrees by which one world differs from another
_STILL = 1e-3  # m
_CENTRED = 0.3  # m, from the origin: roots of bodies lie so near to hips or neck
_AWAY, _LITTLE = 2.0, 0.2  # m that no depth of one view is off by; share of the error left by it
# The same of shorter shifts, which no depth of one view leaves: it changes as the person moves
_MOVED, _HARDLY = 0.6, 0.025
_OTHER = 0.25  # m, after one rigid motion: another clip, whose place is most of the error
_ROUNDS, _NEAR = 20, 0.02  # of a fit that joints which are wrong hardly move; m that count as right


@dataclass(frozen=True)
class Compared:
    """A result and its truth.

    Attributes:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
        whole: all that is known of the truth.
    """

    estimate: Tensor
    truth: Tensor
    valid: Tensor
    whole: Recorded


class WorldNote(str):
    """A sentence that explains places by another world; poses may be right or wrong."""

    __slots__ = ()


@dataclass(frozen=True)
class World:
    """Another world of a truth.

    Attributes:
        note: what is said of it.
        without: what is left to compare once it is taken away.
        relative: whether it is a place in the body, and its axes are not known yet.
    """

    note: WorldNote
    without: Callable[[Compared], Compared]
    relative: bool = False


def relative_world(compared: Compared) -> Iterator[World]:
    """A truth that is relative to the hips, or to another place in the body near its origin."""
    estimate, truth, valid = compared.estimate, compared.truth, compared.valid
    if _stays(root_of(truth), valid) and not _stays(root_of(estimate), valid):
        note = WorldNote(
            "the hips of the truth stay in one place, those of the result do not; the truth is "
            "relative to them, so that only aligned errors count"
        )
        yield World(note, partial(_about, joints=list(HIPS)), relative=True)
        return
    for joints in (list(HIPS), [NECK]):
        seen = valid[:, joints].all(-1)
        if int(seen.sum()) < 2:
            continue
        true, own = (points[seen][:, joints].mean(1).norm(dim=-1) for points in (truth, estimate))
        if float(true.max()) < _CENTRED and float(own.median()) > 2 * _CENTRED:
            note = WorldNote(
                "the person of the truth stays at the world's origin, that of the result does not; "
                "the truth is relative to a place in the body, so that only aligned errors count"
            )
            yield World(note, partial(_about, joints=joints), relative=True)
            return


def moved_world(compared: Compared) -> Iterator[World]:
    """A truth that one rotation, or one shift, of all frames brings to the result."""
    estimate, truth, valid = compared.estimate, compared.truth, compared.valid
    now = error(estimate, truth, valid)
    turn, left = turned(estimate, truth, valid)
    if left / now < _LEFT and turn > _TURN and left < _OTHER:
        note = WorldNote(
            f"after one rotation of all frames by {turn:.0f} degrees {left / now:.0%} of the error "
            "is left; give the truth in the world of the cameras"
        )
        yield World(note, _without_motion)
    shift = (truth - estimate)[valid].mean(0)
    shifted = error(estimate + shift, truth, valid)
    far = float(shift.norm())
    if (far > _AWAY and shifted < _LITTLE * now) or (far > _MOVED and shifted < _HARDLY * now):
        note = WorldNote(
            f"after one shift of all frames by {far:.3g} m {shifted / now:.0%} of "
            "the error is left; give the truth in the world of the cameras, with its origin"
        )
        yield World(note, _without_shift)


def turned(estimate: Tensor, truth: Tensor, valid: Tensor) -> tuple[float, float]:
    """One rigid motion of all frames: its angle in degrees, and the error it leaves, metres.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
    """
    source, target = estimate[valid], truth[valid]
    moved = procrustes(source, target, scale=False)
    left = float((moved.apply(source) - target).norm(dim=-1).mean())
    return _angle(moved), left


def _angle(motion: Similarity) -> float:
    """Of its rotation, degrees."""
    return float(matrix_to_rotvec(motion.rotation).norm().rad2deg())


def _stays(points: Tensor, valid: Tensor) -> bool:
    seen = points[valid[:, list(HIPS)].all(-1)]
    return len(seen) > 1 and float((seen - seen[0]).norm(dim=-1).max()) < _STILL


def _about(compared: Compared, joints: list[int]) -> Compared:
    """Both relative to the middle of some joints; frames without them do not count."""
    estimate, truth, whole = (
        each - each[:, joints].mean(1, keepdim=True)
        for each in (compared.estimate, compared.truth, compared.whole.joints)
    )
    valid = compared.valid & compared.valid[:, joints].all(-1, keepdim=True)
    return Compared(estimate, truth, valid, replace(compared.whole, joints=whole))


def _motion(compared: Compared) -> Similarity:
    """The rigid motion of those joints that fit: others would turn all of them.

    Of least distances, not of their squares, found by weights that are renewed.
    """
    source, target = compared.estimate[compared.valid], compared.truth[compared.valid]
    moved = procrustes(source, target, scale=False)
    for _ in range(_ROUNDS):
        weights = 1 / (moved.apply(source) - target).norm(dim=-1).clamp(min=_NEAR)
        moved = procrustes(source, target, weights, scale=False)
    return moved


def _without_motion(compared: Compared) -> Compared:
    return replace(compared, estimate=_motion(compared).apply(compared.estimate))


def _without_shift(compared: Compared) -> Compared:
    apart = (compared.truth - compared.estimate)[compared.valid]
    return replace(compared, estimate=compared.estimate + apart.median(0).values)
