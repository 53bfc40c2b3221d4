"""The stage that meets edges of raw images: what it gains, when it doubts, and what it refuses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from time import sleep

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from synthetic import cameras as circle
from takes import Take, detect, sway
from torch import Tensor

from perfcap.actor.volume_fit import VolumeFit
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.actor import load_actor
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import RHODIN, CaptureConfig
from perfcap.pipeline.refine_contours import ContoursConfig, ContourSight
from perfcap.pipeline.stage import Stage
from perfcap.render import ProjectedMesh, Texture, render
from perfcap.temporal.window import Window

SIZE, FRAMES, VIEWS = 260, 6, 3
FIT = VolumeFit(height=120, poses=1, steps=120)
QUICK = replace(RHODIN, contours=ContoursConfig(enabled=True, height=160, fit=FIT))


@dataclass(frozen=True)
class Film:
    """Frames in memory, [view] (F, H, W, 3)."""

    views: list[NDArray[np.uint8]]

    def __len__(self) -> int:
        return len(self.views[0])

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        return self.views[view][start:stop]


def background(kind: str, view: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(view)
    if kind == "noise":
        return rng.integers(0, 256, (SIZE, SIZE, 3)).astype(np.uint8)
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    slope = 70 + 60 * (x if view % 2 else y)
    return np.asarray(slope[..., None] * np.array([1.0, 0.9, 0.7]), np.uint8)


@pytest.fixture(scope="module")
def take() -> Take:
    person = load_actor("sam").double()
    cameras = circle(VIEWS, size=SIZE)
    truth = sway(person, FRAMES)
    seen = detect(person, cameras, truth, lifted=False)
    draw = torch.Generator().manual_seed(2)
    noise = 3.0 * torch.randn(seen.joints2d.shape, generator=draw, dtype=torch.float64)
    return Take(person, cameras, replace(seen, joints2d=seen.joints2d + noise), truth, 30.0)


def film(take: Take, kind: str = "slope") -> Film:
    """The person, lit, before a background."""
    faces = torch.tensor(take.actor.template.faces)
    picture = torch.full((8, 8, 3), 200, dtype=torch.uint8)
    coat = Texture.from_image(picture, torch.zeros(1, 2), torch.zeros_like(faces))
    views = []
    for view in range(VIEWS):
        camera = take.cameras.select([view])
        behind = torch.from_numpy(background(kind, view))
        shots = []
        for vertices in take.actor.surface(take.truth).float():
            mesh = ProjectedMesh.seen_by(camera, vertices, faces)
            shots.append(render(mesh, coat, behind).image.numpy())
        views.append(np.stack(shots))
    return Film(views)


def captured(
    take: Take,
    images: Film | None,
    config: CaptureConfig = QUICK,
    lag: Tensor | None = None,
    **options: object,
) -> Performance:
    given = None if images is None else Images(images, take.cameras, lag=lag)
    return capture(
        take.actor,
        take.cameras,
        take.detections,
        take.rate,
        config,
        images=given,
        **{"workers": 1, **options},  # type: ignore[arg-type]
    )


@pytest.mark.long
def test_edges_correct_noisy_joints(take: Take) -> None:
    joints_alone = captured(take, None)
    found = captured(take, film(take))
    before, after = (take.error_mm(each.joints()).mean() for each in (joints_alone, found))
    assert float(after) < 0.75 * float(before)
    contours = found.contours
    assert contours is not None and not contours.doubtful.any()
    assert (contours.after > contours.before - 0.02).all()
    assert found.surface is not None and found.refinement is None
    assert "refine_contours" in found.report()["stages"]
    assert len(found.report()["contours"]["support_after"]) == FRAMES


@pytest.mark.long
def test_pictures_of_nothing_change_little_and_are_doubted(take: Take) -> None:
    rng = np.random.default_rng(0)  # some noise: images of one color are refused
    nothing = rng.integers(82, 98, (FRAMES, SIZE, SIZE, 1), dtype=np.uint8).repeat(3, -1)
    blank = Film([nothing] * VIEWS)
    joints_alone, found = captured(take, None), captured(take, blank)
    assert found.contours is not None and found.contours.doubtful.all()
    assert any("hardly any edge" in warning for warning in found.warnings)
    moved = 1000 * (found.joints() - joints_alone.joints()).norm(dim=-1).mean()
    assert float(moved) < 15


@pytest.mark.long
def test_the_stage_is_resumed_to_the_same_bits(take: Take, tmp_path: Path) -> None:
    shots = film(take)
    first = captured(take, shots, checkpoint=Checkpoint(tmp_path))
    again = captured(take, shots, checkpoint=Checkpoint(tmp_path))
    assert torch.equal(first.motion.angles, again.motion.angles)
    assert {"volume.log", "refine_contours.log"} <= {path.name for path in tmp_path.iterdir()}
    assert again.contours is not None and first.contours is not None
    np.testing.assert_array_equal(first.contours.after, again.contours.after)


@pytest.mark.long
def test_threads_read_a_video_in_order(take: Take) -> None:
    """Files are decoded from frame to frame, by one thread at a time."""
    reading = Lock()

    class Decoded(Film):
        def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
            assert reading.acquire(blocking=False), "a video is read by two threads at once"
            sleep(1e-3)
            reading.release()
            return super().read_view(view, start, stop)

    shots = Decoded(film(take).views)
    windows = replace(QUICK, pose=replace(QUICK.pose, window=3, overlap=1))
    two, one = (captured(take, shots, windows, workers=workers) for workers in (2, 1))
    assert torch.equal(two.motion.angles, one.motion.angles)


@pytest.mark.long
def test_a_person_outside_of_the_images(take: Take) -> None:
    lens = take.cameras.intrinsics.clone()
    lens[:, 0, 2] += 5 * SIZE
    away = replace(take.cameras, intrinsics=lens)
    elsewhere = replace(take, cameras=away, detections=detect(take.actor, away, take.truth, False))
    found = captured(elsewhere, film(take))
    assert found.contours is not None and found.contours.doubtful.all()
    assert float(take.error_mm(found.joints()).mean()) < 20


@pytest.mark.long
def test_without_images_only_the_motion(take: Take) -> None:
    found = captured(take, None)
    assert found.contours is None and found.surface is None
    ended = captured(take, film(take), until=Stage.TRACK_MOTION)
    assert ended.contours is None
    torch.testing.assert_close(ended.joints(), found.joints())


def test_taller_people_are_shrunk(take: Take) -> None:
    images = Images(film(take), take.cameras)
    heights = torch.tensor([320.0, 160.0, 80.0]).double()
    sight = ContourSight.of(images, heights, QUICK.contours, heights)
    assert sight.cameras.size == ((130, 130), (260, 260), (260, 260))
    point = torch.tensor([[[0.1, 1.2, 0.3]]]).double()
    corner = 0.5
    large, small = (each.project(point)[0, 0, 0] + corner for each in (take.cameras, sight.cameras))
    torch.testing.assert_close(small, 0.5 * large)
    torch.testing.assert_close(sight.unit, torch.tensor([1.6, 1.6, 0.8]).double())


@pytest.mark.long
def test_moving_cameras(take: Take) -> None:
    cameras = take.cameras
    moving = Camera(
        *(
            each.expand(FRAMES, *each.shape)
            for each in (cameras.intrinsics, cameras.rotation, cameras.translation)
        ),
        size=cameras.size,
    )
    still, moved = captured(take, film(take)), captured(replace(take, cameras=moving), film(take))
    torch.testing.assert_close(still.joints(), moved.joints(), atol=1e-6, rtol=0)


@pytest.mark.long
def test_views_between_frames_are_met_where_the_person_was(take: Take) -> None:
    """Images of two are half a frame late: that is known, or not."""
    whole = sway(take.actor, 2 * FRAMES, 12.0)
    truth = whole[0 : 2 * FRAMES : 2]
    detections = detect(take.actor, take.cameras, truth, lifted=False)
    seen = Take(take.actor, take.cameras, detections, truth, 6.0)
    shots, late = (film(replace(seen, truth=whole[first::2])) for first in (0, 1))
    shots = Film([shots.views[0], *late.views[1:]])
    lag = torch.zeros(FRAMES, VIEWS)
    lag[:, 1:] = 0.5
    sure = replace(QUICK, contours=replace(QUICK.contours, weight=20.0))
    known, unknown = (captured(seen, shots, sure, lag=each) for each in (lag, None))
    errors = [float(seen.error_mm(each.joints()).mean()) for each in (known, unknown)]
    assert errors[0] < 0.8 * errors[1]


@pytest.mark.long
def test_images_that_a_view_does_not_have_are_not_looked_at(take: Take) -> None:
    lag = torch.zeros(FRAMES, VIEWS)
    lag[0, 2] = torch.nan
    shots = film(take)
    other = Film([*shots.views[:2], np.concatenate((shots.views[2][3:4], shots.views[2][1:]))])
    found = [captured(take, each, lag=lag).joints() for each in (shots, other)]
    torch.testing.assert_close(*found)
    with pytest.raises(InputError, match="images have lags"):
        Images(shots, take.cameras, lag=lag[1:])
    part = Images(shots, take.cameras, lag=lag).frames(slice(0, 2))
    assert part.lag is not None and len(part.lag) == 2


def test_gaussians_move_on_parabolas(take: Take) -> None:
    lag = torch.full((FRAMES, VIEWS), 0.25, dtype=torch.float64)
    images = Images(film(take), take.cameras, lag=lag)
    heights = torch.full((VIEWS,), 160.0, dtype=torch.float64)
    sight = ContourSight.of(images, heights, QUICK.contours, heights)
    time = torch.arange(FRAMES, dtype=torch.float64)[:, None, None]
    way = torch.tensor([[[0.02, 0.01, 0.03]], [[0.004, -0.002, 0.001]]], dtype=torch.float64)
    start = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    here, there = (start + way[0] * t + way[1] * t**2 for t in (time, time + 0.25))
    shift = sight.shift(here, Window(0, FRAMES))
    assert shift is not None and shift.shape == (FRAMES, VIEWS, 1, 2)
    expected = sight.cameras.project(there) - sight.cameras.project(here)
    assert float((shift - expected)[1:-1].norm(dim=-1).max()) < 0.02
