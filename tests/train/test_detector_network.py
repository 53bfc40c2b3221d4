"""The detector: maps and their losses, learning, resuming, export."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from perfcap.detect.manifest import Calibration
from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError
from perfcap.train import export as exporting
from perfcap.train.body_parts import PARTS, UNKNOWN
from perfcap.train.config import (
    DetectorConfig,
    DetectorLoss,
    LoopConfig,
    SceneData,
    TrainDetectorConfig,
)
from perfcap.train.crop_batches import CropBatch
from perfcap.train.detector import Detector
from perfcap.train.detector_task import (
    DetectorTask,
    detection_loss,
    heat_targets,
    parts_loss,
    peaks_and_hits,
    pose_loss,
    read_joints,
    score_detector,
    side_at,
)
from perfcap.train.export import export_detector
from perfcap.train.loop import BEST, LAST, train
from perfcap.train.scenes import Shot

TINY = DetectorConfig(size=64, widths=(8, 8, 16, 16), blocks=(1, 1, 1))
CONFIG = TrainDetectorConfig(
    sizes=((0.0, 64),),
    detector=TINY,
    scene=SceneData(size=64),
    loop=LoopConfig(steps=6, batch=4, warmup=1, evaluate_every=3, save_every=3),
)


class Squares:
    """Bright squares: the joints are places in them."""

    def __init__(self, count: int = 6) -> None:
        self._count = count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, number: int) -> Shot:
        rng = np.random.default_rng(number)
        image = np.zeros((64, 64, 3), np.uint8)
        x, y = rng.integers(12, 30, 2)
        image[y : y + 20, x : x + 12] = rng.integers(120, 255, 3)
        share = np.random.default_rng(99).random((16, 2))
        joints = (np.array([x, y]) + share * [11, 19]).astype(np.float32)
        poses = np.random.default_rng(98).normal(size=(16, 3)).astype(np.float32) * 0.3
        parts = (image[::4, ::4, 0] > 0).astype(np.uint8)
        return Shot(image, joints, poses, 80.0, number != 5, parts)


def batch_at(points: torch.Tensor, inside: torch.Tensor) -> CropBatch:
    count = len(points)
    known = torch.ones_like(inside)
    poses = torch.linspace(-1, 1, count * 48).reshape(count, 16, 3)
    parts = torch.randint(len(PARTS), (count, 16, 16), generator=torch.Generator().manual_seed(3))
    crops = torch.zeros(count, 3, 64, 64)
    return CropBatch(crops, points, poses, inside, known, known[:, 0], parts.to(torch.uint8))


@pytest.fixture(scope="module")
def network() -> Detector:
    torch.manual_seed(0)
    return Detector(TINY).eval()


def test_maps_have_a_quarter_of_the_resolution(network: Detector) -> None:
    for height, width in ((64, 64), (96, 64)):
        logits, places = network(torch.zeros(2, 3, height, width))
        assert logits.shape == (2, 16, height // 4, width // 4)
        assert places.shape == (2, 3, 16, height // 4, width // 4)
    crops = torch.rand(2, 3, 64, 64)
    guessed = network.guess(crops)
    assert guessed.pose.shape == (2, 16, 3) and guessed.parts.shape == (2, len(PARTS), 16, 16)
    for one, same in zip(network(crops), guessed, strict=False):
        torch.testing.assert_close(one, same)


def test_targets_are_read_back() -> None:
    points = 10 + 40 * torch.rand(3, 16, 2, generator=torch.Generator().manual_seed(0))
    inside = torch.ones(3, 16, dtype=torch.bool)
    inside[1, 4] = False
    batch = batch_at(points, inside)
    target = heat_targets(batch, 16, 1.0)
    torch.testing.assert_close(target.sum((-2, -1)), torch.ones(3, 16))
    assert target[1, 4].std() == 0
    places = batch.joints3d.mT[..., None, None].expand(3, 3, 16, 16, 16)
    found, peak, joints3d = read_joints((target + 1e-9).log(), places, 64)
    assert (found - points)[inside].abs().max() < 0.05  # a sixteenth of a map pixel
    torch.testing.assert_close(joints3d, batch.joints3d)
    assert peak[1, 4] < 0.01 < 0.08 < peak[inside].min()


def test_the_truth_has_no_loss_and_unknown_joints_none_either() -> None:
    points = 10 + 40 * torch.rand(2, 16, 2, generator=torch.Generator().manual_seed(1))
    inside = torch.ones(2, 16, dtype=torch.bool)
    inside[0, 3] = False
    batch = batch_at(points, inside)
    logits = (heat_targets(batch, 16, 1.0) + 1e-12).log()
    places = batch.joints3d.mT[..., None, None].expand(2, 3, 16, 16, 16)
    losses = detection_loss(logits, places, batch, DetectorLoss())
    assert losses["heat"].abs() < 1e-4 and losses["places"] < 1e-5
    assert pose_loss(batch.joints3d, batch) == 0
    known = batch.known.clone()
    known[:, 5] = False
    spoilt = replace(batch, known=known, inside=batch.inside & known)
    logits[:, 5] = torch.randn(16, 16)
    assert detection_loss(logits, places, spoilt, DetectorLoss())["heat"].abs() < 1e-4
    unposed = replace(batch, posed=torch.zeros(2, dtype=torch.bool))
    assert detection_loss(logits, places + 1, unposed, DetectorLoss())["places"] == 0


def test_parts_are_learned_at_people_as_much_as_around_them() -> None:
    batch = batch_at(torch.zeros(2, 16, 2), torch.ones(2, 16, dtype=torch.bool))
    batch.parts[:, 4:] = 0
    right = 40 * torch.nn.functional.one_hot(batch.parts.long(), len(PARTS)).movedim(-1, 1).float()
    assert parts_loss(right, batch) < 1e-6
    even = torch.zeros_like(right)
    assert parts_loss(even, batch) == pytest.approx(2 * np.log(len(PARTS)))
    nobody = right.clone()
    nobody[:, :, :4] = right[:, :, -1:]
    assert parts_loss(nobody, batch) > 30  # though few pixels are of people
    unknown = replace(batch, parts=torch.full_like(batch.parts, UNKNOWN))
    assert parts_loss(even, unknown) == 0
    everybody = right.clone()
    everybody[:, 0] -= 100  # and so is this where pixels are of nobody
    assert parts_loss(everybody, batch) > 30


def test_sizes_follow_the_progress() -> None:
    config = replace(CONFIG, sizes=((0.0, 96), (0.5, 128), (0.9, 192)))
    assert [side_at(config, p) for p in (0, 0.49, 0.5, 0.89, 0.95, 1)] == [
        96,
        96,
        128,
        128,
        192,
        192,
    ]


def test_a_tiny_network_learns_in_a_few_steps() -> None:
    loop = replace(CONFIG.loop, learning_rate=5e-3, batch=6)
    task = DetectorTask(Squares(5), Squares(5), replace(CONFIG, loop=loop))
    optimizer = torch.optim.AdamW(task.model.parameters(), lr=5e-3)
    losses = []
    for number in range(25):
        loss = task.loss(number, 6, 0.0)
        optimizer.zero_grad()
        loss["loss"].backward()
        optimizer.step()
        losses.append([float(loss[name].detach()) for name in ("loss", "heat", "places", "pose")])
    first, last = np.mean(losses[:3], 0), np.mean(losses[-3:], 0)
    assert last[0] < 0.85 * first[0] and (last < first).all(), (first, last)


@pytest.mark.long
def test_resumed_training_ends_with_the_same_weights(tmp_path: Path) -> None:
    described = asdict(CONFIG)

    def run(folder: Path, resume: bool = False) -> Detector:
        task = DetectorTask(Squares(), Squares(), CONFIG)
        return train(task, CONFIG.loop, folder, described, resume=resume)

    whole = run(tmp_path / "whole").state_dict()

    class Stopped(Exception):
        pass

    def stop(stage: str, done: int, total: int) -> None:
        if done == 4:
            raise Stopped

    task = DetectorTask(Squares(), Squares(), CONFIG)
    with pytest.raises(Stopped):
        train(task, CONFIG.loop, tmp_path / "parts", described, progress=stop)
    parts = run(tmp_path / "parts", resume=True).state_dict()
    assert all(torch.equal(whole[name], parts[name]) for name in whole)
    files = {path.name for path in (tmp_path / "parts").iterdir()}
    assert files == {BEST, LAST, "metrics.jsonl"}


def test_scores_of_joints_found_and_missed(network: Detector) -> None:
    shots = Squares(6)
    scores = score_detector(network, shots, CONFIG, torch.device("cpu"))
    assert scores["missed %"] + scores["PCK %"] == pytest.approx(100)
    peaks, hits = peaks_and_hits(network, shots, CONFIG, torch.device("cpu"))
    assert peaks.shape == hits.shape == (96,) and peaks.min() > 0 and peaks.max() <= 1
    assert not hits[-16:].any()  # nobody is there


@pytest.mark.long
def test_export_says_the_same_and_opens(network: Detector, tmp_path: Path) -> None:
    calibration = Calibration((0.0, 0.1, 0.2), (0.0, 0.5, 0.9))
    export_detector(network, tmp_path, calibration, 'made "here"', "CC0-1.0")
    detector = OnnxDetector(tmp_path, flip_test=False)
    assert not detector.joint_set.missing() and detector.manifest.output.crop_axes
    assert OnnxDetector(tmp_path).flip_test
    crops = np.random.default_rng(0).integers(0, 255, (3, 64, 64, 3), dtype=np.uint8)
    found = detector.estimate(crops)
    with torch.no_grad():
        maps = network(torch.tensor(crops).permute(0, 3, 1, 2).float())
    points, peak, joints3d = read_joints(*maps, 64)
    torch.testing.assert_close(found.joints2d, points, atol=1e-2, rtol=0)
    assert found.joints3d is not None
    torch.testing.assert_close(found.joints3d, joints3d, atol=1e-4, rtol=0)
    expected = torch.tensor(np.interp(peak.numpy(), calibration.raw, calibration.probability))
    torch.testing.assert_close(found.confidence.double(), expected, atol=1e-4, rtol=0)
    written = (tmp_path / "model.onnx").read_bytes()
    assert b"site-packages" not in written and b"/home" not in written


@pytest.mark.long
def test_an_export_that_differs_is_refused(
    network: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = exporting.DetectorMaps(network)
    axes = {"crops": {0: torch.export.Dim("crops")}}
    data = exporting.to_onnx(model, torch.zeros(2, 3, 64, 64), exporting.OUTPUTS, axes)
    torch.manual_seed(1)
    other = exporting.DetectorMaps(Detector(TINY).eval())
    with pytest.raises(InputError, match=r"output 'heat' of onnxruntime differs"):
        exporting.check_maps_equal(other, data, 64)
    torch.nn.init.constant_(other.detector.maps.weight, float("nan"))
    with pytest.raises(InputError, match="not finite; train again with a lower learning rate"):
        exporting.check_maps_equal(other, data, 64)
