"""Crops of a person in several views, as a network sees them and as a solution of all views does.

The network is frozen, so it looks once at every crop: those that a capture would cut, and others
that are moved, turned and mirrored a little, since a few frames hold few of either.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.crop import Crop, body_angle, body_crop
from perfcap.detect.joint_set import LANDMARKS16, map_to_landmarks
from perfcap.detect.manifest import Manifest
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.train.config import HeadCrops
from perfcap.train.head import Lesson, rooted
from perfcap.train.onnx_head import FrozenNetwork

_CHUNK = 16  # frames decoded at once
_SEEN = 0.3  # of the confidence a crop's joints are counted with, which are all known here
_MIRROR = list(LANDMARKS16.mirrored())

# frames (n, H, W, 3), RGB, of a view from one frame to before another
ReadView = Callable[[int, int, int], NDArray[np.uint8]]
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Watched:
    """A person in C calibrated views, and the solution of all of them together.

    Attributes:
        read: images of a view.
        cameras: C fixed views, in pixels of the images.
        joints: the solution, landmarks in the world, (F, 16, 3) m.
        trust: of the solution, (F,), 0 to 1.
        joints2d: detections, pixels of the images, (F, C, 16, 2).
        confidence: of these, (F, C, 16).
        rate: frames a second.
    """

    read: ReadView
    cameras: Camera
    joints: Tensor
    trust: Tensor
    joints2d: Tensor
    confidence: Tensor
    rate: float

    def every(self, step: int) -> Watched:
        """One frame of so many."""
        if step == 1:
            return self

        def read(view: int, start: int, stop: int) -> NDArray[np.uint8]:
            return self.read(view, step * start, step * (stop - 1) + 1)[::step]

        parts = {n: getattr(self, n)[::step] for n in ("joints", "trust", "joints2d", "confidence")}
        return replace(self, read=read, rate=self.rate / step, **parts)


@dataclass(frozen=True)
class CropAnswers:
    """What a network says of K crops of every frame and view: the first is cut as in a capture.

    Attributes:
        features: (C, F, K, D).
        joints2d: landmarks in pixels of the crop, (C, F, K, 16, 2); sides as the solution has them.
        confidence: (C, F, K, 16).
        joints3d: metres along the axes of the crop, relative to the hips, (C, F, K, 16, 3).
        known2d: the solution's landmarks likewise.
        known3d: likewise.
        exchanged: whether the network calls left what the solution calls right, (C, F, K).
        mirrored: whether the crop is a mirror image, (K,).
        to_image: pixels of the image from those of the crop, (C, F, K, 2, 3).
        to_camera: axes of the camera from those of the crop, (C, F, K, 3, 3).
    """

    features: Tensor
    joints2d: Tensor
    confidence: Tensor
    joints3d: Tensor
    known2d: Tensor
    known3d: Tensor
    exchanged: Tensor
    mirrored: Tensor
    to_image: Tensor
    to_camera: Tensor

    @property
    def views(self) -> int:
        """C."""
        return self.features.shape[0]

    def lesson(
        self,
        frames: slice,
        trust: Tensor,
        size: int,
        *,
        plain: bool = False,
        views: Sequence[int] | None = None,
    ) -> Lesson:
        """Crops of some frames to learn from, or those alone that a capture would cut.

        Args:
            frames: of the F.
            trust: of the solution, (F,).
            size: width of the crops, pixels.
            plain: leave out crops that are moved or mirrored.
            views: some of them; all if not given.
        """
        count = 1 if plain else len(self.mirrored)
        chosen = list(range(self.views) if views is None else views)

        def part(values: Tensor) -> Tensor:
            return values[chosen, frames, :count].flatten(0, 2)

        # the head moves what the network calls left, whatever that is
        known = torch.cat((part(self.known2d) / size, part(self.known3d)), -1)
        seen = torch.cat((part(self.joints2d) / size, part(self.joints3d)), -1)
        other = part(self.exchanged)[:, None, None]
        known = torch.where(other, known[:, _MIRROR], known)
        seen = torch.where(other, seen[:, _MIRROR], seen)
        weight = trust[None, :, None].expand(self.exchanged.shape)
        return Lesson(part(self.features), seen, known, part(weight).to(seen))


def digest_of(watched: Watched, crops: CropAnswers) -> str:
    """SHA-256 of all that a head learns from: that of other videos, cameras or joints differs."""
    total = hashlib.sha256(f"{watched.rate}".encode())
    learned = (watched.joints, watched.trust, watched.joints2d, watched.confidence)
    for values in (*learned, *vars(crops).values()):
        total.update(values.contiguous().numpy().tobytes())
    return total.hexdigest()


def look_at_crops(
    network: FrozenNetwork, watched: Watched, config: HeadCrops, seed: int, tell: Tell
) -> CropAnswers:
    """Show a network the crops of a person.

    Args:
        network: frozen.
        watched: the person.
        config: how many crops, and how they are moved.
        seed: of the moves.
        tell: told how far it is.

    Raises:
        InputError: the solution puts the person outside of all that a camera sees.
    """
    local = watched.cameras.to_camera(watched.joints)
    pixels = watched.cameras.project_camera(local).float()  # F C 16 2
    if not bool(pixels.isfinite().all()):
        raise InputError("the solution of all views is behind a camera; check --cameras")
    poses = rooted(local).float()
    frames, views = pixels.shape[:2]
    random = np.random.default_rng(seed)
    found: list[CropAnswers] = []
    for view in range(views):
        for start in range(0, frames, _CHUNK):
            stop = min(frames, start + _CHUNK)
            images = watched.read(view, start, stop)
            found += [
                _of_frame(network, image, pixels[f, view], poses[f, view], config, random)
                for f, image in zip(range(start, stop), images, strict=True)
            ]
            tell("look", view * frames + stop, views * frames)
    first = found[0]
    parts = {
        name: torch.stack([getattr(each, name) for each in found])
        for name in first.__dataclass_fields__
        if name != "mirrored"
    }
    parts = {name: part.reshape(views, frames, *part.shape[1:]) for name, part in parts.items()}
    return CropAnswers(mirrored=first.mirrored, **parts)


def _of_frame(
    network: FrozenNetwork,
    image: NDArray[np.uint8],
    pixels: Tensor,
    pose: Tensor,
    config: HeadCrops,
    random: np.random.Generator,
) -> CropAnswers:
    """K crops of one image: as it would be cut, mirrored, and so on with moved ones."""
    width = network.manifest.input.size[1]
    crops = _crops(network.manifest, pixels, config, random)
    cut = [crop.cut(image) for crop in crops]
    both = [part for one in cut for part in (one, one[:, ::-1])] if config.mirrored else cut
    twice = [crop for crop in crops for _ in range(2 if config.mirrored else 1)]
    mirrored = torch.tensor([bool(k % 2) and config.mirrored for k in range(len(both))])
    answers = network(np.stack(both))
    joint_set, estimate = network.manifest.joint_set, answers.estimate
    assert estimate.joints3d is not None
    joints2d, confidence = map_to_landmarks(estimate.joints2d, estimate.confidence, joint_set)
    joints3d, _ = map_to_landmarks(
        estimate.joints3d, torch.ones_like(estimate.confidence), joint_set
    )
    joints3d = rooted(joints3d)
    known2d = torch.stack([crop.from_image(pixels) for crop in twice])
    known3d = torch.stack([pose @ crop.turn(pose) for crop in twice])
    flip = mirrored[:, None, None]
    edge, sign = torch.tensor([-1.0, 1.0]), torch.tensor([-1.0, 1.0, 1.0])
    seen_flipped = known2d[:, _MIRROR] * edge + torch.tensor([width - 1.0, 0.0])
    known2d = torch.where(flip, seen_flipped, known2d)
    known3d = torch.where(flip, known3d[:, _MIRROR] * sign, known3d)
    straight, across = (
        (confidence[:, order] * (joints2d[:, order] - known2d).norm(dim=-1)).sum(-1)
        for order in (list(range(len(_MIRROR))), _MIRROR)
    )
    other = across < straight
    return CropAnswers(
        answers.features,
        torch.where(other[:, None, None], joints2d[:, _MIRROR], joints2d),
        torch.where(other[:, None], confidence[:, _MIRROR], confidence),
        torch.where(other[:, None, None], joints3d[:, _MIRROR], joints3d),
        known2d,
        known3d,
        other,
        mirrored,
        torch.stack([crop.matrix(pose) for crop in twice]),
        torch.stack([crop.turn(pose) for crop in twice]),
    )


def _crops(
    manifest: Manifest, pixels: Tensor, config: HeadCrops, random: np.random.Generator
) -> list[Crop]:
    """The crop that a capture would cut about landmarks (16, 2), and moved ones."""
    spec, sure = manifest.input, torch.ones(len(pixels))
    angle = body_angle(pixels, sure, LANDMARKS16) if spec.turns == "upright" else None
    first = body_crop(pixels, sure, _SEEN, spec.size, spec.padding, angle or 0.0)
    assert first is not None  # all landmarks are known
    found = [first]
    for _ in range(config.moved):
        shift, size, turn = random.normal(size=2), random.normal(), random.normal()
        x, y = (
            c + config.shift * first.width * s for c, s in zip(first.center, shift, strict=True)
        )
        wide = first.width * math.exp(config.zoom * size)
        more = math.radians(config.turn) * turn
        found.append(Crop((float(x), float(y)), wide, first.size, first.angle + more))
    return found
