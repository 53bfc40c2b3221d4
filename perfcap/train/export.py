"""Trained networks as ONNX files with a manifest, checked against torch before they are kept."""

from __future__ import annotations

import hashlib
import logging
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.lifting import FEATURES
from perfcap.detect.manifest import FILE as MANIFEST
from perfcap.detect.manifest import Calibration
from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.publish import publishing
from perfcap.train.detector import Detector, DetectorMaps
from perfcap.train.lifter import Lifter, LifterCommittee

MODEL = "model.onnx"
TOLERANCE = 1e-4  # m
_OPSET = 20
_LENGTHS = ((1, 1), (2, 7), (1, 200))  # tracks and frames that the export is compared on


def export_lifter(
    lifter: Lifter | LifterCommittee, folder: Path, rate: float, origin: str, licence: str
) -> None:
    """Write ``model.onnx`` and ``manifest.toml`` of a lifter.

    Args:
        lifter: trained; exported as it is in evaluation.
        folder: where to; made if need be.
        rate: frames a second that it was trained at.
        origin: of the weights, a sentence.
        licence: of the weights.

    Raises:
        InputError: the exporter is not installed, or onnxruntime answers otherwise than torch.
    """
    lifter.eval()
    example = torch.zeros(2, 9, FEATURES)
    axes = {"features": {0: torch.export.Dim("tracks"), 1: torch.export.Dim("frames")}}
    data = to_onnx(lifter, example, ("joints", "spread"), axes)
    check_equal(lifter, data)
    network = f"""[input]
rate = {rate:g}  # frames a second
reach = {lifter.config.reach}  # frames either side that an answer depends on

[output]
joints = "joints"  # (N, F, 16, 3), metres, about the middle of the hips
spread = "spread"  # (N, F, 16), metres that each is expected to be off
"""
    head = '# A lifter: 2D joint tracks to 3D poses.\nkind = "lifter"'
    save_network(folder, data, head, (origin, licence), network)


def save_network(
    folder: Path, data: bytes, head: str, weights: tuple[str, str], network: str
) -> None:
    """Write ``model.onnx`` and its ``manifest.toml``.

    Args:
        folder: where to; made if need be.
        data: the network as ONNX.
        head: TOML before the table of the file.
        weights: their origin and licence, a sentence each.
        network: TOML after it, of what goes in and comes out.
    """
    origin, licence = weights
    text = f"""{head}

[[file]]
name = "{MODEL}"
size = {len(data)}
sha256 = "{hashlib.sha256(data).hexdigest()}"
licence = {quoted(licence)}
origin = {quoted(origin)}

{network}"""
    with publishing(folder) as scratch:
        for name, content in ((MODEL, data), (MANIFEST, text.encode())):
            with writing(scratch / name) as file:
                file.write(content)


def to_onnx(
    model: nn.Module,
    example: Tensor,
    outputs: tuple[str, ...],
    axes: dict[str, dict[int, Any]],
) -> bytes:
    """A module of one tensor as ONNX, weights inside.

    Args:
        model: in evaluation.
        example: of its input.
        outputs: names of its outputs.
        axes: open axes of the input, under the name of its argument.

    Raises:
        InputError: the exporter is not installed.
    """
    try:
        import onnxscript  # noqa: F401
    except ImportError:
        raise InputError(
            "onnxscript is not installed; the export needs it: pip install 'perfcap[train]'"
        ) from None
    quiet = logging.getLogger("torch.onnx")
    level = quiet.level
    try:
        quiet.setLevel(logging.ERROR)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the exporter about itself
            program = torch.onnx.export(
                model,
                (example,),
                input_names=list(axes),
                output_names=list(outputs),
                dynamic_shapes=axes,
                opset_version=_OPSET,
                dynamo=True,
                verbose=False,
            )
    finally:
        quiet.setLevel(level)
    assert program is not None
    return _without_traces(program.model_proto)


def _without_traces(model: Any) -> bytes:
    """The bytes of a model without what the exporter noted about this machine's source files."""
    for node in model.graph.node:
        del node.metadata_props[:]
        node.doc_string = ""
    for value in (*model.graph.value_info, *model.graph.input, *model.graph.output):
        del value.metadata_props[:]
    del model.graph.metadata_props[:]
    del model.metadata_props[:]
    data: bytes = model.SerializeToString(deterministic=True)
    return data


def check_equal(lifter: Lifter | LifterCommittee, data: bytes) -> None:
    """Compare the export with the module, on tracks of several lengths.

    Raises:
        InputError: they differ by more than a tenth of a millimetre, or are not finite.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    generator = torch.Generator().manual_seed(0)
    for shape in _LENGTHS:
        features = torch.randn(*shape, FEATURES, generator=generator)
        with torch.no_grad():
            expected = lifter(features)
        _require_finite(expected)
        found = session.run(["joints", "spread"], {"features": features.numpy()})
        worst = max(
            float(np.abs(a - b.numpy()).max()) for a, b in zip(found, expected, strict=True)
        )
        if not worst <= TOLERANCE:
            raise InputError(
                f"export: onnxruntime differs from torch by {worst:.2g} m on {shape[1]} frames, "
                f"expected at most {TOLERANCE:g}; export with other versions of torch or onnxscript"
            )


def _require_finite(answers: Iterable[Tensor]) -> None:
    """Refuse a network that diverged, as its loss may be finite still."""
    if not all(bool(answer.isfinite().all()) for answer in answers):
        raise InputError(
            "training: the network's answers are not finite; train again with a lower learning rate"
        )


def quoted(text: str) -> str:
    """A TOML string."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
    return f'"{escaped}"'


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
        InputError: heat maps or positions (m) differ by more than 1e-4, or are not finite.
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
        _require_finite(expected)
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
