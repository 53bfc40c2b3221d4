"""Batches of augmented crops by number."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.errors import InputError
from perfcap.train.augment import Framing, View, cut, random_framing, spoil
from perfcap.train.backgrounds import Backgrounds, Picture
from perfcap.train.body_parts import UNKNOWN
from perfcap.train.config import Augmentation
from perfcap.train.loop import mixed_seed
from perfcap.train.scenes import Shot

# --- Rendered people before other backgrounds than they were rendered with ------------------------
#
# Pictures of real places are few; people cut out and shown before any part of any of them, in
# colours that may be the person's own, teach that a body is a shape. The cut follows the coarse map
# of parts, harder or softer each time, so that its edge teaches nothing (Dwibedi et al. 2017, Cut,
# Paste and Learn).

_FEWEST = 4  # pixels of a part whose colours are taken

Floats = NDArray[np.float32]


def elsewhere(
    shot: Shot, backgrounds: Backgrounds, settings: Augmentation, rng: np.random.Generator
) -> Shot:
    """A shot before another background, or as it is.

    Args:
        shot: as stored; photographs, whose parts are unknown, stay as they are.
        backgrounds: where to; with a folder of pictures.
        settings: how often.
        rng: of everything random.
    """
    if rng.random() >= settings.moved or (shot.parts == UNKNOWN).any():
        return shot
    behind = backgrounds.photograph(len(shot.image), rng).astype(np.float32)
    behind = _recolored(behind, shot, settings, rng)
    opaque = _cut_out(shot.parts, len(shot.image), rng)[..., None]
    image = behind + opaque * (shot.image - behind)
    return replace(shot, image=image.clip(0, 255).astype(np.uint8))


def _cut_out(parts: Picture, size: int, rng: np.random.Generator) -> Floats:
    """How opaque somebody is, (size, size), 0 to 1."""
    mask = cv2.resize((parts > 0).astype(np.float32), (size, size), interpolation=cv2.INTER_CUBIC)
    mask = cv2.GaussianBlur(mask, (0, 0), float(rng.uniform(0.6, 1.6)))
    share = (mask - rng.uniform(0.3, 0.6)) * rng.uniform(2.0, 8.0) + 0.5
    return np.asarray(share.clip(0, 1), np.float32)


def _recolored(
    behind: Floats, shot: Shot, settings: Augmentation, rng: np.random.Generator
) -> Floats:
    """A background in other colours; some have those of a part of the person."""
    present = np.unique(shot.parts[shot.parts > 0])
    if len(present) and rng.random() < settings.camouflaged:
        side = len(shot.parts)
        small = cv2.resize(shot.image, (side, side), interpolation=cv2.INTER_AREA)
        colors = small[shot.parts == rng.choice(present)].astype(np.float32)
        if len(colors) >= _FEWEST:
            few = behind[::4, ::4].reshape(-1, 3)
            contrast = np.float32(rng.uniform(0.5, 1.5)) * few.std()
            shifted = (behind - few.mean(0)) * (contrast / (few.std(0) + 1)) + colors.mean(0)
            return np.asarray(shifted, np.float32)
    gains = np.exp(rng.normal(0, 0.15) + rng.normal(0, 0.08, 3)).astype(np.float32)
    return behind * gains


# --- Batches of augmented crops by number ---------------------------------------------------------


class Shots(Protocol):
    """Shots by number."""

    def __len__(self) -> int: ...

    def __getitem__(self, number: int) -> Shot: ...


@dataclass(frozen=True)
class CropBatch:
    """Crops and their truth.

    Attributes:
        crops: (N, 3, size, size) float32, RGB, 0 to 255.
        joints2d: pixels, (N, 16, 2).
        joints3d: root-relative, axes of the crop, (N, 16, 3) m.
        inside: joints that lie in the crop, (N, 16).
        known: joints of which that is known, (N, 16).
        posed: crops with 3D positions, (N,).
        parts: of the body at each pixel of the maps, indices in ``PARTS``, (N, size/4, size/4).
    """

    crops: Tensor
    joints2d: Tensor
    joints3d: Tensor
    inside: Tensor
    known: Tensor
    posed: Tensor
    parts: Tensor

    def to(self, device: torch.device) -> CropBatch:
        """The same on a device."""
        return CropBatch(*(getattr(self, name).to(device) for name in self.__match_args__))


class CropBatches:
    """Shuffled, augmented batches: the same number gives the same batch, after any pause too.

    Args:
        shots: stored or rendered.
        margin: width of a shot, in boxes around the joints.
        settings: of the augmentation.
        seed: of the order and everything random.
        backgrounds: to show people before; None leaves them where they are.
    """

    def __init__(
        self,
        shots: Shots,
        margin: float,
        settings: Augmentation,
        seed: int,
        backgrounds: Backgrounds | None = None,
    ) -> None:
        if not len(shots):
            raise InputError("crops: are none; expected rendered crops or photographs")
        self._shots, self._margin, self._settings, self._seed = shots, margin, settings, seed
        self._backgrounds = backgrounds

    def batch(self, number: int, count: int, size: int) -> CropBatch:
        """Batch ``number`` of ``count`` crops of ``size`` pixels; every shot once an epoch."""
        views = []
        for place in range(number * count, (number + 1) * count):
            rng = np.random.default_rng(mixed_seed(self._seed, place))
            epoch, row = divmod(place, len(self._shots))
            shot = self._shots[int(_order(self._seed, epoch, len(self._shots))[row])]
            if self._backgrounds is not None:
                shot = elsewhere(shot, self._backgrounds, self._settings, rng)
            view = cut(shot, random_framing(self._settings, rng), size, self._margin)
            image = spoil(view.image, self._settings, rng)
            views.append(replace(view, image=image))
        return collated(views)


class Ahead:
    """Makes the batch that is likely to be asked for next while this one is learned from.

    Args:
        make: a batch of a number, a count and a size.
    """

    def __init__(self, make: Callable[[int, int, int], CropBatch]) -> None:
        self._make = make
        self._worker = ThreadPoolExecutor(1)
        self._last: tuple[int, int, int] | None = None
        self._next: tuple[tuple[int, int, int], Future[CropBatch]] | None = None

    def __call__(self, number: int, count: int, size: int) -> CropBatch:
        """Batch ``number``; what it is does not depend on what was asked for before."""
        wanted = (number, count, size)
        if self._next is not None and self._next[0] == wanted:
            batch = self._next[1].result()
        else:
            batch = self._make(*wanted)
        if self._last is not None and number > self._last[0]:
            following = (2 * number - self._last[0], count, size)
            self._next = following, self._worker.submit(self._make, *following)
        self._last = wanted
        return batch


def plain_batch(shots: Shots, numbers: Sequence[int], size: int, margin: float) -> CropBatch:
    """Crops as a person is followed, not augmented."""
    return collated([cut(shots[number], Framing(), size, margin) for number in numbers])


def collated(views: Sequence[View]) -> CropBatch:
    """Views of one size as a batch."""
    images = torch.from_numpy(np.stack([view.image for view in views]))
    # in memory the channels stay last, which convolutions on the CPU are faster with
    return CropBatch(
        images.permute(0, 3, 1, 2).float(),
        *(
            torch.from_numpy(np.stack([getattr(view, name) for view in views]))
            for name in ("joints2d", "joints3d", "inside", "known", "posed", "parts")
        ),
    )


@lru_cache(2)
def _order(seed: int, epoch: int, count: int) -> NDArray[np.int64]:
    rng = np.random.default_rng(mixed_seed(seed ^ 0x5EED, epoch))
    return rng.permutation(count)
