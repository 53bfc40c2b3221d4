"""perfcap: human performance capture in PyTorch.

The names below are loaded when they are first used: importing the package costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from perfcap.errors import InputError

if TYPE_CHECKING:
    from perfcap.actor import Actor, Motion, Skeleton
    from perfcap.detect import Association, Detections, associate
    from perfcap.energy import JointPosition, Reprojection, Trajectory
    from perfcap.geometry import Camera
    from perfcap.io import Clip, load_actor, read_cameras, read_candidates, read_detections
    from perfcap.pipeline import (
        MONOPERFCAP,
        CaptureConfig,
        Images,
        Performance,
        Person,
        PoseRefiner,
        Scene,
        Stage,
        capture,
        refine_jointly,
    )
    from perfcap.report import show
    from perfcap.solve import (
        Adam,
        Energy,
        Implicit,
        LevenbergMarquardt,
        Objective,
        Residual,
        Solution,
    )

__version__ = "0.1.0"

# ``solve`` is not among them: perfcap.solve is the package, perfcap.solve.solve its function.
__all__ = [
    "MONOPERFCAP",
    "Actor",
    "Adam",
    "Association",
    "Camera",
    "CaptureConfig",
    "Clip",
    "Detections",
    "Energy",
    "Images",
    "Implicit",
    "InputError",
    "JointPosition",
    "LevenbergMarquardt",
    "Motion",
    "Objective",
    "Performance",
    "Person",
    "PoseRefiner",
    "Reprojection",
    "Residual",
    "Scene",
    "Skeleton",
    "Solution",
    "Stage",
    "Trajectory",
    "__version__",
    "associate",
    "capture",
    "load_actor",
    "read_cameras",
    "read_candidates",
    "read_detections",
    "refine_jointly",
    "show",
]

_HOMES = {
    "perfcap.actor": ("Actor", "Motion", "Skeleton"),
    "perfcap.detect": ("Association", "Detections", "associate"),
    "perfcap.energy": ("JointPosition", "Reprojection", "Trajectory"),
    "perfcap.geometry": ("Camera",),
    "perfcap.io": ("Clip", "load_actor", "read_cameras", "read_candidates", "read_detections"),
    "perfcap.pipeline": (
        *("MONOPERFCAP", "CaptureConfig", "Images", "Performance", "Person", "PoseRefiner"),
        *("Scene", "Stage", "capture", "refine_jointly"),
    ),
    "perfcap.report": ("show",),
    "perfcap.solve": (
        *("Adam", "Energy", "Implicit", "LevenbergMarquardt", "Objective", "Residual", "Solution"),
    ),
}

if not TYPE_CHECKING:  # a type checker would take every name for one of the package

    def __getattr__(name: str) -> object:
        """Load a public name (PEP 562)."""
        for home, names in _HOMES.items():
            if name in names:
                value = globals()[name] = getattr(import_module(home), name)
                return value
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        """Public names, loaded or not."""
        return sorted({*globals(), *__all__})
