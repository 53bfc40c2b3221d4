"""Exports of twenty varied results, read by programs that are not ours.

Expect 0 errors and 0 warnings of the Khronos validator, and everything that other programs read to
agree with the capture within 0.1 mm and 0.01 degrees. Needs the extras usd and mocap, and the
packages bvhio, c3d and opensim; Blender, three.js and the validator where they are named.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from export_cases import Case, apart, cases, linear_skin, save, turned
from export_readers import (
    Programs,
    read_bvh,
    read_c3d,
    read_trc,
    read_usd,
    read_usd_surface,
    targets,
)
from report import DATA, Report, Table, main

from perfcap.app.export import run_export
from perfcap.commands.results import Export, Format
from perfcap.geometry.rotation import turn_to_y
from perfcap.io.export import Recording
from perfcap.io.export.options import unique_names, word
from perfcap.io.export.recording import Z_UP
from perfcap.io.result import read_result
from perfcap.pipeline.surroundings import upright

SAMPLES = 20
FORMATS: tuple[Format, ...] = ("glb", "bvh", "usd", "usdz", "trc", "c3d", "npz", "csv")
COLUMNS = ("validator", "three", "blender", "bones", "bvhio", "bvhio deg", "usd skin", "usd deg",
           "usd errors", "usd surface", "opensim", "c3d", "own rig")  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """Which data, which programs, and results to look at beside the made ones."""

    data: Path = DATA
    """Folder of the recordings and of the MakeHuman assets."""
    programs: Programs = field(default_factory=Programs)
    """Where they are."""
    results: tuple[Path, ...] = ()
    """Folders of captures."""
    only: str = ""
    """Part of the names of the results to look at."""


def run(config: Experiment) -> Report:
    """Make, export and read everything."""
    rows, files = [], 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        todo: list[tuple[Case, Path | None]] = [(Case(p.name, ""), p) for p in config.results]
        todo += [(case, None) for case in cases(config.data, folder)]
        for number, (case, result) in enumerate(todo):
            if config.only in case.name:
                out = folder / f"out {number}"
                found = _examine(case, result or save(case, folder), out, config.programs)
                rows.append((case.name, *(found.get(column, "") for column in COLUMNS)))
                files += len(list(out.glob("*.glb")))
    notes = (
        f"{len(rows)} results, {files} GLB files. Largest distances in mm over up to {SAMPLES} "
        "frames; validator: errors + warnings; own rig: BVH played on the user's file in Blender.",
    )
    return Report((Table("exports, read elsewhere", ("result", *COLUMNS), tuple(rows), 5),), notes)


def _examine(case: Case, folder: Path, out: Path, programs: Programs) -> Mapping[str, Any]:
    """A row of the table by column."""
    with redirect_stdout(StringIO()):
        run_export(Export(folder, FORMATS, out, name="x"))
    result = read_result(folder)
    turn = turn_to_y(upright(torch.from_numpy(result.joints))).numpy()
    recording = Recording(result, "x", 0, result.frames, turn)
    frames = np.unique(np.linspace(0, result.frames - 1, SAMPLES).round().astype(int)).tolist()
    found = {**_texts(recording, out, frames), **_stage(recording, out, frames)}
    if programs.node_modules:
        errors, warnings = programs.validate(sorted(out.glob("*.glb")))
        found["validator"] = f"{errors} + {warnings}"
    if result.surface is not None:
        found |= _surfaces(recording, out, frames, programs)
    if case.own and programs.blender:
        more = ("--onto", str(case.own.resolve()))
        seen = programs.sample_blender(out / "x.bvh", result.rate, frames, *more)
        found["own rig"] = apart(seen["vertices"], linear_skin(recording, frames))
    return found


def _texts(recording: Recording, out: Path, frames: list[int]) -> Mapping[str, Any]:
    names = unique_names(recording.template.bone_names, word)
    places, turns = read_bvh(out / "x.bvh", names, frames)
    points, rate = read_c3d(out / "x.c3d")
    markers, times = read_trc(out / "x.trc")
    assert abs(rate - recording.rate) < 1e-4 and np.allclose(times, recording.times, atol=1e-6)
    return {
        "bvhio": apart(places / 100, recording.posed_bones[frames][..., :3, 3]),
        "bvhio deg": turned(turns, recording.bone_transforms[frames][..., :3, :3]),
        "c3d": apart(points / 1000, recording.landmarks @ Z_UP.T),
        "opensim": apart(markers / 1000, recording.landmarks),
    }


def _stage(recording: Recording, out: Path, frames: list[int]) -> Mapping[str, Any]:
    vertices, motions, errors = read_usd(out / "x.usdc", frames)
    packed, _, more = read_usd(out / "x.usdz", frames)
    skinned = replace(recording, result=replace(recording.result, surface=None))
    expected = np.concatenate([skinned.vertices(f, f + 1) for f in frames])
    transforms = recording.bone_transforms[frames]
    return {
        "usd skin": max(apart(vertices, expected), apart(packed, expected)),
        "usd deg": turned(motions[..., :3, :3], transforms[..., :3, :3]),
        "usd errors": errors + more,
    }


def _surfaces(
    recording: Recording, out: Path, frames: list[int], programs: Programs
) -> Mapping[str, Any]:
    """The captured surface in every program; of clips in pieces, the last piece."""
    expected = np.concatenate([recording.vertices(f, f + 1) for f in frames]).astype(float)
    found: dict[str, Any] = {
        "usd surface": apart(read_usd_surface(out / "x_surface.usdc", frames), expected)
    }
    path = sorted(out.glob("x*.glb"))[-1]
    first = recording.frames - targets(path)
    kept = [number for number, frame in enumerate(frames) if frame >= first]
    shown = [frames[number] - first for number in kept]
    if programs.chromium:
        seen = programs.sample_three(path, recording.rate, shown)
        found["three"] = apart(seen, expected[kept])
    if programs.blender:
        seen = programs.sample_blender(path, recording.rate, shown)
        found["blender"] = apart(seen["vertices"], expected[kept])
        order = [seen["bone_names"].tolist().index(n) for n in recording.template.bone_names]
        places = recording.posed_bones[[frames[number] for number in kept]][..., :3, 3]
        found["bones"] = apart(seen["bone_places"][:, order], places)
    return found


if __name__ == "__main__":
    main(run, Experiment, "export_check")
