"""Files of moving cameras whose way is too long or too short, in one view: what a capture says.

Videos are staged, as those of ``given_cameras.py``; files are scaled about the first frame's
camera, as where the unit is another, or where software that has none made them. Of who rides
along, as on a cart beside the camera, right files are captured too: feet stand nowhere.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from hand_held import WAYS
from report import Report, Table, data_folder
from staged_people import RATE, staged

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.pipeline import Stage, capture
from perfcap.train.motion_library import MotionLibrary

_WAY = 0.01  # m; a camera that turns alone has none
_SAID = "if the camera's way were "
_FAR = ("the person jumps", "the person lies")


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    clips: int = 8
    """Staged: people, rooms and ways drawn at random; cameras that turn alone are left out."""
    frames: int = 90
    """Of a clip."""
    size: int = 240
    """Of its pictures, pixels."""
    seed: int = 5
    """Of the clips; thresholds were chosen on seed 3 and dev_coat."""
    factors: tuple[float, ...] = (1.0, 0.1, 0.3, 0.5, 2.0, 3.0, 10.0, 39.4, 100.0)
    """Of the length of the way; inches and centimetres among them."""


@dataclass(frozen=True)
class Take:
    """A person before one camera that moves, (F, 1)."""

    name: str
    actor: Actor
    camera: Camera
    detections: Detections

    @property
    def way(self) -> float:
        """Farthest that the camera is from where it began, m."""
        return float((self.camera.centre - self.camera.centre[0]).norm(dim=-1).max())


def run(config: Experiment) -> Report:
    """A row a factor, and one of who rides along."""
    with tempfile.TemporaryDirectory() as scratch:
        takes = list(_takes(config, Path(scratch)))
    walked = [take for take in takes if take.way > _WAY]
    rows = [_row(f"way times {factor:g}", walked, factor) for factor in config.factors]
    rows.append(_row("right, of who rides along", [_riding(take) for take in walked], 1.0))
    columns = ("file", "videos", "named", "factor, over the right one", "not named", "jumps or far")
    return Report((Table("lengths of ways", columns, tuple(rows)),), ())


def _takes(config: Experiment, folder: Path) -> Iterator[Take]:
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    for number in range(config.clips):
        settings = config.frames, config.size, config.seed
        clip = staged(folder, library, number, *settings, handling=WAYS[number % len(WAYS)])
        yield Take(clip.name, clip.actor, clip.cameras, clip.detections)


def _row(kind: str, takes: list[Take], factor: float) -> tuple[str | float, ...]:
    """How many videos with such a file are named, and what factor is said."""
    said: list[float] = []
    missed: list[str] = []
    beside = 0
    for take in takes:
        camera = scaled_way(take.camera, factor)
        found = capture(take.actor, camera, take.detections, RATE, until=Stage.TRACK_MOTION)
        named = [line for line in found.warnings if _SAID in line]
        beside += any(line.startswith(_FAR) for line in found.warnings)
        if named:
            said.append(factor * float(named[0].split(_SAID)[1].split()[0]))
        else:
            missed.append(f"{take.name} ({take.way:.2g} m)")
    middle = f"{np.median(said):.2f} ({min(said):.2f} to {max(said):.2f})" if said else math.nan
    return kind, len(takes), len(said), middle, "; ".join(missed), beside


def scaled_way(camera: Camera, factor: float) -> Camera:
    """A camera (F, C) with a way that is longer than the true one, all else alike."""
    centre = camera.centre[0] + factor * (camera.centre - camera.centre[0])
    return replace(camera, translation=-(camera.rotation @ centre[..., None])[..., 0])


def _riding(take: Take) -> Take:
    """The person of the first frame's pose, carried along by the camera, which turns as it did."""
    camera, seen = take.camera, take.detections
    pixels, poses = seen.joints2d[:1], seen.joints3d
    assert poses is not None
    rays = torch.nn.functional.pad(camera.frames(slice(0, 1)).to_plane(pixels), (0, 1), value=1.0)
    turned = camera.rotation @ camera.rotation[0].mT  # F 1 3 3
    generator = torch.Generator().manual_seed(0)
    noise = 0.01 * torch.randn(seen.joints2d.shape[:3], generator=generator, dtype=torch.float64)
    shown = camera.project_camera((turned.unsqueeze(-3) @ rays.to(turned)[..., None]).squeeze(-1))
    carried = (turned.unsqueeze(-3) @ poses[:1].to(turned)[..., None]).squeeze(-1)
    carried = carried + noise[..., None].to(carried)
    known = replace(
        seen,
        joints2d=(shown + 100 * noise[..., None]).to(pixels),
        confidence2d=seen.confidence2d[:1].expand_as(seen.confidence2d).clone(),
        joints3d=carried.to(poses),
    )
    return replace(take, detections=known)


if __name__ == "__main__":
    report.main(run, Experiment, "way_lengths")
