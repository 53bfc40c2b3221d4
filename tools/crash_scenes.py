"""What ``crash.py`` captures: takes of one view and of several, and a video that comes alone."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
for _folder in ("tests", "tests/pipeline"):
    sys.path.insert(0, str(_ROOT / _folder))

import cv2  # noqa: E402
import numpy as np  # noqa: E402
from takes import (  # noqa: E402
    camera_entry,
    detect,
    make_take,
    marked_template,
    shrunk,
    write_actor,
    write_detections,
    write_json,
)
from test_checkpoint import FRAMES, SIDE, film  # noqa: E402

from perfcap.actor.actor import Actor  # noqa: E402
from perfcap.io import models_folder  # noqa: E402
from perfcap.io.clip import Clip  # noqa: E402
from perfcap.io.video_writer import VideoWriter  # noqa: E402

_LONE = 24  # frames of a video that comes alone


@dataclass(frozen=True)
class Scene:
    """The files of a take and the command that captures it; no views: a video and nothing else."""

    folder: Path
    views: int

    def call(self, out: Path, *more: str) -> list[str]:
        """Arguments of ``perfcap``."""
        if not self.views:
            return ["capture", str(self.folder / "alone.mp4"), "--out", str(out), *more]
        names = [f"cam{view}" for view in range(self.views)]
        videos = [str(self.folder / f"{name}.mp4") for name in names]
        detections = [str(self.folder / f"{name}.npz") for name in names]
        options = {"actor": "actor.glb", "cameras": "cameras.json"}
        files = [text for name, file in options.items()
                 for text in (f"--{name}", str(self.folder / file))]  # fmt: skip
        return ["capture", *videos, *files, "--detections", *detections, "--out", str(out), *more]


def make_lone_scene(folder: Path) -> Scene:
    """The shipped clip, half as large, as a camera films it that is turned to the side."""
    folder.mkdir(parents=True)
    clip = Clip.open(models_folder() / "demo" / "video.mp4")
    with VideoWriter(folder / "alone.mp4", clip.fps) as writer:
        for frame in range(_LONE):
            image = clip.read_view(0, frame, frame + 1)[0]
            small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            writer.write(np.ascontiguousarray(small[20:340, 10 + frame : 310 + frame]))
    return Scene(folder, 0)


def make_scene(folder: Path, views: int) -> Scene:
    """Film a take of so many views and write all that its capture needs; 0: a video alone."""
    if not views:
        return make_lone_scene(folder)
    actor = Actor(marked_template())
    take = make_take(FRAMES, views=views, actor=actor)
    cameras = shrunk(take.cameras, (SIDE, SIDE))
    take = replace(take, cameras=cameras, detections=detect(actor, cameras, take.truth))
    folder.mkdir(parents=True)
    write_actor(folder / "actor.glb", actor.template)
    shown = film(take, cameras)
    names = [f"cam{view}" for view in range(views)]
    for view, name in enumerate(names):
        write_detections(folder / f"{name}.npz", take.detections.select([view]))
        with VideoWriter(folder / f"{name}.mp4", take.rate, preset="ultrafast") as writer:
            for image in shown.read_view(view, 0, FRAMES):
                writer.write(np.ascontiguousarray(image))
    entries = {name: camera_entry(cameras, view) for view, name in enumerate(names)}
    write_json(folder / "cameras.json", entries["cam0"] if views == 1 else {"views": entries})
    return Scene(folder, views)
