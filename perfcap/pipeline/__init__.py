"""The job, stage by stage."""

from perfcap.pipeline.camera_path import CameraPath, calibrated, orbit
from perfcap.pipeline.clip_problem import FrameNumbers, Term
from perfcap.pipeline.config import (
    BoneConfig,
    PoseConfig,
    PositionConfig,
    PriorConfig,
    ReprojectionConfig,
    RetargetConfig,
    TrajectoryConfig,
)
from perfcap.pipeline.free_view import draw_free_view, save_free_view
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.joint_motion import JointMotion
from perfcap.pipeline.joint_refinement import (
    JointConfig,
    JointRefinement,
    refine_jointly,
)
from perfcap.pipeline.objective import angle_bounds, pose_objective, trajectory_prior
from perfcap.pipeline.overlay import save_overlay, save_textured
from perfcap.pipeline.people import Person, Scene
from perfcap.pipeline.performance import Performance, StageReport
from perfcap.pipeline.pose_refiner import PoseRefiner, RefinedPose
from perfcap.pipeline.presets import MONOPERFCAP, PRESETS, CaptureConfig
from perfcap.pipeline.resized_cameras import resized
from perfcap.pipeline.retargeting import Retargeted, retarget
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface, SurfaceFrames
from perfcap.pipeline.surroundings import Surroundings
from perfcap.pipeline.track_motion import WindowReport

__all__ = [
    "MONOPERFCAP",
    "PRESETS",
    "BoneConfig",
    "CameraPath",
    "CaptureConfig",
    "FrameNumbers",
    "Images",
    "JointConfig",
    "JointMotion",
    "JointRefinement",
    "Performance",
    "Person",
    "PoseConfig",
    "PoseRefiner",
    "PositionConfig",
    "PriorConfig",
    "RefinedPose",
    "ReprojectionConfig",
    "RetargetConfig",
    "Retargeted",
    "Scene",
    "SkinnedSurface",
    "Stage",
    "StageReport",
    "StoredSurface",
    "SurfaceFrames",
    "Surroundings",
    "Term",
    "TrajectoryConfig",
    "WindowReport",
    "angle_bounds",
    "calibrated",
    "capture",
    "draw_free_view",
    "orbit",
    "pose_objective",
    "refine_jointly",
    "resized",
    "retarget",
    "save_free_view",
    "save_overlay",
    "save_textured",
    "trajectory_prior",
]
