"""What is computed where it is looked at alone, against the same for whole maps and all joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from perfcap.detect import joint_set as sets
from perfcap.detect.candidates import _highest_around, _mass
from perfcap.detect.heatmap import _blurred_patch, argmax2d
from perfcap.detect.joint_set import LANDMARKS, JointSet, map_to_landmarks
from perfcap.detect.look import sureness
from perfcap.detect.manifest import InputSpec, read_manifest
from perfcap.detect.onnx import OnnxDetector, _average
from perfcap.detect.session import prepare_crops
from perfcap.io.actor import models_folder

SHAPES = [(1, 16, 56, 56), (2, 3, 24, 32), (3, 5, 64, 48)]


def heat(shape: tuple[int, ...], seed: int = 0, dtype: torch.dtype = torch.float32) -> Tensor:
    """Maps with a few sharp peaks, and some negative pixels."""
    random = torch.Generator().manual_seed(seed)
    return torch.rand(shape, generator=random, dtype=dtype) ** 8 - 0.01


@pytest.mark.parametrize("shape", SHAPES)
def test_highest_neighbours(shape: tuple[int, ...]) -> None:
    for maps in (heat(shape), torch.zeros(shape), heat(shape).index_fill(0, torch.tensor(0), -1)):
        assert torch.equal(_highest_around(maps), nn.functional.max_pool2d(maps, 3, 1, 1))


@pytest.mark.parametrize("shape", SHAPES)
def test_mass_about_pixels(shape: tuple[int, ...]) -> None:
    maps, (height, width) = heat(shape), shape[-2:]
    random = torch.Generator().manual_seed(1)
    row = torch.randint(height, (*shape[:2], 6), generator=random)
    column = torch.randint(width, (*shape[:2], 6), generator=random)
    row[..., 0], column[..., 0] = 0, width - 1  # a corner
    mass = nn.functional.avg_pool2d(maps.clamp(min=0), 3, 1, 1)
    expected = mass.flatten(2).gather(2, row * width + column)
    torch.testing.assert_close(_mass(maps, row, column), expected, rtol=1e-6, atol=0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("sigma", [0.2, 1.0, 1.7])
def test_smoothed_pixels_about_peaks(sigma: float, dtype: torch.dtype) -> None:
    maps = heat((2, 8, 40, 30), dtype=dtype)
    peak = argmax2d(maps[..., 1:-1, 1:-1])[0] + 1  # inside
    reach = max(1, round(3 * sigma))
    offset = torch.arange(-reach, reach + 1, dtype=dtype)
    kernel = torch.exp(-0.5 * (offset / sigma).square())
    kernel = kernel / kernel.sum()
    flat = nn.functional.pad(maps.reshape(-1, 1, 40, 30), (reach,) * 4, mode="replicate")
    rows = nn.functional.conv2d(flat, kernel[None, None, None, :])
    whole = nn.functional.conv2d(rows, kernel[None, None, :, None]).reshape(maps.shape)
    found = _blurred_patch(maps, peak, sigma)
    for person, joint in np.ndindex(2, 8):
        x, y = peak[person, joint].long().tolist()
        expected = whole[person, joint, y - 1 : y + 2, x - 1 : x + 2]
        torch.testing.assert_close(found[person, joint], expected, rtol=1e-6, atol=0)


@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("joint_set", sets.JOINT_SETS, ids=lambda s: s.name)
def test_landmarks_one_by_one(joint_set: JointSet, measured: bool) -> None:
    """By the recipe of each landmark, for batches in which joints are missing."""
    random = torch.Generator().manual_seed(2)
    values = torch.randn(4, 5, len(joint_set), 2, generator=random)
    confidence = torch.rand(4, 5, len(joint_set), generator=random) - 0.2
    mapped, trust = map_to_landmarks(values, confidence, joint_set, measured=measured)
    seen = confidence > 0
    values, confidence = torch.where(seen[..., None], values, 0), confidence.clamp(min=0)
    for place, name in enumerate(LANDMARKS):
        joints = list(joint_set.sources(name, measured=measured))
        if not joints:
            assert (trust[..., place] == 0).all() and (mapped[..., place, :] == 0).all()
            continue
        shares = torch.tensor(joint_set.shares(name))[:, None]
        least = confidence[..., joints].amin(-1)
        mean = (shares * values[..., joints, :]).sum(-2)
        assert torch.equal(trust[..., place], least)
        assert torch.equal(mapped[..., place, :], torch.where(least[..., None] > 0, mean, 0))


@pytest.mark.parametrize("joint_set", sets.JOINT_SETS, ids=lambda s: s.name)
def test_sureness_is_the_mean_of_landmarks(joint_set: JointSet) -> None:
    confidence = torch.rand(len(joint_set), generator=torch.Generator().manual_seed(3))
    names = [name for name in LANDMARKS if name != "head_top" or name in joint_set.joints]
    known = [list(joint_set.sources(name)) for name in names if joint_set.sources(name)]
    expected = float(torch.stack([confidence[each].amin() for each in known]).mean())
    assert sureness(confidence, joint_set) == expected


@pytest.mark.parametrize("name", ["thunder", "blazepose", "rendered", "multipose"])
@pytest.mark.parametrize("color", ["rgb", "bgr"])
@pytest.mark.parametrize(
    "normal", [(1.0, (0.0,) * 3, (1.0,) * 3), (1 / 255, (0.4,) * 3, (2.0,) * 3)]
)
def test_inputs_of_networks(
    name: str, color: str, normal: tuple[float, tuple[float, ...], tuple[float, ...]]
) -> None:
    own: InputSpec = read_manifest(models_folder() / "detectors" / name).input
    crops = np.random.default_rng(0).integers(0, 256, (2, 20, 30, 3)).astype(np.uint8)
    scale, mean, std = normal
    for spec in (own, replace(own, color=color, scale=scale, mean=mean, std=std)):
        channels = crops[..., ::-1] if spec.color == "bgr" else crops
        about = (np.asarray(v, np.float32) for v in (spec.mean, spec.std))
        shift, size = about
        expected = ((channels * np.float32(spec.scale) - shift) / size).astype(spec.dtype)
        if spec.layout == "nchw":
            expected = expected.transpose(0, 3, 1, 2)
        found = prepare_crops(crops, spec)
        assert found.dtype == expected.dtype and np.array_equal(found, expected)


@pytest.mark.long
@pytest.mark.parametrize("count", [1, 3, 17])
def test_mirror_images_in_one_batch(count: int) -> None:
    """A look and its mirror image are what two looks are."""
    detector = OnnxDetector(models_folder() / "detectors" / "rendered")
    assert detector.flip_test
    size = (count, *detector.crop_size, 3)
    crops = np.random.default_rng(1).integers(0, 256, size).astype(np.uint8)
    found = detector.estimate(crops)
    one, other = detector._run(crops), detector._run(crops[:, :, ::-1])
    expected = _average(one, detector._mirror(other), detector.crop_size)
    assert found.candidates is not None and expected.candidates is not None
    for pair in (
        (found.joints2d, expected.joints2d),
        (found.confidence, expected.confidence),
        (found.candidates.places, expected.candidates.places),
        (found.candidates.support, expected.candidates.support),
    ):
        torch.testing.assert_close(*pair, rtol=1e-5, atol=1e-5)
