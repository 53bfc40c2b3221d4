"""Networks that really find joints, as dots of known colours, in the layouts of common exports.

Every one is a few operators with weights written down: no training, no download. A joint's heat is
high where the image has the joint's colour in a neighbourhood of 9x9 pixels, most in its middle.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIZE = (128, 96)
MEAN, STD = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
_LEVELS = (60, 120, 180, 240)
_SHARPNESS = 400.0


def color(joint: int) -> np.ndarray:
    """The colour (r, g, b) of a joint; far from that of any other."""
    return np.array([_LEVELS[joint // 4**k % 4] for k in range(3)], float)


def body(joints: int, seed: int = 0) -> np.ndarray:
    """Places of dots in a body 1 high and 0.5 wide, (J, 2), none close to another."""
    rng = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(np.arange(5), np.arange(10)), -1).reshape(-1, 2)
    picked = cells[rng.permutation(len(cells))[:joints]]
    return (picked + 0.5 + rng.uniform(-0.2, 0.2, picked.shape)) / [10.0, 10.0]


def draw(size: tuple[int, int], places: np.ndarray, radius: float) -> np.ndarray:
    """An image (H, W, 3) with a dot at each place (J, 2), to a sixteenth of a pixel."""
    image = np.zeros((*size, 3), np.uint8)
    for joint, place in enumerate(places):
        center = tuple(int(v) for v in np.rint(16 * place))
        cv2.circle(image, center, round(16 * radius), color(joint).tolist(), -1, cv2.LINE_AA, 4)
    return image


@dataclass
class Graph:
    """A graph under construction."""

    joints: int
    nodes: list[Any] = field(default_factory=list)
    weights: list[Any] = field(default_factory=list)

    def constant(self, value: np.ndarray) -> str:
        name = f"w{len(self.weights)}"
        self.weights.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def add(self, operator: str, *inputs: str, **attributes: Any) -> str:
        name = f"t{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    def floats(self, value: Any) -> str:
        return self.constant(np.asarray(value, np.float32))

    def integers(self, *value: int) -> str:
        return self.constant(np.asarray(value, np.int64))

    def rename(self, tensor: str, name: str) -> None:
        self.nodes.append(helper.make_node("Identity", [tensor], [name]))

    def heat(self, image: str, mean: Sequence[float], std: Sequence[float], bgr: bool) -> str:
        """Heat (N, J, H, W) of an image (N, 3, H, W) that was normalised."""
        colors = np.stack([color(j) for j in range(self.joints)])[:, :: -1 if bgr else 1]
        pick = np.tile(np.diag(std), (self.joints, 1))[..., None, None]
        bias = (np.array(mean) - colors).reshape(-1)
        apart = self.add("Conv", image, self.floats(pick), self.floats(bias))
        total = np.kron(np.eye(self.joints), np.full((1, 3), -1 / 40))[..., None, None]
        near = self.add(
            "Conv", self.add("Abs", apart), self.floats(total), self.floats(np.ones(self.joints))
        )
        return self.blur(self.blur(self.add("Relu", near)))

    def blur(self, maps: str) -> str:
        return self.add("AveragePool", maps, kernel_shape=[5, 5], pads=[2] * 4, count_include_pad=1)


def model(
    graph: Graph, outputs: Sequence[str], shape: Sequence[Any], kind: int = TensorProto.FLOAT
) -> onnx.ModelProto:
    """The finished model with one input ``image``."""
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in outputs]
    image = helper.make_tensor_value_info("image", kind, shape)
    proto = helper.make_graph(graph.nodes, "tiny", [image], values, graph.weights)
    return helper.make_model(proto, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def vitpose(joints: int = 17, batch: Any = "N") -> onnx.ModelProto:
    """Heat maps of a quarter of the input: ``heatmaps`` (N, J, 32, 24)."""
    graph = Graph(joints)
    heat = graph.heat("image", MEAN, STD, bgr=False)
    graph.rename(graph.add("AveragePool", heat, kernel_shape=[4, 4], strides=[4, 4]), "heatmaps")
    return model(graph, ["heatmaps"], [batch, 3, *SIZE])


def rtmpose(joints: int = 26, *, bgr: bool = False) -> onnx.ModelProto:
    """Two classifications a joint: ``simcc_x`` (N, J, 192), ``simcc_y`` (N, J, 256)."""
    graph = Graph(joints)
    heat = graph.heat("image", MEAN, STD, bgr)
    for name, axis in (("simcc_x", 2), ("simcc_y", 3)):
        line = graph.add("ReduceMax", heat, axes=[axis], keepdims=0)
        wide = graph.add(
            "Resize",
            line,
            "",
            graph.floats([1, 1, 2]),
            mode="linear",
            coordinate_transformation_mode="asymmetric",
        )
        graph.rename(wide, name)
    return model(graph, ["simcc_x", "simcc_y"], ["N", 3, *SIZE])


def mediapipe(joints: int = 33, rows: int = 39) -> onnx.ModelProto:
    """NHWC in 0 to 1; ``landmarks`` (1, 195): x, y, z, visibility, presence; ``world`` (1, 117)."""
    graph = Graph(rows)
    image = graph.add("Transpose", "image", perm=[0, 3, 1, 2])
    heat = graph.heat(image, (0, 0, 0), (255, 255, 255), bgr=False)
    flat = graph.add("Reshape", heat, graph.integers(0, 0, -1))
    share = graph.add("Softmax", graph.add("Mul", flat, graph.floats(_SHARPNESS)), axis=-1)
    y, x = np.mgrid[:128, :128].reshape(2, -1)
    points = graph.add("MatMul", share, graph.floats(np.stack((x, y), -1)))
    peak = graph.add("ReduceMax", flat, axes=[2], keepdims=1)
    logit = graph.add("Mul", graph.add("Sub", peak, graph.floats(0.1)), graph.floats(100))
    zero = graph.add("Mul", peak, graph.floats(0))
    rowwise = graph.add("Concat", points, zero, logit, zero, axis=2)
    graph.rename(graph.add("Reshape", rowwise, graph.integers(0, -1)), "landmarks")
    pose = graph.add("Add", graph.floats(positions(rows)[None]), zero)
    graph.rename(graph.add("Reshape", pose, graph.integers(0, -1)), "world")
    return model(graph, ["landmarks", "world"], [1, 128, 128, 3])


def vnect(joints: int = 16) -> onnx.ModelProto:
    """NHWC maps ``heat``, ``x``, ``y``, ``z`` (N, 16, 12, J); coordinates in 100 mm."""
    graph = Graph(joints)
    plain = graph.add("Cast", "image", to=TensorProto.FLOAT)
    heat = graph.heat(
        graph.add("Transpose", plain, perm=[0, 3, 1, 2]), (0,) * 3, (1,) * 3, bgr=True
    )
    heat = graph.add("AveragePool", heat, kernel_shape=[8, 8], strides=[8, 8])
    # right at the peak only: elsewhere the maps are off by metres
    peak = graph.add("ReduceMax", heat, axes=[2, 3], keepdims=1)
    off = graph.add("Mul", graph.add("Sub", peak, heat), graph.floats(1000))
    for axis, name in enumerate("xyz"):
        values = 10 * positions(joints)[:, axis].reshape(1, -1, 1, 1)
        located = graph.add("Add", graph.floats(values), off)
        graph.rename(graph.add("Transpose", located, perm=[0, 2, 3, 1]), name)
    graph.rename(graph.add("Transpose", heat, perm=[0, 2, 3, 1]), "heat")
    return model(graph, ["heat", "x", "y", "z"], ["N", *SIZE, 3], TensorProto.UINT8)


def direct(joints: int = 16) -> onnx.ModelProto:
    """``pose`` (N, J * 3), millimetres."""
    graph = Graph(joints)
    zero = graph.add(
        "Mul", graph.add("ReduceMean", "image", axes=[1, 2, 3], keepdims=1), graph.floats(0)
    )
    flat = graph.add("Reshape", zero, graph.integers(0, 1))
    graph.rename(
        graph.add("Add", flat, graph.floats(1000 * positions(joints).reshape(1, -1))), "pose"
    )
    return model(graph, ["pose"], ["N", 3, *SIZE])


def positions(joints: int) -> np.ndarray:
    """The 3D pose that networks above see, (J, 3), metres."""
    return np.random.default_rng(3).uniform(-0.8, 0.8, (joints, 3))


# --- folders --------------------------------------------------------------------------------------

_IMAGE = f"""
[input]
size = [{SIZE[0]}, {SIZE[1]}]
color = "rgb"
mean = {list(MEAN)}
std = {list(STD)}
"""
_CALIBRATION = """
[calibration]
raw = [0.0, 0.1]
probability = [0.0, 1.0]
"""
MANIFESTS = {
    "vitpose": _IMAGE
    + """
[output]
kind = "heatmaps"
names = ["heatmaps"]
decode = "dark"
alignment = "centers"
[joints]
set = "COCO-17"
"""
    + _CALIBRATION,
    "rtmpose": _IMAGE
    + """
[output]
kind = "simcc"
names = ["simcc_x", "simcc_y"]
split = 2.0
[joints]
set = "Halpe-26"
"""
    + _CALIBRATION,
    "mediapipe": """
[input]
size = [128, 128]
color = "rgb"
layout = "nhwc"
scale = 0.00392156862745098
[output]
kind = "coordinates"
names = ["landmarks"]
columns = ["x", "y", "z", "confidence", "ignored"]
activation = "sigmoid"
rows = 39
joints3d = "world"
[joints]
set = "BlazePose-33"
""",
    "vnect": f"""
[input]
size = [{SIZE[0]}, {SIZE[1]}]
color = "bgr"
layout = "nhwc"
dtype = "uint8"
[output]
kind = "location_maps"
names = ["heat", "x", "y", "z"]
layout = "nhwc"
alignment = "centers"
metres = 0.1
[joints]
set = "landmarks16"
"""
    + _CALIBRATION,
    "direct": _IMAGE
    + """
[output]
kind = "joints3d"
joints3d = "pose"
metres = 0.001
[joints]
set = "landmarks16"
""",
}
MODELS = {
    "vitpose": vitpose,
    "rtmpose": rtmpose,
    "mediapipe": mediapipe,
    "vnect": vnect,
    "direct": direct,
}


def write_model(
    folder: Path, proto: onnx.ModelProto | bytes, manifest: str, kind: str = "detector"
) -> Path:
    """A model's folder: ``model.onnx`` and its manifest, to which size and digest are added."""
    data = proto if isinstance(proto, bytes) else proto.SerializeToString()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.onnx").write_bytes(data)
    head = f"""kind = "{kind}"
[[file]]
name = "model.onnx"
size = {max(1, len(data))}
sha256 = "{hashlib.sha256(data).hexdigest()}"
licence = "Apache-2.0"
origin = "made in a test"
"""
    (folder / "manifest.toml").write_text(head + manifest)
    return folder


def write_tiny(folder: Path, name: str, change: tuple[str, str] = ("", "")) -> Path:
    """One of the models above, with a text of its manifest replaced."""
    assert change[0] in MANIFESTS[name]
    return write_model(folder / name, MODELS[name](), MANIFESTS[name].replace(*change, 1))
