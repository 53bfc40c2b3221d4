"""BlazePose landmarks, a TensorFlow Lite file, as ONNX for any number of crops."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tflite
from network_conversion.graph import Graph, same_padding
from numpy.typing import NDArray

_DTYPES = {0: np.float32, 1: np.float16, 2: np.int32}
_KINDS = {v: k for k, v in vars(tflite.BuiltinOperator).items() if isinstance(v, int)}
# of the original's outputs: landmarks, presence, the person's mask, landmarks in metres
OUTPUTS = {"Identity": "joints", "Identity_1": "presence", "Identity_2": "mask"}
OUTPUTS |= {"Identity_4": "world"}


def convert_blazepose(source: Path, target: Path) -> None:
    """Convert ``pose_landmark_*.tflite`` to an ONNX file with the four outputs named above."""
    translation = _Translation(source)
    translation.run()
    size = translation.shape(translation.image)[1]
    shapes = translation.finish()
    translation.graph.save(target, source.stem, {"image": ("N", size, size, 3)}, shapes)


class _Translation:
    """One subgraph, operator by operator; activations are (N, C, H, W) until they are flat."""

    def __init__(self, source: Path) -> None:
        self.model = tflite.Model.GetRootAs(source.read_bytes(), 0)
        self.lite = self.model.Subgraphs(0)
        self.graph = Graph()
        self.image = int(self.lite.InputsAsNumpy()[0])
        self.widened: dict[int, NDArray[Any]] = {}
        self.images = {self.image: self.graph.add("Transpose", "image", perm=[0, 3, 1, 2])}
        self.flat: dict[int, str] = {}

    def run(self) -> None:
        for number in range(self.lite.OperatorsLength()):
            operator = self.lite.Operators(number)
            code = self.model.OperatorCodes(operator.OpcodeIndex())
            kind = _KINDS[max(code.BuiltinCode(), code.DeprecatedBuiltinCode())]
            translate = getattr(self, f"_{kind.lower()}", None)
            if translate is None:
                raise ValueError(f"operator {number} is a {kind}, which is not translated")
            inputs = [int(i) for i in operator.InputsAsNumpy()]
            translate(operator, inputs, int(operator.OutputsAsNumpy()[0]))

    def finish(self) -> dict[str, tuple[int | str, ...]]:
        """Name the outputs that are kept; their shapes."""
        shapes: dict[str, tuple[int | str, ...]] = {}
        for index in self.lite.OutputsAsNumpy():
            name = OUTPUTS.get(self.lite.Tensors(int(index)).Name().decode())
            if name is None:
                continue
            if index in self.flat:
                self.graph.add("Identity", self.flat[index], name=name)
            else:
                self.graph.add("Transpose", self.images[index], name=name, perm=[0, 2, 3, 1])
            shapes[name] = ("N", *self.shape(int(index))[1:])
        return shapes

    def shape(self, index: int) -> list[int]:
        return [int(v) for v in self.lite.Tensors(index).ShapeAsNumpy()]

    def _constant(self, index: int) -> NDArray[Any]:
        if index in self.widened:
            return self.widened[index]
        tensor = self.lite.Tensors(index)
        data = self.model.Buffers(tensor.Buffer()).DataAsNumpy().tobytes()
        return np.frombuffer(data, _DTYPES[tensor.Type()]).reshape(self.shape(index))

    def _dequantize(self, operator: Any, inputs: list[int], output: int) -> None:
        self.widened[output] = self._constant(inputs[0]).astype(np.float32)

    def _conv_2d(self, operator: Any, inputs: list[int], output: int) -> None:
        self._convolve(operator, inputs, output, tflite.Conv2DOptions)

    def _depthwise_conv_2d(self, operator: Any, inputs: list[int], output: int) -> None:
        self._convolve(operator, inputs, output, tflite.DepthwiseConv2DOptions)

    def _convolve(self, operator: Any, inputs: list[int], output: int, kind: Any) -> None:
        options = _options(operator, kind)
        weight = self._constant(inputs[1]).transpose(1, 2, 3, 0)  # h w in out, or h w C 1
        if (options.DilationHFactor(), options.DilationWFactor()) != (1, 1):
            raise ValueError(f"tensor {output} is dilated")
        strides = options.StrideH(), options.StrideW()
        pads = self._pads(options, inputs[0], weight.shape[:2], strides)
        result = self.graph.convolve(
            self.images[inputs[0]],
            weight,
            self._constant(inputs[2]),
            strides,
            pads,
            kind is tflite.DepthwiseConv2DOptions,
        )
        self.images[output] = self._activate(result, options.FusedActivationFunction())

    def _add(self, operator: Any, inputs: list[int], output: int) -> None:
        result = self.graph.add("Add", *(self.images[i] for i in inputs))
        function = _options(operator, tflite.AddOptions).FusedActivationFunction()
        self.images[output] = self._activate(result, function)

    def _pad(self, operator: Any, inputs: list[int], output: int) -> None:
        pads = self._constant(inputs[1])[[0, 3, 1, 2]].T.reshape(-1)
        value = self.graph.whole(*(int(v) for v in pads))
        self.images[output] = self.graph.add("Pad", self.images[inputs[0]], value)

    def _max_pool_2d(self, operator: Any, inputs: list[int], output: int) -> None:
        options = _options(operator, tflite.Pool2DOptions)
        kernel = options.FilterHeight(), options.FilterWidth()
        strides = options.StrideH(), options.StrideW()
        pads = self._pads(options, inputs[0], kernel, strides)
        result = self.graph.add(
            "MaxPool", self.images[inputs[0]], kernel_shape=kernel, strides=strides, pads=pads
        )
        self.images[output] = self._activate(result, options.FusedActivationFunction())

    def _resize_bilinear(self, operator: Any, inputs: list[int], output: int) -> None:
        options = _options(operator, tflite.ResizeBilinearOptions)
        larger = self.shape(output)[1] / self.shape(inputs[0])[1]
        mode = "half_pixel" if options.HalfPixelCenters() else "asymmetric"
        if options.AlignCorners():
            mode = "align_corners"
        scales = self.graph.constant(np.array([1, 1, larger, larger], np.float32))
        self.images[output] = self.graph.add(
            *("Resize", self.images[inputs[0]], "", scales),
            mode="linear",
            coordinate_transformation_mode=mode,
        )

    def _reshape(self, operator: Any, inputs: list[int], output: int) -> None:
        rows = self.graph.add("Transpose", self.images[inputs[0]], perm=[0, 2, 3, 1])
        shape = self.graph.whole(-1, *self.shape(output)[1:])
        self.flat[output] = self.graph.add("Reshape", rows, shape)

    def _logistic(self, operator: Any, inputs: list[int], output: int) -> None:
        where = self.flat if inputs[0] in self.flat else self.images
        where[output] = self.graph.add("Sigmoid", where[inputs[0]])

    def _pads(
        self, options: Any, image: int, kernel: tuple[int, ...], strides: tuple[int, int]
    ) -> tuple[int, int, int, int]:
        if options.Padding() != tflite.Padding.SAME:
            return 0, 0, 0, 0
        return same_padding(self.shape(image)[1:3], kernel, strides)

    def _activate(self, value: str, function: int) -> str:
        if function == tflite.ActivationFunctionType.RELU:
            return self.graph.add("Relu", value)
        if function == tflite.ActivationFunctionType.RELU6:
            return self.graph.clip(value, 0, 6)
        if function != tflite.ActivationFunctionType.NONE:
            raise ValueError(f"activation {function} is not translated")
        return value


def _options(operator: Any, kind: Any) -> Any:
    options, table = kind(), operator.BuiltinOptions()
    options.Init(table.Bytes, table.Pos)
    return options
