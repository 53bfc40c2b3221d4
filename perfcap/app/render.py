"""``perfcap render``: a finished capture as a video from any camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from perfcap.app.capture_folder import beside, for_everybody, named_people, spare_result
from perfcap.app.console import PlainConsole, print_written, progress_bars
from perfcap.app.inputs import parse_frames
from perfcap.app.level import Level, level_of
from perfcap.commands.results import Render
from perfcap.errors import InputError
from perfcap.io.calibration import read_cameras
from perfcap.io.distrust import distrust
from perfcap.io.result import Result, read_result
from perfcap.io.view_names import find_view
from perfcap.pipeline.camera_path import CameraPath, calibrated, orbit
from perfcap.pipeline.free_view import draw_free_view, save_free_view
from perfcap.pipeline.surroundings import Surroundings

_SIZE = (720, 720)  # px, height and width
_TURN = 360.0  # degrees
_SECONDS = 4.0  # of a frozen frame
_LONGEST = 600.0  # s
_NEAR = 0.05  # m, before a camera
_SMALL = 0.02  # of a picture's shorter side: a person of this size is a dot


def run_render(request: Render) -> int:
    """Write the video, of several people one each, OUT_person1.mp4 ..., and say which.

    Returns:
        The exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    _check(request)
    results = {place: read_result(place) for place, _ in named_people(request.folder)}
    level = level_of(list(results.values()))
    return for_everybody(
        request.folder,
        lambda folder, person: _render(
            replace(request, folder=folder, out=beside(request.out, person)), results[folder], level
        ),
    )


def _render(request: Render, result: Result, level: Level) -> int:
    spare_result(request.folder, request.out)
    rows = _rows(request, result)
    for line in distrust(result.report, result.frame_numbers[rows]):
        PlainConsole().print(f"{request.folder}: {line}", soft_wrap=True)
    joints = torch.from_numpy(result.joints)
    up, lines = level.chosen("--up", request.up)
    for line in lines:
        PlainConsole().print(line, soft_wrap=True)
    around = Surroundings.around(joints, result.shown, up, slice(rows[0], rows[-1] + 1))
    path = _path(request, result, around, rows)
    if request.camera is not None:
        _tell_of_empty(request, path, joints[path.frames])
    older = request.out.exists()
    pictures = draw_free_view(result.template, result.shown, around, path)
    with progress_bars() as tell:
        save_free_view(
            request.out,
            pictures,
            len(path),
            result.rate,
            lambda done, total: tell("render", done, total),
        )
    print_written(request.out, older)
    return 0


def _check(request: Render) -> None:
    if request.out.suffix.lower() != ".mp4":
        raise InputError(f"--out {request.out}: expected the name of a video that ends in .mp4")
    if not request.out.parent.is_dir():
        raise InputError(f"--out {request.out}: no folder {request.out.parent}; make it first")
    if request.camera is not None and request.orbit is not None:
        raise InputError(
            "--orbit and --camera: expected one of them; the camera of a file is fixed"
        )
    if request.view is not None and request.camera is None:
        raise InputError(f"--view {request.view}: names a view of --camera FILE, which is missing")
    if request.freeze is not None and request.frames is not None:
        raise InputError("--frames and --freeze: expected one of them; a frozen frame is alone")
    if request.seconds is not None and request.freeze is None:
        raise InputError("--seconds: is the length of a frozen frame; add --freeze FRAME")
    if request.seconds is not None and not 0 < request.seconds <= _LONGEST:
        raise InputError(f"--seconds {request.seconds}: expected more than 0, at most {_LONGEST:g}")


def _rows(request: Render, result: Result) -> list[int]:
    """The frame of the result that each picture shows; options count as the video does."""
    numbers = result.frame_numbers.tolist()
    held = f"{request.folder} holds frames {numbers[0]} to {numbers[-1]}"
    if request.freeze is not None:
        if request.freeze not in numbers:
            raise InputError(f"--freeze {request.freeze}: {held}; expected one of them")
        length = _SECONDS if request.seconds is None else request.seconds
        return [numbers.index(request.freeze)] * max(1, round(length * result.rate))
    part = parse_frames(request.frames)
    stop = numbers[-1] + 1 if part.stop is None else part.stop
    rows = [row for row, number in enumerate(numbers) if part.start <= number < stop]
    if not rows:
        raise InputError(f"--frames {request.frames}: {held}; expected a part of them")
    if stop > numbers[-1] + 1:
        PlainConsole().print(f"--frames {request.frames}: the result ends with {numbers[-1]}")
    return rows


def _path(request: Render, result: Result, around: Surroundings, rows: Sequence[int]) -> CameraPath:
    size = None if request.size is None else (request.size[1], request.size[0])
    if request.camera is None:
        joints = torch.from_numpy(result.joints)
        degrees = _TURN if request.orbit is None else request.orbit
        return orbit(joints, around, rows, size or _SIZE, result.rate, degrees)
    rig = read_cameras(request.camera, None if size is None else [size])
    view = 0
    if request.view is not None:
        found = find_view(request.view, rig.names)
        if found is None:
            known = ", ".join(rig.names)
            raise InputError(f"--view {request.view}: {request.camera} has the views {known}")
        view = found
    numbers = result.frame_numbers[list(rows)].tolist()
    return calibrated(rig.cameras.select([view]), rows, numbers, size)


def _tell_of_empty(request: Render, path: CameraPath, joints: torch.Tensor) -> None:
    """Say so where no picture shows the landmarks, (N, 16, 3) m, or all of them as a dot."""
    cameras = path.cameras.to(joints)
    local = cameras.to_camera(joints)[:, 0]
    pixels = cameras.project_camera(local[:, None])[:, 0]
    size = pixels.new_tensor(cameras.size[0])
    inside = (local[..., 2] > _NEAR) & ((pixels >= 0) & (pixels < size.flip(0))).all(-1)
    extent = (pixels.amax(-2) - pixels.amin(-2)).amax(-1)[inside.any(-1)]
    if not len(extent):
        what = "no picture shows the person"
    elif float(extent.max()) < _SMALL * float(size.min()):
        what = f"the person is {float(extent.max()):.2g} px tall at most"
    else:
        return
    PlainConsole().print(
        f"--camera {request.camera}: {what}; expected a camera of the capture's world: metres, "
        "x_camera = R x_world + t",
        soft_wrap=True,
    )
