"""One person through the frames of a view: found once, then followed from crop to crop."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import torch
from torch import Tensor

from perfcap.detect.candidates import join_candidates
from perfcap.detect.crop import Crop, Frame, next_crop
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16, JointSet, map_to_landmarks
from perfcap.detect.look import SEEN, Box, CropNetwork, Look, is_person, look_at, sureness, turned
from perfcap.detect.pose_fusion import Landmarks, exchanged, fuse, sides_differ
from perfcap.detect.search import SAME, centre, overlap, search, turn_around, whole
from perfcap.detect.sides import Track, settle_sides
from perfcap.detect.viewing_ray import toward
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera

_LOG = logging.getLogger(__name__)
_SHRUNK = 0.6  # of the size in the frame before: what is less may be something else
_JUMPED = 0.5  # of that size, for the middle
_NEARBY = 1.0  # of that size: whoever is lost for a few frames comes back within it
_UNSURE = 0.4  # mean confidence below which somebody may have turned upside down
_AGE = 8  # frames after which somebody who was lost may be anywhere and of any size
_OTHER = (
    "frame %d: the person was not seen for %d frames, and who is followed from here on is %.1f "
    "body sizes away: somebody else? (--frames ends before; --box and --person say whom to follow)"
)


@dataclass(frozen=True)
class Start:
    """Whom to follow.

    Attributes:
        box: (left, top, right, bottom) of the person in the first frame; None to search.
        person: where nobody says a box: 1 for the surest person of the image, 2 for the next, ...
        alone: whether to warn of others in that image.
    """

    box: Box | None = None
    person: int = 1
    alone: bool = False


@dataclass(frozen=True)
class _Seen:
    """What all networks see of the person in one frame; the first one followed."""

    look: Look
    others: tuple[Look | None, ...]


def follow_person(
    network: CropNetwork,
    frames: Iterable[Frame],
    start: Start,
    camera: Camera | None = None,
    others: Sequence[CropNetwork] = (),
    poses: bool = False,
) -> Detections:
    """Joints of one person in every frame of a view, (F, 1).

    The crop of a frame is centred on the joints of the frame before. Where nobody is followed, and
    where somebody shrinks or jumps from one frame to the next, windows of several sizes are
    searched all over the image. Left and right are settled at the end, by motion; see
    ``settle_sides``. Other networks look at the person whom the first one follows, and add what
    they see better; see ``fuse``.

    Args:
        network: the detector.
        frames: (H, W, 3), RGB, in order.
        start: whom to follow.
        camera: the view, in pixels of the frames; turns 3D joints from the axes of each crop
            into the camera's where the manifest says they are (Mehta et al. 2017).
        others: further detectors of 2D joints.
        poses: whether 3D joints of another network are of use where the first one has none.

    Returns:
        The 16 landmarks in pixels of the frames, float32; confidence 0 where nobody is found. 3D
        joints are those of the first network, if it has any; another's are in the axes of its crop.

    Raises:
        InputError: nobody is in the box of the first frame.
    """
    seen = list(_with_others(network, frames, start, others))
    looks = [None if one is None else one.look for one in seen]
    found = _to_detections(_finished(looks, network, camera), network)
    if not others:
        return found
    size = torch.tensor([0.0 if look is None else look.crop.height for look in looks])
    further = [_helped(other, place, seen) for place, other in enumerate(others)]
    for other, marks in zip(others, further, strict=True):
        if sides_differ(_landmarks(marks), _landmarks(found), size.clamp(min=1.0)):
            _LOG.warning(
                "%s and %s call left and right differently, in nearly every frame; those of the "
                "first are used: check joints of their manifests",
                *(each.manifest.path.parent.name for each in (network, other)),
            )
    return _fused(found, further, size.clamp(min=1.0), poses)


def _finished(
    looks: list[Look | None], network: CropNetwork, camera: Camera | None
) -> list[Look | None]:
    settled = _settled(looks, network.joint_set)
    if camera is not None and network.manifest.output.crop_axes:
        settled = _in_camera_axes(settled, camera)
    return settled


def _helped(network: CropNetwork, place: int, seen: list[_Seen | None]) -> Detections:
    """What another network saw, with the sides as it saw them."""
    looks = [None if one is None else one.others[place] for one in seen]
    return _to_detections(looks, network)


def _fused(
    first: Detections, others: Sequence[Detections], size: Tensor, poses: bool
) -> Detections:
    """One person's detections by several networks, each (F, 1), as one."""
    marks = [_landmarks(each) for each in (first, *others)]
    whole_body = fuse(marks[0], marks[1:], size)
    found = replace(
        first,
        joints2d=whole_body.joints2d[:, None],
        confidence2d=whole_body.confidence[:, None],
    )
    if not poses or found.joints3d is not None:
        return found
    for other, seen in zip(others, marks[1:], strict=True):
        if other.joints3d is not None:
            swapped = other.joints3d[:, :, list(LANDMARKS16.mirrored())]
            wrong = exchanged(seen, marks[0], size)[:, None, None, None]
            right = torch.where(wrong, swapped, other.joints3d)
            return replace(
                found, joints3d=right, trusted3d=other.trusted3d, deviation3d=other.deviation3d
            )
    return found


def _landmarks(found: Detections) -> Landmarks:
    return Landmarks(found.joints2d[:, 0], found.confidence2d[:, 0])


def _with_others(
    network: CropNetwork, frames: Iterable[Frame], start: Start, others: Sequence[CropNetwork]
) -> Iterator[_Seen | None]:
    for frame, look in _follow(network, frames, start):
        if look is None:
            yield None
            continue
        crops = [look.around(other, network.joint_set) for other in others]
        yield _Seen(
            look,
            tuple(
                None if crop is None else look_at(other, frame, [crop])[0]
                for other, crop in zip(others, crops, strict=True)
            ),
        )


def _follow(
    network: CropNetwork, frames: Iterable[Frame], start: Start
) -> Iterator[tuple[Frame, Look | None]]:
    spec = network.manifest.input
    crop = None if start.box is None else Crop.around(start.box, spec.size, spec.padding)
    known = _Known()
    for number, frame in enumerate(frames):
        if network.manifest.output.kind == "joints3d":  # no 2D joints to follow
            padding = spec.padding if start.box else 1.0
            part = Crop.around(start.box or whole(frame), spec.size, padding)
            yield frame, look_at(network, frame, [part])[0]
            continue
        look = None if crop is None else look_at(network, frame, [crop])[0]
        if look is not None and number == 0:
            look = _shown(network, frame, start, look)
        if look is None or not is_person(look.confidence, network.joint_set):
            whom = Start() if known.ever else start
            look = known.unless_elsewhere(search(network, frame, whom.person, alone=whom.alone))
        elif known.doubts(look):
            look = _surer(look, search(network, frame), network.joint_set, known)
        else:
            look = turn_around(network, frame, look, _UNSURE)
        if known.age >= _AGE and look is not None and (apart := known.moved(look.box())) > _NEARBY:
            _LOG.warning(_OTHER, number, known.age, apart)
        known = known.after(look)
        yield frame, look
        crop = None
        if look is not None:
            angle = turned(look, network.joint_set, spec.turns)
            joints = look.joints2d, look.confidence, SEEN
            crop = next_crop(look.crop, *joints, spec.padding, angle)


def _shown(network: CropNetwork, frame: Frame, start: Start, look: Look) -> Look:
    """The person in the user's box, nobody else: the crop of the box, or what is found in it."""
    look = turn_around(network, frame, centre(network, frame, look))
    box, joints = look.box(), network.joint_set
    if start.box is None or (
        box is not None and overlap(start.box, box) >= SAME and is_person(look.confidence, joints)
    ):
        return look
    found = search(network, frame, inside=start.box)
    if found is None:
        told = " ".join(f"{each:g}" for each in start.box or ())
        raise InputError(
            f"--box {told}: nobody is seen there in the first frame; expected LEFT TOP RIGHT "
            "BOTTOM about the person, in pixels of the video (--frames chooses another first frame)"
        )
    return found


@dataclass(frozen=True)
class _Known:
    """Where the person was seen last: the box, and how many frames ago."""

    box: Box | None = None
    age: int = 0
    ever: bool = False

    def after(self, look: Look | None) -> _Known:
        box = None if look is None else look.box()
        if box is None:
            return replace(self, age=self.age + 1)
        return _Known(box, 0, True)

    def doubts(self, look: Look) -> bool:
        """Whether a look shows something smaller, or elsewhere, than a frame before."""
        box = look.box()
        if self.box is None or box is None or self.age >= _AGE:
            return False
        return _size(box) < _SHRUNK * _size(self.box) or self.moved(box) > _JUMPED

    def unless_elsewhere(self, look: Look | None) -> Look | None:
        """A look, but none at somebody too far away to be who was seen a moment ago."""
        box = None if look is None else look.box()
        if box is None or self.box is None or self.age >= _AGE:
            return look
        return look if self.moved(box) <= _NEARBY else None

    def moved(self, box: Box | None) -> float:
        """Distance of the middles, in sizes of the person."""
        if self.box is None or box is None:
            return 0.0
        x, y = (0.5 * (box[i] + box[i + 2] - self.box[i] - self.box[i + 2]) for i in (0, 1))
        return float((x * x + y * y) ** 0.5) / max(_size(self.box), 1e-6)


def _surer(look: Look, other: Look | None, joint_set: JointSet, known: _Known) -> Look:
    """The likelier of two people to be the one who was followed."""
    if other is None:
        return look

    def score(one: Look) -> float:
        box = one.box()
        return sureness(one.confidence, joint_set) - (1.0 if box is None else known.moved(box))

    return other if score(other) > score(look) else look


def _size(box: Box) -> float:
    return max(box[2] - box[0], box[3] - box[1])


def _settled(looks: list[Look | None], joint_set: JointSet) -> list[Look | None]:
    """The same looks with sides that motion allows, wherever somebody is followed."""
    order = joint_set.mirrored()
    settled: list[Look | None] = []
    for _, group in groupby(looks, key=lambda look: look is None):
        run = list(group)
        seen = [look for look in run if look is not None]
        settled += _settle(seen, order) if seen else run
    return settled


def _settle(looks: list[Look], order: tuple[int, ...]) -> list[Look]:
    """The same for frames in a row."""
    track = Track(
        torch.stack([look.joints2d for look in looks]),
        torch.stack([look.confidence for look in looks]),
        join_candidates([look.candidates for look in looks]),
        torch.tensor([max(look.crop.width, look.crop.height) for look in looks]),
    )
    track, exchanged = settle_sides(track, order)
    settled = []
    for row, look in enumerate(looks):
        pose = look.joints3d
        if pose is not None and exchanged[row]:
            pose = pose[list(order)]
        points, confidence = track.points[row], track.confidence[row]
        settled.append(replace(look, joints2d=points, confidence=confidence, joints3d=pose))
    return settled


def _in_camera_axes(looks: list[Look | None], camera: Camera) -> list[Look | None]:
    """The same looks with 3D joints turned from the ray through their crop to the camera."""
    centers = [(0.0, 0.0) if look is None else look.crop.center for look in looks]
    pixels = torch.tensor(centers, dtype=camera.intrinsics.dtype)[:, None, None]
    turns = toward(camera.to_plane(pixels)[:, 0, 0]).float()
    return [
        look
        if look is None or look.joints3d is None
        else replace(look, joints3d=look.joints3d @ turn.mT)
        for look, turn in zip(looks, turns, strict=True)
    ]


def _to_detections(looks: list[Look | None], network: CropNetwork) -> Detections:
    """Looks of F frames as detections of the landmarks, (F, 1)."""
    joint_set, error = network.joint_set, network.manifest.output.error3d
    joints = len(joint_set)
    nothing = torch.zeros(joints, 2), torch.zeros(joints)
    points = torch.stack([nothing[0] if look is None else look.joints2d for look in looks])
    trust = torch.stack([nothing[1] if look is None else look.confidence for look in looks])
    joints2d, confidence = map_to_landmarks(points, trust, joint_set)
    seen = [look is not None and look.joints3d is not None for look in looks]
    if not any(seen):
        return Detections.from_joints(joints2d[:, None], confidence[:, None])
    zero3d = torch.zeros(joints, 3)
    poses = torch.stack(
        [zero3d if look is None or look.joints3d is None else look.joints3d for look in looks]
    )
    joints3d, complete = _positions(poses, joint_set)
    trusted = torch.tensor(seen) & complete
    return Detections(
        joints2d[:, None],
        confidence[:, None],
        joints3d[:, None],
        trusted[:, None],
        None if error is None else torch.full((len(looks), 1), error),
    )


def _positions(poses: Tensor, joint_set: JointSet) -> tuple[Tensor, Tensor]:
    """3D landmarks (F, 16, 3) about the middle of the hips, and which frames have all of them."""
    known = poses.isfinite().all(-1)
    mapped, seen = map_to_landmarks(poses, known.to(poses), joint_set)
    hips = [LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]
    root = mapped[:, hips].mean(1, keepdim=True)
    there = seen > 0
    return torch.where(there[..., None], mapped - root, 0), there.all(-1)
