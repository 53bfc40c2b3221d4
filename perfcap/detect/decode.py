"""Outputs of a network to joints, as its manifest says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.candidates import Candidates, find_candidates
from perfcap.detect.heatmap import DECODERS, argmax2d, map_to_input, soft_argmax
from perfcap.detect.manifest import PEOPLE, Calibration, Manifest, OutputSpec
from perfcap.errors import InputError

# beyond what a calibration takes: confidences are a little above 1 at times, and -1 of nobody
_BEYOND, _NOBODY = 0.5, 1.5
_ROUNDED = 0.02  # of the bins of a classification, which are a side times a factor


@dataclass(frozen=True)
class Estimate:
    """Joints of N crops, in the order of the network's joint set.

    Attributes:
        joints2d: (N, J, 2), pixels of the crop.
        confidence: (N, J), 0 to 1; 0 everywhere for networks of 3D joints alone.
        joints3d: (N, J, 3), metres, root-relative, x right, y down, z forward; None without.
        candidates: where else the joints may be; None without heat maps.
    """

    joints2d: Tensor
    confidence: Tensor
    joints3d: Tensor | None
    candidates: Candidates | None = None

    def part(self, crops: slice) -> Estimate:
        """Those of some of the crops."""
        pose, others = self.joints3d, self.candidates
        return Estimate(
            self.joints2d[crops],
            self.confidence[crops],
            None if pose is None else pose[crops],
            None if others is None else Candidates(others.places[crops], others.support[crops]),
        )


def decode(outputs: Mapping[str, NDArray[np.float32]], manifest: Manifest) -> Estimate:
    """Read the joints of N crops.

    Raises:
        InputError: an output has another shape than the manifest says.
    """
    spec, joints = manifest.output, len(manifest.joint_set)
    named = {name: torch.from_numpy(np.asarray(a, np.float32)) for name, a in outputs.items()}
    maps = [named[name] for name in spec.names]
    reader = _Reader(manifest, joints)
    joints3d = heat = None
    if spec.kind in ("heatmaps", "location_maps"):
        maps = [reader.maps(name, value) for name, value in zip(spec.names, maps, strict=True)]
        heat = maps[0]
        points, raw = _read_maps(heat, spec, manifest.input.size)
        if spec.kind == "location_maps":
            joints3d = reader.positions(read_locations(heat, maps[1:]))
    elif spec.kind == "simcc":
        sides = manifest.input.size[::-1]
        points, raw = read_simcc(
            *(reader.bins(n, m, s) for n, m, s in zip(spec.names, maps, sides, strict=True))
        )
        points = points / spec.split
    elif spec.kind in ("coordinates", PEOPLE):  # of people, each is a row as a crop is
        points, raw = _read_columns(
            reader.rows(spec.names[0], maps[0], len(spec.columns)), manifest
        )
    else:
        (joints2d,) = (named[spec.joints3d],)
        points, raw = torch.zeros(len(joints2d), joints, 2), torch.zeros(len(joints2d), joints)
    if spec.joints3d:
        joints3d = reader.positions(reader.rows(spec.joints3d, named[spec.joints3d], 3))
    confidence = _confidence(raw, manifest)
    candidates = None
    if heat is not None:
        candidates = _read_candidates(heat, points, confidence, manifest)
    return Estimate(points, confidence, joints3d, candidates)


def read_simcc(x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """Largest bins of two classifications a joint (Li et al. 2022, SimCC).

    Args:
        x: scores of the bins of x, (N, J, bins).
        y: of y.

    Returns:
        Bins (N, J, 2) and the lesser of the two scores, (N, J).
    """
    score_x, place_x = x.max(-1)
    score_y, place_y = y.max(-1)
    return torch.stack((place_x, place_y), -1).to(x), torch.minimum(score_x, score_y)


def read_locations(heat: Tensor, maps: list[Tensor]) -> Tensor:
    """Metric coordinates where the heat map peaks (Mehta et al. 2017, VNect).

    Args:
        heat: (N, J, h, w).
        maps: of X, Y and Z, each (N, J, h, w).

    Returns:
        (N, J, 3), units of the maps.
    """
    peak, _ = argmax2d(heat)
    index = (peak[..., 1] * heat.shape[-1] + peak[..., 0]).long()[..., None]
    return torch.cat([axis.flatten(-2).gather(-1, index) for axis in maps], -1)


def calibrate(raw: Tensor, calibration: Calibration) -> Tensor:
    """Probability of raw confidences, linear between the knots and constant beyond them."""
    values = np.interp(raw.numpy(), calibration.raw, calibration.probability)
    return torch.from_numpy(np.asarray(values)).to(raw)


def _read_maps(heat: Tensor, spec: OutputSpec, size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    if spec.decode == "soft_argmax":
        (points, _), raw = soft_argmax(spec.sharpness * heat), heat.amax((-2, -1))
    else:
        points, raw = DECODERS[spec.decode](heat)
    height, width = heat.shape[-2:]
    return map_to_input(points, (height, width), size, spec.alignment), raw


def _read_candidates(
    heat: Tensor, points: Tensor, confidence: Tensor, manifest: Manifest
) -> Candidates:
    """In pixels of the crop; peaks as they were read."""
    mirrored = list(manifest.joint_set.mirrored())
    shape, size = (heat.shape[-2], heat.shape[-1]), manifest.input.size
    maps = heat.sigmoid() if manifest.output.activation == "sigmoid" else heat
    peaks, _ = argmax2d(maps)
    found = find_candidates(maps, peaks, confidence, mirrored)
    places = map_to_input(found.places, shape, size, manifest.output.alignment)
    places[:, :, 0], places[:, :, 2] = points, points[:, mirrored]
    return Candidates(places, found.support)


def _read_columns(rows: Tensor, manifest: Manifest) -> tuple[Tensor, Tensor]:
    spec = manifest.output
    height, width = manifest.input.size
    column = {name: rows[..., i] for i, name in enumerate(spec.columns)}
    points = torch.stack((column["x"], column["y"]), -1)
    if spec.units == "unit":
        points = points * points.new_tensor([width, height])
    return points, column.get("confidence", torch.ones_like(column["x"]))


def _confidence(raw: Tensor, manifest: Manifest) -> Tensor:
    if manifest.output.activation == "sigmoid":
        raw = raw.sigmoid()
    elif manifest.output.kind == "coordinates":
        # not of people, whose rows may be of nobody, and hold anything
        _require_probabilities(raw, manifest)
    return calibrate(raw.nan_to_num(0.0, 1.0, 0.0), manifest.calibration)


def _require_probabilities(raw: Tensor, manifest: Manifest) -> None:
    """Refuse columns of confidences that no calibration takes, such as logits."""
    known = raw[raw.isfinite()]
    if not len(known):
        return
    (low, high), knots = known.aminmax(), manifest.calibration.raw
    least, most = min(0.0, *knots), max(1.0, *knots)
    if low < least - _NOBODY or high > most + _BEYOND:
        raise InputError(
            f"{manifest.path}: confidences are {low:.3g} to {high:.3g}, expected {least:g} to "
            f'{most:g}: give output.activation = "sigmoid" where they are logits, or [calibration] '
            "up to the largest"
        )


@dataclass(frozen=True)
class _Reader:
    """Checks shapes of outputs against the joints named, and brings axes in order."""

    manifest: Manifest
    joints: int

    def maps(self, name: str, value: Tensor) -> Tensor:
        """(N, J, h, w)."""
        if value.dim() != 4:
            self._refuse(name, value, "maps of rank 4, (N, J, h, w)")
        if self.manifest.output.layout == "nhwc":
            value = value.permute(0, 3, 1, 2)
        return self._first_joints(name, value, f"{self.joints} maps; check output.layout")

    def bins(self, name: str, value: Tensor, side: int) -> Tensor:
        """(N, J, bins), of a crop with so many pixels along this side."""
        if value.dim() != 3:
            self._refuse(name, value, "scores of rank 3, (N, J, bins)")
        expected = side * self.manifest.output.split
        if abs(value.shape[2] - expected) > _ROUNDED * expected:
            self._refuse(
                name,
                value,
                f"{expected:g} bins: output.split of them a pixel, names of x and then of y,",
            )
        return self._first_joints(name, value, f"bins of {self.joints} joints")

    def rows(self, name: str, value: Tensor, columns: int) -> Tensor:
        """(N, J, columns), from any rank with the right count."""
        expected = f"{self.manifest.output.rows} x {columns} numbers a crop; check output.rows"
        count = self.manifest.output.rows * columns
        if value.dim() < 2 or value[0].numel() != count:
            self._refuse(name, value, expected)
        return value.reshape(len(value), -1, columns)[:, : self.joints]

    def positions(self, values: Tensor) -> Tensor:
        """Metres, x right, y down, z forward."""
        spec = self.manifest.output
        return values * spec.metres * values.new_tensor(spec.signs3d)

    def _first_joints(self, name: str, value: Tensor, expected: str) -> Tensor:
        if value.shape[1] != self.manifest.output.rows:
            self._refuse(name, value, expected)
        return value[:, : self.joints]

    def _refuse(self, name: str, value: Tensor, expected: str) -> None:
        raise InputError(
            f"{self.manifest.path}: output {name!r} has shape {tuple(value.shape)}, expected "
            f"{expected} for {self.manifest.joint_set.name} as output.kind "
            f"{self.manifest.output.kind!r}"
        )
