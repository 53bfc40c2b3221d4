"""Silhouettes spoiled on purpose, as segmentation spoils them: for some frames in a row, and where
the person is, moving along.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any, Protocol
from unittest import mock

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.pipeline.sight import Mask, View
from perfcap.render import rasterize
from perfcap.segment import Segmentation, extract_contour, segment_block

Floats = NDArray[np.float64]
Plane = NDArray[np.float32]

SMALLEST, LARGEST = 0.02, 0.05  # radius of a blob, of the person's height
_HOLD = 10  # frames in which the same blobs stay


class Fault(Protocol):
    """Spoils the mask (H, W) of one frame, frames in order, where the model looks like ``view``."""

    @property
    def name(self) -> str:
        """For tables."""

    def spoil(self, frame: int, mask: Mask, view: View) -> Mask:
        """The spoiled mask."""


@dataclass(frozen=True)
class _Blob:
    """A disc that rides on a vertex of the model."""

    vertex: int
    offset: Floats
    radius: float
    added: bool


@dataclass
class Blobs:
    """Discs put on the contour until they cover a share of it: half are added, half cut out.

    Args:
        share: of the contour's points.
        height: of the person, px.
        seed: of places and sizes.
    """

    share: float
    height: float
    seed: int = 0
    _held: list[_Blob] = field(default_factory=list)

    @property
    def name(self) -> str:
        """For tables."""
        return f"{100 * self.share:.0f} %"

    def spoil(self, frame: int, mask: Mask, view: View) -> Mask:
        """With the blobs of this stretch of frames, new ones at its first."""
        if frame % _HOLD == 0 or not self._held:
            self._held = self._place(frame // _HOLD, mask, view)
        canvas = mask.astype(np.uint8)
        for blob in self._held:
            column, row = np.rint(view.pixels[blob.vertex] + blob.offset).astype(int).tolist()
            cv2.circle(canvas, (column, row), round(blob.radius), int(blob.added), cv2.FILLED)
        return canvas > 0

    def _place(self, stretch: int, mask: Mask, view: View) -> list[_Blob]:
        rng = np.random.default_rng((self.seed, stretch))
        points = extract_contour(mask).points
        touched = np.zeros(len(points), np.bool_)
        blobs: list[_Blob] = []
        while touched.mean() < self.share:
            place = points[rng.integers(len(points))]
            radius = self.height * rng.uniform(SMALLEST, LARGEST)
            vertex = int(np.linalg.norm(view.pixels - place, axis=1).argmin())
            offset = place - view.pixels[vertex]
            blobs.append(_Blob(vertex, offset, radius, len(blobs) % 2 == 0))
            touched |= np.linalg.norm(points - place, axis=1) < radius
        return blobs


@dataclass(frozen=True)
class MissingLimb:
    """Everything of the mask that is nearer to a limb of the model than to the rest of it.

    Args:
        name: of the limb.
        joints: that move it, names of ``JOINTS``.
        actor: whose limb.
        reach: px beyond the model that count as the limb.
    """

    name: str
    joints: tuple[str, ...]
    actor: Actor
    reach: float

    def spoil(self, frame: int, mask: Mask, view: View) -> Mask:
        """Without the limb."""
        heaviest = self.actor.skin.rows()[2].numpy()
        moved = np.isin(heaviest, [JOINTS.index(joint) for joint in self.joints])
        faces = self.actor.template.faces
        of_limb = moved[faces].all(1)
        limb, rest = (_distance(view, faces[part]) for part in (of_limb, ~of_limb))
        missing: Mask = (limb < rest) & (limb < self.reach)
        return mask & ~missing


def _distance(view: View, faces: NDArray[np.int64]) -> Plane:
    """Pixels to a part of the model, (H, W)."""
    size = view.size
    pixels, depth = torch.from_numpy(view.pixels), torch.from_numpy(view.depth)
    drawn = rasterize(pixels, depth, torch.from_numpy(faces), (size[0], size[1])).mask.numpy()
    away: Plane = cv2.distanceTransform(1 - drawn.astype(np.uint8), cv2.DIST_L2, 5)
    return away


@contextmanager
def spoiling(fault: Fault, views: list[View]) -> Iterator[None]:
    """Silhouettes that are extracted meanwhile, by one worker in one view, are spoiled.

    All that the pipeline computes from a mask is computed from the spoiled one: its contour, and
    from image and evidence along it, how far it can be trusted.
    """
    frames = count()

    def spoiled(*arguments: Any) -> Iterator[Segmentation]:
        for found in segment_block(*arguments):
            frame = next(frames)
            yield replace(found, mask=fault.spoil(frame, found.mask, views[frame]))

    pipeline = importlib.import_module("perfcap.pipeline.extract_silhouettes")
    with mock.patch.object(pipeline, "segment_block", spoiled):
        yield
