"""Networks without the outputs that nobody asks for: the same answers, less work."""

from __future__ import annotations

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper, numpy_helper

from perfcap.detect.manifest import read_manifest
from perfcap.detect.onnx_prune import prune_outputs
from perfcap.detect.session import Session
from perfcap.io.actor import models_folder


def two_answers(nested: bool = False) -> onnx.ModelProto:
    """``small`` by one node, ``large`` by two more; with ``nested``, by one that holds a graph."""
    floats = TensorProto.FLOAT
    image = helper.make_tensor_value_info("image", floats, ["N", 4])
    answers = [helper.make_tensor_value_info(n, floats, ["N", 4]) for n in ("small", "large")]
    nodes = [
        helper.make_node("Mul", ["image", "two"], ["half"]),
        helper.make_node("Relu", ["half"], ["small"]),
        helper.make_node("Exp", ["half"], ["between"]),
        helper.make_node("Add", ["between", "two"], ["large"]),
    ]
    if nested:
        answer = helper.make_tensor_value_info("kept", floats, ["N", 4])
        body = helper.make_graph(
            [helper.make_node("Identity", ["between"], ["kept"])], "body", [], [answer]
        )
        nodes[3] = helper.make_node("If", ["yes"], ["large"], then_branch=body, else_branch=body)
    weights = [numpy_helper.from_array(np.float32([2.0]), "two")]
    weights += [numpy_helper.from_array(np.array(True), "yes")] if nested else []
    graph = helper.make_graph(nodes, "two_answers", [image], answers, weights)
    opset = [helper.make_opsetid("", 17)]
    return helper.make_model(graph, opset_imports=opset, ir_version=8, doc_string="kept")


def answers(data: bytes, names: list[str], image: np.ndarray) -> list[np.ndarray]:
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    return session.run(names, {session.get_inputs()[0].name: image})


@pytest.mark.parametrize(("name", "nodes"), [("small", 2), ("large", 3)])
def test_what_is_left_answers_as_before(name: str, nodes: int) -> None:
    whole = two_answers()
    data = prune_outputs(whole.SerializeToString(), [name])
    left = onnx.load_from_string(data)
    onnx.checker.check_model(left, full_check=True)
    assert [output.name for output in left.graph.output] == [name]
    assert len(left.graph.node) == nodes
    assert left.doc_string == whole.doc_string
    image = np.random.default_rng(0).normal(size=(3, 4)).astype(np.float32)
    (found,), (expected,) = (
        answers(each, [name], image) for each in (data, whole.SerializeToString())
    )
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("wanted", [(), ("small", "large"), ("other",), ("small", "other")])
def test_nothing_is_cut_where_all_is_wanted_or_what_is_not_there(wanted: tuple[str, ...]) -> None:
    data = two_answers().SerializeToString()
    assert prune_outputs(data, wanted) == data


def test_graphs_inside_nodes_are_left_alone() -> None:
    data = two_answers(nested=True).SerializeToString()
    assert prune_outputs(data, ["small"]) == data


@pytest.mark.parametrize("data", [b"", b"\x3a\xff", b"\x3a\x02\x62\x05", b"no model at all"])
def test_what_is_no_model_is_left_to_the_runtime(data: bytes) -> None:
    assert prune_outputs(data, ["small"]) == data


@pytest.mark.parametrize("seed", range(20))
def test_damaged_models_never_raise(seed: int) -> None:
    random = np.random.default_rng(seed)
    data = bytearray(two_answers().SerializeToString())
    for place in random.integers(0, len(data), 4).tolist():
        data[place] = int(random.integers(256))
    for damaged in (bytes(data), bytes(data[: random.integers(len(data))])):
        assert len(prune_outputs(damaged, ["small"])) <= len(damaged)


def test_a_shipped_network_answers_to_the_last_bit() -> None:
    manifest = read_manifest(models_folder() / "detectors" / "blazepose")
    wanted = (*manifest.output.names, manifest.output.joints3d)
    whole, cut = Session(manifest.file), Session(manifest.file, wanted=wanted)
    assert set(cut.outputs) == set(wanted) < set(whole.outputs)
    image = np.random.default_rng(1).random((1, *manifest.input.size, 3)).astype(np.float32)
    feeds = {whole.inputs[0]: image}
    for found, expected in zip(cut.run(feeds, wanted), whole.run(feeds, wanted), strict=True):
        assert np.array_equal(found, expected)


def test_an_unknown_output_leaves_all_to_choose_from() -> None:
    manifest = read_manifest(models_folder() / "detectors" / "blazepose")
    session = Session(manifest.file, wanted=("joints", "none"))
    assert {"joints", "world", "mask"} <= set(session.outputs)
