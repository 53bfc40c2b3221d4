"""Detections of several people without names, put together over views and time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn.functional import one_hot

from perfcap.detect.association.frame_doubts import frame_doubts
from perfcap.detect.association.grouping import Groups, group_views
from perfcap.detect.association.leap_doubts import leap_doubts
from perfcap.detect.association.settle import Settled, own_limbs, settle
from perfcap.detect.association.sightings import AssociationConfig, Sightings
from perfcap.detect.association.tracks import Track, link, places, rejoin
from perfcap.detect.association.view_doubts import view_doubts
from perfcap.detect.detections import Detections
from perfcap.detect.joint_checks import require_joints
from perfcap.detect.view_words import view_words
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.camera_checks import require_usable
from perfcap.rates import Timed, frame_rate, rate_doubts
from perfcap.setting_checks import require_count

_LEAST_FRAMES = 3
_OFTEN = 0.1  # of the frames: a stranger who is told of


@dataclass(frozen=True)
class Association:
    """Who is who.

    Attributes:
        people: of K people, the best seen one first, (F, C, 16) each.
        slots: of the candidates that are theirs, -1 where a view does not show them, (K, F, C).
        joint_slots: the same of each joint, (K, F, C, 16): limbs may be listed as somebody else's.
        points: joints where two views see them, (K, F, 16, 3) m, else NaN.
        margin: how much farther from a person the next candidate of a view is than their own, m,
            (K, F, C); infinite where there is no other.
        notes: what a user should know.
    """

    people: tuple[Detections, ...]
    slots: Tensor
    joint_slots: Tensor
    points: Tensor
    margin: Tensor
    notes: tuple[str, ...]


def associate(
    cameras: Camera,
    candidates: Detections,
    rate: float | Timed = 30.0,
    *,
    people: int | None = None,
    config: AssociationConfig | None = None,
    names: Sequence[str] | None = None,
) -> Association:
    """Find the people whom two or more calibrated views show, and what was detected of each.

    Slots of candidates mean nothing: a detector may list people in any order in every frame and
    view, miss them, list them twice, or list somebody whom one view alone shows. Rays of joints
    tell (grouping), then where people were before and after (tracks, settle), then bone lengths,
    for those who were away.

    Args:
        cameras: C views, (C,) or (F, C), in pixels of the candidates.
        candidates: (P, F, C, 16), see ``read_candidates``.
        rate: frames a second, or the clip that has them.
        people: how many are wanted, the best seen ones; as many as there are when not given.
        config: sizes.
        names: of the views, for notes; they are counted from 0 without.

    Raises:
        InputError: one view alone; fewer people than are wanted, a number or rate that is none, or
            arguments of another kind; cameras that are none, or joints that are no pixels.
    """
    rate = frame_rate(rate)
    if people is not None:
        require_count(people, "people")
    if config is not None and not isinstance(config, AssociationConfig):
        raise InputError(f"config is {config!r:.80}, expected an AssociationConfig")
    _require_views(cameras, candidates)
    if candidates.views < 2:
        raise InputError(
            "people: one view cannot tell who is who; expected two or more calibrated views, or "
            "one person"
        )
    if names is not None and len(names) != cameras.views:
        raise InputError(f"names are {len(names)}, expected one for each of {cameras.views} views")
    config = config or AssociationConfig()
    candidates = candidates.detach()
    plain = candidates.to(torch.zeros((), dtype=torch.float64))
    sightings = Sightings.of(cameras.detach(), plain, config)
    groups = group_views(sightings)
    tracks, joins = rejoin(link(groups, rate, config), groups, rate, config)
    wrong = (*view_doubts(sightings.cameras, plain, config, names), *frame_doubts(plain))
    chosen = _choose(tracks, candidates.frame_count, rate, people, config, wrong)
    first = torch.stack([places(track, groups, candidates.frame_count) for track in chosen])
    settled = settle(sightings, first, rate)
    order = (settled.slots >= 0).sum((1, 2)).argsort(descending=True, stable=True)
    settled = Settled(
        settled.slots[order], settled.points[order], settled.misfit[order], settled.margin[order]
    )
    kept = [chosen[k] for k in order.tolist()]
    joints = own_limbs(sightings, settled, rate)
    about = (*_left_out(tracks, chosen), *_strangers(sightings, settled, groups, names))
    about = (*leap_doubts(settled.points, rate), *about)
    notes = (*rate_doubts(rate), *wrong, *_away(kept, joins), *about)
    return Association(
        tuple(_of(candidates, *each) for each in zip(settled.slots, joints, strict=True)),
        settled.slots,
        joints,
        settled.points,
        settled.margin,
        notes,
    )


def _require_views(cameras: Camera, candidates: Detections) -> None:
    if not isinstance(cameras, Camera) or not isinstance(candidates, Detections):
        kinds = f"{type(cameras).__name__} and {type(candidates).__name__}"
        raise InputError(
            f"cameras and candidates are {kinds}; expected a Camera (the cameras of a CameraRig) "
            "and the Detections of read_candidates"
        )
    shape = tuple(candidates.joints2d.shape)
    if len(shape) != 5 or shape[2] != cameras.views:
        raise InputError(
            f"candidates have joints2d {shape} for cameras of {cameras.views} views; expected "
            "(P, F, C, 16, 2) of as many views: people, who may be in any order, first"
        )
    if cameras.moving and len(cameras.intrinsics) != shape[1]:
        raise InputError(
            f"moving cameras have {len(cameras.intrinsics)} frames, candidates {shape[1]}; give as "
            "many poses as frames"
        )
    require_usable("cameras", cameras, shape[1])
    require_joints(candidates)


def _choose(
    tracks: list[Track],
    frames: int,
    rate: float,
    people: int | None,
    config: AssociationConfig,
    doubts: tuple[str, ...],
) -> list[Track]:
    """The longest tracks, those that are long enough where nobody says how many."""
    also = "".join(f"; {line}" for line in doubts)
    if frames < _LEAST_FRAMES:
        raise InputError(
            f"people: the clip has {frames} frames; expected {_LEAST_FRAMES} or more, in which "
            "people are followed"
        )
    longest = sorted(tracks, key=lambda track: -len(track.rows))
    if people is None:
        enough = max(_LEAST_FRAMES, min(config.shortest * rate, frames / 2))
        chosen = [track for track in longest if len(track.rows) >= enough]
        if not chosen:
            raise InputError(
                "people: nobody is seen by two views at once for long enough; expected "
                f"synchronous, calibrated views of the same people{also}"
            )
        return chosen
    if len(longest) < people:
        raise InputError(
            f"people: {people} are wanted, {len(longest)} are seen by two views at once; ask for "
            f"that many, or check cameras and detections{also}"
        )
    return longest[:people]


def _of(candidates: Detections, slots: Tensor, joint_slots: Tensor) -> Detections:
    """The candidates of one person, (F, C, 16), from slots (F, C) and of joints (F, C, 16).

    A 3D pose of which limbs are somebody else's is not trusted.
    """
    device = candidates.joints2d.device
    own, each = slots.to(device), joint_slots.to(device)

    def pick(values: Tensor) -> Tensor:
        index = own if values.dim() == own.dim() + 1 else each
        spread = index.clamp(min=0).reshape(
            1, *index.shape, *[1] * (values.dim() - 1 - index.dim())
        )
        chosen = values.gather(0, spread.expand(1, *values.shape[1:]))[0]
        kept = (index >= 0).reshape(*index.shape, *[1] * (chosen.dim() - index.dim()))
        return torch.where(kept, chosen, torch.zeros_like(chosen))

    found = candidates.map(pick)
    whole = (each == own[..., None]).all(-1)
    return replace(found, trusted3d=found.trusted3d & whole)


def _away(chosen: list[Track], joins: list[tuple[int, int, float]]) -> Iterator[str]:
    """Who was away and is known again by their bones."""
    for end, start, off in joins:
        for number, track in enumerate(chosen, 1):
            if end in track.rows and start in track.rows:
                yield (
                    f"person {number} is unseen between frames {end} and {start}, counted from 0, "
                    f"and known again by bone lengths, which differ by {100 * off:.1f} %"
                )
                break


def _left_out(tracks: list[Track], chosen: list[Track]) -> Iterator[str]:
    others = [track for track in tracks if track not in chosen]
    if others:
        frames = ", ".join(str(len(track.rows)) for track in others[:5])
        yield f"further people: {len(others)}, seen in {frames} frames; left out"


def _strangers(
    sightings: Sightings, settled: Settled, groups: Groups, names: Sequence[str] | None
) -> Iterator[str]:
    """Detections that nobody has, not even somebody who is left out."""
    slots = sightings.there.shape[-1]
    owned = one_hot(settled.slots + 1, slots + 1)[..., 1:].bool().any(0)
    rows, views = (groups.members >= 0).nonzero()
    owned[groups.frames[rows], views, groups.members[rows, views]] = True
    alone = (sightings.there & ~owned).any(-1).sum(0)
    for view, frames in enumerate(alone.tolist()):
        if frames > _OFTEN * len(sightings.there):
            span = "1 frame" if frames == 1 else f"{frames} frames"
            yield (
                f"{view_words([view], names)} lists somebody in {span} whom no other view "
                "confirms; left out"
            )
