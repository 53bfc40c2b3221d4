"""Tracks that networks found in videos, with the truth: errors as they are, not as formulas say.

Networks err where a pose is hard: both knees under a skirt, sides of a person who turns away, a
hand behind the hip. Errors drawn at random know nothing of the pose; tracks of videos whose
truth is known do (``experiments/filmed_tracks.py`` makes some).
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Generator, Tensor

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.lifting import lifting_features
from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.doctor.depth import examine_depth
from perfcap.io.doctor.doubled import examine_doubled
from perfcap.io.doctor.neighbours import examine_neighbours
from perfcap.io.doctor.order import examine_order, examine_shuffled
from perfcap.io.doctor.pairs import examine_pairs
from perfcap.io.doctor.repeated import examine_held
from perfcap.io.doctor.sides import examine_sides
from perfcap.train.config import LiftingData
from perfcap.train.detector_noise import unseen
from perfcap.train.lifting_data import STANDING, LiftingBatch, LiftingSamples, root_relative
from perfcap.train.loop import mixed_seed
from perfcap.train.track_confidence import require_surer_nearer

_WHAT = "tracks with their truth (joints2d, confidence, truth, intrinsics)"
_SHAPES = {
    "joints2d": (len(LANDMARKS), 2),
    "confidence": (len(LANDMARKS),),
    "truth": (len(LANDMARKS), 3),
}
_SPANS = 0.4, 3.0  # m, from end to end of a person in most frames
_FOLLOWED = 0.1  # of a person's height
_MOST = 0.5  # of the tracks
_NEAR = 0.04  # of a person's height: joints of filmed people are nearer in the median, 0.01 to 0.03
_SEVERAL = 10  # tracks: a joint of few is elsewhere where networks err, as a hidden elbow by 0.17
_CLEARLY = 0.5  # times that, of another joint's truth
_ODD = 0.05  # of the tracks
_OFTEN = 0.1  # of the tracks: networks take one side's joint for the other's throughout in fewer
_MIRRORED = list(LANDMARKS16.mirrored())
_OTHER = 0x7AC5  # of seeds: tracks are chosen independently of motion


@dataclass(frozen=True)
class SeenTracks:
    """People in videos, each for as many frames, at about 30 a second.

    Attributes:
        plane: where their landmarks were seen, x/z and y/z, (N, F, 16, 2).
        confidence: (N, F, 16), 0 where unseen.
        joints: where they are, in the axes of the camera, (N, F, 16, 3), metres.
        digest: SHA-256 of the three, in hexadecimal.
    """

    plane: Tensor
    confidence: Tensor
    joints: Tensor
    digest: str

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read an archive of ``joints2d`` (N, F, 16, 2) px, ``confidence`` (N, F, 16), ``truth``
        (N, F, 16, 3) m in the axes of the camera, and ``intrinsics`` (N, 3, 3) of pictures without
        distortion.

        Raises:
            InputError: it lacks an array, or one has another shape or holds what it cannot.
        """
        arrays = read_archive(path, (*_SHAPES, "intrinsics"), _WHAT)
        _require(path, arrays)
        joints2d, confidence, truth, lens = (
            arrays[name].astype(np.float64) for name in (*_SHAPES, "intrinsics")
        )
        seen = (confidence > 0) & np.isfinite(joints2d).all(-1)
        pixels = np.where(seen[..., None], joints2d, 0.0)
        ray = np.concatenate((pixels, np.ones_like(pixels[..., :1])), -1)
        plane = (ray @ np.linalg.inv(lens)[:, None].swapaxes(-1, -2))[..., :2]
        kept = [a.astype(np.float32) for a in (plane, np.where(seen, confidence, 0.0), truth)]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in kept))
        places, sure, joints = (torch.from_numpy(array) for array in kept)
        return cls(places, sure, joints, digest.hexdigest())

    def require_followed(self, path: Path) -> None:
        """Refuse tracks that are not of their truth, which a lifter would learn all the same.

        Args:
            path: that they were read from, for the message.

        Raises:
            InputError: most bodies are of no person's size in metres, a track or a joint is in the
                median a tenth of a person's height from the truth before its camera, most have left
                and right exchanged, two joints are each nearer to the other's truth, or confidences
                are next to nothing or the higher, the farther joints are from the truth.
        """
        span = float((self.joints.amax(-2) - self.joints.amin(-2)).norm(dim=-1).median())
        if not _SPANS[0] < span < _SPANS[1]:
            raise InputError(f"{path}: truth spans {span:.3g} a person; expected metres")
        straight, other = self._misses(list(range(len(LANDMARKS)))), self._misses(_MIRRORED)
        exchanged = float(((other < straight) & (other < _FOLLOWED)).double().mean())
        if exchanged > _MOST:
            raise InputError(
                f"{path}: in {exchanged:.0%} of the tracks joints2d are nearer to the truth with "
                "left and right exchanged; both are the person's own"
            )
        lost = (~(straight < _FOLLOWED)).nonzero().flatten().tolist()
        if lost:
            miss = f"{float(straight[lost[0]]):.0%} of a person's height"
            raise InputError(
                f"{path}: joints2d of {len(lost)} of {len(straight)} tracks are elsewhere, of "
                f"track {lost[0]} {miss} from the truth before the camera; expected less than "
                f"{_FOLLOWED:.0%}: truth in the axes of the camera, y down, of the same frames, "
                "and intrinsics of the same pictures; leave tracks of somebody else out"
            )
        self._require_joints(path)
        require_surer_nearer(path, self.confidence, self._apart())

    def _require_joints(self, path: Path) -> None:
        """Refuse single joints that are elsewhere: medians over all hardly know of them."""
        if len(self.plane) < _SEVERAL:
            return
        apart = self._joint_misses(self.plane, self.confidence, self.joints)
        own = apart.diagonal()
        if pairs := _crossed(apart):
            raise InputError(
                f"{path}: {', '.join(pairs)} of joints2d are each nearer to the other's truth; "
                f"exchange them: expected landmarks in the order {', '.join(LANDMARKS)}"
            )
        each = zip(self.plane, self.confidence, self.joints, strict=True)
        crossed = Counter(pair for one in each for pair in _crossed(self._joint_misses(*one)))
        often = {k: n for k, n in crossed.items() if n > _OFTEN * len(self.plane)}
        if often:
            some = ", ".join(f"{pair} in {count}" for pair, count in often.items())
            raise InputError(
                f"{path}: joints2d are each nearer to the other's truth, {some} of "
                f"{len(self.plane)} tracks; exchange them there: expected landmarks in one order, "
                f"{', '.join(LANDMARKS)}"
            )
        lost = (own > _FOLLOWED).nonzero().flatten().tolist()
        if lost:
            some = ", ".join(f"{LANDMARKS[k]} ({float(own[k]):.0%})" for k in lost)
            raise InputError(
                f"{path}: joints2d of {some} are farther from the truth before the camera than "
                f"{_FOLLOWED:.0%} of a person's height in most frames; expected confidence 0 where "
                f"a joint is not seen, and landmarks in the order {', '.join(LANDMARKS)}"
            )

    def require_people(self, path: Path) -> None:
        """Refuse truth whose depth is wrong, of which its places in pictures know nothing, and
        frames that do not follow one another.

        Args:
            path: that they were read from, for the message.

        Raises:
            InputError: of a twentieth of the tracks, feet point backwards in the truth, joints of
                it are in each other's place, it has no depth or one in another unit, or the joints
                move as in no order, repeat those of the frame before, or are copies of others.
        """
        wrong = [
            (track, finding.what)
            for track, (places, sure, joints) in enumerate(
                zip(self.plane, self.confidence, self.joints, strict=True)
            )
            for finding in (
                examine_sides("", joints)
                or examine_pairs("", joints)
                or examine_neighbours("", joints)
                or examine_depth("", joints)
                or examine_order("", places, sure)
                or examine_shuffled("", places, sure)
                or examine_held("", joints, torch.ones_like(sure), "true joints")
                or examine_doubled("", joints, torch.ones_like(sure).bool(), true=True)
                or examine_doubled("", places, sure > 0)
                or examine_held("", places, sure)
            )
        ]
        if len(wrong) > _ODD * len(self.joints):
            track, what = wrong[0]
            raise InputError(
                f"{path}: {len(wrong)} of {len(self.joints)} tracks are no motion of a person, of "
                f"track {track} {what}; expected truth in metres in the axes of the camera, z "
                "forward, and frames that follow each other"
            )

    @staticmethod
    def _joint_misses(plane: Tensor, confidence: Tensor, joints: Tensor) -> Tensor:
        """Median distance of each landmark from each true one, in heights, (16, 16); NaN of those
        that are nowhere seen.

        Args:
            plane: of some frames, (*b, 16, 2).
            confidence: (*b, 16).
            joints: (*b, 16, 3), metres.
        """
        true = joints[..., :2] / joints[..., 2:]
        height = STANDING / joints[..., 2].mean(-1)
        rows = []
        for joint in range(len(LANDMARKS)):
            seen = confidence[..., joint] > 0
            if not seen.any():
                rows.append(torch.full_like(true[..., 0].flatten(0, -2)[0], torch.nan))
                continue
            apart = (plane[seen][:, joint, None] - true[seen]).norm(dim=-1)
            rows.append((apart / height[seen][:, None]).median(0).values)
        return torch.stack(rows)

    def _misses(self, order: list[int]) -> Tensor:
        """Median distance of each track from true landmarks in an order, in heights, (N,)."""
        apart = torch.where(self.confidence > 0, self._apart(order), torch.nan)
        return apart.flatten(1).nanmedian(1).values

    def _apart(self, order: Sequence[int] = range(len(LANDMARKS))) -> Tensor:
        """Distances of landmarks from true ones in an order, in heights, (N, F, 16)."""
        true = (self.joints[..., :2] / self.joints[..., 2:])[:, :, list(order)]
        height = STANDING / self.joints[..., 2].mean(-1, keepdim=True)
        apart: Tensor = (self.plane - true).norm(dim=-1) / height
        return apart

    def to(self, device: torch.device) -> SeenTracks:
        """The same on a device."""
        kept = (self.plane, self.confidence, self.joints)
        plane, confidence, joints = (values.to(device) for values in kept)
        return SeenTracks(plane, confidence, joints, self.digest)

    def sample(
        self, count: int, frames: int, data: LiftingData, generator: Generator
    ) -> LiftingBatch:
        """Stretches of ``count`` tracks, half of them mirrored, in cameras turned a little.

        Landmarks, limbs and frames go missing as the settings of the noise say.
        """
        total = self.plane.shape[1]
        frames = min(frames, total)
        which = torch.randint(len(self.plane), (count,), generator=generator)
        first = torch.randint(total - frames + 1, (count,), generator=generator)
        rows = first[:, None] + torch.arange(frames)
        plane, confidence, joints = (
            values[which[:, None], rows] for values in (self.plane, self.confidence, self.joints)
        )
        flip = torch.rand(count, generator=generator) < 0.5
        turn = _rolls(flip, data.roll, generator)
        chosen = flip[:, None, None]
        plane = torch.where(chosen[..., None], plane[:, :, _MIRRORED], plane)
        confidence = torch.where(chosen, confidence[:, :, _MIRRORED], confidence)
        joints = torch.where(chosen[..., None], joints[:, :, _MIRRORED], joints)
        plane = plane @ turn[:, None, :2, :2].mT
        joints = joints @ turn[:, None].mT
        gone = unseen(plane, data.noise, generator)
        features, axes = lifting_features(plane, torch.where(gone, 0.0, confidence))
        return LiftingBatch(features, root_relative(joints) @ axes)


class MixedSamples:
    """Batches of recorded motion under simulated detectors, and of tracks that networks found.

    Args:
        simulated: without end.
        tracks: of videos.
        data: its ``seen`` is the share of the tracks of videos.
        seed: of everything random.
    """

    def __init__(
        self, simulated: LiftingSamples, tracks: SeenTracks, data: LiftingData, seed: int
    ) -> None:
        self._simulated, self._data, self._seed = simulated, data, seed
        self._tracks = tracks.to(simulated.device)

    def batch(self, number: int, size: int, frames: int | None = None) -> LiftingBatch:
        """As ``LiftingSamples.batch``: the same number gives the same batch."""
        device = self._simulated.device
        generator = Generator(device).manual_seed(mixed_seed(self._seed ^ _OTHER, number))
        frames = frames or self._data.frames
        count = round(self._data.seen * size)
        with device:
            seen = self._tracks.sample(count, frames, self._data, generator)
        if count == size:
            return seen
        rest = self._simulated.batch(number, size - count, seen.features.shape[1])
        return LiftingBatch(
            torch.cat((seen.features, rest.features)), torch.cat((seen.joints, rest.joints))
        )


def _crossed(apart: Tensor) -> list[str]:
    """Pairs of landmarks that are each clearly nearer to the other's truth.

    Args:
        apart: median distance of each landmark from each true one, in heights, (16, 16).
    """
    own, (miss, nearest) = apart.diagonal(), apart.nan_to_num(torch.inf).min(1)
    clear = (miss < _CLEARLY * own) & (own > _NEAR)
    return [
        f"{LANDMARKS[one]} and {LANDMARKS[other]}"
        for one, other in enumerate(nearest.tolist())
        if one < other and clear[one] and clear[other] and nearest[other] == one
    ]


def _rolls(flip: Tensor, deviation: float, generator: Generator) -> Tensor:
    """Turns (N, 3, 3) of pictures about their middle, after some were mirrored."""
    angle = torch.deg2rad(deviation * torch.randn(len(flip), generator=generator))
    side = 1.0 - 2.0 * flip.float()
    zero, one = torch.zeros_like(angle), torch.ones_like(angle)
    cosine, sine = angle.cos(), angle.sin()
    rows = (side * cosine, -sine, zero, side * sine, cosine, zero, zero, zero, one)
    return torch.stack(rows, -1).reshape(-1, 3, 3)


def _require(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    missing = [name for name in (*_SHAPES, "intrinsics") if name not in arrays]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; expected {_WHAT}")
    lead = arrays["confidence"].shape[:2]
    expected = {name: (*lead, *shape) for name, shape in _SHAPES.items()}
    expected["intrinsics"] = (*lead[:1], 3, 3)
    for name, shape in expected.items():
        array = arrays[name]
        if array.shape != shape or len(lead) != 2 or 0 in shape or array.dtype.kind != "f":
            raise InputError(
                f"{path}: {name} is {array.dtype} {array.shape}; expected floating point "
                f"{shape}: N tracks of F frames"
            )
    if not (np.isfinite(arrays["truth"]).all() and (arrays["truth"][..., 2] > 0).all()):
        raise InputError(f"{path}: truth is not finite before the cameras; leave such tracks out")
    confidence, lens = arrays["confidence"], arrays["intrinsics"]
    if not (np.isfinite(confidence).all() and (confidence >= 0).all() and (confidence <= 1).all()):
        raise InputError(f"{path}: confidence is not 0 to 1 everywhere; expected shares")
    if not (np.isfinite(lens).all() and (abs(np.linalg.det(lens)) > 0).all()):
        raise InputError(f"{path}: intrinsics cannot be inverted; expected those of cameras")
