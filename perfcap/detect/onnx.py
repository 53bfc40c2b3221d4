"""Joint networks in ONNX files: images to ``Detections``, as a manifest describes them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.array_checks import require_picture
from perfcap.detect.candidates import Candidates, join_candidates, merge_candidates
from perfcap.detect.crop import Frame
from perfcap.detect.decode import Estimate, decode
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import JointSet
from perfcap.detect.look import Box, Finder
from perfcap.detect.manifest import PEOPLE, Manifest, read_manifest
from perfcap.detect.person import Start, follow_person
from perfcap.detect.session import Execution, Session, check_image_input, prepare_crops
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera

_BATCH, _CPU_BATCH = 16, 4  # crops in one call; of more the CPU's caches hold too little
_APART = 0.05  # of the crop's diagonal: what its mirror image may move a joint and be averaged
_SAME = 0.03  # of it: what the mirror image may move a candidate that is taken for the same
_ROUNDING = 0.25  # of a white pixel: cubic filters overshoot by 0.2


class OnnxDetector:
    """A joint network from disk, run by onnxruntime.

    Args:
        model: folder with ``manifest.toml`` and the ONNX file it names, or the manifest.
        execution: provider and threads.
        flip_test: look at every crop and its mirror image, and average. Twice the time. None: as
            the manifest says.

    Raises:
        InputError: the manifest or the model cannot be used, or do not fit each other; one line
            that names the field and the remedy.
    """

    def __init__(
        self,
        model: str | Path,
        *,
        execution: Execution | None = None,
        flip_test: bool | None = None,
    ) -> None:
        self._settings = str(model), execution, flip_test
        self.manifest: Manifest = read_manifest(Path(model))
        if self.manifest.output.kind == PEOPLE:
            raise InputError(
                f"{self.manifest.path}: finds the people of whole images, expected a network of "
                "one person in a crop; name it first, and one that looks up close after it"
            )
        self.session = Session(self.manifest.file, execution, _outputs(self.manifest))
        self.flip_test = self.manifest.input.flip_test if flip_test is None else flip_test
        self._input, self._batch = check_image_input(
            self.manifest.path, self.manifest.input, self.session
        )
        self._outputs = _outputs(self.manifest)
        _check_outputs(self.manifest, self.session)
        height, width = self.manifest.input.size
        self.estimate(np.zeros((1, height, width, 3), np.uint8))  # shapes show when it runs

    def __reduce__(self) -> tuple[Any, ...]:
        return _reopen, self._settings

    @property
    def joint_set(self) -> JointSet:
        """What the network calls its joints."""
        return self.manifest.joint_set

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know: where it runs, which landmarks it never sees."""
        missing = self.joint_set.missing()
        name = self.manifest.path.parent
        note = f"{name}: {self.joint_set.name} has no {', '.join(missing)}"
        if self.sees_poses:
            note += "; its 3D poses are not used, which need all of the 16 landmarks"
        return (*self.session.warnings, *((note,) if missing else ()))

    @property
    def sees_poses(self) -> bool:
        """Whether it answers with 3D joints."""
        spec = self.manifest.output
        return bool(spec.joints3d) or spec.kind in ("location_maps", "joints3d")

    @property
    def crop_size(self) -> tuple[int, int]:
        """(height, width) of what the network looks at, pixels."""
        return self.manifest.input.size

    def __call__(
        self,
        images: Tensor,
        boxes: Sequence[Box | None] | None = None,
        cameras: Camera | None = None,
        finder: Finder | None = None,
    ) -> Detections:
        """Detect one person, followed from frame to frame in each view.

        Args:
            images: (F, C, 3, H, W), RGB, uint8 or floats 0 to 1.
            boxes: where the person is in the first frame of each view: (left, top, right,
                bottom), pixels; searched for in the whole image where None.
            cameras: C views; needed where 3D joints come in the axes of crops.
            finder: finds people in whole images, such as ``OnnxFinder``, and separates other
                people nearby; windows are searched without one.

        Returns:
            Detections of the 16 landmarks, (F, C), in pixels of the images; confidence 0 where
            nobody is found. Floats follow the images, float32 for uint8.
        """
        frames = _as_bytes(images)
        given = boxes or [None] * images.shape[1]
        if len(given) != images.shape[1]:
            raise InputError(
                f"boxes: are {len(given)}, expected one for each of {len(frames)} views"
            )
        found = [
            self.follow(frames[:, c], box, None if cameras is None else cameras.select([c]), finder)
            for c, box in enumerate(given)
        ]
        whole = stack_views(found)
        return whole.to(images) if images.is_floating_point() else whole

    def follow(
        self,
        frames: Iterable[Frame],
        box: Box | None = None,
        camera: Camera | None = None,
        finder: Finder | None = None,
    ) -> Detections:
        """The same for the frames (H, W, 3) of one view, read as they are needed: (F, 1).

        Raises:
            InputError: a frame is no RGB image in bytes, or the box is none in pixels.
        """
        frames = _pictures(frames)
        return follow_person(self, frames, Start(box, finder=finder, watcher=finder), camera)

    def estimate(self, crops: NDArray[np.uint8]) -> Estimate:
        """Joints of crops (N, h, w, 3), RGB, in pixels of the crops."""
        if not len(crops):  # onnxruntime answers an empty batch with outputs of any rank
            return self._nothing()
        if not self.flip_test:
            return self._run(crops)
        both, count = self._run(np.concatenate((crops, crops[:, :, ::-1]))), len(crops)
        straight, mirrored = both.part(slice(0, count)), both.part(slice(count, None))
        return _average(straight, self._mirror(mirrored), self.crop_size)

    def _run(self, crops: NDArray[np.uint8]) -> Estimate:
        most = _CPU_BATCH if self.session.provider.startswith("CPU") else _BATCH
        size = self._batch or most
        parts = [self._run_batch(crops[i : i + size], size) for i in range(0, len(crops), size)]
        return _join(parts)

    def _run_batch(self, crops: NDArray[np.uint8], size: int) -> Estimate:
        count = len(crops)
        if self._batch and count < size:  # an export of fixed batch gets copies to fill it
            crops = np.concatenate((crops, np.repeat(crops[-1:], size - count, 0)))
        outputs = self.session.run(
            {self._input: prepare_crops(crops, self.manifest.input)}, self._outputs
        )
        named = {
            name: value[:count] if value.ndim else value[None]
            for name, value in zip(self._outputs, outputs, strict=True)
        }
        found = decode(named, self.manifest)
        if len(found.joints2d) != count:
            raise InputError(
                f"{self.manifest.file.path}: answers {size} crops with {len(found.joints2d)} "
                "poses; export it with the crops as first axis of every output"
            )
        return found

    def _mirror(self, found: Estimate) -> Estimate:
        """What was seen in mirror images, back on its own side."""
        order = list(self.joint_set.mirrored())
        flip, shift = torch.tensor([-1.0, 1.0]), torch.tensor([self.crop_size[1] - 1.0, 0.0])
        joints2d = found.joints2d[:, order] * flip + shift
        joints3d = candidates = None
        if found.joints3d is not None:
            joints3d = found.joints3d[:, order] * torch.tensor([-1.0, 1.0, 1.0])
        if found.candidates is not None:
            own = found.candidates.take(order)
            candidates = Candidates(own.places * flip + shift, own.support)
        return Estimate(joints2d, found.confidence[:, order], joints3d, candidates)

    def _nothing(self) -> Estimate:
        joints = len(self.joint_set)
        none3d = torch.zeros(0, joints, 3) if self.sees_poses else None
        return Estimate(torch.zeros(0, joints, 2), torch.zeros(0, joints), none3d)


def stack_views(views: Sequence[Detections]) -> Detections:
    """Views of as many frames, each (F, 1), side by side: (F, C)."""
    joints3d = None
    if any(view.joints3d is not None for view in views):
        poses = [
            torch.zeros(*view.joints2d.shape[:-1], 3) if view.joints3d is None else view.joints3d
            for view in views
        ]
        joints3d = torch.cat(poses, 1)
    said = [view.deviation3d for view in views if view.deviation3d is not None]
    return Detections(
        torch.cat([view.joints2d for view in views], 1),
        torch.cat([view.confidence2d for view in views], 1),
        joints3d,
        torch.cat([view.trusted3d for view in views], 1),
        torch.cat(said, 1) if len(said) == len(views) else None,
    )


def _pictures(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Frames as they are, refused where they are no RGB images in bytes."""
    for number, frame in enumerate(frames):
        require_picture(frame, f"frame {number}")
        yield frame


def _reopen(model: str, execution: Execution | None, flip_test: bool | None) -> OnnxDetector:
    return OnnxDetector(model, execution=execution, flip_test=flip_test)


def _as_bytes(images: Tensor) -> NDArray[np.uint8]:
    """Images (F, C, 3, H, W) as bytes (F, C, H, W, 3)."""
    if not isinstance(images, Tensor):
        raise InputError(
            f"images: are a {type(images).__name__}, expected a tensor (F, C, 3, H, W), RGB; "
            "torch.from_numpy makes one of an array"
        )
    if images.dim() != 5 or images.shape[2] != 3:
        raise InputError(
            f"images: have shape {tuple(images.shape)}, expected (F, C, 3, H, W), RGB; add the "
            "axes that are missing"
        )
    if images.is_floating_point():
        _require_shares(images)
        images = (images.clamp(0, 1) * 255).round().to(torch.uint8)
    if images.dtype != torch.uint8:
        raise InputError(f"images: are {images.dtype}, expected uint8, or floats 0 to 1")
    return images.permute(0, 1, 3, 4, 2).cpu().numpy()


def _require_shares(images: Tensor) -> None:
    """Refuse values of another range: they would be cut off, and next to nothing left of them."""
    low, high = (float(end) for end in images.detach().aminmax()) if images.numel() else (0.0, 0.0)
    if not (low >= -_ROUNDING and high <= 1 + _ROUNDING):
        raise InputError(
            f"images: are {images.dtype} of {low:.3g} to {high:.3g}, expected floats 0 to 1, or "
            "uint8; divide bytes by 255, and leave mean and deviation to the manifest"
        )


def _outputs(manifest: Manifest) -> tuple[str, ...]:
    """Names of the outputs to ask for."""
    further = (manifest.output.joints3d,) if manifest.output.joints3d else ()
    return tuple(dict.fromkeys((*manifest.output.names, *further)))


def _check_outputs(manifest: Manifest, session: Session) -> None:
    """Refuse a model without the outputs that its manifest names."""
    for name in manifest.output.names:
        session.require_output(name, "output.names")
    if manifest.output.joints3d:
        session.require_output(manifest.output.joints3d, "output.joints3d")


def _join(parts: Sequence[Estimate]) -> Estimate:
    poses = [part.joints3d for part in parts if part.joints3d is not None]
    return Estimate(
        torch.cat([part.joints2d for part in parts]),
        torch.cat([part.confidence for part in parts]),
        torch.cat(poses) if poses else None,
        join_candidates([part.candidates for part in parts]),
    )


def _average(one: Estimate, other: Estimate, size: tuple[int, int]) -> Estimate:
    """Mean of two views of the same crops by confidence; the surer one where they disagree."""
    weights = torch.stack((one.confidence, other.confidence))
    diagonal = float(np.hypot(*size))
    apart = (one.joints2d - other.joints2d).norm(dim=-1) > _APART * diagonal
    surer = (weights == weights.amax(0)).to(weights)
    shares = torch.where(apart, surer, weights) + 1e-6
    shares = shares / shares.sum(0)
    points = shares[0, ..., None] * one.joints2d + shares[1, ..., None] * other.joints2d
    joints3d = candidates = None
    if one.joints3d is not None and other.joints3d is not None:
        joints3d = 0.5 * (one.joints3d + other.joints3d)
    if one.candidates is not None and other.candidates is not None:
        candidates = merge_candidates(one.candidates, other.candidates, _SAME * diagonal)
    return Estimate(points, weights.mean(0), joints3d, candidates)
