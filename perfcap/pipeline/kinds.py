"""Whether arguments are of the kind that a function takes, by name and with what to give."""

from __future__ import annotations

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import CameraRig
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.images import Images
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage

_KINDS: dict[str, tuple[type, str]] = {
    "actor": (Actor, "load_actor makes one of a name or a file"),
    "cameras": (Camera, "read_cameras gives a CameraRig, whose cameras are one"),
    "detections": (Detections, "read_detections gives them and notes, Detections.from_joints both"),
    "config": (
        CaptureConfig,
        "MONOPERFCAP is one, and perfcap.pipeline.PRESETS has others by name",
    ),
    "until": (Stage, "such as Stage.TRACK_MOTION"),
    "images": (Images, "Images(clip, cameras) makes them of a Clip"),
    "checkpoint": (Checkpoint, "it keeps work in a folder"),
}
_LEFT_OUT = ("config", "until", "images", "checkpoint")


def require_kinds(**given: object) -> None:
    """Refuse arguments of ``capture`` that are something else.

    Raises:
        InputError: one is; those that may be left out may be None.
    """
    for name, value in given.items():
        kind, hint = _KINDS[name]
        if not isinstance(value, kind) and not (value is None and name in _LEFT_OUT):
            raise _another(name, value, kind.__name__, hint)


def require_flags(**given: object) -> None:
    """Refuse what is neither true nor false: a word would be true.

    Raises:
        InputError: one is.
    """
    for name, value in given.items():
        if not isinstance(value, bool):
            raise InputError(f"{name} is {value!r:.80}, expected True or False")


def require_cameras(cameras: object) -> None:
    """Refuse a rig where its cameras are expected, and what is no sequence of them.

    Raises:
        InputError: they are something else.
    """
    several = cameras if isinstance(cameras, list | tuple) else [cameras]
    for each in several:
        if not isinstance(each, Camera):
            raise _another("cameras", each, "Camera, or a list of them", _KINDS["cameras"][1])


def _another(name: str, value: object, kind: str, hint: str) -> InputError:
    found = "a CameraRig" if isinstance(value, CameraRig) else f"a {type(value).__name__}"
    return InputError(f"{name}: got {found}, expected {kind}: {hint}")
