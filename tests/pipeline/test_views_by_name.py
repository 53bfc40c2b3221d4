"""Views of videos are called by their names in what a capture says of them."""

from __future__ import annotations

from pathlib import Path

from takes import make_take, without, write_video

from perfcap.io.clip import Clip
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.stage import Stage


def test_a_view_that_detects_nobody_is_named(tmp_path: Path) -> None:
    made = make_take(6, views=2)
    blind = without(made.detections, slice(None), slice(1, 2))
    paths = [tmp_path / "left.mp4", tmp_path / "right.mp4"]
    for path, (height, width) in zip(paths, made.cameras.size, strict=True):
        write_video(path, 6, (height, width))
    images = Images(Clip.open(paths), made.cameras)
    assert images.frames(slice(0, 3)).checked().names == ("left", "right")
    parts = made.actor, made.cameras, blind, 30.0
    found = capture(*parts, images=images, until=Stage.TRACK_MOTION)
    assert any(line.startswith("view right detects nobody;") for line in found.warnings)
