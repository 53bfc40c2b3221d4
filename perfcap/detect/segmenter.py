"""Person masks from an ONNX network, as a manifest describes it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.array_checks import require_picture, require_shape
from perfcap.detect.crop import Crop, Frame
from perfcap.detect.manifest import (
    InputSpec,
    ModelFile,
    open_manifest,
    read_input,
    read_model_file,
)
from perfcap.detect.session import Execution, Session, check_image_input, prepare_crops
from perfcap.detect.toml_table import TomlTable
from perfcap.errors import InputError

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]
Box = tuple[slice, slice]

_LEAST = 1e-4  # probability: a network is never surer
_CLASSES = 1000


@dataclass(frozen=True)
class SegmenterManifest:
    """A network of person masks on disk.

    Attributes:
        path: the manifest.
        file: the network.
        input: the crop it wants to see.
        output: name of the output, maps of any size.
        layout: of the output: ``nchw`` or ``nhwc``; without an axis of classes, ``nhw``.
        classes: of the output.
        person: which of them is a person, from 0.
        activation: what makes probabilities of the output: ``sigmoid``, ``softmax`` over classes,
            or ``none``.
    """

    path: Path
    file: ModelFile
    input: InputSpec
    output: str
    layout: str
    classes: int
    person: int
    activation: str


def read_segmenter_manifest(path: Path) -> SegmenterManifest:
    """Read and check the manifest of a segmenter's folder, or the file itself.

    Raises:
        InputError: one line that names the field and what to write there.
    """
    table = open_manifest(path, "segmenter")
    file = read_model_file(table)
    spec = read_input(table.table("input"))
    answer = table.table("output")
    classes = _whole(answer, "classes", 1)
    person = _whole(answer, "person", 0)
    activation = answer.text("activation", "sigmoid", ("sigmoid", "softmax", "none"))
    if classes > _CLASSES:
        answer.fail("classes", f"is {classes}", f"at most {_CLASSES}")
    if person >= classes:
        answer.fail("person", f"is {person} of {classes} classes", "one from 0 on")
    if activation == "softmax" and classes < 2:
        answer.fail("activation", "is softmax of one class", "sigmoid, or two or more classes")
    layout = answer.text("layout", "nchw", ("nchw", "nhwc", "nhw"))
    if layout == "nhw" and classes > 1:
        answer.fail("layout", f"is nhw with {classes} classes", "nchw or nhwc")
    name = answer.text("name")
    for part in (answer, table):
        part.done()
    return SegmenterManifest(table.path, file, spec, name, layout, classes, person, activation)


def _whole(table: TomlTable, key: str, default: int) -> int:
    return table.integer(key, default) if key in table else default


class OnnxSegmenter:
    """A network of person masks, run by onnxruntime.

    Args:
        model: folder with ``manifest.toml`` and the ONNX file it names, or the manifest.
        execution: provider and threads.

    Raises:
        InputError: the manifest or the model cannot be used, or do not fit each other.
    """

    def __init__(self, model: str | Path, *, execution: Execution | None = None) -> None:
        self._settings = str(model), execution
        self.manifest = read_segmenter_manifest(Path(model))
        self.session = Session(self.manifest.file, execution, (self.manifest.output,))
        spec = self.manifest.input
        self._input, self._batch = check_image_input(self.manifest.path, spec, self.session)
        self.session.require_output(self.manifest.output, "output.name")
        self.probabilities(np.zeros((1, *spec.size, 3), np.uint8))  # shapes show when it runs

    def __reduce__(self) -> tuple[Any, ...]:
        """Opened again in another process."""
        return _reopen, self._settings

    def __call__(self, image: Frame, model: Mask, spine: NDArray[np.floating], part: Box) -> Plane:
        """How sure the network is of the person, in a part of an image.

        Args:
            image: (H, W, 3) RGB.
            model: about where the person is, (h, w) of the part.
            spine: neck and middle of the hips, (2, 2) px of the image; not finite if unknown.
            part: rows and columns wanted.

        Returns:
            Log odds, (h, w); of the least probability where the network looked at nothing.

        Raises:
            InputError: the image is no RGB one in bytes, the model is of another part, or the spine
                no two points.
        """
        shape = part[0].stop - part[0].start, part[1].stop - part[1].start
        require_picture(image, "image")
        require_shape(model, "model", shape, "(h, w), of the part alone")
        require_shape(spine, "spine", (2, 2), "neck and middle of the hips, px")
        crop = self._crop(model, spine, part)
        if crop is None:
            return np.zeros(shape, np.float32)
        cut = crop.cut(image)[None]
        views = np.concatenate((cut, cut[:, :, ::-1])) if self.manifest.input.flip_test else cut
        odds = _log_odds(self.probabilities(views))
        if len(odds) == 2:
            odds = 0.5 * (odds[:1] + odds[1:, :, ::-1])
        return _paste(odds[0], crop, part)

    def probabilities(self, crops: NDArray[np.uint8]) -> Plane:
        """That a pixel shows a person, of crops (N, h, w, 3), RGB: (N, h', w') of any size."""
        size = self._batch or len(crops)
        parts = []
        for start in range(0, len(crops), size):
            batch = crops[start : start + size]
            filled = np.concatenate((batch, np.repeat(batch[-1:], size - len(batch), 0)))
            feed = {self._input: prepare_crops(filled, self.manifest.input)}
            (answer,) = self.session.run(feed, (self.manifest.output,))
            parts.append(self._of_person(answer)[: len(batch)])
        return np.concatenate(parts)

    def _of_person(self, answer: NDArray[Any]) -> Plane:
        spec = self.manifest
        axes = {"nchw": 4, "nhwc": 4, "nhw": 3}[spec.layout]
        maps = answer.astype(np.float32)
        if maps.ndim == axes and spec.layout == "nhwc":
            maps = maps.transpose(0, 3, 1, 2)
        if maps.ndim == axes == 3:
            maps = maps[:, None]
        if maps.ndim != 4 or maps.shape[1] != spec.classes:
            raise InputError(
                f"{spec.path}: output {spec.output!r} has shape {answer.shape}, expected "
                f"{spec.layout} of {spec.classes} classes; correct output.layout or output.classes"
            )
        if spec.activation == "softmax":
            maps = np.exp(maps - maps.max(1, keepdims=True))
            maps /= maps.sum(1, keepdims=True)
        found = maps[:, spec.person]
        if spec.activation == "sigmoid":
            found = (1 / (1 + np.exp(-np.clip(found, -30, 30)))).astype(np.float32)
        bad = not np.isfinite(found).all() or found.min() < -1e-3 or found.max() > 1 + 1e-3
        if bad:
            raise InputError(
                f"{spec.path}: output {spec.output!r} is {found.min():.3g} to {found.max():.3g}, "
                "expected probabilities; correct output.activation"
            )
        return found

    def _crop(self, model: Mask, spine: NDArray[np.floating], part: Box) -> Crop | None:
        """Around a person, turned upright if the network learned that."""
        rows, columns = np.nonzero(model)
        if not len(rows):
            return None
        angle = 0.0
        if self.manifest.input.turns == "upright" and np.isfinite(spine).all():
            right, down = spine[0] - spine[1]
            angle = math.atan2(right, -down)
        cos, sin = math.cos(angle), math.sin(angle)
        x, y = columns + part[1].start, rows + part[0].start
        across, along = cos * x + sin * y, cos * y - sin * x
        low, high = (
            (float(across.min()), float(along.min())),
            (float(across.max()), float(along.max())),
        )
        spec = self.manifest.input
        crop = Crop.around((*low, high[0] + 1, high[1] + 1), spec.size, spec.padding)
        u, v = crop.center
        return Crop((cos * u - sin * v, sin * u + cos * v), crop.width, spec.size, angle)


def _log_odds(probability: Plane) -> Plane:
    sure = np.clip(probability, _LEAST, 1 - _LEAST)
    odds: Plane = np.log(sure / (1 - sure)).astype(np.float32)
    return odds


def _paste(odds: Plane, crop: Crop, part: Box) -> Plane:
    """A map of a crop, (h', w'), in a part of the image."""
    to_image = np.eye(3)
    to_image[:2] = crop.matrix(torch.zeros((), dtype=torch.float64)).numpy()
    # pixel centres are integers: a map of another size than the crop covers the same rectangle
    across, down = crop.size[1] / odds.shape[1], crop.size[0] / odds.shape[0]
    to_crop = np.array([[across, 0, 0.5 * across - 0.5], [0, down, 0.5 * down - 0.5], [0, 0, 1]])
    corner = np.array([[1, 0, part[1].start], [0, 1, part[0].start], [0, 0, 1]], float)
    matrix = np.linalg.inv(to_image @ to_crop) @ corner
    size = (part[1].stop - part[1].start, part[0].stop - part[0].start)
    nothing = float(np.log(_LEAST))
    pasted: Plane = cv2.warpAffine(
        odds,
        matrix[:2],
        size,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=nothing,
    )
    return pasted


def _reopen(model: str, execution: Execution | None) -> OnnxSegmenter:
    return OnnxSegmenter(model, execution=execution)
