"""The job, stage by stage."""

from perfcap.pipeline.config import (
    BoneConfig,
    PoseConfig,
    PositionConfig,
    PriorConfig,
    ReprojectionConfig,
    TrajectoryConfig,
)
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.objective import angle_bounds, pose_objective, trajectory_prior
from perfcap.pipeline.overlay import save_overlay
from perfcap.pipeline.performance import Performance, StageReport
from perfcap.pipeline.presets import MONOPERFCAP, PRESETS, CaptureConfig
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.track_motion import WindowReport

__all__ = [
    "MONOPERFCAP",
    "PRESETS",
    "BoneConfig",
    "CaptureConfig",
    "Performance",
    "PoseConfig",
    "PositionConfig",
    "PriorConfig",
    "ReprojectionConfig",
    "Stage",
    "StageReport",
    "TrajectoryConfig",
    "WindowReport",
    "angle_bounds",
    "capture",
    "pose_objective",
    "save_overlay",
    "trajectory_prior",
]
