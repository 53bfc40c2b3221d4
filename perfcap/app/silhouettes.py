"""Silhouettes of a result and true ones: read, drawn, compared."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from perfcap.app.mask_pixels import Mask, MaskPixels, mask_pixels
from perfcap.app.truth import Truth, match_frames
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.image_file import decode_image, read_silhouette
from perfcap.io.surface_file import SurfaceFile
from perfcap.metrics import silhouette_mismatches, silhouette_scores
from perfcap.render import rasterize

_LOOKED, _LAGS, _LONGEST = 12, 10, 160  # frames, frames around each, px
_WELL, _WORSE = 0.85, 0.2  # overlap of masks, and how much less that of the surface is


@dataclass(frozen=True)
class Silhouettes:
    """Silhouettes of a result, beside the true ones of the same frames.

    Attributes:
        what: what they are called.
        pairs: rows of the result and of the truth.
        read: the silhouette of such a pair, (H, W).
        true: reads the true one of a row of the truth, (H, W).
        rows: rows of the truth by numbers of frames.
    """

    what: str
    pairs: tuple[tuple[int, int], ...]
    read: Callable[[int, int], Mask]
    true: Callable[[int], Mask]
    rows: dict[int, int]

    def every(self, step: int) -> Iterator[tuple[Mask, Mask]]:
        """Both silhouettes of every such frame."""
        return ((self.read(*pair), self.true(pair[1])) for pair in self.pairs[::step])


def drawn_silhouettes(surface: SurfaceFile, truth: Truth) -> Silhouettes | None:
    """Those of a captured surface in the first view of the truth; None where it has none."""
    rig = truth.sequence.rig
    if not truth.sequence.masks or rig is None:
        return None
    rows, others = match_frames(surface.frames, truth, str(surface.path))
    return _beside(
        f"{surface.path}: outlines of the surface, drawn in the camera of the truth,",
        rows,
        others,
        lambda row, other: _draw(surface, row, rig.cameras, other),
        truth,
    )


def mask_silhouettes(folder: Path, truth: Truth) -> tuple[Silhouettes | None, list[str]]:
    """The masks of a result, ``masks/%06d.png``, in pixels of the truth.

    None where the result or the truth has none, and where their pixels have nothing known in
    common, which a remark explains.
    """
    files = {int(path.stem): path for path in folder.glob("[0-9]*.png") if path.stem.isdecimal()}
    sequence = truth.sequence
    if not files or not sequence.masks:
        return None, []
    frames = np.array(sorted(files))
    rows, others = match_frames(frames, truth, str(folder))

    def read(row: int) -> Mask:
        return read_silhouette(files[int(frames[row])], person=1)

    sizes = (read(0).shape, _gray(sequence.masks[0]).shape)
    video, true = ((height, width) for height, width in sizes)
    try:
        pixels = mask_pixels(folder.parent, video, true, sequence.rig)
    except InputError as error:
        return None, [f"{folder}: masks are not compared with true silhouettes: {error}"]
    return _beside(
        f"{folder}: masks",
        rows,
        others,
        lambda row, _: pixels.of_result(read(row)),
        truth,
        pixels,
    ), []


def _beside(
    what: str,
    rows: list[int],
    others: list[int],
    read: Callable[[int, int], Mask],
    truth: Truth,
    pixels: MaskPixels | None = None,
) -> Silhouettes:
    masks = truth.sequence.masks
    spread = np.unique(np.linspace(0, len(masks) - 1, _LOOKED).astype(int))
    brightest = max(int(_gray(masks[row]).max()) for row in spread)

    def true(row: int) -> Mask:
        mask: Mask = _gray(masks[row]) > brightest / 2  # 255, or labels: 0 and 1
        return mask if pixels is None else pixels.of_truth(mask)

    return Silhouettes(
        what,
        tuple(zip(rows, others, strict=True)),
        read,
        true,
        {int(number): row for row, number in enumerate(truth.sequence.frames.tolist())},
    )


def _gray(path: Path) -> NDArray[np.uint8]:
    image: NDArray[np.uint8] = decode_image(
        path, cv2.IMREAD_GRAYSCALE, "an image of a silhouette"
    ).astype(np.uint8)
    return image


def compare_silhouettes(
    folder: Path, surface: SurfaceFile | None, truth: Truth, every: int
) -> tuple[dict[str, float], list[str]]:
    """How well masks of a result, and its surface as drawn, cover the true silhouettes.

    Args:
        folder: of the masks.
        surface: of the result, where it has one.
        truth: what has the true ones.
        every: compare every so many frames.

    Returns:
        Scores by name, percent, and of how many frames they are; and mistakes in the true
        silhouettes, or in the camera of the truth, that those of the result show, or why masks
        are not compared.

    Raises:
        InputError: frames do not belong together, or an image cannot be used.
    """
    scores: dict[str, float] = {}
    masks, lacking = mask_silhouettes(folder, truth)
    drawn = None if surface is None else drawn_silhouettes(surface, truth)
    notes: list[str] = []
    covered = overlap = None
    if drawn is not None:
        overlap, notes = _scores(drawn, every)
        scores["silhouette_iou"] = overlap["iou"]
        scores["silhouette_frames"] = float(len(drawn.pairs[::every]))
    if masks is not None:
        covered, notes = _scores(masks, every)
        scores |= {f"segmentation_{name}": value for name, value in covered.items()}
        scores["segmentation_frames"] = float(len(masks.pairs[::every]))
        notes += _told(masks)
    if drawn is None or overlap is None or (masks is not None and notes):
        return scores, lacking + notes  # outlines would say what masks say
    if covered is None or covered["iou"] < 100 * _WELL:
        return scores, lacking + notes + _told(drawn)
    # A surface that is a little aside is the result's own fault; one with more or fewer clothes
    # than the person holds all of the silhouette, or lies within it
    holds = max(overlap["precision"], overlap["recall"])
    if overlap["iou"] < covered["iou"] - 100 * _WORSE and holds < 100 * _WELL:
        notes.append(
            f"masks of the result overlap with the true ones at {covered['iou']:.0f} %, its "
            f"surface, drawn in the camera of the truth, at {overlap['iou']:.0f} %; check that "
            "this is the camera of the capture, and its world"
        )
    return scores, notes


def _scores(silhouettes: Silhouettes, every: int) -> tuple[dict[str, float], list[str]]:
    """Mean of each score, percent, and that true silhouettes alone are empty."""
    found, empty = [], 0
    for mask, true in silhouettes.every(every):
        found.append(silhouette_scores(torch.tensor(mask), torch.tensor(true)))
        empty += bool(mask.any() and not true.any())
    names = ("iou", "precision", "recall", "boundary_f")
    scores = {name: 100 * float(np.mean([getattr(s, name) for s in found])) for name in names}
    notes = [
        f"the true silhouettes of {empty} of {len(found)} frames are empty, and count as 0 %; give "
        "those of the person, bright on black"
    ]
    return scores, notes if empty else []


def _told(silhouettes: Silhouettes) -> list[str]:
    pairs = silhouettes.pairs
    looked = [pairs[i] for i in np.unique(np.linspace(0, len(pairs) - 1, _LOOKED).astype(int))]
    numbers = {row: number for number, row in silhouettes.rows.items()}
    lags = range(-_LAGS, _LAGS + 1)
    scale, found, true = 1.0, [], []
    for row, other in looked:
        mask = silhouettes.read(row, other)
        scale = max(1.0, max(mask.shape) / _LONGEST)
        found.append(_small(mask, scale))
        around = [silhouettes.rows.get(numbers[other] + lag) for lag in lags]
        there = [None if each is None else silhouettes.true(each) for each in around]
        true.append(
            torch.stack(
                [
                    torch.zeros_like(found[-1]) if each is None else _small(each, scale)
                    for each in there
                ]
            )
        )
    said = silhouette_mismatches(torch.stack(found), torch.stack(true), lags, scale)
    return [
        f"{silhouettes.what} and true silhouettes {what}; check that the true ones are of this "
        "clip, person and camera, and the numbers of their frames"
        for what in said
    ]


def _small(mask: Mask, scale: float) -> Tensor:
    """A silhouette with so many pixels of the image along each side of its own."""
    size = [max(round(side / scale), 1) for side in mask.shape]
    image = torch.from_numpy(mask).to(torch.float32)[None, None]
    return functional.interpolate(image, size, mode="area")[0, 0] > 0.5


def _draw(surface: SurfaceFile, row: int, cameras: Camera, other: int) -> Mask:
    """Silhouette of a frame's surface in the first view."""
    camera = cameras.frames(slice(other, other + 1)) if cameras.moving else cameras
    lens = camera.distortion
    first = Camera(
        camera.intrinsics.reshape(-1, *camera.intrinsics.shape[-3:])[0, :1],
        camera.rotation.reshape(-1, *camera.rotation.shape[-3:])[0, :1],
        camera.translation.reshape(-1, *camera.translation.shape[-2:])[0, :1],
        None if lens is None else lens.reshape(-1, *lens.shape[-2:])[0, :1],
        size=camera.size[:1],
    )
    vertices = torch.from_numpy(surface.read(slice(row, row + 1))[0].astype(float))
    local = first.to_camera(vertices)
    faces = torch.tensor(surface.faces)
    drawn = rasterize(first.project_camera(local)[0], local[0, :, 2], faces, first.size[0])
    mask: Mask = drawn.mask.numpy()
    return mask
