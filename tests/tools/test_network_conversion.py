"""Conversion of TensorFlow's networks: what is shipped, and the parts that could go wrong."""

import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tools"))

from network_conversion.graph import Graph, same_padding  # noqa: E402


@pytest.mark.parametrize(
    ("size", "kernel", "stride", "expected"),
    [(8, 3, 1, (1, 1)), (8, 3, 2, (0, 1)), (7, 3, 2, (1, 1)), (8, 2, 2, (0, 0)), (5, 1, 2, (0, 0))],
)
def test_same_padding_is_tensorflows(
    size: int, kernel: int, stride: int, expected: tuple[int, int]
) -> None:
    top, left, bottom, right = same_padding((size, 6), (kernel, 1), (stride, 1))
    assert (top, bottom) == expected and (left, right) == (0, 0)


def test_a_graph_computes_keeps_half_floats_and_drops_what_nobody_needs(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    weight = rng.normal(size=(3, 3, 2, 5)).astype(np.float16)
    paths = [tmp_path / "one.onnx", tmp_path / "two.onnx"]
    for path in paths:
        graph = Graph()
        nchw = graph.add("Transpose", "image", perm=[0, 3, 1, 2])
        bias = np.arange(5, dtype=np.float16)
        found = graph.convolve(nchw, weight, bias, (1, 1), (0, 0, 0, 0), depthwise=False)
        graph.add("Relu", found)  # leads nowhere
        graph.add("Identity", found, name="answer")
        graph.save(path, "test", {"image": ("N", 4, 4, 2)}, {"answer": ("N", 5, 2, 2)})
        assert {w.name for w in graph.weights if w.data_type == 10}, "weights are half floats"
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert b"Relu" not in paths[0].read_bytes()
    images = rng.normal(size=(2, 4, 4, 2)).astype(np.float32)
    (answer,) = onnxruntime.InferenceSession(str(paths[0])).run(None, {"image": images})
    windows = np.lib.stride_tricks.sliding_window_view(images, (3, 3), axis=(1, 2))
    expected = np.einsum("nyxihw,hwio->noyx", windows, weight.astype(np.float32))
    np.testing.assert_allclose(answer, expected + np.arange(5)[:, None, None], atol=1e-4)


@pytest.mark.long
def test_shipped_networks_answer_any_number_of_crops_alike() -> None:
    rng = np.random.default_rng(1)
    sizes = {"thunder": 256, "lightning": 192, "blazepose": 256, "blazepose_heavy": 256}
    for name, size in sizes.items():
        model = ROOT / "models" / "detectors" / name / "model.onnx"
        session = onnxruntime.InferenceSession(str(model))
        images = rng.random((2, size, size, 3)).astype(np.float32)
        both = session.run(["joints"], {"image": images})[0]
        apart = [session.run(["joints"], {"image": images[[i]]})[0][0] for i in range(2)]
        np.testing.assert_allclose(both, np.stack(apart), rtol=1e-4, atol=1e-4)


@pytest.mark.long
def test_the_shipped_network_of_several_people_takes_images_of_any_number_and_size() -> None:
    model = ROOT / "models" / "detectors" / "multipose" / "model.onnx"
    session = onnxruntime.InferenceSession(str(model))
    rng = np.random.default_rng(1)
    for height, width in ((256, 256), (160, 256), (320, 224)):
        images = 255 * rng.random((2, height, width, 3)).astype(np.float32)
        (both,) = session.run(["people"], {"image": images})
        apart = [session.run(["people"], {"image": images[[i]]})[0][0] for i in range(2)]
        assert both.shape == (2, 6, 56)
        np.testing.assert_allclose(both, np.stack(apart), rtol=1e-4, atol=1e-4)
        scores, joints = both[..., 55], both[..., :51].reshape(2, 6, 17, 3)
        assert ((scores >= 0) & (scores <= 1)).all()
        low, high = both[..., 51:53], both[..., 53:55]
        assert (low >= 0).all() and (high <= 1).all() and (low <= high).all()
        inside = (joints[..., :2] > low[:, :, None] - 0.1) & (
            joints[..., :2] < high[:, :, None] + 0.1
        )
        assert inside[joints[..., 2] > 0.05].all(), "joints are looked for within the box"


def test_a_graph_has_nodes_of_two_outputs(tmp_path: Path) -> None:
    graph = Graph()
    values, places = graph.add_pair("TopK", "rows", graph.whole(2), axis=1)
    graph.add("Identity", values, name="values")
    graph.add("Cast", places, name="places", to=1)
    graph.save(
        tmp_path / "g.onnx", "test", {"rows": ("N", 4)}, {"values": ("N", 2), "places": ("N", 2)}
    )
    rows = np.array([[1, 4, 2, 3]], np.float32)
    found = onnxruntime.InferenceSession(str(tmp_path / "g.onnx")).run(None, {"rows": rows})
    np.testing.assert_array_equal(found, [[[4, 3]], [[1, 3]]])
