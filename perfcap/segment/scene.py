"""What stays the same behind a person over a stretch of a clip, in one view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_mask, require_picture
from perfcap.errors import InputError
from perfcap.segment.background import Plate, PlateSettings, build_plate
from perfcap.segment.moving_scene import KeyFrame, MovingSettings, Samples
from perfcap.segment.network_cue import CueTrust
from perfcap.segment.part_colors import PartColors
from perfcap.segment.registration import (
    RegistrationSettings,
    find_landmarks,
    register,
    resample,
    shrink,
)
from perfcap.segment.trimap import Box, Mask, bounds, distance_outside
from perfcap.setting_checks import Settings
from perfcap.workers import ordered_map

Image = NDArray[np.uint8]

_SLOPE = 2.0  # grey levels a pixel; weaker ones say nothing about a shift
_EDGES = 0.8  # quantile of the slopes that are edges
_LEAST_EDGES = 200  # pixels
_ALIKE = 3.0  # grey levels
_MARGIN = 0.06  # of the longest side: what a hand-held camera moves while a plate serves


@dataclass(frozen=True)
class SceneSettings(Settings):
    """How much is looked at.

    Attributes:
        samples: frames from which a plate is made, over a whole stretch.
        span: frames of a stretch; light may change between stretches.
        still: px, median shift of the background below which the camera stands still.
        share: of the samples that must show the same still picture.
        moving: how the background is found where the camera moves.
    """

    samples: int = 25
    span: int = 300
    still: float = 0.5
    share: float = 0.6
    moving: MovingSettings = field(default_factory=MovingSettings)
    registration: RegistrationSettings = field(default_factory=RegistrationSettings)


@dataclass(frozen=True)
class Scene:
    """The background of a stretch of a clip.

    Attributes:
        plate: of the whole image; None where the camera moves.
        shift: px, median over samples by which the background moved.
        used: samples that show the plate.
        samples: to make plates of, where the camera moves.
        trust: in a network's masks; None where there is none.
        colors: of each of several people, where they are to be told apart.
    """

    plate: Plate | None
    shift: float
    used: int
    samples: Samples | None = None
    trust: CueTrust | None = None
    colors: tuple[PartColors, ...] = ()


def sample_frames(start: int, stop: int, count: int) -> list[int]:
    """Evenly spread frames of a stretch, increasing."""
    count = min(count, stop - start)
    return [start + int((i + 0.5) * (stop - start) / count) for i in range(count)]


def hide(model: Mask, clearance: float) -> Mask:
    """Where people may be: a model (H, W) and what is nearer to it than a share of its size.

    Of several models, (K, H, W), where any of them may be: each with a width of its own.
    """
    if model.ndim == 3:
        anybody: Mask = np.any([hide(each, clearance) for each in model], 0)
        return anybody
    rows, columns = np.nonzero(model.any(1))[0], np.nonzero(model.any(0))[0]
    if not len(rows):
        return np.zeros_like(model)
    reach = clearance * (max(np.ptp(rows), np.ptp(columns)) + 1)
    near, part = np.zeros_like(model), bounds(model, int(np.ceil(reach)) + 1)
    near[part] = distance_outside(model[part]) > -reach
    return near


def require_footage(images: Sequence[Image], models: Sequence[Mask]) -> None:
    """Refuse images that are no RGB ones (H, W, 3) of one size in bytes, or models (H, W) or
    (K, H, W) that are no masks of them.

    Raises:
        InputError: they are not.
    """
    if len(images) != len(models):
        raise InputError(f"{len(images)} images and {len(models)} models; expected one of each")
    for number, (image, model) in enumerate(zip(images, models, strict=True)):
        size = images[0].shape[:2] if number else None
        require_picture(image, f"image {number}", size)
        people = tuple(model.shape[:-2]) if model.ndim == 3 else ()
        require_mask(model, f"model {number}", (*people, *image.shape[:2]))


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
        models: silhouettes of everybody modelled, (H, W) or (K, H, W).
        plate: how a plate is made.
        settings: of the survey.
        workers: threads; all cores when None.

    Raises:
        InputError: images that are no RGB ones in bytes and of one size, or models that are no
            masks of them.
    """
    require_footage(images, models)
    plate, settings = plate or PlateSettings(), settings or SceneSettings()
    if len(images) < plate.least:
        return Scene(None, float("nan"), 0)
    scale = min(1.0, settings.registration.side / max(images[0].shape[:2]))

    def glimpse(sample: tuple[Image, Mask]) -> _Glimpse:
        return _Glimpse.of(*sample, plate.clearance, scale)

    samples = list(ordered_map(glimpse, zip(images, models, strict=True), workers))
    middle = samples[len(samples) // 2]
    edges = _Edges.of(middle.small)

    def shift(sample: _Glimpse) -> float:
        return edges.shift_to(sample.small, middle.closed | sample.closed)

    shifts = np.array(list(ordered_map(shift, samples, workers))) / scale
    same = np.nonzero(shifts < settings.still)[0]
    typical = float(np.median(np.delete(shifts, len(samples) // 2)))
    if len(same) < max(settings.share * len(images), plate.least):
        hidden = [sample.hidden for sample in samples]
        return Scene(None, typical, len(same), Samples.of(images, hidden, settings.moving))
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


def shift_of(one: Image, other: Image, hidden: Mask) -> float:
    """Pixels by which edges of the background moved between two grey images (H, W), roughly.

    The change of a pixel over the slope there: brightness constancy along the gradient. Large
    shifts are underrated, but never as small. Without any edge to go by, zero if the images are
    alike, infinite otherwise.
    """
    return _Edges.of(one).shift_to(other, hidden)


@dataclass(frozen=True)
class _Edges:
    """A grey image (H, W), smoothed, and its slopes: many others are compared with it."""

    smooth: NDArray[np.float32]
    slope: NDArray[np.float32]

    @classmethod
    def of(cls, image: Image) -> _Edges:
        smooth = _smooth(image)
        ways = ((1, 0), (0, 1))
        return cls(
            smooth, np.hypot(*(cv2.Sobel(smooth, cv2.CV_32F, *way, ksize=3) / 8 for way in ways))
        )

    def shift_to(self, other: Image, hidden: Mask) -> float:
        """See ``shift_of``."""
        shown = np.flatnonzero(~hidden)
        visible = self.slope.reshape(-1)[shown]
        if not len(visible):
            return float("inf")
        change = (_smooth(other) - self.smooth).reshape(-1)[shown]
        change = np.abs(change - np.median(change))  # the light may differ
        edges = visible > max(_SLOPE, float(np.quantile(visible, _EDGES)))
        if int(edges.sum()) < _LEAST_EDGES:
            return 0.0 if float(np.median(change)) < _ALIKE else float("inf")
        return float(np.median(change[edges] / visible[edges]))


def _smooth(image: Image) -> NDArray[np.float32]:
    smooth: NDArray[np.float32] = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
    return smooth


def key_frame(
    images: Sequence[Image],
    hidden: Sequence[Mask],
    boxes: Sequence[Box],
    scene: Scene,
    plate: PlateSettings,
) -> KeyFrame | None:
    """A plate for frames in a row of a moving camera, made for the one in their middle.

    Args:
        images: of one shot, (H, W, 3).
        hidden: where people may be, (H, W), see ``hide``.
        boxes: the part of each that is wanted.
        scene: from ``survey``.
        plate: how plates are made.
    """
    wanted = [box for box in boxes if box[0].stop > box[0].start]
    if scene.samples is None or not wanted:
        return None
    middle = len(images) // 2
    region = _around(wanted, images[middle].shape)
    # few samples show any one pixel here: one is better than none
    return scene.samples.key_frame(images[middle], hidden[middle], region, replace(plate, least=1))


def _around(boxes: Sequence[Box], shape: tuple[int, ...]) -> Box:
    """What holds all boxes, and what a camera moves in a few frames."""
    margin = round(_MARGIN * max(shape))
    low = [min(box[axis].start for box in boxes) - margin for axis in range(2)]
    high = [max(box[axis].stop for box in boxes) + margin for axis in range(2)]
    return slice(max(low[0], 0), min(high[0], shape[0])), slice(
        max(low[1], 0), min(high[1], shape[1])
    )


def registered_neighbors(
    images: Sequence[Image], hidden: Mask, index: int, box: Box, settings: RegistrationSettings
) -> list[Image]:
    """The frames before and after a frame, brought to where its camera is, in a box.

    Args:
        images: consecutive frames of one shot, (H, W, 3).
        hidden: where people may be in the frame, (H, W).
        index: of the frame among them.
        box: the part wanted.
        settings: of the registration.

    Returns:
        (h, w, 3) each, unchanged where they see nothing; fewer where they could not be registered.
    """
    landmarks = find_landmarks(images[index], hidden, settings)
    found = []
    for other in (index - 1, index + 1):
        if not 0 <= other < len(images):
            continue
        matrix = register(landmarks, images[other], settings)
        if matrix is not None:
            image, inside = resample(images[other], matrix, box)
            found.append(np.where(inside[..., None], image, images[index][box]))
    return found
