"""A trained detector as an ONNX file with a manifest, checked against torch, calibrated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.manifest import Calibration
from perfcap.errors import InputError
from perfcap.train.detector import Detector, DetectorMaps
from perfcap.train.export import TOLERANCE, save_network, to_onnx

# --- What the peak of a heat map is worth: the share of such joints that are found ----------------

_KNOTS = 9


def fit_calibration(
    peaks: NDArray[np.float64], found: NDArray[np.bool_], knots: int = _KNOTS
) -> Calibration:
    """The monotone map from peaks (N,) to the probability that a joint is found (N,).

    Isotonic regression by pooling neighbours that are in the wrong order (Barlow and others
    1972), read at quantiles of the peaks. Nothing is promised below the smallest peak: 0 there.
    """
    order = np.argsort(peaks, kind="stable")
    raw, hit = peaks[order].astype(np.float64), found[order].astype(np.float64)
    level, weight = _pooled(hit)
    fitted = np.repeat(level, weight.astype(int))
    inner = np.linspace(0, len(raw) - 1, knots).round().astype(int)
    places = np.concatenate([[0.0], raw[inner]])
    values = np.concatenate([[0.0], fitted[inner]])
    keep = np.concatenate([[True], np.diff(places) > 1e-6])
    return Calibration(tuple(float(v) for v in places[keep]), tuple(float(v) for v in values[keep]))


def _pooled(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means and sizes of the blocks of the rising sequence nearest to values."""
    means: list[float] = []
    sizes: list[float] = []
    for value in values:
        means.append(float(value))
        sizes.append(1.0)
        while len(means) > 1 and means[-2] >= means[-1]:
            size = sizes[-2] + sizes[-1]
            mean = (means[-2] * sizes[-2] + means[-1] * sizes[-1]) / size
            means[-2:], sizes[-2:] = [mean], [size]
    return np.array(means), np.array(sizes)


def expected_error(
    peaks: NDArray[np.float64],
    found: NDArray[np.bool_],
    calibration: Calibration,
    bins: int = 10,
) -> float:
    """Mean gap between what is promised and what is found (Naeini et al. 2015), 0 to 1."""
    confidence = np.interp(peaks, calibration.raw, calibration.probability)
    index = np.minimum((confidence * bins).astype(int), bins - 1)
    gap = 0.0
    for row in range(bins):
        here = index == row
        if here.any():
            gap += here.mean() * abs(float(confidence[here].mean()) - float(found[here].mean()))
    return gap


# --------------------------------------------------------------------------------------------------
# A trained detector as an ONNX file with a manifest, checked against torch before it is kept.

OUTPUTS = ("heat", "x", "y", "z")


def export_detector(
    detector: Detector, folder: Path, calibration: Calibration, origin: str, licence: str
) -> None:
    """Write ``model.onnx`` and ``manifest.toml`` of a detector.

    Args:
        detector: trained; exported as it is in evaluation.
        folder: where to; made if need be.
        calibration: of the peaks of its heat maps.
        origin: of the weights, a sentence.
        licence: of the weights.

    Raises:
        InputError: the exporter is not installed, or onnxruntime answers otherwise than torch.
    """
    model = DetectorMaps(detector.cpu().float()).eval()
    size = detector.config.size
    axes = {"crops": {0: torch.export.Dim("crops")}}
    data = to_onnx(model, torch.zeros(2, 3, size, size), OUTPUTS, axes)
    check_maps_equal(model, data, size)
    names = ", ".join(f'"{name}"' for name in LANDMARKS)
    network = f"""[input]
size = [{size}, {size}]
color = "rgb"
flip_test = true  # twice the time, and better

[output]
kind = "location_maps"
names = ["heat", "x", "y", "z"]
decode = "dark"
alignment = "centers"
crop_axes = true

[joints]
names = [{names}]

[calibration]  # share of joints within a fifth of the torso, by the peak of the heat map
raw = {_numbers(calibration.raw)}
probability = {_numbers(calibration.probability)}
"""
    head = '# A detector: the crop of a person to 2D joints and 3D positions.\nkind = "detector"'
    save_network(folder, data, head, (origin, licence), network)


def check_maps_equal(model: DetectorMaps, data: bytes, size: int) -> None:
    """Compare the export with the module on batches of one and three crops.

    Raises:
        InputError: heat maps or positions (m) differ by more than 1e-4.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    generator = torch.Generator().manual_seed(0)
    for count in (1, 3):
        crops = 255 * torch.rand(count, 3, size, size, generator=generator)
        with torch.no_grad():
            expected = model(crops)
        found = session.run(list(OUTPUTS), {"crops": crops.numpy()})
        for name, ours, theirs in zip(OUTPUTS, expected, found, strict=True):
            worst = float(np.abs(ours.numpy() - theirs).max())
            if not worst <= TOLERANCE:
                raise InputError(
                    f"export: output {name!r} of onnxruntime differs from torch by {worst:.2g}, "
                    f"expected at most {TOLERANCE:g}; export with other versions of torch or "
                    "onnxscript"
                )


def _numbers(values: tuple[float, ...]) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"
