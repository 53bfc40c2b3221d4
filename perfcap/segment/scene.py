"""What stays the same behind a person over a stretch of a clip, in one view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.background import Plate, PlateSettings, build_plate
from perfcap.segment.registration import (
    RegistrationSettings,
    find_landmarks,
    register,
    resample,
    shrink,
)
from perfcap.segment.trimap import Box, Mask, signed_distance
from perfcap.workers import ordered_map

Image = NDArray[np.uint8]

_SLOPE = 2.0  # grey levels a pixel; weaker ones say nothing about a shift
_EDGES = 0.8  # quantile of the slopes that are edges
_LEAST_EDGES = 200  # pixels
_ALIKE = 3.0  # grey levels


@dataclass(frozen=True)
class SceneSettings:
    """How much is looked at.

    Attributes:
        samples: frames from which a plate is made, over a whole stretch.
        span: frames of a stretch; light may change between stretches.
        still: px, median shift of the background below which the camera stands still.
        share: of the samples that must show the same still picture.
        offsets: frames, before and after, that show the background behind the person when the
            camera moves.
    """

    samples: int = 25
    span: int = 300
    still: float = 0.5
    share: float = 0.6
    offsets: tuple[int, ...] = (-12, -7, -3, 3, 7, 12)
    registration: RegistrationSettings = field(default_factory=RegistrationSettings)


@dataclass(frozen=True)
class Scene:
    """The background of a stretch of a clip.

    Attributes:
        plate: of the whole image; None where the camera moves.
        shift: px, median over samples by which the background moved.
        used: samples that show the plate.
    """

    plate: Plate | None
    shift: float
    used: int


def sample_frames(start: int, stop: int, count: int) -> list[int]:
    """Evenly spread frames of a stretch, increasing."""
    count = min(count, stop - start)
    return [start + int((i + 0.5) * (stop - start) / count) for i in range(count)]


def hide(model: Mask, clearance: float) -> Mask:
    """Where a person may be: the model (H, W) and what is nearer to it than a share of its size."""
    rows, columns = np.nonzero(model.any(1))[0], np.nonzero(model.any(0))[0]
    if not len(rows):
        return np.zeros_like(model)
    reach = clearance * (max(np.ptp(rows), np.ptp(columns)) + 1)
    near: Mask = signed_distance(model) > -reach
    return near


def survey(
    images: Sequence[Image],
    models: Sequence[Mask],
    plate: PlateSettings | None = None,
    settings: SceneSettings | None = None,
    workers: int | None = 1,
) -> Scene:
    """Look at samples of a stretch: does the camera stand still, and what is behind the person?

    Args:
        images: (H, W, 3) RGB, in the order of time.
        models: silhouettes of everybody modelled, (H, W).
        plate: how a plate is made.
        settings: of the survey.
        workers: threads; all cores when None.
    """
    plate, settings = plate or PlateSettings(), settings or SceneSettings()
    if len(images) < plate.least:
        return Scene(None, float("nan"), 0)
    scale = min(1.0, settings.registration.side / max(images[0].shape[:2]))

    def glimpse(sample: tuple[Image, Mask]) -> _Glimpse:
        return _Glimpse.of(*sample, plate.clearance, scale)

    samples = list(ordered_map(glimpse, zip(images, models, strict=True), workers))
    middle = samples[len(samples) // 2]
    shifts = np.array(list(ordered_map(middle.shift_to, samples, workers))) / scale
    same = np.nonzero(shifts < settings.still)[0]
    typical = float(np.median(np.delete(shifts, len(samples) // 2)))
    if len(same) < max(settings.share * len(images), plate.least):
        return Scene(None, typical, len(same))
    chosen = [int(i) for i in same]
    hidden = [samples[i].hidden for i in chosen]
    made = build_plate([images[i] for i in chosen], hidden, plate, workers)
    return Scene(made, typical, len(same))


@dataclass(frozen=True)
class _Glimpse:
    """One sample: where people may be, and its picture for finding shifts."""

    hidden: Mask
    small: Image
    closed: Mask

    @classmethod
    def of(cls, image: Image, model: Mask, clearance: float, scale: float) -> _Glimpse:
        """Of an image (H, W, 3), shrunk by a scale."""
        hidden, small = hide(model, clearance), shrink(image, scale)
        size = small.shape[::-1]
        closed = cv2.resize(hidden.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        return cls(hidden, small, closed)

    def shift_to(self, other: _Glimpse) -> float:
        """Pixels of the small picture by which the background moved."""
        return shift_of(self.small, other.small, self.closed | other.closed)


def shift_of(one: Image, other: Image, hidden: Mask) -> float:
    """Pixels by which edges of the background moved between two grey images (H, W), roughly.

    The change of a pixel over the slope there: brightness constancy along the gradient. Large
    shifts are underrated, but never as small. Without any edge to go by, zero if the images are
    alike, infinite otherwise.
    """
    smooth = [cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0) for image in (one, other)]
    slope = np.hypot(*(cv2.Sobel(smooth[0], cv2.CV_32F, *a, ksize=3) / 8 for a in ((1, 0), (0, 1))))
    visible = slope[~hidden]
    if not len(visible):
        return float("inf")
    change = (smooth[1] - smooth[0])[~hidden]
    change = np.abs(change - np.median(change))  # the light may differ
    edges = visible > max(_SLOPE, float(np.quantile(visible, _EDGES)))
    if int(edges.sum()) < _LEAST_EDGES:
        return 0.0 if float(np.median(change)) < _ALIKE else float("inf")
    return float(np.median(change[edges] / visible[edges]))


@dataclass(frozen=True)
class Context:
    """Other frames seen from one frame of a moving camera, in the box around the person.

    Attributes:
        plate: of the box; None where no other frame could be registered.
        adjacent: previous and next frame, unchanged where they see nothing.
        registered: how many of the frames asked for.
    """

    plate: Plate | None
    adjacent: list[Image]
    registered: int


def follow(
    images: Sequence[Image],
    hidden: Sequence[Mask],
    index: int,
    box: Box,
    plate: PlateSettings,
    settings: SceneSettings,
) -> Context:
    """Bring the frames around a frame to where its camera is.

    Args:
        images: consecutive frames of one shot, (H, W, 3).
        hidden: where people may be, (H, W), see ``hide``.
        index: of the frame among them.
        box: the part wanted.
        plate: how a plate is made.
        settings: which frames.
    """
    landmarks = find_landmarks(images[index], hidden[index], settings.registration)
    shown, closed, adjacent = [], [], []
    for offset in sorted({-1, 1, *settings.offsets}):
        other = index + offset
        if not 0 <= other < len(images):
            continue
        matrix = register(landmarks, images[other], settings.registration)
        if matrix is None:
            continue
        image, inside = resample(images[other], matrix, box)
        if abs(offset) == 1:
            adjacent.append(np.where(inside[..., None], image, images[index][box]))
        if offset in settings.offsets:
            covered, _ = resample(hidden[other].astype(np.uint8), matrix, box)
            shown.append(image)
            closed.append((covered > 0) | ~inside)
    if not shown:
        return Context(None, adjacent, len(adjacent))
    # few frames show any one pixel here: one is better than none
    seen = build_plate(shown, closed, plate)
    return Context(seen, adjacent, len(shown))
