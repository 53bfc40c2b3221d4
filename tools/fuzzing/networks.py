"""Networks of every kind as small files, and their readers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from fuzzing.mutate import Random
from fuzzing.targets import Target
from safetensors.torch import save_file
from tiny_networks import write_tiny

from perfcap.detect.onnx import OnnxDetector
from perfcap.segment.edge_network import EdgeNetwork

_WEIGHTS = "weights.safetensors"


def networks(root: Path) -> list[Target]:
    """A detector, and weights of a network of edges."""
    detectors, edges = root / "networks", root / "edges"
    for folder in (detectors, edges):
        folder.mkdir(parents=True)
    write_tiny(detectors, "vitpose")
    save_file(EdgeNetwork().state_dict(), edges / _WEIGHTS)
    return [Target("networks", detectors, _detector), Target("edges", edges, _edges)]


def _detector(folder: Path, _: Random) -> Any:
    detector = OnnxDetector(folder / "vitpose")
    return detector.estimate(np.zeros((1, 128, 96, 3), np.uint8)).joints2d


def _edges(folder: Path, _: Random) -> Any:
    return EdgeNetwork.load(folder / _WEIGHTS).look(np.full((20, 30, 3), 90, np.uint8))
