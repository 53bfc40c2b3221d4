"""MoveNet MultiPose, a TensorFlow.js graph, as ONNX for images of any number and size."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from network_conversion.graph import Graph, Shape
from network_conversion.movenet import ROOT, Body, read_weights
from onnx import TensorProto

_JOINTS = 17
_NOMINAL = 256  # pixels: padding is the same at all sizes that are multiples of 32
# what the decoder after them reads: where people's middles are, the sizes of their boxes and where
# in its cell a middle is; one map a joint, offsets from a middle to its joints, and where in its
# cell a joint is
_HEADS = {
    "center": f"{ROOT}center_0/conv2d_4/BiasAdd",
    "extent": f"{ROOT}box_scale_0/conv2d_5/BiasAdd",
    "shift": f"{ROOT}box_offset_0/conv2d_6/BiasAdd",
    "heat": f"{ROOT}kpt_heatmap_0/conv2d_7/BiasAdd",
    "regress": f"{ROOT}kpt_regress_0/conv2d_8/BiasAdd",
    "offset": f"{ROOT}kpt_offset_0/conv2d_9/BiasAdd",
}


def convert_multipose(source: Path, target: Path) -> None:
    """Convert ``movenet-multipose.json``, with its weights beside it, to an ONNX file.

    The convolutions are translated node by node. What follows the six heads is written anew, for
    any number of images: the six surest middles of people; the box of each; of each joint the
    highest place of its map within the box, weighted down with the distance from where that
    person's middle says it is; the offset within its cell; and how sure the person is, which is
    how sure the middle is times the mean of the joints that are seen.
    """
    description = json.loads(source.read_text())
    weights = read_weights(description, source.parent)
    nodes = [node for node in description["modelTopology"]["node"] if node["op"] != "Const"]
    body = Body(Graph(), weights, _NOMINAL)
    body.run(nodes, _HEADS.values())
    decoder = _Decoder(body)
    body.graph.save(target, source.stem, {"image": ("N", "H", "W", 3)}, decoder.run())


class _Decoder:
    """Heads to ``people`` (N, 6, 56): y, x and confidence of joints, box, confidence."""

    def __init__(self, body: Body) -> None:
        self.graph, self.weights = body.graph, body.weights
        self.maps = {name: body.known[node][0] for name, node in _HEADS.items()}
        self.flat = {
            name: self.graph.add("Reshape", value, self.graph.whole(0, 0, -1))
            for name, value in self.maps.items()
        }
        shape = self.graph.add("Shape", self.maps["heat"])
        self.height, self.width = (
            self.graph.add("Gather", shape, self.graph.whole(axis)) for axis in (2, 3)
        )
        self.sides = self._float(self.graph.add("Concat", self.height, self.width, axis=0))
        self.count = int(self._constant("TopKV2/k"))

    def run(self) -> dict[str, Shape]:
        graph = self.graph
        sure, middles = self._middles()
        cell = self._cells(middles)  # N P 2
        low, high = self._box(middles, cell)
        expected = graph.add("Add", self._at_middles("regress", middles), self._unsqueezed(cell, 2))
        score = self._scores(expected, low, high)  # N P 17 cells
        best = graph.add("ArgMax", score, axis=3, keepdims=0)  # N P 17
        by_joint = graph.add("Transpose", best, perm=[0, 2, 1])
        anyone = graph.add("ReduceMax", score, graph.whole(1), keepdims=0)
        seen = graph.add("GatherElements", anyone, by_joint, axis=2)
        confidence = graph.add("Transpose", seen, perm=[0, 2, 1])  # N P 17
        units = graph.add("Div", self._places(by_joint), self.sides)
        joints = graph.add("Concat", units, self._unsqueezed(confidence, 3), axis=3)
        rows = graph.add("Reshape", joints, graph.whole(0, self.count, 3 * _JOINTS))
        edges = [graph.add("Div", edge, self.sides) for edge in (low, high)]
        boxes = graph.clip(graph.add("Concat", *edges, axis=2), 0, 1)
        certainty = self._unsqueezed(self._certainty(sure, confidence), 2)
        graph.add("Concat", rows, boxes, certainty, name="people", axis=2)
        return {"people": ("N", self.count, 3 * _JOINTS + 5)}

    def _middles(self) -> tuple[str, str]:
        """How sure the surest peaks are, and their cells, (N, P)."""
        graph = self.graph
        heat = graph.add("Sigmoid", self.maps["center"])
        around = graph.add("MaxPool", heat, kernel_shape=[5, 5], pads=[2] * 4, strides=[1, 1])
        below = graph.add("Abs", graph.add("Sub", heat, around))
        peak = graph.add("Less", below, graph.number(float(self._constant("Less/y"))))
        kept = graph.add("Mul", heat, self._float(peak))
        flat = graph.add("Reshape", kept, graph.whole(0, -1))
        return graph.add_pair("TopK", flat, graph.whole(self.count), axis=1)

    def _box(self, middles: str, cell: str) -> tuple[str, str]:
        """Top left and bottom right of people, (N, P, 2), cells, within the image."""
        graph = self.graph
        extent = graph.add("Relu", self._at_middles("extent", middles))
        half = graph.add("Mul", extent, graph.number(float(self._constant("truediv_2_recip", 1))))
        middle = graph.add("Add", cell, self._at_middles("shift", middles))
        edges = [graph.add(kind, middle, half) for kind in ("Sub", "Add")]
        low, high = (
            graph.add("Max", graph.add("Min", edge, self.sides), graph.number(0)) for edge in edges
        )
        return low, high

    def _scores(self, expected: str, low: str, high: str) -> str:
        """Maps of joints as one person sees them, (N, P, 17, cells)."""
        graph = self.graph
        smaller = graph.add("ReduceMin", self.sides, keepdims=0)
        spread = graph.add("Mul", smaller, graph.number(float(self._constant("mul_6/y"))))
        near = []
        for axis, length in enumerate((self.height, self.width)):
            one = graph.whole(axis)
            steps = graph.add(
                "Range", *(graph.constant(np.int64(0)), self._scalar(length)),
                graph.constant(np.int64(1)),
            )  # fmt: skip
            along = self._float(steps)
            there = graph.add("Gather", expected, one, axis=3)  # N P 17 1
            apart = graph.add("Sub", along, there)
            squared = graph.add("Mul", apart, apart)
            weight = graph.add("Exp", graph.add("Neg", graph.add("Div", squared, spread)))
            first, last = (graph.add("Gather", edge, one, axis=2) for edge in (low, high))  # N P 1
            inside = graph.add(
                "And", graph.add("GreaterOrEqual", along, first), graph.add("Less", along, last)
            )
            within = self._unsqueezed(self._float(inside), 2)  # N P 1 length
            near.append(graph.add("Mul", weight, within))  # N P 17 length
        both = graph.add("Mul", self._unsqueezed(near[0], 4), self._unsqueezed(near[1], 3))
        heat = graph.add("Sigmoid", self._unsqueezed(self.maps["heat"], 1))
        shape = graph.whole(0, self.count, _JOINTS, -1)
        return graph.add("Reshape", graph.add("Mul", heat, both), shape)

    def _places(self, by_joint: str) -> str:
        """Joints (N, P, 17, 2) at cells (N, 17, P)."""
        graph = self.graph
        offsets = graph.add("Reshape", self.flat["offset"], graph.whole(0, _JOINTS, 2, -1))
        index = graph.add(
            "Expand", self._unsqueezed(by_joint, 2), graph.whole(1, 1, 2, 1)
        )  # N 17 2 P
        within = graph.add("GatherElements", offsets, index, axis=3)
        turned = graph.add("Transpose", within, perm=[0, 3, 1, 2])
        cells = self._cells(graph.add("Transpose", by_joint, perm=[0, 2, 1]))
        return graph.add("Add", turned, cells)

    def _certainty(self, sure: str, confidence: str) -> str:
        """Of people, (N, P)."""
        graph = self.graph
        least = graph.number(float(self._constant("Greater_1/y")))
        seen = self._float(graph.add("Greater", confidence, least))
        last = graph.whole(-1)
        count = graph.add("ReduceSum", seen, last, keepdims=0)
        total = graph.add("ReduceSum", graph.add("Mul", confidence, seen), last, keepdims=0)
        mean = graph.add("Div", total, graph.add("Max", count, graph.number(1)))
        return graph.add("Mul", sure, mean)

    def _at_middles(self, name: str, middles: str) -> str:
        """Channels of a head at cells (N, P): (N, P, 2), or (N, P, 17, 2) of joints."""
        graph, channels = self.graph, 2 * _JOINTS if name == "regress" else 2
        index = graph.add("Expand", self._unsqueezed(middles, 1), graph.whole(1, channels, 1))
        found = graph.add("GatherElements", self.flat[name], index, axis=2)
        rows = graph.add("Transpose", found, perm=[0, 2, 1])
        if name != "regress":
            return rows
        return graph.add("Reshape", rows, graph.whole(0, 0, _JOINTS, 2))

    def _cells(self, index: str) -> str:
        """Row and column (..., 2) of cells (...)."""
        row = self.graph.add("Div", index, self.width)
        column = self.graph.add("Mod", index, self.width)
        parts = [self._unsqueezed(self._float(each), -1) for each in (row, column)]
        return self.graph.add("Concat", *parts, axis=-1)

    def _constant(self, name: str, folded: int = 0) -> np.ndarray:
        value: np.ndarray = self.weights[f"{'ConstantFolding/' if folded else ''}{ROOT}{name}"]
        return value

    def _unsqueezed(self, value: str, axis: int) -> str:
        return self.graph.add("Unsqueeze", value, self.graph.whole(axis))

    def _scalar(self, value: str) -> str:
        return self.graph.add("Squeeze", value, self.graph.whole(0))

    def _float(self, value: str) -> str:
        return self.graph.add("Cast", value, to=TensorProto.FLOAT)
