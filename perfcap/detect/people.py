"""Networks that see a whole image and find several people in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.crop import Crop, Frame
from perfcap.detect.decode import decode
from perfcap.detect.joint_set import JointSet
from perfcap.detect.look import Look
from perfcap.detect.manifest import PEOPLE, Manifest, read_manifest
from perfcap.detect.search import whole
from perfcap.detect.session import Execution, Session, check_image_input, prepare_crops
from perfcap.errors import InputError

_ABOUT = 5  # numbers of a person beside the joints: a box, and how sure the person is
_MOST = 100  # people of one image


class OnnxFinder:
    """A network from disk, run by onnxruntime, that finds the people of an image.

    Its output is (N, P, J k + 5): of P people the k numbers of J joints, as ``output.columns``
    says, a box, which is not looked at, and how sure the network is of the person. The image is
    drawn into the middle of the input, black around it. Rows of no person have no joints, or no
    certainty.

    Args:
        model: folder with ``manifest.toml`` and the ONNX file it names, or the manifest.
        execution: provider and threads.

    Raises:
        InputError: the manifest or the model cannot be used, or do not fit each other; one line
            that names the field and the remedy.
    """

    def __init__(self, model: str | Path, *, execution: Execution | None = None) -> None:
        self._settings = str(model), execution
        self.manifest: Manifest = read_manifest(Path(model))
        if self.manifest.output.kind != PEOPLE:
            raise InputError(
                f"{self.manifest.path}: output.kind is {self.manifest.output.kind!r}, expected "
                f"{PEOPLE!r} of a network that finds the people of an image"
            )
        self.session = Session(self.manifest.file, execution)
        self._input, self._batch = check_image_input(
            self.manifest.path, self.manifest.input, self.session
        )
        self.session.require_output(self.manifest.output.names[0], "output.names")
        self(np.zeros((*self.manifest.input.size, 3), np.uint8))  # shapes show when it runs

    def __reduce__(self) -> tuple[Any, ...]:
        return _reopen, self._settings

    @property
    def joint_set(self) -> JointSet:
        """What the network calls its joints."""
        return self.manifest.joint_set

    def __call__(self, frame: Frame) -> list[Look]:
        """People of a frame (H, W, 3), the surest first, joints in pixels of the frame."""
        crop = Crop.around(whole(frame), self.manifest.input.size)
        rows, certainty = self._rows(crop.cut(frame))
        if not len(rows):
            return []
        found = decode({self.manifest.output.names[0]: rows}, self.manifest)
        side = max(crop.size)
        known = ((found.joints2d > -side) & (found.joints2d < 2 * side)).all(-1)  # no NaN either
        confidence = torch.where(known, found.confidence, 0)
        points = crop.to_image(torch.where(known[..., None], found.joints2d, 0))
        order = np.argsort(-certainty, kind="stable")
        return [Look(crop, points[p], confidence[p], None, None) for p in order if certainty[p] > 0]

    def _rows(self, image: Frame) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Joints (P, J k) and certainty (P,) of the people in an input (h, w, 3)."""
        name, spec = self.manifest.output.names[0], self.manifest.output
        copies = np.repeat(image[None], max(1, self._batch), 0)
        feeds = {self._input: prepare_crops(copies, self.manifest.input)}
        found = np.asarray(self.session.run(feeds, (name,))[0], np.float32)
        wide = spec.rows * len(spec.columns)
        if found.ndim != 3 or len(found) != len(copies) or found.shape[2] != wide + _ABOUT:
            raise InputError(
                f"{self.manifest.path}: output {name!r} has shape {found.shape}, expected "
                f"({len(copies)}, people, {wide + _ABOUT}): {spec.rows} joints of "
                f"{len(spec.columns)} numbers, a box and a score; check output.columns and rows"
            )
        if found.shape[1] > _MOST:
            raise InputError(
                f"{self.manifest.path}: output {name!r} has {found.shape[1]} people, expected "
                f"at most {_MOST}; export the network with fewer"
            )
        return found[0, :, :wide], np.nan_to_num(found[0, :, -1])


def _reopen(model: str, execution: Execution | None) -> OnnxFinder:
    return OnnxFinder(model, execution=execution)
