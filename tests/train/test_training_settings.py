"""Settings of training that cannot be."""

from dataclasses import replace
from typing import Any

import pytest

from perfcap.errors import InputError
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
        {"loss": DetectorLoss(deviation=0.0)},
        {"loss": DetectorLoss(pose=-1.0)},
    ],
)
def test_no_detector_can_be_made_of_it(wrong: dict[str, Any]) -> None:
    TrainDetectorConfig().require_sound()
    with pytest.raises(InputError, match="expected"):
        replace(TrainDetectorConfig(), **wrong).require_sound()
