"""Settings of a lifter's training that cannot be."""

from dataclasses import replace
from typing import Any

import pytest

from perfcap.errors import InputError
from perfcap.train.config import (
    DetectorNoise,
    LifterConfig,
    LiftingData,
    LiftingLoss,
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
        {"data": LiftingData(noise=DetectorNoise(gaps=7.0))},
        {"loss": LiftingLoss(velocity=-1.0)},
    ],
)
def test_what_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    TrainLifterConfig().require_sound()
    with pytest.raises(InputError, match="expected"):
        replace(TrainLifterConfig(), **wrong).require_sound()
