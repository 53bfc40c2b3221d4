"""Tracks and poses without end: recorded motion seen by random cameras and fallible detectors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Generator, Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.lifting import lifting_features
from perfcap.detect.retarget import bone_vectors, laid_out, mid_hip
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.train.config import DetectorNoise, LiftingData
from perfcap.train.detector_noise import corrupt
from perfcap.train.loop import mixed_seed
from perfcap.train.motion_library import RATE, MotionLibrary

# --------------------------------------------------------------------------------------------------
# Recorded motion as other people might have moved: limbs of one clip on another, held otherwise.
#
# A few people do few things in a few ways; a network learns them by heart. Arms or a whole upper
# body from another clip, and limbs turned a little in the axes of the pelvis, make motion that
# nobody recorded, though no frame is much less natural than before.

PELVIS, SPINE = JOINTS.index("pelvis"), JOINTS.index("spine")
_TRUNK = {"head", "neck"}
_ARMS = {"shoulder", "elbow", "wrist"}


def _bones(parts: set[str], sides: str = "lr") -> list[int]:
    """Bones that end at these parts, by their landmark."""
    return [
        i
        for i, name in enumerate(LANDMARKS)
        if name.split("_")[0] in parts or (name[0] in sides and name[2:] in parts)
    ]


_ARM_BONES, _UPPER_BONES = _bones(_ARMS), _bones(_ARMS | _TRUNK)
_CHAINS = [  # bones that are turned together
    (side, chain)
    for side in "lr"
    for chain in ({"elbow", "wrist"}, {"wrist"}, {"knee", "ankle", "toe"}, {"ankle", "toe"})
]


@dataclass(frozen=True)
class Track:
    """Stretches of motion.

    Attributes:
        bones: vectors to landmarks from their parents, (N, F, 16, 3).
        pelvis: how it is turned in the world, (N, F, 3, 3).
        spine: likewise.
    """

    bones: Tensor
    pelvis: Tensor
    spine: Tensor


def restyled(track: Track, other: Track, data: LiftingData, generator: Generator) -> Tensor:
    """Bones (N, F, 16, 3) of tracks, some with limbs of others, all held a little otherwise.

    Args:
        track: who moves.
        other: whose limbs they may have.
        data: how often, and how much.
        generator: of everything random.
    """
    bones = _recombined(track, other, data.recombined, generator)
    return _loosened(bones, track.pelvis, data, generator)


def _recombined(track: Track, other: Track, share: float, generator: Generator) -> Tensor:
    """Bones with the arms of others, in the axes of the spine, or all above the pelvis, in its."""
    kind = torch.rand(len(track.bones), generator=generator)[:, None, None, None] / max(share, 1e-9)
    bones = track.bones
    for low, rows, own, theirs in (
        (0.0, _ARM_BONES, track.spine, other.spine),
        (0.5, _UPPER_BONES, track.pelvis, other.pelvis),
    ):
        moved = other.bones @ (own @ theirs.mT).mT
        chosen = torch.zeros(len(LANDMARKS), 1, dtype=torch.bool)
        chosen[rows] = True
        bones = torch.where(chosen & (kind >= low) & (kind < low + 0.5), moved, bones)
    return bones


def _loosened(bones: Tensor, pelvis: Tensor, data: LiftingData, generator: Generator) -> Tensor:
    """Bones with limbs turned in the axes of the pelvis, by as much all the while."""
    bones = bones.clone()
    for side, parts in _CHAINS:
        swing = data.swung if "wrist" in parts else 1.0
        vector = torch.randn(len(bones), 3, generator=generator)
        turn = rotvec_to_matrix(vector * torch.tensor(data.loosened * swing).deg2rad())
        local = pelvis @ turn[:, None] @ pelvis.mT
        rows = _bones(parts, side)
        bones[:, :, rows] = bones[:, :, rows] @ local.mT
    return bones


# --------------------------------------------------------------------------------------------------
# Tracks and poses without end: recorded motion seen by random cameras and fallible detectors.

_MIRRORED = list(LANDMARKS16.mirrored())
STANDING = 1.65  # m, height whose image is 100 units of noise
_NEAREST = 1.0  # m from the camera
_POSES = 40  # of a clip, from which its bone lengths are taken


@dataclass(frozen=True)
class LiftingBatch:
    """Tracks and their truth.

    Attributes:
        features: (N, F, 49).
        joints: root-relative, in the axes of the answer, (N, F, 16, 3), metres.
    """

    features: Tensor
    joints: Tensor

    def to(self, device: torch.device) -> LiftingBatch:
        """The same on a device."""
        return LiftingBatch(self.features.to(device), self.joints.to(device))


class LiftingSamples:
    """Batches by number: the same number gives the same batch, on any machine and after any pause.

    Args:
        library: recorded motion.
        data: what to make of it.
        seed: of everything random.
        device: where to make them; another kind of device makes others.
    """

    def __init__(
        self,
        library: MotionLibrary,
        data: LiftingData,
        seed: int,
        device: torch.device | None = None,
    ) -> None:
        clips = [r.landmarks for r in library.recordings if len(r.landmarks) > 1]
        if not clips:
            raise InputError("motion library: has no clip of two frames; expected recorded motion")
        self._data, self._seed = data, seed
        self.device = device or torch.device("cpu")
        self._points = torch.cat(clips).to(self.device)
        moving = (r.turns for r in library.recordings if len(r.landmarks) > 1)
        turns = torch.cat([turns[:, [PELVIS, SPINE]] for turns in moving])
        self._turns = turns.to(self.device)
        self._length = torch.tensor([len(clip) for clip in clips], device=self.device)
        self._first = self._length.cumsum(0) - self._length
        self._bones = torch.stack([_bone_lengths(clip) for clip in clips]).to(self.device)
        # long clips are seen more often, but not in proportion: they repeat themselves
        self._share = self._length.sqrt()

    def batch(self, number: int, size: int, frames: int | None = None) -> LiftingBatch:
        """A batch of ``size`` tracks, of ``frames`` or as many as the settings say."""
        generator = Generator(self.device).manual_seed(mixed_seed(self._seed, number))
        with self.device:  # all that is made on the way
            world = self._tracks(size, frames or self._data.frames, generator)
            camera = look_at(world, self._data, generator)
            return observe(camera, self._data.noise, generator)

    def _tracks(self, size: int, frames: int, generator: Generator) -> Tensor:
        """Stretches of clips on other people's bones, half of them mirrored, (N, F, 16, 3)."""
        track, middle, clip = self._stretches(size, frames, generator)
        bones = track.bones
        if self._data.recombined or self._data.loosened:
            other, _, _ = self._stretches(size, frames, generator)
            bones = restyled(track, other, self._data, generator)
        lengths = self._bones[clip] * _other_people(size, self._data, generator)
        posed = laid_out(bones, lengths[:, None]) + middle[:, :, None]
        mirrored = posed[:, :, _MIRRORED] * torch.tensor([-1.0, 1.0, 1.0])
        flipped = torch.rand(size, 1, 1, 1, generator=generator) < 0.5
        return torch.where(flipped, mirrored, posed)

    def _stretches(
        self, size: int, frames: int, generator: Generator
    ) -> tuple[Track, Tensor, Tensor]:
        """Stretches of clips, the middles of their hips (N, F, 3), and their clips (N,)."""
        clip = torch.multinomial(self._share, size, replacement=True, generator=generator)
        uniform = torch.rand(size, 2, generator=generator)
        low, high = self._data.rate
        step = RATE / (low + (high - low) * uniform[:, 0])
        last = self._length[clip] - 1
        room = (last - step * (frames - 1)).clamp(min=0)
        place = (room * uniform[:, 1])[:, None] + step[:, None] * torch.arange(frames)
        place = place.minimum(last[:, None])
        before = place.floor().long()
        after = (before + 1).minimum(last[:, None])
        share = (place - before)[..., None, None]
        first = self._first[clip][:, None]

        def between(values: Tensor) -> Tensor:
            shown = share.reshape(*share.shape[:2], *(1,) * (values.dim() - 1))
            return torch.lerp(values[first + before], values[first + after], shown)

        points = between(self._points)
        # turns between frames are not quite rotations; bones are given their lengths afterwards
        pelvis, spine = between(self._turns).unbind(2)
        return Track(bone_vectors(points), pelvis, spine), mid_hip(points), clip


def look_at(world: Tensor, data: LiftingData, generator: Generator) -> Tensor:
    """Tracks (N, F, 16, 3) in the axes of a random camera that sees each of them whole."""
    count = len(world)
    middle = mid_hip(world).mean(1)
    reach = (world - middle[:, None, None]).norm(dim=-1).amax((1, 2))
    uniform = torch.rand(count, 2, generator=generator)
    normal = torch.randn(count, 2, generator=generator)
    near, far = (math.log(v) for v in data.distance)
    distance = torch.exp(near + (far - near) * uniform[:, 0]).maximum(reach + _NEAREST)
    yaw = 2 * math.pi * uniform[:, 1]
    mean, deviation = data.elevation
    pitch = torch.deg2rad((mean + deviation * normal[:, 0]).clamp(-30, 70))
    roll = torch.deg2rad(data.roll * normal[:, 1])
    turn = _camera_rotation(yaw, pitch, roll)
    local = (world - middle[:, None, None]) @ turn[:, None].mT
    offset = torch.stack((0 * distance, 0 * distance, distance), -1)
    return local + offset[:, None, None]


def observe(camera: Tensor, noise: DetectorNoise, generator: Generator) -> LiftingBatch:
    """What a detector and its user make of tracks (N, F, 16, 3) in camera axes."""
    plane = camera[..., :2] / camera[..., 2:]
    root = mid_hip(camera)
    unit = 0.01 * STANDING / root[..., 2]
    found, confidence = corrupt(plane, unit, noise, generator)
    features, turn = lifting_features(found, confidence)
    return LiftingBatch(features, root_relative(camera) @ turn)


def root_relative(joints: Tensor) -> Tensor:
    """Joints (..., 16, 3) about the middle of the hips."""
    return joints - mid_hip(joints).unsqueeze(-2)


def _camera_rotation(yaw: Tensor, pitch: Tensor, roll: Tensor) -> Tensor:
    """World (y up) to camera (y down), (N, 3, 3); a camera of positive pitch looks down."""
    zero, one = torch.zeros_like(yaw), torch.ones_like(yaw)

    def matrix(*rows: Tensor) -> Tensor:
        return torch.stack(rows, -1).reshape(-1, 3, 3)

    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (torch.cos, torch.sin))
    turn = matrix(cy, zero, sy, zero, one, zero, -sy, zero, cy)
    tilt = matrix(one, zero, zero, zero, -cp, -sp, zero, sp, -cp)
    spin = matrix(cr, -sr, zero, sr, cr, zero, zero, zero, one)
    return spin @ tilt @ turn


def _bone_lengths(landmarks: Tensor) -> Tensor:
    """Mean bone lengths of a clip (F, 16, 3), (16,), metres."""
    step = max(1, len(landmarks) // _POSES)
    lengths: Tensor = bone_vectors(landmarks[::step]).norm(dim=-1).mean(0)
    return lengths


def _other_people(count: int, data: LiftingData, generator: Generator) -> Tensor:
    """Factors of bone lengths, (N, 16)."""
    own = torch.randn(count, len(_MIRRORED), generator=generator)
    own = (own + own[:, _MIRRORED]) / 2**0.5  # both sides alike
    size = torch.randn(count, 1, generator=generator)
    return torch.exp(data.bone * own + data.size * size)
