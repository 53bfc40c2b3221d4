"""``perfcap train detector``, from motion to a model that opens, and what it refuses."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from motion_files import write_library
from runs import Command

from perfcap.detect.onnx import OnnxDetector
from perfcap.train.checkpoint import Checkpoint, save_checkpoint, start_from
from perfcap.train.config import DetectorConfig
from perfcap.train.detector import Detector

VALUES = {"step": "1", "best": "1.0", "config": "{}"}
PEOPLE = ("--held-out", "03", "--validation", "02")
TINY = (
    *("--crops", 32, "--validation-crops", 32, "--sizes", 0.0, 64, "--actors"),
    *("--loop.steps", 2, "--loop.batch", 2, "--loop.evaluate-every", 2, "--loop.warmup", 1),
    *("--detector.size", 64, "--detector.widths", 8, 8, 8, 8, "--detector.blocks", 1, 1, 1),
    *("--scene.size", 48, "--scene.group", 1, "--scene.texture", 32, "--scene.shadowed", 0.0),
)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_library(tmp_path_factory.mktemp("motion"), frames=20)


@pytest.mark.slow
def test_trains_exports_and_describes(perfcap: Command, library: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    call = ["train", "detector", "--motion", library, "--out", out, *PEOPLE, *TINY]
    outcome = perfcap(call)
    assert outcome.code == 0 and "PCK" in outcome.out
    assert {p.name for p in out.iterdir()} >= {
        "best.safetensors",
        "last.safetensors",
        "crops",
        "model",
    }
    detector = OnnxDetector(out / "model")
    assert not detector.joint_set.missing()
    card = (out / "model" / "card.md").read_text()
    assert "Where it fails" in card and "1 recorded people (01)" in card
    assert "--resume" in perfcap(call).refused()
    assert perfcap([*call, "--resume"]).code == 0
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    cv2.imwrite(str(pictures / "grey.png"), np.full((40, 60, 3), 99, np.uint8))
    behind = perfcap([*call, "--resume", "--backgrounds", pictures])
    assert "crops of other settings or backgrounds" in behind.refused()
    more = ("--crops-folder", out / "crops", "--start", out / "model/weights.safetensors")
    wider = ("--detector.widths", 8, 8, 8, 16)
    other = perfcap([*call[:4], "--out", tmp_path / "b", *PEOPLE, *TINY, *more, *wider])
    assert "is of another network" in other.refused()


def test_a_network_grows(tmp_path: Path) -> None:
    torch.manual_seed(0)
    small, large = (
        Detector(DetectorConfig(64, (8, 8, 16, 16), (1, 1, count))).eval() for count in (1, 2)
    )
    crops = 255 * torch.rand(2, 3, 64, 64)
    weights = {f"average.{name}": value for name, value in small.state_dict().items()}
    save_checkpoint(tmp_path / "small", Checkpoint(weights, VALUES))
    start_from(large, tmp_path / "small")
    for one, same in zip(small(crops), large(crops), strict=True):
        torch.testing.assert_close(one, same)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("--sizes", 0.5, 64), "start at [0.5]; expected rising shares"),
        (("--sizes", 0.0, 64, 45, 64), "expected rising shares of the steps, from 0 to below 1"),
        (("--sizes", 0.0, 100), "expected multiples of 32"),
        (("--detector.size", 96), "the last one detector.size"),
        (("--held-out", "09"), "09 have no clips"),
        (("--held-out", "02"), "02 are named twice"),
    ],
)
def test_refuses_in_a_line(
    perfcap: Command,
    library: Path,
    tmp_path: Path,
    change: tuple[object, ...],
    message: str,
) -> None:
    call = ["train", "detector", "--motion", library, "--out", tmp_path, *PEOPLE, *TINY, *change]
    assert message in perfcap(call).refused()
