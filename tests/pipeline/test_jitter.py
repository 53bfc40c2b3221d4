"""The noise of detections is measured, and clean ones are believed."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor, cameras
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.pipeline.config import MONOPERFCAP_POSE, PoseConfig
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import jitter, relaxed

CONFIG = PoseConfig()
DETECTIONS = make_take(60).detections
UNIT = 0.01 * DETECTIONS.person_height()


def problem(detections: Detections, config: PoseConfig = CONFIG) -> FrameProblem:
    """In the unit of the exact detections, whatever was done to them."""
    return FrameProblem(actor(), cameras(1), detections, config, UNIT)


def noisy(deviation: float) -> Detections:
    """White noise in percent of the person's height."""
    random = torch.Generator().manual_seed(0)
    noise = torch.randn(DETECTIONS.joints2d.shape, generator=random, dtype=torch.float64)
    pixels = DETECTIONS.joints2d + deviation * UNIT[:, None, None] * noise
    return replace(DETECTIONS, joints2d=pixels)


@pytest.mark.parametrize("deviation", [0.05, 0.1, 0.5])
def test_white_noise_is_measured(deviation: float) -> None:
    assert jitter(problem(noisy(deviation))) == pytest.approx(deviation, rel=0.1)


def test_noisy_detections_keep_the_weights() -> None:
    assert relaxed(problem(noisy(0.5))).config is CONFIG


def test_clean_detections_lower_both_weights_to_the_floor() -> None:
    found = relaxed(problem(DETECTIONS)).config
    assert found.trajectory.weight == pytest.approx(CONFIG.cleanest)
    assert found.prior.weight == pytest.approx(CONFIG.cleanest)


def test_weights_follow_the_square_of_the_noise() -> None:
    weights = [relaxed(problem(noisy(d))).config.trajectory.weight for d in (0.05, 0.1)]
    assert weights[1] / weights[0] == pytest.approx(4, rel=0.2)


def test_a_jump_is_not_clean() -> None:
    pixels = DETECTIONS.joints2d.clone()
    pixels[30, 0, 4] += 30 * UNIT[0]
    assert relaxed(problem(replace(DETECTIONS, joints2d=pixels))).config is CONFIG


def test_one_view_without_depth_keeps_the_weights() -> None:
    flat = Detections.from_joints(DETECTIONS.joints2d, DETECTIONS.confidence2d)
    assert relaxed(problem(flat)).config is CONFIG


@pytest.mark.parametrize("frames", [1, 3])
def test_too_short_to_tell(frames: int) -> None:
    assert relaxed(problem(DETECTIONS.frames(slice(0, frames)))).config is CONFIG


def test_published_weights_stay() -> None:
    assert relaxed(problem(DETECTIONS, MONOPERFCAP_POSE)).config is MONOPERFCAP_POSE
