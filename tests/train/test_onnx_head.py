"""Heads on the features of networks in ONNX files: found, written, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import torch
from tiny_networks import write_tiny

from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError
from perfcap.io.actor import models_folder
from perfcap.train.export_head import export_head
from perfcap.train.head import Head, landmark_map
from perfcap.train.onnx_head import FrozenNetwork

BLAZEPOSE = models_folder() / "detectors" / "blazepose"


def crops(network: FrozenNetwork, count: int = 3) -> np.ndarray:
    height, width = network.manifest.input.size
    random = np.random.default_rng(1)
    return random.integers(0, 256, (count, height, width, 3), np.uint8)


def head_of(network: FrozenNetwork, size: float) -> Head:
    head = Head.of(
        network(crops(network, 8)).features,
        network.manifest.input.size[1],
        network.manifest.joint_set,
    )
    random = torch.Generator().manual_seed(0)
    with torch.no_grad():
        head.weight.normal_(0, size, generator=random)
        head.offset.normal_(0, size, generator=random)
    return head


@pytest.fixture(scope="module")
def blazepose() -> FrozenNetwork:
    return FrozenNetwork(BLAZEPOSE)


def test_both_outputs_of_blazepose_read_the_same_features(blazepose: FrozenNetwork) -> None:
    assert len(blazepose.features) == 1 and blazepose.count == 288 * 2 * 2
    found = blazepose(crops(blazepose, 2))
    assert found.features.shape == (2, blazepose.count) and float(found.features.std()) > 0.01
    expected = OnnxDetector(BLAZEPOSE).estimate(crops(blazepose, 2))
    torch.testing.assert_close(found.estimate.joints3d, expected.joints3d, atol=1e-4, rtol=0)


@pytest.mark.long
def test_a_new_head_changes_nothing(blazepose: FrozenNetwork, tmp_path: Path) -> None:
    export_head(blazepose, head_of(blazepose, 0.0), tmp_path / "same", "a test", None)
    seen = crops(blazepose)
    shipped, written = (OnnxDetector(p) for p in (BLAZEPOSE, tmp_path / "same"))
    before, after = shipped.estimate(seen), written.estimate(seen)
    assert torch.equal(before.joints2d, after.joints2d)
    assert torch.equal(before.confidence, after.confidence)
    assert before.joints3d is not None and after.joints3d is not None
    assert torch.equal(before.joints3d, after.joints3d)
    assert written.manifest.input == shipped.manifest.input
    assert written.manifest.output == shipped.manifest.output
    assert "a test; on " in written.manifest.file.origin


@pytest.mark.long
def test_what_is_written_moves_landmarks_as_torch_does(
    blazepose: FrozenNetwork, tmp_path: Path
) -> None:
    head = head_of(blazepose, 0.1)
    export_head(blazepose, head, tmp_path / "moved", 'a "test"', 0.0421)  # it compares with torch
    written, seen = OnnxDetector(tmp_path / "moved"), crops(blazepose)
    assert written.manifest.output.error3d == 0.04
    answers = blazepose(seen)
    with torch.no_grad():
        moves = head(answers.features)
    found = written.estimate(seen)
    made = landmark_map(written.joint_set)
    assert answers.estimate.joints3d is not None and found.joints3d is not None
    for before, after, move in (
        (answers.estimate.joints2d, found.joints2d, moves[0]),
        (answers.estimate.joints3d, found.joints3d, moves[1]),
    ):
        assert float(move.abs().max()) > 0.05
        torch.testing.assert_close(made @ (after - before), move, atol=2e-3, rtol=1e-3)


def test_columns_of_a_flat_output_stay_in_place(tmp_path: Path) -> None:
    network = FrozenNetwork(write_tiny(tmp_path, "mediapipe"), ("t11",))  # peaks of its heat maps
    assert network.count == 39  # rows, of which 33 are joints; one crop a batch
    export_head(network, head_of(network, 0.05), tmp_path / "moved", "a test", None)
    seen = crops(network)
    before, after = network(seen).estimate, OnnxDetector(tmp_path / "moved").estimate(seen)
    assert torch.equal(before.confidence, after.confidence)
    assert float((before.joints2d - after.joints2d).abs().max()) > 0.1


@pytest.mark.parametrize(
    ("name", "features", "said"),
    [
        ("vnect", (), "answers with location_maps"),
        ("direct", (), "answers with joints3d"),
        ("mediapipe", ("nothing",), "has no tensor 'nothing'"),
        ("mediapipe", ("t1",), "features, expected at most 8192"),
    ],
)
def test_what_cannot_have_a_head_is_refused(
    tmp_path: Path, name: str, features: tuple[str, ...], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        FrozenNetwork(write_tiny(tmp_path, name), features)


def test_an_expected_error_is_a_length(tmp_path: Path) -> None:
    folder = write_tiny(tmp_path, "mediapipe", ("joints3d", "error3d = 0.0\njoints3d"))
    with pytest.raises(InputError, match=r"error3d is 0\.0"):
        FrozenNetwork(folder)
