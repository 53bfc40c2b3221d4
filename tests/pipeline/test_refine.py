"""Silhouettes, refined motion and deformed surface of the shipped clip, a part of it."""

from __future__ import annotations

import weakref
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import torch
from takes import make_take, without
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.errors import InputError
from perfcap.io.actor import load_actor, models_folder
from perfcap.io.calibration import read_cameras
from perfcap.io.clip import Clip
from perfcap.io.detections import read_detections
from perfcap.pipeline import CaptureConfig, Performance, Stage, capture
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import prepare
from perfcap.pipeline.refine import image_heights
from perfcap.pipeline.refine_pose import PoseRefinement
from perfcap.pipeline.sight import Outline, Sight, View
from perfcap.pipeline.surface_config import RefineSurfaceConfig

FRAMES = slice(40, 52)
# enough to see everything work, in seconds
CONFIG = CaptureConfig(refine_surface=RefineSurfaceConfig(nodes=300))


@dataclass(frozen=True)
class Painted:
    """A reader whose frames were changed."""

    frames: Frames

    def __len__(self) -> int:
        return len(self.frames)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        return self.frames[start:stop]


@dataclass(frozen=True)
class Counted:
    """A reader that counts how often each frame was read."""

    clip: Clip
    read: Counter[int] = field(default_factory=Counter)

    def __len__(self) -> int:
        return len(self.clip)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        self.read.update(range(start, stop))
        return self.clip.read_view(view, start, stop)


@pytest.fixture(scope="module")
def take() -> dict[str, object]:
    folder = models_folder() / "demo"
    rig = read_cameras(folder / "camera.json")
    clip = Clip.open(str(folder / "video.mp4"), frames=FRAMES)
    found, _ = read_detections(
        folder / "detections.npz", views=rig.names, pixel_offset=rig.pixel_offset
    )
    cameras = replace(rig.cameras.frames(FRAMES), size=clip.sizes)
    return {
        "actor": load_actor("sam"),
        "cameras": cameras,
        "detections": found.frames(FRAMES),
        "clip": clip,
    }


def run(take: dict[str, object], reader: object = None, **options: object) -> Performance:
    looked = reader is not None  # the looks at a clip before its stages read some frames more
    images = Images(reader or take["clip"], take["cameras"], examined=looked)  # type: ignore[arg-type]
    return capture(
        take["actor"], take["cameras"], take["detections"], 30.0, CONFIG, images=images, **options
    )  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def performance(take: dict[str, object]) -> Performance:
    return run(take)


@pytest.mark.long
def test_every_stage_comes_nearer_to_the_masks(performance: Performance) -> None:
    refinement = performance.refinement
    assert refinement is not None and refinement.surface is not None
    pose, surface = refinement.pose, refinement.surface
    assert pose.after.mean() > pose.before.mean()
    assert surface.after.mean() > surface.before.mean() > 0.8
    assert bool((pose.after >= pose.before - 1e-3).all())
    assert surface.folded.max() < 0.01


@pytest.mark.long
def test_the_surface_is_finite_and_near_the_skin(performance: Performance) -> None:
    assert performance.surface is not None
    vertices = performance.surface[0 : performance.frames]
    skinned = performance.actor.surface(performance.motion)
    assert bool(vertices.isfinite().all())
    moved = (vertices - skinned).norm(dim=-1)
    assert 0 < float(moved.mean()) < 0.05
    torch.testing.assert_close(performance.surface[3:5], vertices[3:5])


@pytest.mark.long
def test_the_number_of_workers_changes_nothing(
    take: dict[str, object], performance: Performance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And drawn views, which are large, live no longer than their frame."""
    drawn, most = Counter[str](), 0

    def watched(sight: Sight, *given: object) -> View:
        nonlocal most
        view = draw(sight, *given)  # type: ignore[arg-type]
        weakref.finalize(view, drawn.update, ["gone"])
        drawn.update(["made"])
        most = max(most, drawn["made"] - drawn["gone"])
        return view

    def outlined(sight: Sight, *given: object) -> Outline:
        drawn.update(["outlines"])
        return outline(sight, *given)  # type: ignore[arg-type]

    draw, outline = Sight._drawn, Sight._outline
    monkeypatch.setattr(Sight, "_drawn", watched)
    monkeypatch.setattr(Sight, "_outline", outlined)
    reader = Counted(take["clip"])  # type: ignore[arg-type]
    alone = run(take, reader, workers=1)
    # once for a pass, however many blocks show it
    assert max(reader.read.values()) <= 3 and reader.read[9] == reader.read[1]
    assert drawn["made"] + drawn["outlines"] > 10 * performance.frames and most <= 3
    assert torch.equal(alone.motion.angles, performance.motion.angles)
    assert alone.surface is not None and performance.surface is not None
    assert torch.equal(alone.surface[0:4], performance.surface[0:4])


@pytest.mark.long
def test_nothing_to_see_leaves_the_motion_alone(take: dict[str, object]) -> None:
    """Grey images: no contour can be trusted, nothing becomes worse, nothing is not a number."""
    size = take["clip"].sizes[0]  # type: ignore[attr-defined]
    dusk = np.linspace(112, 142, size[1])[:, None]  # images of one color are refused
    shape = FRAMES.stop - FRAMES.start, *size, 3
    grey = np.broadcast_to(dusk, shape).astype(np.uint8)
    found = run(take, Painted(grey))
    without = capture(take["actor"], take["cameras"], take["detections"], 30.0, CONFIG)  # type: ignore[arg-type]
    assert found.surface is not None
    assert bool(found.surface[0 : found.frames].isfinite().all())
    shift = (found.joints() - without.joints()).norm(dim=-1)
    assert float(shift.mean()) < 0.001


@pytest.mark.long
def test_a_person_outside_the_image_is_said_to_be(take: dict[str, object]) -> None:
    cameras = take["cameras"]
    aside = cameras.intrinsics.clone()  # type: ignore[attr-defined]
    aside[..., 0, 2] += 5000
    away = replace(cameras, intrinsics=aside)  # type: ignore[type-var]
    images = Images(take["clip"], away)  # type: ignore[arg-type]
    found = capture(take["actor"], take["cameras"], take["detections"], 30.0, CONFIG, images=images)  # type: ignore[arg-type]
    assert any("outside every image" in line for line in found.warnings)
    assert found.surface is not None
    assert bool(found.surface[0 : found.frames].isfinite().all())


def test_a_view_that_detects_nobody_knows_how_tall_the_person_is() -> None:
    """From the motion, in pixels of the images; contours of a 1 px person would find no pair."""
    made = make_take(6, views=2)
    blind = without(made.detections, slice(None), slice(1, 2))
    frames = FrameProblem.of(made.actor, made.cameras, blind, CONFIG.pose)
    assert frames.pixel_unit[1] == 0.01
    problem = ClipProblem.of(prepare(frames).problem, 30.0)
    intrinsics = made.cameras.intrinsics * torch.tensor([2.0, 2.0, 1.0]).double()[:, None]
    large = replace(made.cameras, intrinsics=intrinsics)
    heights = image_heights(problem, made.truth, Images(Painted(np.zeros(0, np.uint8)), large))
    torch.testing.assert_close(heights, 2 * made.detections.person_height())
    found = capture(made.actor, made.cameras, blind, 30.0)
    assert [line for line in found.warnings if "view 1" in line and "detects nobody" in line]
    assert not capture(made.actor, made.cameras, made.detections, 30.0).warnings


@pytest.mark.long
def test_a_stage_that_needs_images_asks_for_them(take: dict[str, object]) -> None:
    parts = (take["actor"], take["cameras"], take["detections"])
    with pytest.raises(InputError, match="looks at images"):
        capture(*parts, 30.0, until=Stage.REFINE_POSE)  # type: ignore[arg-type]
    assert capture(*parts, 30.0).refinement is None  # type: ignore[arg-type]


@pytest.mark.long
def test_it_can_end_at_the_motion(take: dict[str, object]) -> None:
    found = run(take, until=Stage.REFINE_POSE)
    assert found.refinement is not None and found.refinement.surface is None
    assert isinstance(found.refinement.pose, PoseRefinement)
    actor: Actor = found.actor
    skinned: Tensor = actor.surface(found.motion[0:2])
    assert found.surface is not None
    torch.testing.assert_close(found.surface[0:2], skinned)
