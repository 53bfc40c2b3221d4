"""A trained detector as an ONNX file with a manifest, checked against torch before it is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.manifest import Calibration
from perfcap.errors import InputError
from perfcap.train.detector import Detector, DetectorMaps
from perfcap.train.export import TOLERANCE, save_network, to_onnx

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
