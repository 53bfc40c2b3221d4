"""The stage that refines motion and surface at once, on a small capture."""

from __future__ import annotations

import warnings
from dataclasses import replace

import pytest
import torch
from joint_problem import F64
from synthetic import actor, cameras, random_motion

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.pipeline import JointConfig, Performance, capture, refine_jointly, resized
from perfcap.pipeline.overlap import warn_of_masks_elsewhere
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.solve import LevenbergMarquardt, Status

ACTOR, FRAMES, SIZE = actor(), 3, 64
VIEWS = cameras(2, SIZE, distance=3.0)
QUICK = JointConfig(nodes=8, bands=(4.0,), method=LevenbergMarquardt(max_steps=4))


def still() -> Motion:
    pose = random_motion(ACTOR.skeleton, 1, (), seed=3)
    return pose[torch.zeros(FRAMES, dtype=torch.long)]


@pytest.fixture(scope="module")
def start() -> Performance:
    pixels = VIEWS.project(ACTOR.joints(still()))
    return capture(ACTOR, VIEWS, Detections.from_joints(pixels, torch.ones(FRAMES, 2, 16)), 30.0)


@pytest.fixture(scope="module")
def masks() -> torch.Tensor:
    silhouette = SoftSilhouette(torch.tensor(ACTOR.template.faces), (SIZE, SIZE))
    return silhouette.seen_by(VIEWS, ACTOR.surface(still())).clone()


def test_motion_and_surface_come_from_one_solve(start: Performance, masks: torch.Tensor) -> None:
    found = refine_jointly(start, masks, config=QUICK)
    assert found.frames == FRAMES
    assert found.vertices().shape == (FRAMES, len(ACTOR.vertices), 3)
    torch.testing.assert_close(found[0:1], found.vertices()[:1])
    (_, solution), *others = found.windows
    assert not others
    assert {"joints2d", "trajectory", "silhouettes", "rigidity"} <= set(solution.terms)
    assert not found.vertices().requires_grad


@pytest.mark.long
def test_gradients_reach_masks_and_detections(start: Performance, masks: torch.Tensor) -> None:
    soft = (0.1 + 0.8 * masks).requires_grad_()
    pixels = start.detections.joints2d.clone().requires_grad_()
    seen = Detections.from_joints(pixels, start.detections.confidence2d)
    found = refine_jointly(start, soft, detections=seen, config=QUICK)
    for slope in torch.autograd.grad(found.vertices().square().sum(), (soft, pixels)):
        assert bool(slope.isfinite().all()) and bool(slope.any())


def test_cameras_are_made_as_large_as_masks() -> None:
    half = resized(VIEWS, (SIZE // 2, SIZE // 2))
    point = torch.tensor([[[0.1, 1.2, 0.2]]], dtype=F64)
    # pixel centres are integers
    torch.testing.assert_close(half.project(point), (VIEWS.project(point) + 0.5) / 2 - 0.5)


def test_masks_of_nobody_and_cameras_of_other_images_are_refused(
    start: Performance, masks: torch.Tensor
) -> None:
    blank = masks.clone()
    blank[:, 1] = 0
    with pytest.raises(InputError, match=r"masks of views \[1\] show nobody"):
        refine_jointly(start, blank, config=QUICK)
    with pytest.raises(InputError, match=r"cameras are of images of \(64, 64\)"):
        refine_jointly(start, masks[..., ::2, ::2], VIEWS, config=QUICK)


def test_masks_of_other_frames_are_refused(start: Performance, masks: torch.Tensor) -> None:
    with pytest.raises(InputError, match="the frames and views of the capture"):
        refine_jointly(start, masks[:2], config=QUICK)
    with pytest.raises(InputError, match="expected 0 to 1"):
        refine_jointly(start, 2 * masks, config=QUICK)
    other = Detections.from_joints(torch.zeros(2, 2, 16, 2, dtype=F64), torch.ones(2, 2, 16))
    with pytest.raises(InputError, match="the same frames and views"):
        refine_jointly(start, masks, detections=other, config=QUICK)


def test_detections_of_other_frames_are_named(start: Performance, masks: torch.Tensor) -> None:
    seen = start.detections
    shorter = replace(start, detections=seen.frames(slice(2)))
    for given in (None, seen):
        with pytest.raises(InputError, match="but the motion 3 frames; expected"):
            refine_jointly(shorter, masks, detections=given, config=QUICK)
    moved = replace(seen, joints2d=seen.joints2d + torch.tensor([12.0, 0.0]))
    with pytest.warns(UserWarning, match=r"detections of views \[0, 1\] are \d+% of the person's"):
        refine_jointly(start, masks, detections=moved, config=QUICK)


@pytest.mark.long
def test_gradients_reach_cameras_alone(start: Performance, masks: torch.Tensor) -> None:
    """Without the graph of the solve nothing would reach them, and an actor's only in part."""
    shift = VIEWS.translation.clone().requires_grad_()
    found = refine_jointly(start, masks, replace(VIEWS, translation=shift), config=QUICK)
    (slope,) = torch.autograd.grad(found.motion.angles.square().sum(), shift)
    assert bool(slope.isfinite().all()) and bool(slope.any())


@pytest.mark.parametrize(
    "spoil",
    [lambda masks: 1 - masks, torch.ones_like, lambda masks: masks.roll(SIZE // 2, -1)],
)
def test_masks_elsewhere_are_warned_of(start: Performance, masks: torch.Tensor, spoil) -> None:  # type: ignore[no-untyped-def]
    with pytest.warns(UserWarning, match=r"masks of views \[0, 1\] overlap the captured person by"):
        refine_jointly(start, spoil(masks), config=QUICK)


def test_masks_upside_down_are_warned_of(start: Performance, masks: torch.Tensor) -> None:
    """Of a person in the middle of the image they overlap the right ones more than a little."""
    with pytest.warns(UserWarning, match=r"masks of views \[0.*(upside down|captured person by)"):
        refine_jointly(start, masks.flip(-2), config=QUICK)


def test_masks_that_are_transposed_are_warned_of() -> None:
    """Square masks of somebody who stands keep a part of the overlap."""
    drawn = torch.zeros(2, 1, 40, 40)
    drawn[..., 4:36, 12:26] = 1
    warn_of_masks_elsewhere(drawn, drawn)
    with pytest.warns(UserWarning, match=r"masks of views \[0\] would overlap .* transposed"):
        warn_of_masks_elsewhere(drawn.mT, drawn)


def test_masks_beside_the_person_are_warned_of(start: Performance, masks: torch.Tensor) -> None:
    """As of images that were padded: the person went there, with most of the overlap as before."""
    aside = masks.clone()
    aside[:, 1] = aside[:, 1].roll((3, -2), (-1, -2))
    with pytest.warns(UserWarning, match=r"beside the captured .* of views 1 \(by \+3, -2 pixels"):
        refine_jointly(start, aside, config=QUICK)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_masks_elsewhere(masks, masks.roll(1, -1))  # a pixel is nothing


def test_masks_that_are_missing_are_no_doubt(start: Performance, masks: torch.Tensor) -> None:
    some = masks.clone()
    some[1:, 1] = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)  # what it imports may warn otherwise
        found = refine_jointly(start, some, config=QUICK)
    assert found.vertices().isfinite().all()


def test_masks_that_are_learned_are_no_doubt(start: Performance, masks: torch.Tensor) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)  # what it imports may warn otherwise
        found = refine_jointly(start, (1 - masks).requires_grad_(), config=QUICK)
    assert found.vertices().requires_grad


def test_settings_and_kinds_that_are_none(start: Performance, masks: torch.Tensor) -> None:
    with pytest.raises(InputError, match="masks are a ndarray"):
        refine_jointly(start, masks.numpy(), config=QUICK)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"trust is torch\.uint8 up to 255"):
        refine_jointly(start, masks, config=QUICK, trust=255 * torch.ones_like(masks).byte())
    with pytest.raises(InputError, match=r"trust is up to 255; expected 0 to 1"):
        refine_jointly(start, masks, config=QUICK, trust=255 * torch.ones_like(masks))
    with pytest.raises(InputError, match=r"trust has shape \(5,\); expected one that broadcasts"):
        refine_jointly(start, masks, config=QUICK, trust=torch.ones(5))
    three = replace(VIEWS.map(lambda part: part[[0, 1, 1]]), size=((SIZE, SIZE),) * 3)
    with pytest.raises(InputError, match="cameras have 3 views, the capture has 2"):
        refine_jointly(start, masks, three, config=QUICK)
    with pytest.raises(InputError, match=r"moving cameras have 2 frames but the clip has 3"):
        refine_jointly(start, masks, VIEWS.every_frame(2), config=QUICK)
    with pytest.raises(InputError, match="trust is a float, expected a tensor"):
        refine_jointly(start, masks, config=QUICK, trust=0.5)  # type: ignore[arg-type]
    for bands in ((), (-1.0,), (0.0,), 2.5):
        with pytest.raises(InputError, match=r"bands .* expected"):
            JointConfig(bands=bands)  # type: ignore[arg-type]
    for size in ({"reach": 0.0}, {"stretch": 3.0}):
        with pytest.raises(InputError, match="expected metres: above zero"):
            JointConfig(**size)  # type: ignore[arg-type]
    for size in ({"stretch": -0.003}, {"reach": float("nan")}):
        with pytest.raises(InputError, match="expected a number"):
            JointConfig(**size)  # type: ignore[arg-type]
    for nodes in (0, 2.5):
        with pytest.raises(InputError, match="nodes of JointConfig is"):
            JointConfig(nodes=nodes)  # type: ignore[arg-type]


def test_joints_that_are_no_numbers_are_unseen(start: Performance, masks: torch.Tensor) -> None:
    """The result was where it began, and nothing said so."""
    seen = start.detections
    holes = seen.confidence2d.clone()
    holes[1] = torch.nan
    given = replace(seen, confidence2d=holes)
    found = refine_jointly(start, masks, detections=given, config=QUICK)
    assert all(solution.status < Status.NOT_FINITE for _, solution in found.windows)
    with pytest.raises(InputError, match="show nobody in any frame"):
        refine_jointly(start, masks, detections=replace(given, confidence2d=0 * holes))
    with pytest.raises(InputError, match="trust is 0 everywhere"):
        refine_jointly(start, masks, trust=torch.zeros(1))
    with pytest.raises(InputError, match="start is a tuple, expected the Performance"):
        refine_jointly((start,), masks)  # type: ignore[arg-type]
