"""Videos of cameras that are moved by hand, captured with nothing but the video.

Each is captured with the camera's way found, with a camera that is taken to stand still, and with
the true cameras. The staged clips are people, motions, rooms and ways drawn at random; truth is
used to score alone.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import torch
from feet import FEET
from recordings import rendered
from report import Report, Table, data_folder
from staged_cameras import HELD, Handling
from staged_people import RATE, staged
from torch import Tensor

from perfcap.app.capture import run_capture
from perfcap.commands.capture import Capture, Until
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import read_cameras
from perfcap.io.calibration.assumed import save_assumed
from perfcap.metrics import floor_contact, foot_skate, joint_errors
from perfcap.train.motion_library import MotionLibrary

WAYS = (
    HELD,
    Handling("turned after the person", sway=0, roam=0.02, follows=0.8, roll=0.2),
    Handling("walked around", around=30),
    Handling("held with one hand", sway=0.08, roam=0.2, follows=0.5, roll=2),
)
_MM = 1e3


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_coat",)
    """Of the rendered set; the others' cameras stand still."""
    clips: int = 8
    """Staged ones: people, rooms and ways drawn at random."""
    frames: int = 90
    """Of a staged clip."""
    size: int = 480
    """Of its pictures, pixels."""
    seed: int = 7
    """Of the staged clips."""
    until: Until = "track_motion"
    """The last stage to run."""
    keep: Path | None = None
    """Folder to keep videos and captures in, with pictures."""


@dataclass(frozen=True)
class Video:
    """A video, its camera of each frame (F, 1), and the truth about joints, (F, 16, 3) m."""

    name: str
    path: Path
    camera: Camera
    truth: Tensor
    rate: float


def run(config: Experiment) -> Report:
    """Three rows a video."""
    rows: list[tuple[str | float, ...]] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) if config.keep is None else config.keep
        for number, video in enumerate(_videos(config, folder)):
            rows += _rows(config, video, folder / f"capture{number}")
    columns = (
        "video",
        "camera",
        "PA-MPJPE mm",
        "one similarity for all frames mm",
        "slide mm a frame",
        "true slide",
        "angle of view",
        "true angle",
        "turn off by degrees, worst",
        "place off by mm, worst",
        "farthest from where it began m",
    )
    return Report((Table("cameras in hands", columns, tuple(rows)),), tuple(_medians(rows)))


def _medians(rows: list[tuple[str | float, ...]]) -> Iterator[str]:
    for kind in ("found", "still", "true"):
        own = np.array([row[2:6] for row in rows if row[1] == kind], float)
        pose, whole, slide, true = np.nanmedian(own, 0).tolist()
        yield (
            f"{kind}: PA-MPJPE {pose:.1f} mm, after one similarity {whole:.1f} mm, slide "
            f"{slide:.1f} mm a frame (the truth's {true:.1f}), medians of {len(own)} videos"
        )


def _videos(config: Experiment, folder: Path) -> Iterator[Video]:
    for name in config.sequences:
        known = rendered(config.data, name)
        camera = known.cameras.every_frame(len(known.truth))
        yield Video(name, known.folder / "video.mp4", camera, known.truth.double(), known.rate)
    if config.clips:
        library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    for number in range(config.clips):
        place = folder / f"staged{number}"
        place.mkdir(parents=True, exist_ok=True)
        way = WAYS[number % len(WAYS)]
        settings = config.frames, config.size, config.seed
        clip = staged(place, library, number, *settings, handling=way)
        path = place / f"staged{number}.mp4"
        yield Video(clip.name, path, clip.cameras, clip.truth, RATE)


def _rows(config: Experiment, video: Video, out: Path) -> Iterator[tuple[str | float, ...]]:
    known = out.with_suffix(".json")
    known.parent.mkdir(parents=True, exist_ok=True)
    save_assumed(known, video.camera, (video.path.stem,), video.rate)
    found: tuple[Path, ...] = ()
    for kind in ("found", "still", "true"):
        here = out / kind
        run_capture(
            Capture(
                videos=(video.path,),
                out=here,
                detections=found,
                cameras=known if kind == "true" else None,
                camera_motion="none" if kind == "still" else "auto",
                until=config.until,
                overlay=config.keep is not None,
                overwrite=True,
            )
        )
        if kind == "found":
            found = (here / "detections.npz",)
        yield video.name, kind, *_scores(video, here, known if kind == "true" else None)


def _scores(video: Video, out: Path, given: Path | None) -> tuple[float, ...]:
    with np.load(out / "motion.npz") as file:
        joints = torch.from_numpy(file["joints3d"]).double()
    truth = video.truth[: len(joints)].double()
    errors = joint_errors(joints, truth, video.rate)
    path = given or out / "assumed_camera.json"
    camera = read_cameras(path, video.camera.size).cameras.every_frame(len(joints))
    turn, place, scale = _way_errors(camera, video.camera, joints, truth)
    up = torch.eye(3, dtype=torch.float64)[1]
    contact = floor_contact(truth[:, FEET], truth[:, FEET, 1], video.rate)
    slides = (float(foot_skate(each[:, FEET], contact, up)) for each in (joints * scale, truth))
    return (
        float(errors.mpjpe_similarity),
        _together(joints, truth),
        *slides,
        *(_angle(each) for each in (camera, video.camera)),
        *(turn, place),
        float(_centres(video.camera).sub(_centres(video.camera)[0]).norm(dim=-1).max()),
    )


def _together(joints: Tensor, truth: Tensor) -> float:
    """Mean distance of joints after one similarity of all frames, mm."""
    points, others = joints.flatten(0, 1), truth.flatten(0, 1)
    moved = procrustes(points, others).apply(points)
    return _MM * float((moved - others).norm(dim=-1).mean())


def _way_errors(
    camera: Camera, true: Camera, joints: Tensor, truth: Tensor
) -> tuple[float, float, float]:
    """Degrees and millimetres by which a camera is elsewhere than in the first frame, and the size.

    Lengths are by the person's size, which one camera does not tell.
    """
    turns = [each.rotation[:, 0] @ each.rotation[0, 0].mT for each in (camera, true)]
    trace = (turns[0] @ turns[1].mT).diagonal(dim1=-2, dim2=-1).sum(-1)
    apart = ((trace - 1) / 2).clamp(-1, 1).arccos().rad2deg()
    size = float(procrustes(joints, truth).scale.median())
    ways = [
        (c.rotation[0, 0] @ (_centres(c) - _centres(c)[0])[..., None]).squeeze(-1)
        for c in (camera, true)
    ]
    return float(apart.max()), _MM * float((size * ways[0] - ways[1]).norm(dim=-1).max()), size


def _centres(camera: Camera) -> Tensor:
    return camera.centre[:, 0].double()


def _angle(camera: Camera) -> float:
    """Degrees across the longer side."""
    focal = float(camera.intrinsics[..., 0, 0].mean())
    return math.degrees(2 * math.atan(0.5 * max(camera.size[0]) / focal))


if __name__ == "__main__":
    report.main(run, Experiment, "hand_held")
