"""MoveNet SinglePose, a TensorFlow.js graph, as ONNX for any number of crops."""

from __future__ import annotations

import base64
import json
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from network_conversion.graph import Graph, same_padding
from numpy.typing import NDArray

_JOINTS = 17
_DTYPES = {"float32": "<f4", "float16": "<f2", "int32": "<i4"}
ROOT = "StatefulPartitionedCall/"
# what the decoder after them reads: one map a joint, offsets from the middle to the joints, where
# a person's middle is, and where in its pixel a joint is
_HEADS = {
    "heat": f"{ROOT}kpt_heatmap_0/conv2d_5/BiasAdd",
    "regress": f"{ROOT}kpt_regress_0/conv2d_6/BiasAdd",
    "center": f"{ROOT}center_0/conv2d_4/BiasAdd",
    "offset": f"{ROOT}kpt_offset_0/conv2d_7/BiasAdd",
}


def convert_movenet(source: Path, target: Path) -> None:
    """Convert ``NAME.json``, with its weights beside it, to an ONNX file.

    The convolutions are translated node by node. What follows the four heads is written anew,
    since the original decodes one image at a time: the person whose middle is the surest, near
    the middle of the crop; of each joint the highest place of its map, weighted down with the
    distance from where that person's middle says it is; and the offset within its pixel.
    """
    description = json.loads(source.read_text())
    weights = read_weights(description, source.parent)
    nodes = [node for node in description["modelTopology"]["node"] if node["op"] != "Const"]
    (size,) = {
        int(node["attr"]["shape"]["shape"]["dim"][1]["size"])
        for node in nodes
        if node["op"] == "Placeholder"
    }
    body = Body(Graph(), weights, size)
    body.run(nodes, _HEADS.values())
    outputs = _decode(body)
    body.graph.save(target, source.stem, {"image": ("N", size, size, 3)}, outputs)


def read_weights(description: dict[str, Any], folder: Path) -> dict[str, NDArray[Any]]:
    """Weights by name, of a description and the files beside it."""
    weights = {}
    for group in description["weightsManifest"]:
        data = b"".join((folder / name).read_bytes() for name in group["paths"])
        start = 0
        for entry in group["weights"]:
            stored = entry.get("quantization", entry)
            if set(stored) - {"name", "shape", "dtype", "original_dtype"}:
                raise ValueError(f"{entry['name']} is quantized: {stored}")
            dtype = np.dtype(_DTYPES[stored["dtype"]])
            count = int(np.prod(entry["shape"]))
            values = np.frombuffer(data, dtype, count, start).reshape(entry["shape"])
            weights[entry["name"]] = values
            start += values.nbytes
        if start != len(data):
            raise ValueError(f"{group['paths']}: {len(data)} bytes, {start} of them described")
    return weights


class Body:
    """The convolutions: names of the original to outputs of the graph, and their sizes.

    Args:
        graph: that is written.
        weights: by the original's names.
        size: height and width of the image, pixels.
    """

    def __init__(self, graph: Graph, weights: dict[str, NDArray[Any]], size: int) -> None:
        self.graph, self.weights, self.size = graph, weights, size
        self.known: dict[str, tuple[str, int]] = {}  # output and height, which is the width
        self.factors: dict[str, NDArray[Any]] = {}  # of sizes that follow from those of images

    def run(self, nodes: Iterable[dict[str, Any]], heads: Collection[str]) -> None:
        """Translate nodes in order until all heads are there."""
        for node in nodes:
            if all(name in self.known for name in heads):
                break
            self.translate(node)

    def translate(self, node: dict[str, Any]) -> None:
        """One node of the original."""
        kind, name, inputs = node["op"], node["name"], node.get("input", ())
        if kind == "Placeholder":
            image = self.graph.add("Transpose", "image", perm=[0, 3, 1, 2])
            self.known[name] = image, self.size
        elif kind in ("Cast", "Unpack", "ExpandDims", "Squeeze"):  # one image of a batch, and back
            self.known[name] = self.known[inputs[0]]
        elif kind in ("Shape", "StridedSlice"):  # height and width, which are scaled next
            pass
        elif kind == "Mul" and inputs[0] not in self.known:
            self.factors[name] = self.weights[inputs[1]]
        elif kind in ("Sub", "Mul"):  # the normalisation of pixels, by constants
            value, side = self.known[inputs[0]]
            constant = self.weights[inputs[1]].astype(np.float32).reshape(-1, 1, 1)
            self.known[name] = self.graph.add(kind, value, self.graph.constant(constant)), side
        elif kind == "AddV2":
            (one, side), (other, same) = (self.known[i] for i in inputs)
            if side != same:
                raise ValueError(f"{name} adds images of {side} and {same} pixels")
            self.known[name] = self.graph.add("Add", one, other), side
        elif kind == "ResizeBilinear":
            self.known[name] = self._resize(node)
        elif "Conv2D" in kind or "Conv2d" in kind:
            self.known[name] = self._convolve(node)
        else:
            raise ValueError(f"{name} is a {kind}, which is not translated")

    def _resize(self, node: dict[str, Any]) -> tuple[str, int]:
        value, side = self.known[node["input"][0]]
        size = node["input"][1]
        sides = side * self.factors[size] if size in self.factors else self.weights[size]
        height, width = (int(v) for v in sides)
        if height != width or not node["attr"]["half_pixel_centers"]["b"]:
            raise ValueError(f"{node['name']}: expected half-pixel centres and a square")
        scales = np.array([1, 1, height / side, width / side], np.float32)
        mode = {"mode": "linear", "coordinate_transformation_mode": "half_pixel"}
        return self.graph.add("Resize", value, "", self.graph.constant(scales), **mode), height

    def _convolve(self, node: dict[str, Any]) -> tuple[str, int]:
        value, side = self.known[node["input"][0]]
        weight = self.weights[node["input"][1]]
        attributes = node["attr"]
        steps = [int(v) for v in attributes["strides"]["list"]["i"][1:3]]
        if {int(v) for v in attributes["dilations"]["list"]["i"]} != {1}:
            raise ValueError(f"{node['name']} is dilated")
        same = base64.b64decode(attributes["padding"]["s"]) == b"SAME"
        kernel = weight.shape[:2]
        pads = same_padding((side, side), kernel, steps) if same else (0, 0, 0, 0)
        fused = attributes.get("fused_ops", {"list": {}})["list"].get("s", [])
        after = [base64.b64decode(text).decode() for text in fused]
        bias = self.weights[node["input"][2]] if after[:1] == ["BiasAdd"] else None
        depthwise = "Depthwise" in node["op"]
        result = self.graph.convolve(value, weight, bias, steps, pads, depthwise)
        for activation in after[1:]:
            if activation == "Relu":
                result = self.graph.add("Relu", result)
            elif activation == "Relu6":
                result = self.graph.clip(result, 0, 6)
            else:
                raise ValueError(f"{node['name']} ends in {activation}, which is not translated")
        length = side if same else side - kernel[0] + 1
        return result, -(-length // steps[0])


def _decode(body: Body) -> dict[str, tuple[int | str, ...]]:
    """Heads to ``joints`` (N, 17, 3) of y, x in units of the crop and confidence."""
    graph, weights = body.graph, body.weights
    heads = {name: body.known[node] for name, node in _HEADS.items()}
    side = heads["heat"][1]
    cells = side * side
    flat = {
        name: graph.add("Reshape", value, graph.whole(0, -1, cells))
        for name, (value, _) in heads.items()
    }
    heat = graph.add("Sigmoid", flat["heat"])  # N 17 cells
    near = weights[f"ConstantFolding/{ROOT}truediv_2_recip"].astype(np.float32)
    middle = graph.add("Mul", graph.add("Sigmoid", flat["center"]), _row(graph, near))
    place = graph.add("ArgMax", middle, axis=2, keepdims=1)  # N 1 1
    # 34 numbers at the middle: y and x of joints, from there
    pair = graph.whole(0, _JOINTS, 2)
    everywhere = graph.add("Expand", place, graph.whole(1, 2 * _JOINTS, 1))
    regressed = graph.add("GatherElements", flat["regress"], everywhere, axis=2)
    from_middle = graph.add("Reshape", regressed, pair)
    expected = graph.add("Add", from_middle, _cell(graph, place, side))  # N 17 2
    grid = np.stack(np.divmod(np.arange(cells), side)).astype(np.float32)
    square = []
    for axis, values in enumerate(grid):
        there = graph.add("Gather", expected, graph.whole(axis), axis=2)  # N 17 1
        apart = graph.add("Sub", _row(graph, values), there)
        square.append(graph.add("Mul", apart, apart))
    distance = graph.add("Sqrt", graph.add("Add", *square))
    softened = graph.add("Add", distance, graph.number(float(weights[f"{ROOT}add_5/y"])))
    best = graph.add("ArgMax", graph.add("Div", heat, softened), axis=2, keepdims=1)  # N 17 1
    confidence = graph.add("GatherElements", heat, best, axis=2)
    offsets = graph.add("Reshape", flat["offset"], graph.whole(0, _JOINTS, 2, cells))
    both = graph.add(
        "Expand", graph.add("Unsqueeze", best, graph.whole(2)), graph.whole(1, 1, 2, 1)
    )
    within = graph.add("Reshape", graph.add("GatherElements", offsets, both, axis=3), pair)
    points = graph.add("Add", within, _cell(graph, best, side))
    (unit,) = {float(v) for v in weights[f"{ROOT}Reshape_13"].ravel()}
    scaled = graph.add("Mul", points, graph.number(unit))
    graph.add("Concat", scaled, confidence, name="joints", axis=2)
    graph.add("Reshape", heat, graph.whole(0, _JOINTS, side, side), name="heat")
    return {"joints": ("N", _JOINTS, 3), "heat": ("N", _JOINTS, side, side)}


def _row(graph: Graph, values: NDArray[np.float32]) -> str:
    return graph.constant(values.reshape(1, 1, -1))


def _cell(graph: Graph, index: str, side: int) -> str:
    """Row and column (N, K, 2) of cells (N, K, 1)."""
    row = graph.add("Div", index, graph.whole(side))
    column = graph.add("Mod", index, graph.whole(side))
    return graph.add("Cast", graph.add("Concat", row, column, axis=2), to=1)
