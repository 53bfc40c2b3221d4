"""Settings of training that cannot be."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.train.augment import random_framing
from perfcap.train.config import (
    Augmentation,
    DetectorConfig,
    DetectorLoss,
    DetectorNoise,
    LifterConfig,
    LiftingData,
    LiftingLoss,
    LoopConfig,
    SceneData,
    TrainDetectorConfig,
    TrainLifterConfig,
)


@pytest.mark.parametrize(
    "wrong",
    [
        {"lifter": LifterConfig(channels=0)},
        {"lifter": LifterConfig(dropout=2.0)},
        {"lifter": LifterConfig(dilations=(0,))},
        {"dense": 3.0},
        {"data": LiftingData(rate=(60.0, 30.0))},
        {"data": LiftingData(size=float("nan"))},
        {"data": LiftingData(rate=(0.033, 0.04))},
        {"data": LiftingData(distance=(2200.0, 9000.0))},
        {"data": LiftingData(bone=4.0)},
        {"data": LiftingData(roll=float("inf"))},
        {"data": LiftingData(frames=0)},
        {"data": LiftingData(frames=1)},
        {"loop": LoopConfig(seed=-1)},
        {"loop": LoopConfig(seed=2**32)},
        {"data": LiftingData(elevation=(8.0, -1.0))},
        {"data": LiftingData(noise=DetectorNoise(gaps=7.0))},
        {"loss": LiftingLoss(velocity=-1.0)},
    ],
)
def test_no_lifter_can_be_made_of_it(wrong: dict[str, Any]) -> None:
    TrainLifterConfig().require_sound()
    with pytest.raises(InputError, match="expected"):
        replace(TrainLifterConfig(), **wrong).require_sound()


@pytest.mark.parametrize(
    "wrong",
    [
        {"crops": 0},
        {"detector": DetectorConfig(size=0)},
        {"detector": DetectorConfig(blocks=(1, 0, 5))},
        {"detector": DetectorConfig(blocks=(1, 3))},
        {"detector": DetectorConfig(widths=(24, 48, 96))},
        {"scene": SceneData(elevation=(float("nan"), 14.0))},
        {"scene": SceneData(elevation=(8.0, -14.0))},
        {"scene": SceneData(empty=2.0)},
        {"scene": SceneData(distance=(9.0, 2.0))},
        {"scene": SceneData(distance=(2000.0, 9000.0))},
        {"scene": SceneData(margin=0.0)},
        {"augmentation": Augmentation(blur=float("nan"))},
        {"augmentation": Augmentation(zoom=(0.0, 1.2))},
        {"augmentation": Augmentation(zoom=(85.0, 120.0))},
        {"augmentation": Augmentation(smallest=40.0)},
        {"augmentation": Augmentation(zoom=(0.3, 0.5))},
        {"augmentation": Augmentation(smallest=float("nan"))},
        {"augmentation": Augmentation(turn=float("inf"))},
        {"scene": SceneData(margin=float("inf"))},
        {"scene": SceneData(roll=float("inf"))},
        {"scene": SceneData(size=3)},
        {"loss": DetectorLoss(deviation=0.0)},
        {"loss": DetectorLoss(pose=-1.0)},
    ],
)
def test_no_detector_can_be_made_of_it(wrong: dict[str, Any]) -> None:
    TrainDetectorConfig().require_sound()
    with pytest.raises(InputError, match="expected"):
        replace(TrainDetectorConfig(), **wrong).require_sound()


@pytest.mark.parametrize(
    "settings",
    [
        Augmentation(),
        Augmentation(small=1.0, smallest=0.85),
        Augmentation(small=1.0, zoom=(0.4, 0.4)),
        Augmentation(small=0.0, zoom=(0.3, 0.5)),
    ],
)
def test_sizes_that_can_be_drawn_from(settings: Augmentation) -> None:
    replace(TrainDetectorConfig(), augmentation=settings).require_sound()
    for seed in range(20):
        zoom = random_framing(settings, np.random.default_rng(seed)).zoom
        low = min(settings.zoom[0], settings.smallest if settings.small else np.inf)
        assert low * 0.999 <= zoom <= settings.zoom[1] * 1.001


def test_people_shown_smaller_are_not_larger() -> None:
    wrong = replace(TrainDetectorConfig(), augmentation=Augmentation(smallest=40.0))
    with pytest.raises(InputError, match=r"smallest: is 40\.0.* begins at 0\.85.*expected at most"):
        wrong.require_sound()
