"""People followed frame by frame from their first poses, by silhouettes (Liu et al. 2013)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
from people_labels import Take
from report import RESULTS, Report, Table
from surface_recordings import clip_of

from perfcap.metrics import surface_error
from perfcap.pipeline.followed_person import FramesConfig
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.overlay import save_people_overlay
from perfcap.pipeline.people import Scene
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import LIU, CaptureConfig
from perfcap.pipeline.stage import Stage

_WINDOWS = "windows, detections in all frames"


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_duo", "dev_trio", "dev_twins")
    """Of ``rendered_multi``."""
    variants: tuple[str, ...] = ("default", "as published", _WINDOWS)
    """Some of the variants, or ``all``."""
    frames: int = 0
    """The first so many; all if 0."""
    overlays: bool = False
    """Write a video of the first variant in all views."""


def variants() -> dict[str, FramesConfig | None]:
    """Settings by name; None for windows."""
    default = LIU.frames
    assert default is not None
    local, search, surface = default.local, default.search, default.surface
    return {
        "default": default,
        "as published": replace(
            default,
            local=replace(local, scale=None),
            search=replace(search, polish=False),
            surface=replace(surface, slides=False, reach=math.inf),
        ),
        "local alone": replace(default, search=replace(search, search="never")),
        "search alone": replace(
            default,
            local=replace(local, rounds=0),
            search=replace(search, search="always", polish=False),
        ),
        "every frame searched": replace(default, search=replace(search, search="always")),
        "without texture": replace(default, local=replace(local, texture=(0.0, 0.0))),
        "without surface": replace(default, surface=replace(surface, carried=0.0)),
        "without labels": replace(default, labels=False),
        "quadratic": replace(default, local=replace(local, scale=None)),
        _WINDOWS: None,
    }


def run(config: Experiment) -> Report:
    """One table."""
    known = variants()
    chosen = list(known) if config.variants == ("all",) else list(config.variants)
    rows: list[tuple[object, ...]] = []
    for name in config.sequences:
        take = Take.read(config.data, name)
        if name == config.sequences[0]:
            followed(take, LIU, 2)  # compiles
        count = config.frames or take.people[0].detections.frame_count
        for variant in chosen:
            frames = known[variant]
            settings = CaptureConfig() if frames is None else replace(LIU, frames=frames)
            start = time.process_time()
            found = followed(take, settings, count)
            spent = (time.process_time() - start) / count / len(found)
            rows += [(name, variant, *row, spent) for row in _rows(take, found)]
            if config.overlays and variant == chosen[0]:
                RESULTS.mkdir(exist_ok=True)
                path = RESULTS / f"people_tracker_{name}.mp4"
                shown = take.people[0]
                shown = shown.part(range(shown.cameras.views), count)
                save_people_overlay(path, found, *clip_of(shown))
    columns = ("take", "variant", "person", "joints", "+-", "95 %", "surface, skinned", "refined",
               "IoU, skinned", "refined", "limbs off", "released %", "s")  # fmt: skip
    return Report(
        (Table("people followed, mm; IoU in %", columns, tuple(rows)),),
        (
            "But for windows, poses see the first frame's detections alone; background and colours "
            "of people are learnt with all. +-: deviation of the mean of frames. Limbs off: mm, "
            "median over frames of the worst. s: CPU a frame and person.",
        ),
    )


def followed(take: Take, config: CaptureConfig, count: int) -> tuple[Performance, ...]:
    """Everybody in the first ``count`` frames."""
    first, span = take.people[0], slice(0, count)
    cast = tuple(replace(each, detections=each.detections.frames(span)) for each in take.cast)
    scene = Scene(first.cameras, cast, first.rate, take.images.frames(span))
    return capture(scene, config=config, until=Stage.REFINE_SURFACE, workers=1)


def _rows(take: Take, found: Sequence[Performance]) -> Iterator[tuple[object, ...]]:
    for number, (person, each) in enumerate(zip(take.people, found, strict=True), 1):
        error = 1000 * (each.joints() - person.truth[: each.frames]).norm(dim=-1)
        skinned = each.actor.surface(each.motion).double().numpy(force=True)
        refined = each.shown[0 : each.frames].double().numpy(force=True)
        assert person.sequence is not None and person.sequence.surface is not None
        known = person.sequence.surface()
        apart = [
            np.mean(
                [
                    surface_error(
                        vertices[frame][known.order], known.vertices[frame], known.faces,
                        np.random.default_rng(0), translated=False,
                    ).surface
                    for frame in range(0, each.frames, 3)
                ]
            )
            for vertices in (skinned, refined)
        ]  # fmt: skip
        refinement = each.refinement
        assert refinement is not None and refinement.surface is not None
        overlaps = (100 * refinement.surface.before.mean(), 100 * refinement.surface.after.mean())
        tracking = refinement.tracking
        off, released = "", ""
        if tracking is not None:
            off = f"{1000 * float(np.median(tracking.errors.max(1))):.1f}"
            released = f"{100 * float(tracking.released.mean()):.1f}"
        frames = error.mean(-1)
        yield (
            number, float(error.mean()), float(frames.std()), float(error.quantile(0.95)),
            *map(float, apart), *map(float, overlaps), off, released,
        )  # fmt: skip


if __name__ == "__main__":
    report.main(run, Experiment, "people_tracker")
