"""Shape from views: energies against differences, girths recovered, one view with a height."""

from __future__ import annotations

import sys
from dataclasses import astuple, replace
from functools import partial

import pytest
import synthetic
import torch
from bodies import QUICK, person, seen
from checks import check_jacobian, check_shapes, check_value
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import measure
from perfcap.actor.motion import BODY
from perfcap.actor.shaped_points import OFFSETS, ShapedPoints, mirrored_offsets
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.energy import Reprojection, SilhouetteOverlap
from perfcap.errors import InputError
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.rigging.fit_body import Stature, fit_body
from perfcap.rigging.person_masks import PersonMasks
from perfcap.solve import Implicit, LevenbergMarquardt, Step


def test_energies_have_the_derivatives_they_state(model: BodyModel) -> None:
    cameras = synthetic.cameras(2, size=96, distance=4.0)
    truth = person(model)
    detections, _ = seen(model, truth, cameras)
    actor = model.actor(torch.zeros(0))
    marks = ShapedPoints.of_landmarks(model, actor).at(torch.arange(16).numpy())
    state = replace(
        truth, translation=truth.translation + 0.01, shared={BODY: 0.9 * truth.shared[BODY]}
    )
    joints = Reprojection(marks, cameras, detections, 2.0, unit=torch.tensor([1.0, 2.0]))
    stature = Stature(model, 1.8, 0.01, frames=3)
    for energy in (joints, stature):
        check_shapes(energy, state)
        check_value(energy, state)
        check_jacobian(energy, state, atol=1e-5, rtol=1e-5)


def test_silhouettes_pull_on_the_shape(model: BodyModel) -> None:
    """The rows of the linearization have the gradient of the energy."""
    cameras = synthetic.cameras(1, size=96, distance=4.0)
    truth = person(model)
    _, masks = seen(model, truth, cameras)
    surface = ShapedPoints.of_surface(model, model.actor(torch.zeros(0)))
    silhouette = SoftSilhouette(torch.from_numpy(model.rig.faces), (96, 96), 3.0)
    energy = SilhouetteOverlap(
        surface, silhouette, cameras, masks, weight=3.0, points=surface.chosen
    )
    shape = (0.8 * truth.shared[BODY]).requires_grad_()
    state = replace(truth, shared={BODY: shape})
    energy(state).backward()
    linear = energy.linearize(replace(truth, shared={BODY: shape.detach()}))
    assert linear.shared is not None
    rows = 2 * 3.0 * (linear.residual.value.unsqueeze(-1) * linear.shared).sum((0, 1, 2))
    assert torch.allclose(rows, shape.grad, rtol=1e-6, atol=1e-9)


@pytest.mark.long
def test_girths_are_recovered_from_two_views(model: BodyModel) -> None:
    cameras = synthetic.cameras(4, size=400, distance=4.0).select([0, 1])
    truth = person(model)
    detections, masks = seen(model, truth, cameras)
    start = replace(truth, translation=truth.translation + 0.02, shared={})
    seen_there = PersonMasks(cameras, masks)
    found = fit_body(model, cameras, detections, start, seen_there, settings=QUICK)
    expected = measure(model.template(truth.shared[BODY]))
    known = astuple(found.deviations)
    for mine, true, spread in zip(
        astuple(found.measurements), astuple(expected), known, strict=True
    ):
        assert mine == pytest.approx(true, abs=0.02)
        assert abs(mine - true) < 3 * spread and spread < 0.04


@pytest.mark.long
def test_a_height_fixes_the_size_of_one_view(model: BodyModel) -> None:
    cameras = synthetic.cameras(1, size=400, distance=4.0)
    truth = person(model)
    detections, _ = seen(model, truth, cameras)
    start = replace(truth, shared={})
    height = measure(model.template(truth.shared[BODY])).height
    found = fit_body(model, cameras, detections, start, height=height, settings=QUICK)
    assert found.measurements.height == pytest.approx(height, abs=0.02)
    assert found.deviations.height < 0.01
    with pytest.warns(UserWarning, match="body fit: one camera does not tell .*, give height$"):
        free = fit_body(model, cameras, detections, start, settings=QUICK)
    assert free.deviations.height > 0.03  # one camera alone


def test_small_images_show_the_same(model: BodyModel) -> None:
    cameras = synthetic.cameras(2, size=402)
    masks = torch.rand(3, 2, 402, 402) > 0.5
    reduced = PersonMasks(cameras, masks).shrunk(4)
    small, fewer = reduced.inside, reduced.cameras
    assert small.shape == (3, 2, 100, 100)
    assert float(small[0, 0, 0, 0]) == pytest.approx(float(masks[0, 0, :4, :4].double().mean()))
    points = torch.randn(1, 5, 3, dtype=torch.float64)
    there, here = cameras.project(points), fewer.project(points)
    assert torch.allclose((there + 0.5) / 4, here + 0.5)


def test_views_of_other_sizes_are_padded_with_what_is_unknown() -> None:
    cameras = synthetic.cameras(2, size=40)
    views = [torch.ones(3, 20, 40), torch.ones(3, 40, 30)]
    padded = PersonMasks.padded(cameras, views)
    assert padded.inside.shape == (3, 2, 40, 40) and padded.known is not None
    assert padded.cameras.size == ((40, 40), (40, 40))
    assert padded.known.sum((1, 2)).tolist() == [800, 1200]
    assert not padded.inside[:, 0, 20:].any()
    with pytest.raises(InputError, match="of 2 views"):
        PersonMasks(cameras, torch.zeros(3, 1, 40, 40))


def test_constant_offsets_of_landmarks_are_alike_left_and_right() -> None:
    moves = mirrored_offsets([0.01] * 16)
    assert moves.shape == (7 * 3 + 2 * 2, 16, 3)
    left, right = LANDMARKS.index("l_knee"), LANDMARKS.index("r_knee")
    mirror = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    assert torch.equal(moves[:, left] * mirror, moves[:, right])
    assert int(moves[:, LANDMARKS.index("neck")].abs().sum(-1).gt(0).sum()) == 2


def test_offsets_move_landmarks_and_nothing_else(model: BodyModel) -> None:
    """In either order of the blocks, whose columns follow that of the motion."""
    truth, actor = person(model), model.actor(torch.zeros(0))
    body = truth.shared[BODY]
    surface = ShapedPoints.of_surface(model, actor, torch.arange(0, 300, 50).numpy())
    marks = ShapedPoints.of_landmarks(model, actor, [0.02] * 16)
    assert marks.offsets is not None
    free = torch.ones(len(marks.offsets), dtype=torch.float64)
    for shared in ({BODY: body, OFFSETS: free}, {OFFSETS: free, BODY: body}):
        both = replace(truth, shared=shared)
        assert torch.equal(surface(both), surface(truth))
        assert surface.linearize(both)[2].shape[-1] == len(body)
        columns = marks.linearize(both)[2]
        none = both.angles.new_zeros(both.angles.shape[0], both.frame_dim)
        for index in (2, 4, 17):
            step = 1e-3 * torch.eye(len(body) + len(free), dtype=torch.float64)[index]
            ahead, behind = (marks(both.retract(Step(none, s * step))) for s in (1, -1))
            slope = (ahead - behind) / 2e-3
            assert torch.allclose(columns[..., index], slope, atol=1e-9)


def test_frames_must_agree(model: BodyModel) -> None:
    cameras, truth = synthetic.cameras(1), person(model)
    pixels = torch.full((2, 1, 16, 2), 40.0, dtype=torch.float64)
    detections = Detections.from_joints(pixels, torch.ones(2, 1, 16).double())
    with pytest.raises(InputError, match="3 frames but detections have 2"):
        fit_body(model, cameras, detections, replace(truth, shared={}))
    both = replace(truth, shared={})[:2]
    masks = PersonMasks(replace(cameras, size=((8, 8),)), torch.zeros(3, 1, 8, 8))
    with pytest.raises(InputError, match="masks have 3 frames"):
        fit_body(model, cameras, detections, both, masks)


def test_wrong_arguments_are_named(model: BodyModel) -> None:
    """Each gave a body that was off without a word, or a traceback."""
    cameras, truth = synthetic.cameras(1, size=96, distance=4.0), person(model)
    detections, inside = seen(model, truth, cameras)
    start, none = replace(truth, shared={}), torch.zeros(3, 1, 16).double()
    for height in (178.0, float("nan"), -1.7, "1.7"):
        with pytest.raises(InputError, match="height is"):
            fit_body(model, cameras, detections, start, height=height)  # type: ignore[arg-type]
    for confidence, said in ((none, "show nobody"), (none + 90, "expected 0 to 1")):
        with pytest.raises(InputError, match=said):
            fit_body(model, cameras, replace(detections, confidence2d=confidence), start)
    with pytest.raises(InputError, match=r"torch.float32, .*the body torch.float64"):
        fit_body(model, cameras, detections.to(torch.zeros(1)), start)
    with pytest.raises(InputError, match="got a Actor, expected a BodyModel"):
        fit_body(model.actor(torch.zeros(0)), cameras, detections, start)  # type: ignore[arg-type]
    moving = cameras.frames(slice(None)).map(lambda x: x.expand(5, *x.shape))
    with pytest.raises(InputError, match="moving cameras have 5 frames"):
        fit_body(model, moving, detections, start)
    mirrored = replace(cameras, rotation=-cameras.rotation)
    with pytest.raises(InputError, match="cameras have a rotation that is none"):
        fit_body(model, mirrored, detections, start)
    small = replace(detections, joints2d=detections.joints2d / 96)
    with pytest.raises(InputError, match="multiply normalised joints"):
        fit_body(model, cameras, small, start)
    with pytest.raises(InputError, match="masks are a Tensor"):
        fit_body(model, cameras, detections, start, inside)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"masks are \(48, 48\)"):
        fit_body(model, cameras, detections, start, PersonMasks(cameras, inside[..., ::2, ::2]))
    for heights in ((), (90.0, 180.0)):
        with pytest.raises(InputError, match="one step more than heights"):
            few = replace(QUICK, heights=heights)
            fit_body(model, cameras, detections, start, PersonMasks(cameras, inside), settings=few)
    with pytest.raises(InputError, match="offsets are 3"):
        replace(QUICK, offsets=(0.02,) * 3)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:body fit. the (height is known|two cameras look):UserWarning")
def test_joints_that_are_no_numbers_are_unseen(model: BodyModel) -> None:
    """The body was the mean one."""
    cameras, truth = synthetic.cameras(2, size=400, distance=4.0), person(model)
    detections, _ = seen(model, truth, cameras)
    start = replace(truth, shared={})
    toe = torch.arange(16) == 15
    lost = torch.where(toe[:, None], torch.nan, detections.joints2d)
    hidden = torch.where(toe, 0.0, detections.confidence2d)
    unseen = replace(detections, confidence2d=hidden)
    expected = fit_body(model, cameras, unseen, start, settings=QUICK)
    for own in (replace(unseen, joints2d=lost), replace(detections, joints2d=lost)):
        found = fit_body(model, cameras, own, start, settings=QUICK)
        torch.testing.assert_close(found.shape, expected.shape)
    assert float(expected.shape.norm()) > 0.5


def test_extents_of_unseen_people_are_finite() -> None:
    pixels = torch.zeros(2, 1, 16, 2, dtype=torch.float64)
    nothing = Detections.from_joints(pixels, torch.zeros(2, 1, 16).double())
    assert bool((nothing.box_heights() > 0).all())


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:body fit. the height is known to:UserWarning")
def test_the_median_of_frames_is_near_the_shared_shape(model: BodyModel) -> None:
    cameras = synthetic.cameras(4, size=400, distance=4.0)
    truth = person(model)
    detections, _ = seen(model, truth, cameras)
    start = replace(truth, translation=truth.translation + 0.02, shared={})
    settings = replace(QUICK, consensus="median", shape=0.01)
    found = fit_body(model, cameras, detections, start, settings=settings)
    alone = [
        fit_body(
            model, cameras, detections.frames(one), start[one], settings=replace(QUICK, shape=0.01)
        ).shape
        for one in (slice(f, f + 1) for f in range(3))
    ]
    assert torch.allclose(found.shape, torch.stack(alone).median(0).values, atol=1e-9)
    expected = measure(model.template(truth.shared[BODY]))
    assert found.measurements.height == pytest.approx(expected.height, abs=0.01)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:body fit. the height is known to:UserWarning")
def test_gradients_reach_detections_through_the_shape(
    model: BodyModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a sum of coefficients, against solves, to the end, of detections moved a little."""
    to_the_end = partial(LevenbergMarquardt, tolerance=0.0)
    monkeypatch.setattr(sys.modules[fit_body.__module__], "LevenbergMarquardt", to_the_end)
    cameras = synthetic.cameras(4, size=400, distance=4.0).select([0, 1])
    truth = person(model)
    detections, _ = seen(model, truth, cameras)
    draw = torch.Generator().manual_seed(1)
    noise, way = torch.randn(2, *detections.joints2d.shape, generator=draw, dtype=torch.float64)
    pixels = detections.joints2d + 2 * noise
    start = replace(truth, shared={})

    def total(at: Tensor) -> Tensor:
        moved = replace(detections, joints2d=at)
        settings = replace(QUICK, steps=(300, 8))
        found = fit_body(model, cameras, moved, start, settings=settings, adjoint=Implicit())
        return (found.shape * torch.tensor([1.0, -2.0, 0.5, 1.5])).sum()

    free = pixels.clone().requires_grad_()
    total(free).backward()
    assert free.grad is not None
    slope = float((free.grad * way).sum())
    change = float(total(pixels + 1e-3 * way) - total(pixels - 1e-3 * way)) / 2e-3
    assert slope == pytest.approx(change, rel=1e-4)
