"""What a capture was made from, as far as it is still where the capture found it."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import torch

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import (
    CameraRig,
    PixelMap,
    match_image,
    read_cameras,
    read_pixel_map,
)
from perfcap.io.clip import END_SLACK, Clip, late_views
from perfcap.io.detections import read_detections
from perfcap.io.files import known_file
from perfcap.io.result import Result
from perfcap.io.result_folder import ASSUMED_CAMERA, DETECTIONS, own_file
from perfcap.pipeline.view_errors import ViewErrors

_LOG = logging.getLogger(__name__)
_RATE = 0.01  # share by which frame rates may differ and mean the same


@dataclass(frozen=True)
class Places:
    """Where inputs lie now, if not where ``run.json`` says; what is given must be readable.

    Attributes:
        videos: one a view, in the order of the capture.
        cameras: the calibration.
    """

    videos: tuple[Path, ...] = ()
    cameras: Path | None = None


@dataclass(frozen=True)
class Sources:
    """Inputs of a capture's frames; None where they cannot be found.

    Attributes:
        names: of the views.
        clip: the frames.
        cameras: C views, fixed or (F, C), in pixels of the clip.
        detections: (F, C, 16) in pixels of the clip.
        notes: what is missing, and why.
    """

    names: tuple[str, ...]
    clip: Clip | None = None
    cameras: Camera | None = None
    detections: Detections | None = None
    notes: tuple[str, ...] = ()


def find_sources(result: Result, rows: slice, places: Places | None = None) -> Sources:
    """Open what a capture was made from.

    Args:
        result: the capture; its report names the files.
        rows: the frames that are wanted.
        places: where files lie now.

    Raises:
        InputError: a file that ``places`` names cannot be used.
    """
    places = places or Places()
    request = _mapping(result.report.get("request"))
    names = tuple(_texts(result.report.get("views")))
    finder = _Finder(result, rows, request, names)
    clip = finder.clip(places.videos)
    rig, cameras, pixel_map = finder.cameras(places.cameras, clip)
    detections = finder.detections(rig, pixel_map, clip)
    for line in finder.doubts:
        _LOG.warning("%s", line)
    shown = clip.names if clip is not None else () if rig is None else rig.names
    if shown and len(names) != len(shown):  # a damaged report
        names = tuple(shown)
    return Sources(names, clip, cameras, detections, tuple(finder.notes))


class _Finder:
    """Looks for one input after the other and notes what it does not find."""

    def __init__(
        self, result: Result, rows: slice, request: Mapping[str, Any], names: tuple[str, ...]
    ) -> None:
        self.folder = result.folder
        self.rate = result.rate
        self.request = request
        self.report = result.report
        self.names = names
        numbers = result.frame_numbers[rows]
        self.frames = slice(int(numbers[0]), int(numbers[-1]) + 1)
        self.first = int(result.frame_numbers[0])
        self.end = int(result.frame_numbers[-1]) + 1
        self.states = _mapping(result.report.get("input_files"))
        self.placed = False  # whether videos were given that are not where the capture had them
        self.doubts: list[str] = []  # of what was given
        self.notes: list[str] = []
        self.clocks = self._clocks()

    def clip(self, given: Sequence[Path]) -> Clip | None:
        """The videos, of which there must be one a view."""
        paths = list(given) or [
            known_file(self.folder, text) for text in _texts(self.request.get("videos"))
        ]
        if not paths:
            self.notes.append("The capture does not say which videos it was made from.")
            return None
        try:
            clip = self._in_step(paths)
            if abs(clip.fps / self.rate - 1) > _RATE or clip.views != len(self.names or paths):
                raise InputError(
                    f"{paths[0]}: {clip.views} videos of {clip.fps:.3g} frames a second, the "
                    f"capture has {len(self.names)} views of {self.rate:.3g}; give its own"
                )
        except InputError as error:
            if given:
                raise
            self.notes.append(f"The input video is not shown: {error}.")
            return None
        texts = _texts(self.request.get("videos"))
        for text, path in zip(texts, paths, strict=False):
            self._compare(text, path, "--videos" if given else "")
        if not texts:
            self._doubt_longer(clip)
        self.placed = bool(given)
        return clip

    def _doubt_longer(self, clip: Clip) -> None:
        """Note videos of which a capture that does not say so may have seen a later part."""
        total = clip.total
        if self.first or total is None or total <= self.end + END_SLACK:
            return
        line = (
            f"{clip.names[0]}: has {total} frames, the capture {self.end}, and does not say which; "
            "its first are shown: of another part, save it with the number of its first_frame"
        )
        self.doubts.append(line)
        self.notes.append(f"{line}.")

    def _in_step(self, paths: Sequence[Path]) -> Clip:
        """The videos' frames that the capture saw at once, whatever their own numbers."""
        late = None if self.clocks is None else self.clocks.late
        if late is None:
            return Clip.open(paths, fps=self.rate, frames=self.frames)
        whole = [round(value) for value in late.tolist()]
        ahead = slice(self.frames.start, self.frames.stop + max(0, *whole))
        clip = Clip.open(paths, fps=self.rate, frames=ahead)
        return late_views(clip, whole, self.frames.stop) if clip.views == len(whole) else clip

    def _clocks(self) -> ViewErrors | None:
        """By how much views are later, as the capture found it."""
        found = _mapping(self.report.get("view_errors")).get("clock_frames")
        if found is None:
            return None
        known = [_mapping(each) for each in _mapping(found).values()]
        parts = [[each.get(key) for each in known] for key in ("value", "deviation")]
        if len(known) != len(self.names) or not all(map(_are_numbers, parts)):
            self.notes.append("By how much views are later cannot be read.")
            return None
        clock, deviation = (torch.tensor(part, dtype=torch.float64) for part in parts)
        return ViewErrors(clock, deviation)

    def _compare(self, text: str, path: Path, option: str) -> None:
        """Note a file of another size than the capture read: another, or written anew.

        Args:
            text: its name in the report.
            path: where it is.
            option: that gave it; empty where it is the one of the report.
        """
        state = self.states.get(text)
        size = state.split(" bytes of ")[0] if isinstance(state, str) else ""
        if not path.is_file() or not size.isdecimal() or str(path.stat().st_size) == size:
            return
        line = (
            f"{path}: has {path.stat().st_size} bytes, that of the capture had {size}; if it is "
            "another, what is drawn over the video does not fit: give the capture's own"
        )
        if option:
            self.doubts.append(f"{option}: {line}")
        self.notes.append(f"{line}.")

    def cameras(
        self, given: Path | None, clip: Clip | None
    ) -> tuple[CameraRig | None, Camera | None, PixelMap | None]:
        """The calibration of the views, in its own pixels and in those of the clip."""
        text = self.request.get("cameras")
        path = given or (
            known_file(self.folder, text) if isinstance(text, str) else self._assumed()
        )
        if path is None:
            self.notes.append("The capture does not say which cameras it was made with.")
            return None, None, None
        unmatched = False
        try:
            rig = self._rig(path, clip)
            sizes = rig.cameras.size if clip is None else clip.sizes
            maps = self._maps() if clip is not None else None
            unmatched = True
            pixel_map = match_image(rig, sizes, maps)
            if isinstance(text, str):
                self._compare(text, path, "--cameras" if given else "")
            return rig, pixel_map.cameras(rig.cameras, sizes), pixel_map
        except InputError as error:
            if given:
                raise
            if unmatched and self.placed:
                found = str(error).split("; ")[0]
                raise InputError(f"--videos: {found}; give the capture's own") from None
            self.notes.append(f"Nothing is projected into the video: {error}.")
            return None, None, None

    def detections(
        self, rig: CameraRig | None, pixel_map: PixelMap | None, clip: Clip | None
    ) -> Detections | None:
        """The joints that were detected, in pixels of the clip."""
        if rig is None or pixel_map is None:
            return None
        texts = _texts(self.request.get("detections"))
        # files that list everybody do not say whom the capture followed; what it kept does
        kept = own_file(self.folder, DETECTIONS)
        if texts and self.request.get("people") is None:
            paths = [known_file(self.folder, text) for text in texts]
        elif kept is None:
            self.notes.append("Detected joints are not shown: there are none in the folder.")
            return None
        else:
            texts, paths = [], [kept]
        in_video = bool(texts) and self.request.get("detections_in") == "video"
        sizes = clip.sizes if in_video and clip is not None else rig.cameras.size
        try:
            found, _ = read_detections(
                paths,
                views=rig.names,
                pixel_offset=rig.pixel_offset,
                frames=None if clip is None else clip.total,
                used=self.end,
                sizes=None if clip is None else sizes,
                images=() if clip is None else clip.image_names,
            )
            if self.clocks is not None:
                found = self.clocks.of_detections(found)
            found = found.frames(self.frames)
            if found.frame_count != self.frames.stop - self.frames.start:
                raise InputError(f"{paths[0]}: holds other frames than the capture")
            for text, path in zip(texts, paths, strict=False):
                self._compare(text, path, "")
        except InputError as error:
            self.notes.append(f"Detected joints are not shown: {error}.")
            return None
        if in_video:
            return found
        return replace(found, joints2d=pixel_map.to_video(found.joints2d))

    def _rig(self, path: Path, clip: Clip | None) -> CameraRig:
        rig = read_cameras(path, None if clip is None else clip.sizes)
        if len(rig.names) > 1 or len(self.names) > 1:
            missing = [name for name in self.names if name not in rig.names]
            if missing or not self.names:
                listing = ", ".join(rig.names)
                raise InputError(f"{path}: has the views {listing}, the capture others")
            rig = rig.select([rig.names.index(name) for name in self.names])
        cameras = rig.cameras
        if cameras.moving and cameras.intrinsics.shape[0] < self.frames.stop:
            raise InputError(f"{path}: has {cameras.intrinsics.shape[0]} frames, less than needed")
        return replace(rig, cameras=self._as_found(cameras.frames(self.frames)))

    def _as_found(self, cameras: Camera) -> Camera:
        """Cameras where the capture had them in the end: by joints, then by silhouettes."""
        refinement = _mapping(self.report.get("refinement"))
        for part in (self.report.get("view_errors"), refinement.get("cameras")):
            found = _mapping(_mapping(part).get("camera_turn_shift")).values()
            steps = [_mapping(each).get("value") for each in found]
            if not steps or cameras.moving:
                continue
            if len(steps) != cameras.views or not all(map(_is_step, steps)):
                self.notes.append("Where the cameras were found to stand cannot be read.")
                continue
            cameras = cameras.nudged(torch.tensor(steps, dtype=torch.float64))
        return cameras

    def _maps(self) -> Any:
        text = self.request.get("video_map")
        return read_pixel_map(known_file(self.folder, text)) if isinstance(text, str) else None

    def _assumed(self) -> Path | None:
        """The camera that a capture without calibration wrote down."""
        return own_file(self.folder, ASSUMED_CAMERA)


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _texts(value: Any) -> list[str]:
    return [each for each in value if isinstance(each, str)] if isinstance(value, list) else []


def _is_step(value: Any) -> bool:
    """Whether something read is a rotation vector and a shift, six numbers."""
    return isinstance(value, list) and len(value) == 6 and _are_numbers(value)


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(each, int | float) and isfinite(each) for each in values)
