"""3D poses from 2D tracks, by a network in an ONNX file: what makes one view enough."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.lifting import FEATURES, lifting_features
from perfcap.detect.manifest import ModelFile, open_manifest, read_model_file
from perfcap.detect.session import Execution, Session
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera

_CHUNK = 2000  # frames in one call: bounds memory
_MIN_JOINTS = 6  # of a frame, with which its pose may be trusted
_MIRRORED = list(LANDMARKS16.mirrored())
_UPPER = [LANDMARKS.index(n) for n in ("head_top", "neck", "r_shoulder", "l_shoulder")]
_LOWER = [LANDMARKS.index(n) for n in ("r_knee", "r_ankle", "l_knee", "l_ankle")]
_DENSEST = 10  # frames made of one, where a clip has fewer than networks know
_SURER = 0.75  # of the expected error, below which somebody is taken for upright, not lying


@dataclass(frozen=True)
class LifterManifest:
    """A lifter on disk.

    Attributes:
        path: the manifest.
        file: the network.
        rate: frames a second that it was trained at.
        reach: frames either side that an answer depends on.
        joints: output of the poses, (N, F, 16, 3).
        spread: output of the expected errors, (N, F, 16).
    """

    path: Path
    file: ModelFile
    rate: float
    reach: int
    joints: str
    spread: str


def read_lifter_manifest(folder: Path) -> LifterManifest:
    """Read and check the manifest of a lifter's folder, or the file itself.

    Raises:
        InputError: one line that names the field and what to write there.
    """
    table = open_manifest(folder, "lifter")
    file = read_model_file(table)
    given, answer = table.table("input"), table.table("output")
    manifest = LifterManifest(
        table.path,
        file,
        given.number("rate", low=1.0),
        given.integer("reach"),
        answer.text("joints"),
        answer.text("spread"),
    )
    for part in (given, answer, table):
        part.done()
    return manifest


class OnnxLifter:
    """A lifter from disk, run by onnxruntime.

    Args:
        model: folder with ``manifest.toml`` and the ONNX file it names, or the manifest.
        execution: provider and threads.
        flip_test: lift every track and its mirror image, and average. Twice the time.

    Raises:
        InputError: the manifest or the model cannot be used, or do not fit each other.
    """

    def __init__(
        self, model: str | Path, *, execution: Execution | None = None, flip_test: bool = True
    ) -> None:
        self._settings = str(model), execution, flip_test
        self.manifest = read_lifter_manifest(Path(model))
        self.session = Session(self.manifest.file, execution)
        self.flip_test = flip_test
        self._check()

    def __reduce__(self) -> tuple[Any, ...]:
        """Opened again in another process."""
        return _reopen, self._settings

    def __call__(self, detections: Detections, cameras: Camera, rate: float) -> Detections:
        """Give 3D poses to frames of views that have none.

        Args:
            detections: (F, C, 16), pixels.
            cameras: C views in these pixels.
            rate: frames a second.

        Returns:
            The same with ``joints3d`` and ``deviation3d``; a frame is trusted where at least six
            joints are seen. Trusted 3D poses are kept.
        """
        joints, spread = self.lift(detections, cameras, rate)
        seen = (detections.confidence2d > 0).sum(-1) >= _MIN_JOINTS
        if detections.joints3d is None:
            deviation = _overall(spread)
            return replace(detections, joints3d=joints, trusted3d=seen, deviation3d=deviation)
        lacks = seen & ~detections.trusted3d
        joints = torch.where(lacks[..., None, None], joints, detections.joints3d)
        return replace(
            detections,
            joints3d=joints,
            trusted3d=detections.trusted3d | lacks,
            deviation3d=_deviation(detections, lacks, spread),
        )

    def lift(self, detections: Detections, cameras: Camera, rate: float) -> tuple[Tensor, Tensor]:
        """Poses and how far they are expected to be off.

        Networks know people who stand. Where one seems to lie, the view is also tried a quarter or
        half a turn about its axis, and that is believed where the network is much surer of it: a
        camera on its side, rather than somebody on the ground.

        Returns:
            Joints (F, C, 16, 3), metres, in camera axes, relative to the middle of the hips; and
            the expected distance of each from the truth, (F, C, 16), metres.

        Raises:
            InputError: the rate is no number of frames a second.
        """
        if not 0 < rate < math.inf:
            raise InputError(f"rate is {rate}, expected frames a second, above 0")
        plane = cameras.to_plane(detections.joints2d).transpose(0, 1).float()
        confidence = detections.confidence2d.transpose(0, 1).float()
        if not plane.shape[1]:
            empty = detections.joints2d
            return empty.new_zeros(*empty.shape[:-1], 3), empty.new_zeros(empty.shape[:-1])
        joints, spread = self._at_rate(plane, confidence, rate)
        turns = _upright(plane, confidence)
        for view, turn in enumerate(turns):
            if bool((turn == torch.eye(2)).all()):
                continue
            part = slice(view, view + 1)
            turned, doubt = self._at_rate(plane[part] @ turn.mT, confidence[part], rate)
            if doubt.mean() < _SURER * spread[part].mean():
                joints[part] = torch.cat((turned[..., :2] @ turn, turned[..., 2:]), -1)
                spread[part] = doubt
        like = detections.joints2d
        return joints.transpose(0, 1).to(like), spread.transpose(0, 1).to(like)

    def _at_rate(self, plane: Tensor, confidence: Tensor, rate: float) -> tuple[Tensor, Tensor]:
        """Poses (C, F, 16, 3) and expected errors (C, F, 16) of tracks at any rate."""
        denser = min(round(self.manifest.rate / rate), _DENSEST)
        if denser > 1:
            answers = self.lift_tracks(*_denser(plane, confidence, denser))
            return answers[0][:, ::denser], answers[1][:, ::denser]
        frames = plane.shape[1]
        step = min(max(1, round(rate / self.manifest.rate)), frames)
        found = []
        for phase in range(step):  # every step-th frame is a track at the usual rate
            part = slice(phase, None, step)
            parts = self.lift_tracks(plane[:, part], confidence[:, part])
            found.append([_between(answer, phase, step, frames) for answer in parts])
        # tracks answer for the frames between theirs too: their mean does not flicker
        joints, spread = (torch.stack(parts).mean(0) for parts in zip(*found, strict=True))
        return joints, spread

    def lift_tracks(self, plane: Tensor, confidence: Tensor) -> tuple[Tensor, Tensor]:
        """Poses of undistorted tracks at the usual rate, float32.

        Args:
            plane: x/z and y/z of the landmarks, (N, F, 16, 2).
            confidence: (N, F, 16).

        Returns:
            Joints (N, F, 16, 3), metres, in camera axes, and their expected errors (N, F, 16).
        """
        features, turn = lifting_features(plane, confidence)
        joints, spread = self._run(features)
        if self.flip_test:
            flipped, other = self._run(mirrored_features(features))
            flipped = flipped[..., _MIRRORED, :] * flipped.new_tensor([-1.0, 1.0, 1.0])
            # where both are apart, more is to be expected than each says
            apart = 0.5 * (joints - flipped)
            square = 0.5 * (spread.square() + other[..., _MIRRORED].square())
            joints, spread = joints - apart, (square + apart.square().sum(-1)).sqrt()
        return joints @ turn.mT, spread

    def _run(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """In parts that overlap by the reach, so that parts do not show."""
        frames, reach = features.shape[1], self.manifest.reach
        found: list[list[NDArray[np.float32]]] = []
        for start in range(0, frames, _CHUNK):
            low, stop = max(0, start - reach), min(frames, start + _CHUNK)
            part = features[:, low : min(frames, stop + reach)]
            outputs = self.session.run(
                {self.session.inputs[0]: part.numpy()}, (self.manifest.joints, self.manifest.spread)
            )
            found.append([array[:, start - low : stop - low] for array in outputs])
        joints, spread = (np.concatenate(arrays, 1) for arrays in zip(*found, strict=True))
        return torch.from_numpy(joints), torch.from_numpy(spread)

    def _check(self) -> None:
        """Refuse a model that does not fit its manifest."""
        manifest, session = self.manifest, self.session
        session.require_output(manifest.joints, "output.joints")
        session.require_output(manifest.spread, "output.spread")
        shape = session.shapes[session.inputs[0]]
        if len(session.inputs) != 1 or len(shape) != 3 or shape[-1] not in (None, FEATURES):
            raise InputError(
                f"{manifest.path}: the model's input is {session.inputs[0]} {shape}, expected one "
                f"of (N, F, {FEATURES}); give a lifter that perfcap exported"
            )
        frames = 5  # no length that an export could have kept by mistake
        zeros = np.zeros((1, frames, FEATURES), np.float32)
        outputs = session.run({session.inputs[0]: zeros}, (manifest.joints, manifest.spread))
        expected = (1, frames, len(LANDMARKS), 3), (1, frames, len(LANDMARKS))
        for name, array, shape in zip(
            (manifest.joints, manifest.spread), outputs, expected, strict=True
        ):
            if array.shape != shape:
                raise InputError(
                    f"{manifest.path}: output {name!r} has shape {array.shape}, expected {shape} "
                    f"for {frames} frames; give a lifter that perfcap exported"
                )


def _deviation(detections: Detections, lacks: Tensor, spread: Tensor) -> Tensor:
    """Expected errors (F, C) where poses are lifted, and those known before elsewhere."""
    known = detections.deviation3d
    others = torch.full_like(spread[..., 0], torch.nan) if known is None else known
    return torch.where(lacks, _overall(spread), others)


def _overall(spread: Tensor) -> Tensor:
    """Root mean square over joints: one that is far off makes a bad pose."""
    mean: Tensor = spread.square().mean(-1).sqrt()
    return mean


def _between(values: Tensor, phase: int, step: int, frames: int) -> Tensor:
    """Values (C, n, ...) of the frames phase, phase + step, ... linearly at all (C, F, ...)."""
    if step == 1:
        return values
    place = (torch.arange(frames) - phase) / step
    place = place.clamp(0, values.shape[1] - 1)
    before = place.floor().long()
    after = (before + 1).clamp(max=values.shape[1] - 1)
    share = (place - before).reshape(-1, *[1] * (values.dim() - 2)).to(values)
    return torch.lerp(values[:, before], values[:, after], share)


def _denser(plane: Tensor, confidence: Tensor, times: int) -> tuple[Tensor, Tensor]:
    """Tracks (C, F, ...) of so many times the frames, between those where both ends are seen."""
    frames = (plane.shape[1] - 1) * times + 1
    seen = _between((confidence > 0).to(confidence), 0, times, frames)
    known = _between(confidence, 0, times, frames)
    return _between(plane, 0, times, frames), torch.where(seen == 1, known, 0.0)


def _upright(plane: Tensor, confidence: Tensor) -> Tensor:
    """Quarter turns after which people are upright in most frames of a view, (C, 2, 2)."""
    high, low = (_mean(plane, confidence, part) for part in (_UPPER, _LOWER))
    up = (high - low).nanmedian(1).values.nan_to_num(0.0)  # C 2
    quarters = (torch.atan2(up[:, 0], -up[:, 1]) / (0.5 * torch.pi)).round().long() % 4
    quarters = torch.where((up == 0).all(-1), 0, quarters)
    cosine = torch.tensor([1.0, 0.0, -1.0, 0.0])[quarters]
    sine = torch.tensor([0.0, -1.0, 0.0, 1.0])[quarters]
    return torch.stack((cosine, -sine, sine, cosine), -1).reshape(-1, 2, 2)


def _mean(plane: Tensor, confidence: Tensor, joints: list[int]) -> Tensor:
    """Of what is seen of some joints, (C, F, 2); NaN where nothing is."""
    weight = confidence[..., joints]
    return (weight[..., None] * plane[..., joints, :]).sum(-2) / weight.sum(-1, keepdim=True)


def mirrored_features(features: Tensor) -> Tensor:
    """Features (..., 49) of the mirror image of a track."""
    count = len(LANDMARKS)
    places = features[..., : 2 * count].reshape(*features.shape[:-1], count, 2)
    places = places[..., _MIRRORED, :] * features.new_tensor([-1.0, 1.0])
    confidence = features[..., 2 * count : 3 * count][..., _MIRRORED]
    return torch.cat((places.flatten(-2), confidence, features[..., 3 * count :]), -1)


def _reopen(model: str, execution: Execution | None, flip_test: bool) -> OnnxLifter:
    return OnnxLifter(model, execution=execution, flip_test=flip_test)
