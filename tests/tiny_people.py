"""A network that finds two people in an image, as dots of known colours: one in each half."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from tiny_networks import Graph, model, write_model

SIDE = 192
MANIFEST = f"""
[input]
size = [{SIDE}, {SIDE}]
color = "rgb"
layout = "nhwc"
[output]
kind = "people"
names = ["people"]
columns = ["y", "x", "confidence"]
units = "unit"
[joints]
set = "COCO-17"
"""


def people(
    joints: int = 17,
    *,
    batch: Any = "N",
    nobody: float = np.nan,
    rows: int = 1,
    about: int = 5,
    split: float = 0.5,
) -> onnx.ModelProto:
    """NHWC in 0 to 255; ``people`` (N, rows + 2, 3 J + 5): left half, right half.

    Args:
        joints: of a person.
        batch: of the export.
        nobody: all numbers of the first rows, which are of no person.
        rows: of these.
        about: numbers beside joints, all of them the score.
        split: share of the input that is the left half.
    """
    graph = Graph(joints)
    image = graph.add("Transpose", "image", perm=[0, 3, 1, 2])
    heat = graph.add("Unsqueeze", graph.heat(image, (0,) * 3, (1,) * 3, False), graph.integers(1))
    y, x = np.mgrid[:SIDE, :SIDE]
    halves = np.stack([x < split * SIDE, x >= split * SIDE])[None, :, None].astype(np.float32)
    cells = graph.add("Mul", heat, graph.constant(halves))  # N 2 J H W
    flat = graph.add("Reshape", cells, graph.integers(0, 2, joints, -1))
    share = graph.add("Softmax", graph.add("Mul", flat, graph.floats(400)), axis=-1)
    points = graph.add("MatMul", share, graph.floats(np.stack((y.ravel(), x.ravel()), -1) / SIDE))
    peak = graph.add("ReduceMax", flat, axes=[3], keepdims=1)
    sure = graph.add("Min", graph.add("Mul", peak, graph.floats(8)), graph.floats(1))
    joined = graph.add("Concat", points, sure, axis=3)
    score = graph.add("ReduceMean", sure, axes=[2], keepdims=0)  # N 2 1
    row = graph.add("Reshape", joined, graph.integers(0, 2, 3 * joints))
    found = graph.add("Concat", row, *[score] * about, axis=2)
    zero = graph.add("Mul", graph.add("ReduceMean", found, axes=[1], keepdims=1), graph.floats(0))
    empty = graph.add("Add", zero, graph.floats(nobody))
    graph.rename(graph.add("Concat", *[empty] * rows, found, axis=1), "people")
    return model(graph, ["people"], [batch, SIDE, SIDE, 3])


def write_people(folder: Path, change: tuple[str, str] = ("", ""), **details: Any) -> Path:
    """The network's folder, with a text of its manifest replaced."""
    assert change[0] in MANIFEST
    return write_model(folder / "people", people(**details), MANIFEST.replace(*change, 1))
