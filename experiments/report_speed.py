"""Size of a report, and how soon a browser can play it.

A rendered sequence there and back again until it is long enough, with a surface that ripples over
the skin, and its silhouettes as masks. The page is opened from disk in new headless Chromiums, with
WebGL in software. It is ready when the textured person is drawn and every control works; the clock
starts with the navigation. Other programs on the machine count in wall time, not in processors'.
"""

from __future__ import annotations

import os
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from recordings import Recording, rendered
from report import Report, Table

from perfcap.actor.motion import Motion
from perfcap.io.clip import Clip
from perfcap.io.mask_files import save_masks
from perfcap.io.video_writer import VideoWriter
from perfcap.pipeline import CaptureConfig, Performance, Stage, capture
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface
from perfcap.render import rasterize
from perfcap.report import make_report

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from chromium import Page, browser

_TICKS = os.sysconf("SC_CLK_TCK")
_RIPPLE = 0.01  # m
_COLUMNS = ("run", "ready, s", "processor, s", "requests", "messages")


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequence: str = "dev_skirt"
    """Of ``rendered``."""
    frames: int = 150
    """Length of the clip."""
    repeats: int = 5
    """How often the page is opened."""
    result: Path | None = None
    """Folder of a capture to measure instead."""


def run(config: Experiment) -> Report:
    """Make the page and open it."""
    with tempfile.TemporaryDirectory() as place:
        folder = config.result or _made(config, Path(place))
        page = make_report(folder)
        rows = [_opened(page, Path(place) / f"profile {i}", i) for i in range(config.repeats)]
        size = page.stat().st_size / 1e6
    median = np.median([row[1] for row in rows])
    notes = (
        f"{size:.1f} MB (aim 25); ready after {median:.2f} s, median of {len(rows)} (aim 3); load "
        f"of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors",
    )
    return Report((Table("a report in headless Chromium", _COLUMNS, tuple(rows), digits=2),), notes)


def _opened(path: Path, profile: Path, number: int) -> tuple[int, float, float, int, int]:
    with browser(profile) as page:
        page.resize(1440, 900)
        before = _processor_seconds(page)
        page.open(path)
        after = _processor_seconds(page)
        ready = float(page.evaluate("document.documentElement.dataset.ready")) / 1000
        return number, ready, after - before, len(page.requests), len(page.console)


def _processor_seconds(page: Page) -> float:
    """Spent by all processes of a browser that are alive; NaN where the system does not tell."""
    if not Path("/proc/self/stat").exists():
        return float("nan")
    total = 0
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended
            fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            total += (int(fields[11]) + int(fields[12])) * (int(fields[3]) == page.process)
    return total / _TICKS


def _made(config: Experiment, place: Path) -> Path:
    """A result of the asked length, and the video it speaks of."""
    recording = rendered(config.data, config.sequence)
    order = _there_and_back(recording.detections.frame_count, config.frames)
    parts = (recording.actor, recording.cameras, recording.detections, recording.rate)
    motion = capture(*parts, until=Stage.TRACK_MOTION).motion
    longer = Motion(motion.translation[order], motion.rotation[order], motion.angles[order])
    surface = _rippling(SkinnedSurface(recording.actor, longer), config.frames)
    seen = recording.detections.frames(torch.tensor(order))
    found = (recording.actor, recording.cameras, seen, longer, recording.rate, CaptureConfig())
    result = Performance(*found, surface=surface)
    _write_video(place / "video.mp4", recording, order)
    folder = place / "result"
    cameras = str(recording.folder / "camera.json")
    request = {"videos": [str(place / "video.mp4")], "cameras": cameras, "detections": []}
    result.save(folder, 0, {"request": request, "views": list(recording.rig.names)})
    save_masks(folder / "masks", {"": _masks(result)})
    return folder


def _there_and_back(frames: int, wanted: int) -> list[int]:
    period = [*range(frames), *range(frames - 2, 0, -1)]
    return [period[i % len(period)] for i in range(wanted)]


def _rippling(skinned: SkinnedSurface, frames: int) -> StoredSurface:
    """The skinned surface with waves that the skin alone does not explain."""
    vertices = skinned[:].float()
    phase = 25 * vertices[:1] + 0.2 * torch.arange(frames)[:, None, None]
    return StoredSurface(vertices + _RIPPLE * phase.sin())


def _write_video(path: Path, recording: Recording, order: list[int]) -> None:
    clip = Clip.open(recording.folder / "video.mp4")
    frames = clip.read_view(0, 0, len(clip))
    with VideoWriter(path, recording.rate) as writer:
        for index in order:
            writer.write(frames[index])


def _masks(result: Performance) -> list[bytes]:
    faces = torch.as_tensor(result.actor.template.faces.copy())
    encoded = []
    for frame in range(result.frames):
        cameras = result.cameras.frames(slice(frame, frame + 1))
        local = cameras.to_camera(result.shown[frame : frame + 1].to(cameras.intrinsics))
        drawn = rasterize(
            cameras.project_camera(local)[0, 0], local[0, 0, :, 2], faces, cameras.size[0]
        )
        encoded.append(cv2.imencode(".png", drawn.mask.numpy().astype(np.uint8))[1].tobytes())
    return encoded


if __name__ == "__main__":
    report.main(run, Experiment, "report_speed")
