"""Settings that cannot be what they are called."""

from typing import Any

import pytest

from perfcap.errors import InputError
from perfcap.pipeline.config import (
    BoneConfig,
    ContactConfig,
    EvidenceConfig,
    PathConfig,
    PoseConfig,
    PositionConfig,
    PriorConfig,
    ReprojectionConfig,
    TrajectoryConfig,
)

NAN = float("nan")


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (PoseConfig, {"batch": 0}),
        (PoseConfig, {"initial_batch": -1}),
        (PoseConfig, {"window": 2.5}),
        (PoseConfig, {"overlap": 2.5}),
        (PoseConfig, {"clean": NAN}),
        (PoseConfig, {"cleanest": -1.0}),
        (PoseConfig, {"initial_widening": 0.0}),
        (PoseConfig, {"paths": True}),
        (PoseConfig, {"reprojection": None}),
        (ReprojectionConfig, {"deviation": 0.0}),
        (PositionConfig, {"deviation": (0.1, 0.2)}),
        (PositionConfig, {"gate": -1.0}),
        (TrajectoryConfig, {"rank": 0}),
        (TrajectoryConfig, {"step": 2.0}),
        (EvidenceConfig, {"rank": 0}),
        (EvidenceConfig, {"share": -1.0}),
        (PathConfig, {"deviation": NAN}),
        (PriorConfig, {"deviation": 0.0}),
        (ContactConfig, {"deviation": "small"}),
        (ContactConfig, {"support": 2.0}),
        (BoneConfig, {"frames": 0}),
    ],
)
def test_settings_that_are_none_are_refused_by_name(kind: Any, wrong: dict[str, Any]) -> None:
    """They ended in a traceback, in NaN, or in another motion without a word."""
    with pytest.raises(InputError, match=f"{next(iter(wrong))}.* expected"):
        kind(**wrong)
