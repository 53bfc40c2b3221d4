"""Settings that cannot be what they are called."""

import importlib
import pkgutil
from dataclasses import fields, is_dataclass
from typing import Any

import pytest
import torch

import perfcap
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
    RetargetConfig,
    TrajectoryConfig,
)
from perfcap.pipeline.keep_apart import ApartConfig
from perfcap.pipeline.presets import PRESETS, CaptureConfig
from perfcap.pipeline.surface_config import (
    ContourConfig,
    RefineCamerasConfig,
    RefinePoseConfig,
    RefineSurfaceConfig,
)
from perfcap.setting_checks import Settings

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
        (ApartConfig, {"moved": 0.0}),
        (ContourConfig, {"scale": 0.0}),
        (ContourConfig, {"weight": NAN}),
        (ContourConfig, {"chance": 1.5}),
        (RefinePoseConfig, {"contour": None}),
        (RefinePoseConfig, {"rounds": 2.0}),
        (RefinePoseConfig, {"whole": 1}),
        (RefineSurfaceConfig, {"nodes": 0}),
        (RefineSurfaceConfig, {"rigidity": 0.6}),
        (RefineSurfaceConfig, {"settle": (1.0, NAN)}),
        (RetargetConfig, {"change": (0.003, 0.5)}),
        (RetargetConfig, {"limbs": 0.0}),
        (CaptureConfig, {"pose": "default"}),
    ],
)
def test_settings_that_are_none_are_refused_by_name(kind: Any, wrong: dict[str, Any]) -> None:
    """They ended in a traceback, in NaN, or in another motion without a word."""
    with pytest.raises(InputError, match=f"{next(iter(wrong))}.* expected"):
        kind(**wrong)


@pytest.mark.parametrize(
    ("kind", "wrong", "unit"),
    [
        (
            PositionConfig,
            {"deviation": tuple(1000 * d for d in PositionConfig().deviation)},
            "metres",
        ),
        (PositionConfig, {"deviation": (0.05,) * 15 + (50.0,)}, "metres"),
        (PathConfig, {"deviation": 20.0}, "metres"),
        (ContactConfig, {"deviation": 20.0}, "metres"),
        (ContactConfig, {"depth": 5.0}, "metres"),
        (ContactConfig, {"margin": 7.0}, "metres"),
        (ApartConfig, {"steps": (20.0, 10.0)}, "metres"),
        (RefinePoseConfig, {"deviation": 30.0}, "metres"),
        (RefineSurfaceConfig, {"reach": 30.0}, "metres"),
        (RefineCamerasConfig, {"shift": 30.0}, "metres"),
        (RefineCamerasConfig, {"turn": 10.0}, "radians"),
        (RetargetConfig, {"feet": 3.0}, "metres"),
        (ApartConfig, {"moved": 20.0}, "metres"),
        (PriorConfig, {"alone": 45.0}, "radians"),
    ],
)
def test_other_units_are_refused(kind: Any, wrong: dict[str, Any], unit: str) -> None:
    """Deviations in millimetres left 3D joints without a say, and nothing showed it."""
    with pytest.raises(InputError, match=f"{next(iter(wrong))} of .* expected {unit}"):
        kind(**wrong)


def test_infinite_deviations_switch_terms_off() -> None:
    assert PathConfig(deviation=float("inf")).deviation > 1
    assert PositionConfig(deviation=(0.05,) * 15 + (float("inf"),)).deviation[-1] > 1
    assert PriorConfig(alone=float("inf")).alone > 1


def every_kind() -> list[type]:
    """Settings of all modules but those of training, whose commands check them."""
    found = set()
    for module in pkgutil.walk_packages(perfcap.__path__, "perfcap."):
        if not any(part in module.name for part in ("numba", "__main__", ".train", ".viewers")):
            for value in vars(importlib.import_module(module.name)).values():
                if isinstance(value, type) and value.__name__.endswith(("Config", "Settings")):
                    found.add(value)
    kept = [kind for kind in found if is_dataclass(kind) and ".train" not in kind.__module__]
    return sorted(kept, key=lambda kind: kind.__name__)


def test_all_settings_are_looked_at() -> None:
    kinds = every_kind()
    assert len(kinds) > 40
    for kind in kinds:
        assert issubclass(kind, Settings), kind
        for number in [field for field in fields(kind) if field.type in ("float", "int")]:
            with pytest.raises(InputError, match=f"{number.name}.* expected"):
                kind(**{number.name: NAN})


def test_presets_are_sound_and_weights_may_be_learned() -> None:
    assert len(PRESETS) > 3
    weight = torch.ones((), requires_grad=True)
    assert ContourConfig(weight=weight).weight is weight
    assert ContourConfig(scale=None).scale is None
