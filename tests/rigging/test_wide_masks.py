"""Masks that a body would fill, but no person does: wide, faint, or known inside alone."""

from __future__ import annotations

import warnings
from dataclasses import replace

import pytest
import synthetic
import torch
from bodies import QUICK, few_shapes, person, seen
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import BODY
from perfcap.errors import InputError
from perfcap.io.body_model import load_body_model
from perfcap.rigging.drawn_bodies import areas_of, faint_doubts, wide_doubts
from perfcap.rigging.fit_body import fit_body
from perfcap.rigging.fit_checks import warn_of_inputs
from perfcap.rigging.person_masks import PersonMasks


def widened(inside: Tensor, by: int) -> Tensor:
    return torch.nn.functional.max_pool2d(inside.double(), 2 * by + 1, 1, by)


def coarse(inside: Tensor, by: int) -> Tensor:
    """As a network's small masks are, made as large as the images."""
    small = torch.nn.functional.avg_pool2d(inside.double(), by)
    return torch.nn.functional.interpolate(small, scale_factor=by, mode="bilinear")


def test_soft_masks_stay_soft_when_they_are_padded() -> None:
    """They grew to wherever they were not 0."""
    cameras = synthetic.cameras(2, size=40)
    soft = [torch.rand(3, 20, 40), torch.rand(3, 40, 30).double().requires_grad_()]
    padded = PersonMasks.padded(cameras, soft)
    assert padded.inside.dtype == torch.float64 and padded.inside.requires_grad
    for view, own in enumerate(soft):
        rows, columns = own.shape[1:]
        assert torch.equal(padded.inside[:, view, :rows, :columns], own.double())
    PersonMasks(cameras, torch.full((3, len(soft), 8, 8), 1 + 1e-6))  # as resizing rounds
    hard = [view > 0.5 for view in soft]
    assert PersonMasks.padded(cameras, hard).inside.dtype == torch.bool


@pytest.mark.parametrize("scale", [255.0, -1.0, float("nan")])
def test_masks_of_other_values_are_refused(scale: float) -> None:
    cameras = synthetic.cameras(1, size=8)
    masks = scale * torch.ones(3, 1, 8, 8)
    with pytest.raises(InputError, match=r"masks have values from .*expected bool, or 0 to 1"):
        PersonMasks(cameras, masks)
    with pytest.raises(InputError, match=r"masks have values from .*expected bool, or 0 to 1"):
        PersonMasks.padded(cameras, [masks[:, 0]])


def test_areas_of_masks_are_compared_with_a_body(model: BodyModel) -> None:
    cameras = synthetic.cameras(2, size=160, distance=3.0)
    motion = person(model)
    _, inside = seen(model, motion, cameras)
    upper = torch.ones(160, 160)
    upper[90:] = 0
    hidden = inside.clone()
    hidden[..., 70:] = False  # behind something that is not marked

    def told(masks: Tensor, known: Tensor | None = None) -> str:
        areas = areas_of(model, motion, PersonMasks(cameras, masks, known))
        names = "front", "back"
        return " ".join([*wide_doubts(areas, names), *faint_doubts(areas, names)])

    assert "masks of front: have 1." in told(widened(inside, 1))
    assert "masks of back: have 1." in told(widened(inside, 1), upper)
    assert "have 0.60 times the area of a body that is fitted to joints alone, 0% of it at " in (
        told(0.6 * inside)
    )
    for masks in (inside, coarse(inside, 4), hidden, 0 * inside):
        assert not told(masks)
    assert not told(inside & (upper > 0), upper) and not told(inside, 0 * upper)


def test_masks_that_are_known_inside_alone_are_told(model: BodyModel) -> None:
    """Nothing held the body back from growing beyond them."""
    cameras = synthetic.cameras(2, size=160, distance=3.0)
    motion = person(model)
    detections, inside = seen(model, motion, cameras)
    with pytest.warns(UserWarning, match="known outside of the person by 0% of how much inside"):
        warn_of_inputs(cameras, detections, PersonMasks(cameras, inside, inside))
    upper = torch.ones(160, 160)
    upper[80:] = 0
    for known in (None, upper, widened(inside, 8) > 0, torch.ones(1, 1, 1, 1)):
        warn_of_inputs(cameras, detections, PersonMasks(cameras, inside, known))


@pytest.mark.long
@pytest.mark.parametrize("consensus", ["shared", "median"])
def test_bodies_that_fill_wide_or_faint_masks_are_told(consensus: str) -> None:
    """Waists were as wide as the masks, with no word."""
    model = load_body_model()
    cameras = synthetic.cameras(4, size=160, distance=3.0).select([0, 1])
    motion = person(few_shapes())
    own = motion.shared[BODY]
    shape = torch.nn.functional.pad(own, (0, model.components - len(own)))
    motion = replace(motion, shared={BODY: shape})
    detections, inside = seen(model, motion, cameras)
    start, settings = replace(motion, shared={}), replace(QUICK, consensus=consensus)

    def told(masks: Tensor) -> str:
        given = PersonMasks(cameras, masks)
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", UserWarning)
            fit_body(model, cameras, detections, start, given, settings=settings)
        return " ".join(str(each.message) for each in found)

    assert told(widened(inside, 2)).count("times the area") == 2
    faint = told(0.6 * inside)
    assert faint.count("expected 1 where the person surely is") == 2 and "coat" not in faint
    assert "masks" not in told(inside) + told(coarse(inside, 4))
