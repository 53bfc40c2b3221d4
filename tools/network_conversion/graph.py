"""An ONNX graph under construction: weights of half precision, widened where they are used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

OPSET, IR_VERSION = 18, 9
_FEW = 16  # numbers that are not worth a cast

Shape = tuple[int | str, ...]


class Graph:
    """Nodes in order, each output named by its number.

    Images run through it as (N, C, H, W), whatever the original was laid out like.
    """

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.weights: list[onnx.TensorProto] = []
        self._count = 0

    def add(self, kind: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        """Append a node; returns the name of its output."""
        output = name or self._name()
        self.nodes.append(helper.make_node(kind, list(inputs), [output], **attributes))
        return output

    def add_pair(self, kind: str, *inputs: str, **attributes: Any) -> tuple[str, str]:
        """Append a node of two outputs; returns their names."""
        one, other = self._name(), self._name()
        self.nodes.append(helper.make_node(kind, list(inputs), [one, other], **attributes))
        return one, other

    def constant(self, value: NDArray[Any]) -> str:
        """Numbers as an input of nodes, stored as half precision where nothing is lost."""
        value = np.ascontiguousarray(value)
        name = self._name()
        half = value.astype(np.float16) if value.dtype == np.float32 else value
        if half.dtype == np.float16 and value.size > _FEW and np.array_equal(half, value):
            self.weights.append(numpy_helper.from_array(half, name))
            return self.add("Cast", name, to=TensorProto.FLOAT)
        self.weights.append(numpy_helper.from_array(value, name))
        return name

    def whole(self, *numbers: int) -> str:
        """Whole numbers as an input of nodes, such as a shape."""
        return self.constant(np.array(numbers, np.int64))

    def number(self, value: float) -> str:
        """One number in single precision."""
        return self.constant(np.float32(value))

    def convolve(
        self,
        image: str,
        weight: NDArray[Any],
        bias: NDArray[Any] | None,
        strides: Sequence[int],
        pads: Sequence[int],
        depthwise: bool,
    ) -> str:
        """A convolution with weights as TensorFlow's files order them.

        Args:
            image: (N, C, H, W).
            weight: (h, w, in, out), or (h, w, C, 1) of a depthwise one.
            bias: (out,), if any.
            strides: down and across.
            pads: top, left, bottom, right.
            depthwise: whether each channel is filtered on its own.
        """
        order = (2, 3, 0, 1) if depthwise else (3, 2, 0, 1)
        inputs = [image, self.constant(weight.astype(np.float32).transpose(order))]
        if bias is not None:
            inputs.append(self.constant(bias.astype(np.float32)))
        group = weight.shape[2] if depthwise else 1
        shape = list(weight.shape[:2])
        return self.add(
            "Conv", *inputs, kernel_shape=shape, strides=strides, pads=pads, group=group
        )

    def clip(self, value: str, low: float, high: float) -> str:
        """Values between two numbers."""
        return self.add("Clip", value, self.number(low), self.number(high))

    def save(
        self,
        path: Path,
        name: str,
        inputs: Mapping[str, Shape],
        outputs: Mapping[str, Shape],
    ) -> None:
        """Write what the outputs need; the bytes follow from the calls alone."""
        nodes, live = [], set(outputs)
        for node in reversed(self.nodes):
            if live.intersection(node.output):
                nodes.append(node)
                live.update(node.input)
        graph = helper.make_graph(
            nodes[::-1],
            name,
            [_described(key, shape) for key, shape in inputs.items()],
            [_described(key, shape) for key, shape in outputs.items()],
            [weight for weight in self.weights if weight.name in live],
        )
        opset = [helper.make_opsetid("", OPSET)]
        model = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION)
        onnx.checker.check_model(model, full_check=True)
        path.write_bytes(model.SerializeToString(deterministic=True))

    def _name(self) -> str:
        self._count += 1
        return f"v{self._count}"


def same_padding(
    size: Sequence[int], kernel: Sequence[int], strides: Sequence[int]
) -> tuple[int, int, int, int]:
    """TensorFlow's ``SAME``: top, left, bottom, right; the odd pixel goes to the far side."""
    near, far = [], []
    for length, width, step in zip(size, kernel, strides, strict=True):
        total = max((-(-length // step) - 1) * step + width - length, 0)
        near.append(total // 2)
        far.append(total - total // 2)
    return near[0], near[1], far[0], far[1]


def _described(name: str, shape: Shape) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, list(shape))
