"""Our own camera files: ``camera.json`` of one view, ``cameras.json`` of several."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from perfcap.errors import InputError
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.spelling import lens_of, size_of
from perfcap.io.calibration.view import View, make_view
from perfcap.io.files import TEXT_LIMIT, read_json
from perfcap.rates import FASTEST, SLOWEST

PIXEL_CENTRES = (0.0, 0.5)
_SPELLED = ("pixel_centre", "width", "height")
UNITS = ("unit", "units")
METRES = ("m", "metre", "metres", "meter", "meters")


def read_camera_json(
    path: Path, default_sizes: Sequence[tuple[int, int]] | None = None
) -> CameraRig:
    """Read K, R, t (OpenCV, world to camera, metres), once or per frame, of one or more views.

    ``pixel_centre`` is the coordinate of the top-left pixel's centre: 0, or 0.5 when the file
    counts from the image corner. ``views`` maps names to entries; without it the whole file is
    one view. ``width``, ``height``, ``distortion`` may stand outside for all views.
    """
    data = read_json(path, "a camera file", TEXT_LIMIT)
    if not isinstance(data, dict):
        raise InputError(f"{path}: holds a {type(data).__name__}, expected an object with K, R, t")
    centre = _pixel_centre(path, data)
    views = data.get("views")
    if views is None:
        entries: Mapping[str, Any] = {str(data.get("name", path.stem)): data}
    elif isinstance(views, dict):
        entries = views
    else:
        raise InputError(f"{path}: views is a {type(views).__name__}, expected an object by name")
    return make_rig(
        str(path),
        [_view(path, name, entry, data, centre) for name, entry in entries.items()],
        fps=_fps(path, data),
        pixel_offset=-centre,
        default_sizes=default_sizes,
    )


def _view(path: Path, name: str, entry: Any, shared: Mapping[str, Any], centre: float) -> View:
    where = f"{path}: view {name}"
    if not isinstance(entry, dict):
        raise InputError(f"{where}: is a {type(entry).__name__}, expected an object with K, R, t")
    stated = {**shared, **entry}
    _require_metres(where, stated)
    _require_read(where, stated)
    if entry.get("pixel_centre", centre) != centre:
        raise InputError(f"{where}: has its own pixel_centre; state one for the whole file")
    view = make_view(
        where,
        name,
        intrinsics=entry.get("K"),
        rotation=entry.get("R"),
        translation=entry.get("t"),
        distortion=lens_of(where, stated),
        size=size_of(stated),
        pixel_centre=centre,
    )
    frames = shared.get("frames")
    if len(view.rotation) > 1 and isinstance(frames, int) and frames != len(view.rotation):
        raise InputError(
            f"{where}: has {len(view.rotation)} camera poses but says frames = {frames}"
        )
    return view


def _require_read(where: str, keys: Iterable[str]) -> None:
    """Refuse what is meant for the camera, under a name that is not read."""
    for key in keys:
        near = difflib.get_close_matches(key[:40].lower(), _SPELLED, 1, 0.8)
        if near and key not in _SPELLED and key.lower() not in ("width", "height"):
            raise InputError(f"{where}: has {key!r:.40}, which is not read; call it {near[0]}")


def _given(entry: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    return {name: entry[name] for name in names if name in entry}


def _require_metres(where: str, entry: Mapping[str, Any]) -> None:
    """Refuse what would make every place wrong by a factor, were it overlooked."""
    for name, value in _given(entry, UNITS).items():
        if not (isinstance(value, str) and value.lower() in METRES):
            raise InputError(f"{where}: {name} is {value!r}; expected t in metres: convert it")
    scale = entry.get("scale", 1)
    if isinstance(scale, bool) or scale != 1:
        raise InputError(f"{where}: scale is {scale!r}; expected t and R as they are: apply it")


def _pixel_centre(path: Path, data: Mapping[str, Any]) -> float:
    value = data.get("pixel_centre", 0.0)
    if isinstance(value, bool) or value not in PIXEL_CENTRES:
        raise InputError(
            f"{path}: pixel_centre is {value!r}, expected 0 (pixel centres at integers) or 0.5 "
            "(the image corner is the origin)"
        )
    return float(value)


def _fps(path: Path, data: Mapping[str, Any]) -> float | None:
    fps = data.get("fps")
    if fps is None:
        return None
    if isinstance(fps, bool) or not isinstance(fps, int | float) or not SLOWEST <= fps < FASTEST:
        raise InputError(f"{path}: fps is {fps!r}, expected a positive number")
    return float(fps)
