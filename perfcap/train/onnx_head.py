"""A head on the frozen features of a joint network: found in its ONNX file, and written into it."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.decode import Estimate, decode
from perfcap.detect.manifest import Manifest, ModelFile
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.onnx_file import read_model
from perfcap.detect.session import Session, prepare_crops
from perfcap.errors import InputError

_LAYERS = ("Conv", "Gemm", "MatMul")
_MOST = 8192  # features; a linear head on more would not fit the few frames there are
_BATCH = 16  # crops in one call


@dataclass(frozen=True)
class Answers:
    """What a network says of N crops.

    Attributes:
        features: (N, D).
        estimate: joints in pixels of the crops, and in metres along their axes.
    """

    features: Tensor
    estimate: Estimate


class FrozenNetwork:
    """A joint network whose features come out beside its joints.

    Args:
        folder: with ``manifest.toml`` and the ONNX file it names.
        features: names of tensors in the file, together the features; what the last layers before
            the joints read if none is named.

    Attributes:
        manifest: of the network.
        data: bytes of its file.
        features: names of the tensors.
        count: D, of all features.

    Raises:
        InputError: the network cannot be used, has no 3D joints or answers with maps, or has no
            such features.
    """

    def __init__(self, folder: Path, features: Sequence[str] = ()) -> None:
        detector = OnnxDetector(folder)  # with all its checks of untrusted files
        self.manifest: Manifest = detector.manifest
        spec, path = self.manifest.output, self.manifest.file.path
        if spec.kind != "coordinates" or not spec.joints3d:
            raise InputError(
                f"{self.manifest.path}: answers with {spec.kind}"
                f"{'' if spec.joints3d else ' and without 3D joints'}; a head is put on networks "
                "of kind coordinates that have joints3d, such as blazepose"
            )
        self.data, outside = read_model(path)
        if outside:
            raise InputError(
                f"{path}: keeps weights in other files; export it with external_data=False"
            )
        model = _parsed(self.data, path)
        named = (spec.names[0], spec.joints3d)
        self.features = tuple(features) or find_features(model, named, path)
        self._input = detector.session.inputs[0]
        self._fixed = detector.session.shapes[self._input][0] or 0
        self._outputs = named
        self._session = _session(model, self.features, path)
        height, width = self.manifest.input.size
        found = self(np.zeros((1, height, width, 3), np.uint8)).features
        self.count = found.shape[1]
        if self.count > _MOST:
            raise InputError(
                f"{path}: {', '.join(self.features)} has {self.count} features, expected at most "
                f"{_MOST}; name another tensor with --features"
            )

    def __call__(self, crops: NDArray[np.uint8]) -> Answers:
        """Features and joints of crops (N, h, w, 3), RGB."""
        size = self._fixed or _BATCH
        parts = [self._batch(crops[i : i + size]) for i in range(0, len(crops), size)]
        poses = [part.estimate.joints3d for part in parts if part.estimate.joints3d is not None]
        return Answers(
            torch.cat([part.features for part in parts]),
            Estimate(
                torch.cat([part.estimate.joints2d for part in parts]),
                torch.cat([part.estimate.confidence for part in parts]),
                torch.cat(poses),
            ),
        )

    def _batch(self, crops: NDArray[np.uint8]) -> Answers:
        count = len(crops)
        if self._fixed:  # an export of fixed batch gets copies to fill it
            crops = np.concatenate((crops, np.repeat(crops[-1:], self._fixed - count, 0)))
        wanted = (*self._outputs, *self.features)
        feeds = {self._input: prepare_crops(crops, self.manifest.input)}
        found = [value[:count] for value in self._session.run(feeds, wanted)]
        flat = [np.asarray(value, np.float32).reshape(count, -1) for value in found[2:]]
        named = dict(zip(self._outputs, found[:2], strict=True))
        return Answers(torch.from_numpy(np.concatenate(flat, 1)), decode(named, self.manifest))


def find_features(model: Any, outputs: Sequence[str], path: Path) -> tuple[str, ...]:
    """Names of what the last layers before these outputs read, each once.

    Raises:
        InputError: no convolution or product with weights lies before an output.
    """
    makers = {name: node for node in model.graph.node for name in node.output}
    found: list[str] = []
    for output in outputs:
        name, seen = output, set()
        while name in makers and makers[name].op_type not in _LAYERS:
            inputs = [each for each in makers[name].input if each in makers and each not in seen]
            seen.update(inputs)
            # what depends on the image; constants may be nodes, too
            name = next((each for each in inputs if _seen_from_image(each, model, makers)), "")
        if name not in makers:
            raise InputError(
                f"{path}: no layer is found before output {output!r}; name a tensor with --features"
            )
        if makers[name].input[0] not in found:
            found.append(makers[name].input[0])
    return tuple(found)


def _seen_from_image(name: str, model: Any, makers: Mapping[str, Any]) -> bool:
    """Whether a tensor depends on an input of the model."""
    inputs = {value.name for value in model.graph.input}
    waiting, seen = [name], {name}
    while waiting:
        current = waiting.pop()
        if current in inputs:
            return True
        more = makers[current].input if current in makers else ()
        waiting += [each for each in more if each not in seen]
        seen.update(more)
    return False


def with_head(
    data: bytes, features: Sequence[str], layers: Mapping[str, tuple[Tensor, Tensor]], path: Path
) -> bytes:
    """A network's file whose outputs have a linear map of the features added.

    Args:
        data: of the network's file.
        features: names of the tensors that are flattened and joined, D numbers a crop.
        layers: for each output, weights (D, M) and offsets (M,), M numbers of a crop.
        path: of the file, for messages.

    Raises:
        InputError: the file does not hold such a network.
    """
    onnx = _onnx()
    model = _parsed(data, path)
    graph, helper = model.graph, onnx.helper
    taken = {name for node in graph.node for name in (*node.input, *node.output)}
    prefix = "head"
    while any(name.startswith(prefix) for name in taken):
        prefix += "_"
    for node in graph.node:  # what an output was called is called otherwise inside
        for names in (node.input, node.output):
            for place, name in enumerate(names):
                if name in layers:
                    names[place] = f"{prefix}_before_{name}"
    flat = []
    for number, name in enumerate(features):
        plain, row = f"{prefix}_plain{number}", f"{prefix}_row{number}"
        source = f"{prefix}_before_{name}" if name in layers else name
        graph.node.append(helper.make_node("Cast", [source], [plain], to=onnx.TensorProto.FLOAT))
        graph.node.append(helper.make_node("Flatten", [plain], [row], axis=1))
        flat.append(row)
    joined = f"{prefix}_features"
    graph.node.append(helper.make_node("Concat", flat, [joined], axis=1))
    for name, (weights, offsets) in layers.items():
        own = {part: f"{prefix}_{part}_{name}" for part in ("w", "b", "shift", "shape", "shaped")}
        for part, value in (("w", weights), ("b", offsets)):
            array = np.ascontiguousarray(value.detach().float().numpy())
            graph.initializer.append(onnx.numpy_helper.from_array(array, own[part]))
        before = f"{prefix}_before_{name}"
        graph.node.extend(
            (
                helper.make_node("Gemm", [joined, own["w"], own["b"]], [own["shift"]]),
                helper.make_node("Shape", [before], [own["shape"]]),
                helper.make_node("Reshape", [own["shift"], own["shape"]], [own["shaped"]]),
                helper.make_node("Add", [before, own["shaped"]], [name]),
            )
        )
    written: bytes = model.SerializeToString(deterministic=True)
    return written


def _session(model: Any, features: Sequence[str], path: Path) -> Session:
    """The model opened with its features as further outputs."""
    onnx = _onnx()
    made = {name for node in model.graph.node for name in node.output}
    missing = [name for name in features if name not in made]
    if missing:
        raise InputError(
            f"{path}: has no tensor {missing[0]!r:.80}; --features names outputs of its nodes"
        )
    known = {value.name for value in model.graph.output}
    for name in features:
        if name not in known:
            value = onnx.helper.make_empty_tensor_value_info(name)
            model.graph.output.append(value)
    data = model.SerializeToString()
    with tempfile.TemporaryDirectory() as folder:  # opened at once, so it need not stay
        place = Path(folder) / path.name
        place.write_bytes(data)
        file = ModelFile(place, hashlib.sha256(data).hexdigest(), "", "")
        return Session(file)


def _parsed(data: bytes, path: Path) -> Any:
    onnx = _onnx()
    try:
        return onnx.load_model_from_string(data)
    except Exception as error:  # protobuf's classes are no public ones
        raise InputError(f"{path}: is not an ONNX model ({type(error).__name__})") from None


def _onnx() -> Any:
    try:
        import onnx
    except ImportError:
        raise InputError(
            "onnx is not installed; a head needs it: pip install 'perfcap[train]'"
        ) from None
    return onnx
