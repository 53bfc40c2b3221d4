"""Cameras that silhouettes put where they stand, as a function and in a whole capture."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from synthetic import actor
from takes import make_take
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.geometry.camera import Camera
from perfcap.pipeline import CaptureConfig, Stage, capture
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_silhouettes import given_record
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.refine_cameras import can_refine_cameras, mask_offsets, refine_cameras
from perfcap.pipeline.result_doubts import offset_doubts
from perfcap.pipeline.sight import Mask, Sight
from perfcap.pipeline.surface import SkinnedSurface
from perfcap.pipeline.surface_config import RefineCamerasConfig
from perfcap.pipeline.view_errors import ViewErrors

F64 = torch.float64
ACTOR = actor()
FRAMES, VIEWS = 24, 3
QUICK = RefineCamerasConfig(enabled=True, frames=8)


def errors(size: float = 1.0) -> Tensor:
    """Half a degree and a centimetre or so, (C, 6)."""
    random = torch.Generator().manual_seed(4)
    spread = torch.tensor([0.008] * 3 + [0.01] * 3, dtype=F64)
    return size * spread * torch.randn(VIEWS, 6, generator=random, dtype=F64)


def filmed() -> tuple[Motion, ClipProblem, Sight, Evidence]:
    """Motion, detections and masks of a person, and the cameras that see it."""
    take = make_take(FRAMES, views=VIEWS, lifted=False, actor=ACTOR, rate=8.0)
    frames = FrameProblem.of(ACTOR, take.cameras, take.detections)
    given = ACTOR, take.cameras, take.detections, PoseConfig(), frames.pixel_unit, take.rate
    problem = ClipProblem(*given)
    faces = torch.as_tensor(ACTOR.template.faces.copy())
    sight = Sight(take.cameras, faces, ACTOR.template.weld()[0])
    outlines = sight.outlines(SkinnedSurface(ACTOR, take.truth)[0:FRAMES], slice(0, FRAMES))
    masks = [[view.mask for view in row] for row in outlines]
    records = [[given_record(row[view]) for row in masks] for view in range(VIEWS)]
    return take.truth, problem, sight, Evidence.collect(records, 100 * problem.pixel_unit)


def steps(found: ViewErrors) -> Tensor:
    assert found.cameras is not None
    return found.cameras


def apart(cameras: Camera, real: Camera) -> float:
    """How far views are turned against each other, which no motion of the whole world changes."""
    pairs = [each.rotation[0] @ each.rotation[1:].mT for each in (cameras, real)]
    return float((pairs[0] - pairs[1]).norm())


@pytest.mark.long
def test_cameras_are_found_where_they_stand(tmp_path: Path) -> None:
    truth, problem, sight, evidence = filmed()
    real = sight.cameras
    stated = real.nudged(errors())
    wrong = replace(problem, cameras=stated), sight.through(stated), evidence, truth
    rounds: list[tuple[int, int]] = []
    found = refine_cameras(
        *wrong, QUICK, 1, lambda *done: rounds.append(done), Checkpoint(tmp_path)
    )
    assert apart(found.of_cameras(stated), real) < 0.25 * apart(stated, real)
    assert rounds[-1] == (QUICK.rounds, QUICK.rounds)
    assert found.clock is None and found.cameras_deviation is not None
    assert 0 < float(found.cameras_deviation.min()) < 0.03
    assert "cameras were moved by view 0 0." in next(found.sentences(found.numbers))
    kept = refine_cameras(*wrong, QUICK, 2, None, Checkpoint(tmp_path))
    assert torch.equal(steps(kept), steps(found))
    assert torch.equal(steps(refine_cameras(*wrong, QUICK, 2)), steps(found))
    assert torch.equal(sight.cameras.rotation, real.rotation)


@pytest.mark.long
def test_cameras_that_stand_as_stated_stay() -> None:
    truth, problem, sight, evidence = filmed()
    found = refine_cameras(problem, sight, evidence, truth, QUICK)
    turns = steps(found)[:, :3].norm(dim=-1).rad2deg()
    assert float(turns.max()) < 0.2  # two pixels of 600: outlines of few frames are no finer
    moved = apart(found.of_cameras(sight.cameras), sight.cameras)
    assert moved < 0.2 * apart(sight.cameras.nudged(errors()), sight.cameras)


@pytest.mark.long
def test_views_that_say_nothing_stay_where_they_are() -> None:
    truth, problem, sight, evidence = filmed()
    none = np.zeros(sight.cameras.size[0], bool)
    records = [[evidence.record(f, v) for f in range(FRAMES)] for v in range(VIEWS)]
    records[1] = [given_record(none)] * FRAMES
    blind = Evidence.collect(records, 100 * problem.pixel_unit)
    found = refine_cameras(problem, sight, blind, truth, QUICK)
    assert bool(steps(found).isfinite().all())
    assert torch.allclose(steps(found)[1], torch.zeros(6, dtype=F64), atol=1e-9)
    assert found.cameras_deviation is not None
    stated = torch.tensor([QUICK.turn] * 3 + [QUICK.shift] * 3, dtype=F64)
    assert bool((found.cameras_deviation[1] >= 0.99 * stated).all())


def test_masks_beside_the_body_are_measured_and_named() -> None:
    truth, _, sight, evidence = filmed()
    surface = SkinnedSurface(ACTOR, truth)
    right = mask_offsets(surface, sight, evidence)
    assert right.shape == (VIEWS, 2) and float(np.abs(right).max()) < 0.1
    assert not list(offset_doubts(right))
    # a camera that looks 12 px too far up sees the body that much too low, the mask above it
    height, focal = evidence.heights[1], float(sight.cameras.intrinsics[1, 1, 1])
    step = torch.zeros(VIEWS, 6, dtype=F64)
    step[1, 0] = -12 / focal
    wrong = mask_offsets(surface, sight.through(sight.cameras.nudged(step)), evidence)
    percent = 100 * 12 / height
    assert wrong[1] == pytest.approx([0, -percent * 2 / 3], abs=0.15)
    assert wrong[0] == pytest.approx([0, percent / 3], abs=0.15)
    (line,) = offset_doubts(wrong)
    assert "% of its height in view 1," in line
    assert "--refine-cameras" in line


def test_views_without_masks_lie_nowhere() -> None:
    truth, problem, sight, evidence = filmed()
    none = given_record(np.zeros(sight.cameras.size[0], bool))
    records = [[evidence.record(f, v) for f in range(FRAMES)] for v in range(VIEWS)]
    records[1] = [none] * FRAMES
    blind = Evidence.collect(records, 100 * problem.pixel_unit)
    found = mask_offsets(SkinnedSurface(ACTOR, truth), sight, blind)
    assert np.isnan(found[1]).all() and np.abs(found[[0, 2]]).max() < 0.1
    nothing = Evidence.collect([[none] * FRAMES] * VIEWS, 100 * problem.pixel_unit)
    assert np.isnan(mask_offsets(SkinnedSurface(ACTOR, truth), sight, nothing)).all()
    assert not list(offset_doubts(found))


def test_one_view_and_cameras_that_move_have_none_to_agree_with() -> None:
    _, _, sight, _ = filmed()
    assert can_refine_cameras(sight)
    assert not can_refine_cameras(sight.through(sight.cameras.select([0])))
    assert not can_refine_cameras(sight.through(sight.cameras.every_frame(FRAMES)))


class _Painted:
    """A light person before a dark ground."""

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence

    def __len__(self) -> int:
        return FRAMES

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        masks = np.stack([self.evidence.masks(frame)[view] for frame in range(start, stop)])
        return np.repeat(np.where(masks, 200, 60).astype(np.uint8)[..., None], 3, -1)


class _Known:
    """Masks of every frame."""

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence

    def knows(self, view: int, frame: int) -> bool:
        return True

    def mask(self, view: int, frame: int) -> Mask:
        return self.evidence.masks(frame)[view]


@pytest.mark.long
@pytest.mark.parametrize("views", [VIEWS, 1])
def test_a_capture_ends_with_the_cameras_it_found(views: int) -> None:
    _, problem, sight, evidence = filmed()
    real = sight.cameras.select(list(range(views)))
    stated, chosen = real.nudged(errors()[:views]), list(range(views))
    config = replace(CaptureConfig(), refine_cameras=QUICK)

    def captured(config: CaptureConfig) -> tuple[Camera, ViewErrors | None, dict[str, Any]]:
        found = capture(
            *(ACTOR, stated, problem.detections.select(chosen), problem.rate, config),
            images=Images(_Painted(evidence), stated, masks=_Known(evidence)),
            until=Stage.REFINE_POSE,
        )
        assert found.refinement is not None
        report = {"warnings": found.warnings, **found.report()["refinement"]}
        return found.cameras, found.refinement.views, report

    cameras, moved, report = captured(config)
    assert ("mask_offsets" in report) == (views > 1)
    if views == 1:
        assert moved is None and torch.equal(cameras.rotation, stated.rotation)
        return
    assert moved is not None
    assert torch.equal(cameras.rotation, moved.of_cameras(stated).rotation)
    assert apart(cameras, real) < 0.4 * apart(stated, real)
    assert set(report["cameras"]["camera_turn_shift"]) == {"view 0", "view 1", "view 2"}
    assert any(line.startswith("by silhouettes, cameras were") for line in report["warnings"])
    plain, none, other = captured(CaptureConfig())
    assert none is None and "cameras" not in other and plain is not cameras
    assert torch.equal(plain.rotation, stated.rotation)
    assert len(other["mask_offsets"]) == VIEWS
    assert any("lie beside the captured body" in line for line in other["warnings"])
