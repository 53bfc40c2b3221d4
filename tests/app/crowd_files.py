"""Several people on disk: actors, videos, cameras, shuffled detections, truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from crowds import RATE, Crowd
from numpy.typing import NDArray
from takes import camera_entry, write_actor, write_json, write_video

from perfcap.io.detections import save_candidates
from perfcap.io.video_writer import VideoWriter

SIZE = 120  # px of the square images


@dataclass(frozen=True)
class CrowdFiles:
    """Files of a crowd, and the command line that captures it."""

    folder: Path
    crowd: Crowd

    @property
    def actors(self) -> list[Path]:
        """One file each."""
        return [self.folder / f"actor{k}.glb" for k in range(len(self.crowd.actors))]

    @property
    def videos(self) -> list[Path]:
        """One a view."""
        return [self.folder / f"cam{c + 1}.mp4" for c in range(self.crowd.cameras.views)]

    @property
    def truth(self) -> Path:
        """A folder with one of each person."""
        return self.folder / "truth"

    def command(
        self, out: Path, *more: object, actors: Sequence[object] | None = None
    ) -> list[str]:
        """Arguments of ``perfcap``, with other actors where some are given.

        Images show nobody: it ends at the motion, unless ``more`` says how far.
        """
        chosen = self.actors if actors is None else actors
        parts = ["capture", *self.videos, "--actor", *chosen, "--out", out, *more]
        parts += [] if "--until" in more else ["--until", "track_motion"]
        parts += ["--cameras", self.folder / "cameras.json"]
        parts += ["--detections", self.folder / "detections.npz"]
        return [str(part) for part in parts]


def write_crowd(
    folder: Path, crowd: Crowd, pictures: NDArray[np.uint8] | None = None
) -> CrowdFiles:
    """Everything a capture reads; its truth, the people in another order, beside it.

    Args:
        folder: made if missing.
        crowd: of people.
        pictures: of the videos, (C, F, H, W, 3); a room with nobody in it if None.
    """
    folder.mkdir(exist_ok=True)
    files = CrowdFiles(folder, crowd)
    for actor, path in zip(crowd.actors, files.actors, strict=True):
        write_actor(path, actor.template)
    for view, path in enumerate(files.videos):
        if pictures is None:
            write_video(path, crowd.candidates.frame_count, (SIZE, SIZE), RATE)
            continue
        with VideoWriter(path, RATE, preset="ultrafast") as writer:
            for picture in pictures[view]:
                writer.write(picture)
    views = {path.stem: camera_entry(crowd.cameras, c) for c, path in enumerate(files.videos)}
    write_json(folder / "cameras.json", {"fps": RATE, "views": views})
    save_candidates(folder / "detections.npz", crowd.candidates, tuple(views))
    for number, joints in enumerate(reversed(crowd.joints.unbind()), 1):
        place = files.truth / f"person{number}"
        place.mkdir(parents=True)
        np.savez(place / "truth.npz", joints3d=joints.numpy(), fps=RATE)
    return files
