"""The focal length that a moving person shows: found, assumed and true lenses of one video each.

Nothing but the video goes in. Errors of the distance are of the person's own size, which one
camera does not tell. Videos: the rendered sequences, each view of ``dev_views`` and of the real man
alone, and films of random people, cameras and lenses.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from filmed_people import LENSES, films
from recordings import Recording, balancing, rendered, rendered_views
from report import Report, Table, data_folder
from torch import Tensor

from perfcap.app.capture import run_capture
from perfcap.commands.capture import Capture
from perfcap.detect.retarget import bone_vectors, mid_hip
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import read_cameras
from perfcap.io.calibration.assumed import ASSUMED_FOV
from perfcap.metrics import joint_errors
from perfcap.train.motion_library import MotionLibrary

_WIDE = 0.5, 0.9  # focal lengths, in sizes of the picture


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt", "dev_coat")
    """Of the rendered set."""
    views: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    """Of ``dev_views``, each captured alone."""
    real: tuple[int, ...] = (0, 1, 2, 3)
    """Of the real man's views."""
    films: int = 12
    """Random people, seen by lenses of 31 to 64 degrees."""
    wide: int = 6
    """Others, seen by lenses of 58 to 90 degrees."""
    frames: int = 90
    """Of a film."""
    size: int = 480
    """Of its pictures, pixels."""
    seed: int = 7
    """Of the films."""


@dataclass(frozen=True)
class Video:
    """A video, its camera, one view, and the truth about its joints, (F, 16, 3) m."""

    name: str
    path: Path
    camera: Camera
    truth: Tensor
    rate: float
    longer: float
    """Side of the picture, pixels of the camera."""

    @property
    def angle(self) -> float:
        """Degrees across the longer side."""
        focal = float(self.camera.intrinsics[..., 0, 0].mean())
        return math.degrees(2 * math.atan(0.5 * self.longer / focal))


def run(config: Experiment) -> Report:
    """A row a video: its lens, what is found, and scores with each."""
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for number, video in enumerate(_videos(config, Path(scratch))):
            rows.append(_row(video, Path(scratch) / f"out{number}"))
    columns = (
        "video",
        "true angle",
        "found angle",
        "off by deviations",
        *(f"PA-MPJPE mm, {lens}" for lens in ("found", "assumed", "true")),
        *(f"distance off %, {lens}" for lens in ("found", "assumed", "true")),
    )
    off = np.abs(
        [[_wrong(float(row[1]), float(angle)) for angle in (row[2], ASSUMED_FOV)] for row in rows]
    )
    found, assumed = np.median(off, 0).tolist()
    note = (
        f"focal length off by {100 * found:.0f} % in the median, {100 * assumed:.0f} % as assumed; "
        f"worst {100 * off[:, 0].max():.0f} and {100 * off[:, 1].max():.0f} %"
    )
    return Report((Table("a lens", columns, tuple(rows)),), (note,))


def _wrong(true: float, other: float) -> float:
    """Log of a focal length by another's, of angles."""
    return math.log(math.tan(math.radians(true) / 2) / math.tan(math.radians(other) / 2))


def _videos(config: Experiment, scratch: Path) -> Iterator[Video]:
    for name in config.sequences:
        yield _video(rendered(config.data, name), "video.mp4", 0)
    for view in config.views:
        yield _video(rendered_views(config.data, "dev_views"), "views/*.mp4", view)
    for view in config.real:
        yield _video(balancing(config.data), "videos/*.mp4", view)
    if config.films or config.wide:
        library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
        for kind, count, lenses in (("film", config.films, LENSES), ("wide", config.wide, _WIDE)):
            folder = scratch / kind
            folder.mkdir()
            settings = config.frames, config.size, config.seed
            for film in films(folder, library, count, *settings, lenses=lenses):
                name, camera = f"{kind} {film.name}", film.camera.to(film.truth)
                yield Video(name, film.path, camera, film.truth, film.rate, config.size)


def _video(known: Recording, files: str, view: int) -> Video:
    path = sorted(known.folder.glob(files))[view]
    camera = known.cameras.select([view])
    name = known.name if known.cameras.views == 1 else f"{known.name}, {known.rig.names[view]}"
    return Video(name, path, camera, known.truth, known.rate, max(camera.size[0]))


def _row(video: Video, out: Path) -> tuple[str | float, ...]:
    call = Capture(videos=(video.path,), out=out, until="track_motion", overlay=False)
    run_capture(call)
    lens = json.loads((out / "run.json").read_text())["view_errors"].get("lens", {})
    camera = read_cameras(out / "assumed_camera.json", video.camera.size).cameras
    focal = float(camera.intrinsics.reshape(-1, 3, 3)[0, 0, 0])
    found = math.degrees(2 * math.atan(0.5 * max(camera.size[0]) / focal))
    scores = [_scores(video, out)]
    for lens_name, angle in (("assumed", ASSUMED_FOV), ("true", video.angle)):
        again = out.with_name(f"{out.name}_{lens_name}")
        run_capture(replace(call, out=again, detections=(out / "detections.npz",), fov=angle))
        scores.append(_scores(video, again))
    errors, distances = zip(*scores, strict=True)
    # the way of a camera that moves shows its lens as well, and says no deviation
    off = _wrong(found, video.angle) / lens.get("log_deviation", math.nan)
    return (video.name, video.angle, found, off, *errors, *distances)


def _scores(video: Video, out: Path) -> tuple[float, float]:
    """PA-MPJPE, mm, and by what the distance is wrong in the median, percent."""
    with np.load(out / "motion.npz") as file:
        joints = torch.from_numpy(file["joints3d"]).double()
    frames = min(len(joints), len(video.truth))
    joints, truth = joints[:frames], video.truth[:frames].double()
    error = float(joint_errors(joints, truth, video.rate).mpjpe_similarity)
    camera = read_cameras(out / "assumed_camera.json", video.camera.size).cameras
    size = (_lengths(truth) / _lengths(joints)).nanmedian()
    far = [c.to_camera(p)[:, 0, ..., 2] for c, p in ((camera, joints), (video.camera, truth))]
    found, true = (mid_hip(each[..., None])[..., 0] for each in far)
    return error, 100 * float((size * found / true - 1).abs().nanmedian())


def _lengths(joints: Tensor) -> Tensor:
    """Mean lengths of the bones, m."""
    lengths: Tensor = bone_vectors(joints).norm(dim=-1)
    return lengths.nanmean(0)


if __name__ == "__main__":
    report.main(run, Experiment, "lens")
