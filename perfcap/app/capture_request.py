"""What ``perfcap capture`` is asked for, and what it ran on: files, settings, versions, machine."""

from __future__ import annotations

import platform
import resource
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch

from perfcap import __version__
from perfcap.app.auto_actor import Casting
from perfcap.app.inputs import Inputs
from perfcap.app.networks import (
    DETECTORS,
    LIFTERS,
    NO_SEGMENTER,
    PLAIN_EDGES,
    find_edge_network,
    find_model,
    find_segmenter,
)
from perfcap.commands.capture import AUTO, Capture
from perfcap.detect.segmenter import read_segmenter_manifest
from perfcap.errors import InputError
from perfcap.io.actor_place import MANIFEST
from perfcap.io.calibration import files_beside
from perfcap.io.detections.yolo_txt import LABELS
from perfcap.io.gltf_document import companions
from perfcap.pipeline.preset_doubts import preset_doubts
from perfcap.pipeline.presets import PRESETS, CaptureConfig
from perfcap.pipeline.stage import Stage
from perfcap.segment.edge_network import EdgeNetwork

_PACKAGES = ("torch", "kornia", "numpy", "numba", "opencv-python-headless", "av")


def describe(request: Capture) -> dict[str, Any]:
    """The request as plain values."""
    values = {k: getattr(request, k) for k in request.__dataclass_fields__}
    for name in ("resume", "report", "overwrite", "memory"):  # the result does not depend on them
        del values[name]
    if len(request.actor) == 1:
        values["actor"] = request.actor[0]
    if request.people is None:
        del values["people"]
    return {
        k: [str(p) for p in v] if isinstance(v, tuple) else str(v) if isinstance(v, Path) else v
        for k, v in values.items()
    }


def used_files(request: Capture, actors: Iterable[Path]) -> Iterator[Path]:
    """Files and folders that a request reads."""
    yield from (*request.videos, *request.detections, *request.masks)
    # YOLO's are in a folder of their own inside of a run's
    yield from (each / LABELS for each in request.detections if (each / LABELS).is_dir())
    for actor in actors:
        yield from (actor, *companions(actor))
        manifest = actor.with_name(MANIFEST)
        if manifest.is_file():
            yield manifest
    if request.cameras is not None:
        yield request.cameras
        yield from files_beside(request.cameras)
    if request.video_map is not None:
        yield request.video_map
    segmenter = segmenter_of(request)
    for network in (*networks_of(request), *(() if segmenter is None else (segmenter,))):
        yield network
        if network.is_file():  # a manifest; of a folder, what lies in it counts
            yield from sorted(network.parent.glob("*.onnx"))
    edges = edges_of(request)
    if edges is not None:
        yield edges


def segmenter_of(request: Capture) -> Path | None:
    """Manifest of the network of person masks; None where it is not wanted or nobody would ask.

    Raises:
        InputError: there is none, or it is of another kind: before anything is computed.
    """
    if request.segmenter == NO_SEGMENTER:
        return None
    found, preset = find_segmenter(request.segmenter), PRESETS[request.preset]
    asked = preset.silhouettes.first.frame.network > 0 and preset.segment
    if not asked or not Stage[request.until.upper()].needs_images:
        return None
    read_segmenter_manifest(found)
    return found


def edges_of(request: Capture) -> Path | None:
    """Weights of the network of edges; None where edges count as they are or no contour asks.

    Raises:
        InputError: there are none, or ones of a user's own have no effect.
    """
    found = find_edge_network(request.edges)
    wanted = PRESETS[request.preset].contours.enabled
    if not wanted and request.edges not in (Capture.edges, PLAIN_EDGES):
        raise InputError(
            f"--edges {request.edges}: --preset {request.preset} has no contours that meet edges; "
            "leave it out, or take --preset rhodin2016"
        )
    return found if wanted and Stage[request.until.upper()].needs_images else None


def edge_network(request: Capture) -> EdgeNetwork | None:
    """The network that weighs edges for a request, if any does."""
    weights = edges_of(request)
    return None if weights is None else EdgeNetwork.load(weights)


def uses_masks(request: Capture) -> bool:
    """Whether silhouettes are looked for, so that known ones take their place.

    Raises:
        InputError: masks are given and neither a stage nor a body has a use for them.
    """
    stage, preset = Stage[request.until.upper()], PRESETS[request.preset]
    if (preset.contours.enabled or preset.frames is not None) and not stage.needs_images:
        raise InputError(
            f"--preset {request.preset}: is what is done with images, and --until {request.until} "
            "looks at none; leave one of them out"
        )
    used = stage.needs_images and preset.segment
    if request.masks and not used and request.actor != (AUTO,):
        whose = f"--until {request.until}" if preset.segment else f"--preset {request.preset}"
        raise InputError(f"--masks: are not looked at with {whose}; leave one of them out")
    return used and bool(request.masks)


def networks_of(request: Capture) -> Iterator[Path]:
    """Folders of the networks that a request uses."""
    for names, kind in ((request.detectors, DETECTORS), (request.lifters, LIFTERS)):
        for name in names:
            yield find_model(name, kind)


def keeps_detections(request: Capture) -> bool:
    """Whether the folder of one person holds detections, which no file that was given has alone.

    Those of networks, those that were lifted because that was asked, and those of one person of
    files that list everybody.
    """
    lifted = request.lifter is not None and bool(request.lifters)
    return bool(request.detectors) or lifted or request.people in (1, "auto")


def casting_of(request: Capture, actor: str) -> Casting:
    """How an actor is found; of several people by joints alone, images show all of them at once."""
    alone = not request.everybody
    look = Stage[request.until.upper()].needs_images and alone
    return Casting(actor, request.height, request.masks, look, request.preset, alone)


def settings_of(request: Capture) -> CaptureConfig:
    """The preset, with cameras or without contact and floor where the request says so."""
    preset = PRESETS[request.preset]
    if request.refine_cameras:
        cameras = replace(preset.refine_cameras, enabled=True)
        preset = replace(preset, refine_cameras=cameras)
    if request.floor == "auto":
        return preset
    contact = replace(preset.pose.contact, enabled=False)
    return replace(preset, pose=replace(preset.pose, contact=contact))


def named_doubts(request: Capture, views: int) -> Iterator[str]:
    """What the preset of a request is not made for, by the names of the command's options."""
    settings, option = settings_of(request), "--preset"
    return preset_doubts(settings, views, preset=option, default=f"{option} default")


def find_device(name: str) -> torch.device:
    """The device of that name.

    Raises:
        InputError: it cannot be used.
    """
    if name == "auto":
        # windows are small: a CPU core solves them faster than a GPU launches them
        return torch.device("cpu")
    try:
        device = torch.device(name)
        torch.zeros(1, dtype=torch.float64, device=device).item()
    except (RuntimeError, AssertionError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"--device {name}: cannot be used ({reason}); try cpu") from None
    return device


def environment(inputs: Inputs) -> dict[str, Any]:
    """Versions, machine, memory, files that were read and what reading them had to say."""
    return {
        "perfcap": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(terse=True),
        "packages": {name: _version(name) for name in _PACKAGES},
        "peak_memory_mib": _peak_memory_mib(),
        "views": list(inputs.rig.names),
        "input_files": dict(inputs.files),
        "input_warnings": list(inputs.warnings),
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _peak_memory_mib() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)
