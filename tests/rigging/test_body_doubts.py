"""What speaks against a fitted body, or against what it is fitted to, is told."""

from __future__ import annotations

import warnings
from dataclasses import replace

import pytest
import synthetic
import torch
from bodies import QUICK, person, seen
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import measure
from perfcap.actor.motion import BODY, Motion
from perfcap.rigging.fit_body import fit_body
from perfcap.rigging.fit_checks import warn_of_inputs
from perfcap.rigging.fit_doubts import mask_doubts, overlap_of
from perfcap.rigging.person_masks import PersonMasks


def test_joints_of_smaller_videos_are_told(model: BodyModel) -> None:
    """They gave another body."""
    cameras = synthetic.cameras(2, size=160, distance=3.0)
    motion = person(model)
    detections, _ = seen(model, motion, cameras)
    half = replace(detections, joints2d=detections.joints2d / 2)
    with pytest.warns(UserWarning, match="body fit: view 0: all joints .* top left quarter"):
        warn_of_inputs(cameras.select([0]), half.select([0]), None)
    warn_of_inputs(cameras, detections, None)


def twice(rest: Motion) -> Motion:
    """The same frames, and turned a little."""
    bare = replace(rest, shared={})
    both = Motion.cat([bare, replace(bare, rotation=bare.rotation + 0.3)])
    return replace(both, shared=rest.shared)


def test_views_in_each_others_place_are_told(model: BodyModel) -> None:
    """They gave another body, where `actor fit` named them."""
    cameras = synthetic.cameras(3, size=160, distance=3.0)
    detections, _ = seen(model, twice(person(model)), cameras)
    with pytest.warns(UserWarning, match="body fit: .* px disagreement"):
        warn_of_inputs(cameras, detections.select([1, 0, 2]), None)
    warn_of_inputs(cameras, detections, None)


def test_masks_of_others_are_told(model: BodyModel) -> None:
    """Inverted ones, of another place, and without legs gave another body."""
    cameras = synthetic.cameras(2, size=160, distance=3.0)
    detections, inside = seen(model, twice(person(model)), cameras)
    inverted = inside.clone()
    inverted[:, 1] = ~inside[:, 1]
    aside = torch.cat((inside[:, :1].roll(80, -1), inside[:, 1:]), 1)
    short = inside.clone()
    short[:, 0, 100:] = False
    small = PersonMasks(cameras, inside.double()).shrunk(2)
    for masks, said in (
        (inverted, "masks of view 1: hold . % of the detected joints"),
        (aside, "masks of view 0: hold .* % of the detected joints"),
        (short, "masks of view 0: leave out .*ankle"),
    ):
        with pytest.warns(UserWarning, match=said):
            warn_of_inputs(cameras, detections, PersonMasks(cameras, masks))
    warn_of_inputs(cameras, detections, PersonMasks(cameras, inside))
    warn_of_inputs(cameras, detections, small)


def test_what_is_unknown_of_masks_is_no_doubt(model: BodyModel) -> None:
    """Legs that something hides, marked as unknown, were called left out."""
    cameras = synthetic.cameras(2, size=160, distance=3.0)
    motion = twice(person(model))
    detections, inside = seen(model, motion, cameras)
    known = torch.ones(160, 160)
    known[100:] = 0
    hidden, of = inside & (known > 0), ("ab", range(len(inside)))
    padded = PersonMasks.padded(cameras, [hidden[:, 0, :100], inside[:, 1]])
    for masks in (PersonMasks(cameras, hidden, known), padded):
        warn_of_inputs(cameras, detections, masks)
        found = overlap_of(model, motion, detections, masks)
        assert not list(mask_doubts(found, *of))
        assert float(found.missing.max()) < 0.1 and float(found.beyond.max()) < 0.1
    unmarked = overlap_of(model, motion, detections, PersonMasks(cameras, hidden))
    assert "silhouettes leave out" in " ".join(mask_doubts(unmarked, *of))
    nothing = overlap_of(model, motion, detections, PersonMasks(cameras, 0 * hidden, 0 * known))
    assert not list(mask_doubts(nothing, *of))


def test_masks_that_are_wrong_where_they_are_known_are_told(model: BodyModel) -> None:
    cameras = synthetic.cameras(2, size=160, distance=3.0)
    motion = twice(person(model))
    detections, inside = seen(model, motion, cameras)
    known = torch.ones(160, 160)
    known[:70] = 0
    of = "ab", range(len(inside))
    short = inside.clone()
    short[:, 0, 100:] = False
    with pytest.warns(UserWarning, match="masks of view 0: "):
        warn_of_inputs(cameras, detections, PersonMasks(cameras, short, known))
    known[:70], known[100:] = 1, 0
    wide = torch.nn.functional.max_pool2d(inside.double(), 13, 1, 6)
    for masks, told in (
        (wide, "exceed the body by"),
        (0 * wide, "are empty in most frames"),
        (inside.roll(80, -1), "hold 0 % of the detected joints"),
    ):
        found = overlap_of(model, motion, detections, PersonMasks(cameras, masks, known))
        assert told in " ".join(mask_doubts(found, *of))


@pytest.mark.long
def test_what_speaks_against_a_body_is_told(model: BodyModel) -> None:
    """`actor fit` said so; bodies fitted in Python were as wrong without a word."""
    cameras = synthetic.cameras(2, size=160, distance=3.0)
    motion = twice(person(model))
    detections, inside = seen(model, motion, cameras)
    tall = measure(model.template(motion.shared[BODY])).height
    initial = replace(motion, shared={})
    wide = torch.nn.functional.max_pool2d(inside.double(), 13, 1, 6) > 0.5
    odd = inside.clone()
    odd[:2] = inside[:2].roll(12, -1)

    def told(masks: Tensor | None, height: float, initial: Motion = initial) -> str:
        given = None if masks is None else PersonMasks(cameras, masks)
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", UserWarning)
            fit_body(model, cameras, detections, initial, given, height, settings=QUICK)
        return " ".join(str(each.message) for each in found)

    right = told(inside, tall)  # and the two cameras face each other
    assert right == told(None, tall) and right.startswith("body fit: the two cameras look at each")
    assert right.count("body fit: ") == 1
    assert "body fit: silhouettes exceed the body by" in told(wide, tall)
    assert "masks of view 0: miss the body by" in told(odd, tall)
    assert "check the height, and the scale of the cameras" in told(None, tall + 0.2)
    millimetres = replace(initial, translation=1000 * initial.translation + 500)
    assert "of the person's size from the joints in frames 0-5 (co" in told(None, tall, millimetres)
