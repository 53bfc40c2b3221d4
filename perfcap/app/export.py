"""``perfcap export``: a finished capture as files of other programs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from perfcap.app.capture_folder import for_everybody, named_people, spare_result
from perfcap.app.console import PlainConsole, print_written
from perfcap.app.inputs import parse_frames
from perfcap.app.level import Level, level_of
from perfcap.commands.results import Export
from perfcap.errors import InputError
from perfcap.geometry.rotation import turn_to_y
from perfcap.io.distrust import distrust
from perfcap.io.export import FORMATS, Format, Options, Recording, publishing
from perfcap.io.result import Result, read_result
from perfcap.io.result_folder import EXPORT

_UNNAMED = "capture"
_MARKED = ("trc", "c3d")  # formats of markers
_SURFACED = ("glb", "usd", "usdz")  # that can leave the captured surface out
_LONGEST = 100  # bytes of a name: files get endings, and file systems refuse 255


def run_export(request: Export) -> int:
    """Write all files and say which, of several people each on their own; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    formats: dict[str, Format] = {name: FORMATS[name] for name in request.to}
    if not formats:
        raise InputError(f"--to: expected one or several of {', '.join(FORMATS)}")
    for kind, chosen in formats.items():
        chosen.require(kind)
    _require_use(request, formats)
    results = {place: read_result(place) for place, _ in named_people(request.folder)}
    level = level_of(list(results.values()))

    def export(folder: Path, person: str) -> int:
        base = _name(request)
        name = f"{base}_{person}" if person else request.name
        own = replace(request, folder=folder, name=name)
        return _export(own, formats, results[folder], level)

    return for_everybody(request.folder, export)


def _export(request: Export, formats: Mapping[str, Format], result: Result, level: Level) -> int:
    recording = _recording(request, _name(request), result, level)
    out = request.out or request.folder / EXPORT
    if request.out is None and out.is_symlink():
        raise InputError(
            f"{out}: is a link; nothing outside the folder of a result is written unless --out "
            "names it"
        )
    with publishing(out) as scratch:
        for chosen in formats.values():
            free = not chosen.fixed
            up = (free and request.up) or chosen.up
            unit = (free and request.unit) or chosen.unit
            options = Options(unit, request.surface, request.markers, request.order)
            chosen.write(scratch, recording.facing_up(up), options)
        written = sorted(entry.name for entry in scratch.iterdir())
        for entry in written:
            spare_result(request.folder, out / entry)
        older = [entry for entry in written if request.out is not None and (out / entry).exists()]
    console = PlainConsole(soft_wrap=True)
    for line in distrust(result.report, result.frame_numbers[recording.first : recording.stop]):
        console.print(f"{request.folder}: {line}")
    if not np.array_equal(recording.upright, np.eye(3)):
        about = f"{_up_name(recording)} is up in the capture's world"
        if request.world_up == "floor":
            about = "the floor that was found is level"
        console.print(f"turned upright: {about}")
    for entry in written:
        print_written(out / entry, entry in older)
    return 0


def _require_use(request: Export, formats: Mapping[str, Format]) -> None:
    """Refuse options that none of the formats follows: whoever gives one counts on it."""
    free = any(not each.fixed for each in formats.values())
    given = {
        "--up": (request.up is not None, free),
        "--unit": (request.unit is not None, free),
        "--no-surface": (not request.surface, not formats.keys().isdisjoint(_SURFACED)),
        "--order": (request.order != "auto", "bvh" in formats),
        "--markers": (request.markers != "landmarks", not formats.keys().isdisjoint(_MARKED)),
    }
    for option, (asked, followed) in given.items():
        if asked and not followed:
            raise InputError(f"{option}: means nothing to {', '.join(formats)}; leave it out")


def _name(request: Export) -> str:
    """What files are called: as asked for, or as the folder."""
    if request.name is None:
        try:
            found = request.folder.resolve().name
        except (OSError, RuntimeError):  # a loop of links; reading will say so
            found = request.folder.name
        return _shortened(re.sub(r"[\x00-\x1f\x7f]", "_", found).lstrip(".") or _UNNAMED)
    plain = not re.search(r"[/\\\x00-\x1f\x7f]", request.name)
    if not plain or not request.name.strip() or request.name.startswith("."):
        raise InputError(
            f"--name {request.name!r}: expected the name of a file, without folders and ending"
        )
    if _shortened(request.name) != request.name:
        raise InputError(f"--name {request.name}: is too long, expected at most {_LONGEST} bytes")
    return request.name


def _shortened(name: str) -> str:
    return name.encode("utf-8", "replace")[:_LONGEST].decode("utf-8", "ignore")


def _recording(request: Export, name: str, result: Result, level: Level) -> Recording:
    """The frames that are asked for, counted as in the video, with y up."""
    numbers = result.frame_numbers
    part = parse_frames(request.frames)
    chosen = np.flatnonzero(
        (numbers >= part.start) & (numbers < (part.stop or numbers[-1] + 1))
        if part.stop != 0 else np.zeros(len(numbers), bool)
    )  # fmt: skip
    if not len(chosen):
        raise InputError(
            f"--frames {request.frames}: {request.folder} holds frames {numbers[0]} to "
            f"{numbers[-1]}; expected a part of them"
        )
    if part.stop is not None and part.stop > numbers[-1] + 1:
        PlainConsole().print(f"--frames {request.frames}: the result ends with {numbers[-1]}")
    up, lines = level.chosen("--world-up", request.world_up)
    if level.agreed and request.world_up not in ("auto", "floor", "y"):
        lines = [f"--world-up {request.world_up}: a retargeted motion has y up"]
    for line in lines:
        PlainConsole().print(line, soft_wrap=True)
    recording = Recording(result, name, int(chosen[0]), int(chosen[-1]) + 1)
    return replace(recording, upright=turn_to_y(up).numpy())


def _up_name(recording: Recording) -> str:
    """The axis of the capture's world that was turned to y."""
    up = recording.upright[1]
    place = int(np.abs(up).argmax())
    return ("-" if up[place] < 0 else "") + "xyz"[place]
