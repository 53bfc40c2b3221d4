"""Clocks and places of cameras as unknowns: derivatives, splines, zero at the truth."""

from dataclasses import replace

import pytest
import torch
from checks import check_jacobian, check_shapes, check_value
from synthetic import actor, cameras, random_motion

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy import Reprojection, UncertainViews
from perfcap.energy.uncertain_views import CAMERAS, CLOCK, LENS, smooth_at
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix

F64 = torch.float64
ACTOR = actor()
VIEWS, FRAMES = 3, 12


def straight(speed: float = 3.0) -> Detections:
    """Joints that move on straight lines, all confident."""
    random = torch.Generator().manual_seed(2)
    start = 100 * torch.rand(VIEWS, 16, 2, generator=random, dtype=F64)
    pixels = start + speed * torch.arange(FRAMES, dtype=F64)[:, None, None, None]
    return Detections.from_joints(pixels, torch.ones(FRAMES, VIEWS, 16, dtype=F64))


def seen(motion: Motion) -> Detections:
    random = torch.Generator().manual_seed(4)
    pixels = cameras(VIEWS).project(ACTOR.joints(motion))
    pixels = pixels + 2 * torch.randn(pixels.shape, generator=random, dtype=F64)
    confidence = 0.2 + 0.8 * torch.rand(pixels.shape[:-1], generator=random, dtype=F64)
    return Detections.from_joints(pixels, confidence)


def term(detections: Detections) -> UncertainViews:
    unit = torch.tensor([1.0, 2.0, 1.5], dtype=F64)
    return UncertainViews(ACTOR.landmarks, cameras(VIEWS), detections, 0.8, None, unit)


SHARED = {
    "clock": {CLOCK: torch.tensor([0.3, -0.7, 1.2], dtype=F64)},
    "cameras": {
        CAMERAS: 0.05 * torch.randn(18, generator=torch.Generator().manual_seed(1)).double()
    },
    "still": {CAMERAS: torch.zeros(18, dtype=F64)},
    "lens": {LENS: torch.tensor([0.2, -0.3, 0.1], dtype=F64)},
}
UNKNOWN = [
    (),
    ("clock",),
    ("cameras",),
    ("still",),
    ("lens",),
    ("cameras", "bones", "clock"),
    ("bones", "lens", "cameras"),
]


@pytest.mark.parametrize("blocks", UNKNOWN)
def test_derivatives_are_those_of_differences(blocks: tuple[str, ...]) -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, bones=True)
    shared: dict[str, torch.Tensor] = {}
    for name in blocks:
        shared |= SHARED.get(name, {"bones": motion.shared["bones"]})
    motion = replace(motion, shared=shared)
    energy = term(seen(motion))
    check_shapes(energy, motion)
    check_value(energy, motion)
    check_jacobian(energy, motion)


def test_without_unknown_views_it_is_reprojection() -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES)
    detections = seen(motion)
    plain = Reprojection(
        ACTOR.landmarks, cameras(VIEWS), detections, 0.8, None, torch.tensor([1.0, 2.0, 1.5])
    )
    assert torch.allclose(term(detections)(motion), plain(motion), rtol=1e-12)


def test_splines_keep_straight_motion_and_the_size_of_noise() -> None:
    clock = torch.tensor([0.0, 0.5, -1.25], dtype=F64)
    detections = straight()
    pixels, sure, speed = smooth_at(detections, clock)
    expected = detections.joints2d + 3.0 * clock[:, None, None]
    known = sure > 0
    assert bool(known[4:8].all()) and not bool(known[:2, :2].any())
    assert not bool(known[-2:, :2].any())
    assert torch.allclose(pixels[known], expected[known])
    assert torch.allclose(speed[known], torch.full_like(speed[known], 3.0))
    random = torch.Generator().manual_seed(0)
    noise = torch.randn(4000, VIEWS, 16, 2, generator=random, dtype=F64)
    noisy = Detections.from_joints(noise, torch.ones(4000, VIEWS, 16, dtype=F64))
    spread = smooth_at(noisy, torch.tensor([0.0, 0.25, 0.5], dtype=F64))[0][5:-5].std((0, 2, 3))
    assert float(spread.max() / spread.min()) < 1.03


def test_true_cameras_leave_nothing() -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES)
    wrong = SHARED["cameras"][CAMERAS]
    stated = cameras(VIEWS)
    turn, shift = wrong.reshape(-1, 6).split(3, -1)
    matrix = rotvec_to_matrix(turn)
    real = replace(
        stated,
        rotation=matrix @ stated.rotation,
        translation=(matrix @ stated.translation[..., None])[..., 0] + shift,
    )
    pixels = real.project(ACTOR.joints(motion))
    energy = term(Detections.from_joints(pixels, torch.ones(FRAMES, VIEWS, 16, dtype=F64)))
    assert float(energy(replace(motion, shared={CAMERAS: wrong}))) < 1e-18
    assert float(energy(motion)) > 1


def test_true_lenses_leave_nothing() -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES)
    stated, longer = cameras(VIEWS), SHARED["lens"][LENS]
    focal = stated.intrinsics.clone()
    focal[..., :2, :2] *= longer.exp()[:, None, None]
    pixels = replace(stated, intrinsics=focal).project(ACTOR.joints(motion))
    energy = term(Detections.from_joints(pixels, torch.ones(FRAMES, VIEWS, 16, dtype=F64)))
    assert float(energy(replace(motion, shared={LENS: longer}))) < 1e-18
    assert float(energy(motion)) > 1


def test_what_has_no_neighbour_counts_for_nothing() -> None:
    detections = straight()
    confidence = detections.confidence2d.clone()
    confidence[6, 0, 3] = 0
    gap = replace(detections, confidence2d=confidence)
    sure = smooth_at(gap, torch.zeros(VIEWS, dtype=F64))[1]
    assert not bool(sure[4:9, 0, 3].any()) and bool((sure[4:8, 1] > 0).all())


def test_moving_cameras_are_refused() -> None:
    moving = cameras(VIEWS).every_frame(FRAMES)
    with pytest.raises(InputError, match="cameras move"):
        UncertainViews(ACTOR.landmarks, moving, straight())
