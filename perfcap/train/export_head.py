"""A network with its head as one ONNX file, whose manifest is the network's own."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from perfcap.detect.manifest import Manifest
from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError
from perfcap.train.export import MODEL, TOLERANCE, quoted, save_network
from perfcap.train.head import Head
from perfcap.train.onnx_head import FrozenNetwork, with_head

_CROPS = 3  # that both are compared on


def export_head(
    network: FrozenNetwork, head: Head, folder: Path, origin: str, error: float | None
) -> None:
    """Write ``model.onnx`` and ``manifest.toml`` of a network with its head.

    Args:
        network: frozen.
        head: trained.
        folder: where to; made if need be.
        origin: of the head, a sentence; that of the network follows it.
        error: expected of its 3D joints, metres, for the manifest: to a centimetre, as it is an
            expectation of other footage.

    Raises:
        InputError: onnxruntime answers otherwise than torch.
    """
    manifest, path = network.manifest, network.manifest.path
    data = with_head(network.data, network.features, _layers(head, manifest), path)
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    named = ("input", "output", "joints", "calibration")
    tables = {name: values[name] for name in named if name in values}
    if error is not None:
        tables["output"] = {**tables["output"], "error3d": max(0.01, round(error, 2))}
    text = "\n".join(_table(name, table) for name, table in tables.items())
    said = f"{origin}; on {manifest.file.origin}"
    save_network(
        folder,
        data,
        '# A detector with a head of its own: see card.md.\nkind = "detector"',
        (said, manifest.file.licence),
        text,
    )
    check_head_equal(network, head, folder)


def _layers(head: Head, manifest: Manifest) -> dict[str, tuple[Tensor, Tensor]]:
    """For each output, weights (D, M) and offsets (M,) in its own units and columns."""
    spec, (height, width) = manifest.output, manifest.input.size
    weight, offset = head.layer()  # D J 5, J 5
    pixels = [width, height] if spec.units == "unit" else [1, 1]
    metres = [spec.metres * sign for sign in spec.signs3d]
    places = [spec.columns.index(axis) for axis in "xy"]
    found = {}
    for name, count, columns, axes, units in (
        (spec.names[0], len(spec.columns), places, [0, 1], pixels),
        (spec.joints3d, 3, [0, 1, 2], [2, 3, 4], metres),
    ):
        rows = weight.new_zeros(len(weight), spec.rows, count)
        plain = weight.new_zeros(spec.rows, count)
        rows[:, : len(offset), columns] = weight[..., axes] / weight.new_tensor(units)
        plain[: len(offset), columns] = offset[..., axes] / weight.new_tensor(units)
        found[name] = rows.flatten(1), plain.flatten()
    return found


def _table(name: str, values: Mapping[str, Any]) -> str:
    rows = "\n".join(f"{key} = {_plain(value)}" for key, value in values.items())
    return f"[{name}]\n{rows}\n"


def _plain(value: Any) -> str:
    """A value of a manifest in TOML: text, numbers, flags and lists of them."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, list):
        return f"[{', '.join(_plain(each) for each in value)}]"
    return repr(value)


def check_head_equal(network: FrozenNetwork, head: Head, folder: Path) -> None:
    """Compare what was written with the frozen network and the head in torch, on random crops.

    Raises:
        InputError: 3D joints differ by more than a tenth of a millimetre, 2D ones by more than
            1e-4 of the crop, or something is not finite.
    """
    height, width = network.manifest.input.size
    random = np.random.default_rng(0)
    crops = random.integers(0, 256, (_CROPS, height, width, 3), np.uint8)
    written = OnnxDetector(folder, flip_test=False).estimate(crops)
    answers = network(crops)
    assert written.joints3d is not None and answers.estimate.joints3d is not None
    with torch.no_grad():
        weight, offset = head.layer()
        moves = torch.einsum("nd,djk->njk", answers.features.double(), weight) + offset
    expected2d = answers.estimate.joints2d + moves[..., :2]
    expected3d = answers.estimate.joints3d + moves[..., 2:]
    worst = max(
        float((written.joints2d - expected2d).abs().max()) / width,
        float((written.joints3d - expected3d).abs().max()),
    )
    if not worst <= TOLERANCE:
        raise InputError(
            f"export: {MODEL} differs from torch by {worst:.2g}, expected at most {TOLERANCE:g}; "
            "export with another version of onnx or onnxruntime"
        )
