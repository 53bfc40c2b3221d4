"""What a clip says of its files is in the result of a capture in Python."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from takes import Take, make_take

from perfcap.io.clip import Clip
from perfcap.io.view_times import parting
from perfcap.pipeline.clip_notes import clip_notes
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.people import Person, Scene
from perfcap.pipeline.stage import Stage

FRAMES = 12


def parted(folder: Path) -> Clip:
    """Two views of which a clip knows that they part."""
    for name in "ab":
        (folder / name).mkdir()
        for frame in range(FRAMES):
            path = folder / name / f"{frame:04d}.png"
            cv2.imwrite(str(path), np.zeros((16, 16, 3), np.uint8))
    clip = Clip.open([folder / "a", folder / "b"], fps=30)
    apart = parting([(np.arange(FRAMES) / 30, "a"), (np.arange(FRAMES) / 25, "b")])
    return Clip(clip.sources, 30, (*clip.warnings, *apart))


def captured(take: Take, rate: object, images: Images | None = None) -> tuple[str, ...]:
    given = take.actor, take.cameras, take.detections, rate
    return capture(*given, images=images, until=Stage.INITIALIZE).warnings  # type: ignore[arg-type]


def test_a_capture_says_that_views_part(tmp_path: Path) -> None:
    clip, take = parted(tmp_path), make_take(FRAMES, views=2)
    assert any("frames apart" in line for line in clip.warnings)
    assert not captured(take, 30.0)
    assert captured(take, clip) == clip.warnings
    images = Images(clip, replace(take.cameras, size=clip.sizes))
    assert captured(take, clip, images) == clip.warnings  # each once
    assert captured(take, clip.fps, images) == clip.warnings
    assert not captured(take, clip.fps, replace(images, examined=True))


def test_people_of_a_scene_hear_of_their_clip(tmp_path: Path) -> None:
    clip, take = parted(tmp_path), make_take(FRAMES, views=2)
    person = Person(take.actor, take.detections)
    scene = Scene(take.cameras, (person,), clip)  # type: ignore[arg-type]
    assert scene.rate == clip.fps
    (found,) = capture(scene, until=Stage.INITIALIZE)
    assert found.warnings == clip.warnings
    assert found.report()["warnings"] == list(clip.warnings)
    part = Images(clip, replace(take.cameras, size=clip.sizes)).frames(slice(2, 8))
    assert clip_notes(part.reader, clip.fps) == clip.warnings


def test_a_rate_that_is_given_is_not_said_to_be_assumed(tmp_path: Path) -> None:
    for frame in range(4):
        cv2.imwrite(str(tmp_path / f"{frame:04d}.png"), np.zeros((16, 16, 3), np.uint8))
    clip = Clip.open(tmp_path)
    (line,) = clip_notes(clip, clip.fps)
    assert "assumed" in line
    assert clip_notes(clip, 50.0) == () and clip_notes(50.0, 50.0) == ()
