"""Whether a network sees the person where the joints are, or where others of theirs are.

What moves in a video shows late joints of a person who goes somewhere, before cameras at rest. A
network that looks at the person shows them in place as well, and whatever the camera does: of the
joints of all frames, those of the image are the nearest to what it sees there; and of both sides,
those of the same one, which nothing else shows of one view without 3D poses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.known_person import JUDGED, NEAR, OPPOSITE, look_at_known
from perfcap.detect.look import CropNetwork
from perfcap.io.clip import FrameReader
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.footage import lively_frames
from perfcap.metrics.alignment import HIPS, NECK

_NETWORK = "lightning"  # the fastest of those shipped
_LOOKS, _MOST, _FEWEST = 48, 16, 6  # in all views; in one, and the fewest that say something
_SHIFTS = 12  # frames, both ways
_CONFIDENT, _JOINTS = 0.3, 8  # of joints that count; how many of them a look needs
# Shares of the person, medians of joints: how near joints of another frame must be, and how much
# nearer than those of the same. No right stretch of 24 frames in one view comes near both at once:
# none of 101 is named, and of those 3 to 10 frames off two thirds (``looked_joints.py``).
_SEEN, _NEARER, _LATE = 0.06, 0.8, 2
# Of the distance, what is left with left and right exchanged: none of these 101 is named, and of
# exchanged ones 72 %.
_OPPOSITE = 0.4
# Of joints that the network is sure of, the share near those given, below which they are others:
# 96 % of those of other recordings are named, and of right ones none but where others pass.
_SURE, _ENOUGH, _ELSEWHERE = 0.4, 20, 0.35
# Shares of the person: medians of how far joints are seen from those given, along each axis, and of
# the deviations from these. Of right joints the first is below, or others stand before the person
# and the second is above.
_ASIDE, _ALIKE = 0.045, 0.06
_ANKLES = [LANDMARKS.index(f"{side}_ankle") for side in "rl"]
_TRUNKS = 3.3  # of which a standing person is as tall

Array = NDArray[np.float64]


def examine_looks(
    clip: FrameReader,
    confidence: Tensor,
    joints2d: Tensor,
    names: Sequence[str] = (),
    network: CropNetwork | None = None,
    alone: bool = True,
    everybody: tuple[Tensor, Tensor] | None = None,
) -> list[Finding]:
    """Whether joints are late or early, of the other side, or not of who is seen at all.

    Networks that look from behind take one side for the other in some frames, not in most.

    Args:
        clip: C views.
        confidence: of the joints, (F, C, 16).
        joints2d: in pixels of the videos, (F, C, 16, 2).
        names: of several views.
        network: that looks; the shipped one if not given.
        alone: whether the person is; of several, a network may see the one in front.
        everybody: joints (P, F, C, 16, 2) and confidence (P, F, C, 16) of all of several people, so
            that whom a network sees may be any of them.
    """
    count = min(len(clip), len(joints2d))
    if count < _FEWEST:
        return []
    index, _ = lively_frames(joints2d[:count], confidence[:count])
    views = range(joints2d.shape[1])
    most = min(_MOST, max(_FEWEST, _LOOKS // len(views)))
    frames = index[:: max(1, len(index) // most)][:most]
    places = _known(joints2d[:count], confidence[:count])
    people = places[None] if everybody is None else _known(*everybody)
    network = network or _shipped()
    if network is None:
        return []
    looks, shown = [], []
    for view, frame in product(views, frames):
        if np.isfinite(places[frame, view]).all(-1).sum() >= _JOINTS:
            image = clip.read_view(view, frame, frame + 1)[0]
            looks.append(_look(network, image, places[:, view], frame, people[:, frame, view]))
            shown.append(view)
    if len(looks) < _FEWEST:
        return []
    seen, of = _Looked.all_of(looks), np.array(shown)
    found = _late(seen.apart) or _exchanged(seen.same, seen.opposite)
    # wrong in every view: they can agree all the same
    found = [replace(each, views=tuple(views)) for each in found]
    if found or not (alone or everybody is not None):
        return found
    each = [seen.part(of == view) for view in views]
    names = names if len(views) > 1 else ()
    shares = [_share(one.nearest, one.sure) for one in each]
    return _elsewhere(shares, names) or _beside([_aside(one) for one in each], names)


@dataclass(frozen=True)
class _Looked:
    """How far what a network sees is from joints, shares of the person; NaN where unknown.

    Attributes:
        apart: of frames ``_SHIFTS`` S before to as many behind, (N, 2 S + 1, J).
        opposite: of the other side's joints of the frame, (N, J).
        nearest: of those of the nearest of all people, (N, J).
        aside: from those of the frame, (N, J, 2).
        sure: how sure the network is, (N, J), 0 to 1.
    """

    apart: Array
    opposite: Array
    nearest: Array
    aside: Array
    sure: Array

    @property
    def same(self) -> Array:
        """Of the joints of the frame, (N, J)."""
        return self.apart[:, _SHIFTS]

    @classmethod
    def all_of(cls, looks: Sequence[_Looked]) -> _Looked:
        """Looks one after another."""
        return cls(*(np.concatenate(each) for each in zip(*map(_parts, looks), strict=True)))

    def part(self, chosen: NDArray[np.bool_]) -> _Looked:
        """Some of the looks, by (N,)."""
        return _Looked(*(each[chosen] for each in _parts(self)))


def _parts(looks: _Looked) -> Iterator[Array]:
    return (getattr(looks, each.name) for each in fields(looks))


@cache
def _shipped() -> CropNetwork | None:
    from perfcap.detect.onnx import OnnxDetector
    from perfcap.io.actor import models_folder

    folder = models_folder() / "detectors" / _NETWORK
    return OnnxDetector(folder) if folder.is_dir() else None


def _known(joints: Tensor, confidence: Tensor) -> Array:
    """Joints (..., 16, 2), NaN where unknown."""
    places: Array = joints.detach().double().cpu().numpy().copy()
    places[confidence.detach().cpu().numpy() <= _CONFIDENT] = np.nan
    return places


def _look(
    network: CropNetwork, image: NDArray[np.uint8], places: Array, frame: int, people: Array
) -> _Looked:
    """What is seen in an image (N = 1), from joints (F, 16, 2) and people (P, 16, 2) of it."""
    found = np.full((2 * _SHIFTS + 1, len(JUDGED)), np.nan)
    known = places[frame]
    looked = look_at_known(network, np.ascontiguousarray(image), known)
    if looked is None:
        nothing = found[:1]
        unknown = np.full((1, len(JUDGED), 2), np.nan)
        return _Looked(found[None], nothing, nothing, unknown, np.zeros_like(nothing))
    size = _size(known)
    first, last = max(0, frame - _SHIFTS), min(len(places), frame + _SHIFTS + 1)
    apart = np.linalg.norm(places[first:last] - looked[0], axis=-1)[:, JUDGED]
    found[first - frame + _SHIFTS : last - frame + _SHIFTS] = apart / size
    opposite = np.linalg.norm(known[OPPOSITE] - looked[0], axis=-1)[JUDGED] / size
    others = np.linalg.norm(people - looked[0], axis=-1)[:, JUDGED] / size
    nearest = np.where(np.isfinite(others), others, np.inf).min(0)
    nearest[np.isinf(nearest)] = np.nan
    aside = (looked[0] - known)[JUDGED] / size
    return _Looked(*(each[None] for each in (found, opposite, nearest, aside, looked[1][JUDGED])))


def _size(known: Array) -> float:
    """Larger extent of joints (16, 2), px; of who is cut off above the feet, what it would be."""
    extent = float((np.nanmax(known, 0) - np.nanmin(known, 0)).max())
    if np.isnan(known[_ANKLES]).any(-1).all():
        trunk = float(np.linalg.norm(known[NECK] - known[list(HIPS)].mean(0)))
        extent = max(extent, _TRUNKS * trunk) if np.isfinite(trunk) else 2 * extent
    return max(extent, 1e-6)


def _late(off: Array) -> list[Finding]:
    """A finding where joints of other frames are clearly nearer, by distances (N, 2 S + 1, J)."""
    known = np.isfinite(off).any(-1).sum(0) * 2 >= len(off)
    if not known[_SHIFTS]:
        return []
    misses = np.full(len(known), np.inf)
    misses[known] = np.nanmedian(off[:, known].transpose(1, 0, 2).reshape(known.sum(), -1), 1)
    best, now = int(misses.argmin()), float(misses[_SHIFTS])
    shift = best - _SHIFTS
    if abs(shift) < _LATE or misses[best] > min(_SEEN, _NEARER * now):
        return []
    way = "late" if shift > 0 else "early"
    what = (
        f"joints look {abs(shift)} or so frames {way} against the video: a network sees the person "
        f"{misses[best]:.1%} of their size from the joints of so many frames away, {now:.1%} from "
        "those of the same frame"
    )
    remedy = "detect in this very video, and count frames from its first"
    return [Finding(Severity.WARNING, "detections", what, remedy)]


def _exchanged(same: Array, opposite: Array) -> list[Finding]:
    """A finding where joints of the other side are far nearer, by distances (N, J)."""
    known = np.isfinite(same) & np.isfinite(opposite)
    if not known.any():
        return []
    now, other = float(np.median(same[known])), float(np.median(opposite[known]))
    if other > min(_SEEN, _OPPOSITE * now):
        return []
    what = (
        f"left and right look exchanged: a network sees the person's joints {other:.1%} of their "
        f"size from those of the other side, {now:.1%} from their own"
    )
    remedy = "exchange them: left is the person's own, also where they face the camera"
    return [Finding(Severity.ERROR, "detections", what, remedy)]


def _share(nearest: Array, sure: Array) -> float:
    """Of joints that the network surely sees in a view, those near the ones given; 1 of too few."""
    known = np.isfinite(nearest) & (sure > _SURE)
    return float((nearest[known] < NEAR).mean()) if known.sum() >= _ENOUGH else 1.0


def _elsewhere(shares: Sequence[float], names: Sequence[str]) -> list[Finding]:
    """A finding where joints are not where the network surely sees them, by view."""
    low = [view for view, share in enumerate(shares) if share < _ELSEWHERE]
    if not low:
        return []
    what = (
        "joints look to be of another video or person, or others stand before them: of those that "
        f"a network surely sees, at most {max(shares[view] for view in low):.0%} lie within a "
        "tenth of the person's size of the ones given"
    )
    remedy = "check that they were detected in this very video, and are in its pixels"
    if names:
        remedy += "; and that joints and videos of the views are in the same order"
    subject = ", ".join(names[view] for view in low) if names else "detections"
    return [Finding(Severity.WARNING, subject, what, remedy)]


def _aside(looks: _Looked) -> Array:
    """Where the network sees joints from those given in a view, (2,); 0 where it sees others."""
    own = looks.same <= looks.nearest
    away = looks.aside[own & (looks.sure > _SURE)]
    if len(away) < _ENOUGH:
        return np.zeros(2)
    middle: Array = np.median(away, 0)
    spread = float(np.median(np.abs(away - middle), 0).max())
    return middle if spread < _ALIKE and np.abs(middle).max() > _ASIDE else np.zeros(2)


def _beside(aside: Sequence[Array], names: Sequence[str]) -> list[Finding]:
    """A finding where joints lie to one side of where the network sees them, by view."""
    off = [view for view, each in enumerate(aside) if each.any()]
    if not off:
        return []
    most = max((aside[view] for view in off), key=lambda each: float(np.abs(each).max()))
    axis = int(np.abs(most).argmax())
    where = (("left", "right"), ("above", "below"))[axis][int(most[axis] < 0)]
    where = where if axis else f"to the {where} of"
    much = f"{abs(most[axis]):.0%} of the person's size"
    what = f"joints look to lie {much} {where} where a network sees them"
    remedy = (
        "give them in the pixels of this very video, not of one that was resized, cropped or padded"
    )
    subject = ", ".join(names[view] for view in off) if names else "detections"
    return [Finding(Severity.WARNING, subject, what, remedy)]
