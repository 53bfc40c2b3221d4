from __future__ import annotations

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.render.overlay import OverlayStyle, border_distance, draw_caption, draw_overlay, stroke

RNG = np.random.default_rng(0)
FRAME = RNG.integers(0, 256, (90, 120, 3), dtype=np.uint8)
JOINTS = RNG.uniform(10, 80, (16, 2))


def disc(radius: float = 20.0) -> np.ndarray:
    y, x = np.mgrid[:90, :120]
    return np.hypot(x - 60, y - 45) < radius


def test_the_frame_itself_is_left_alone() -> None:
    before = FRAME.copy()
    drawn = draw_overlay(FRAME, disc(), JOINTS, JOINTS, np.ones(16))
    draw_caption(FRAME, "text")
    assert np.array_equal(FRAME, before)
    assert drawn.shape == FRAME.shape
    assert drawn.dtype == np.uint8


def test_nothing_to_draw_draws_nothing() -> None:
    empty = np.zeros((90, 120), bool)
    missing = np.full((16, 2), np.nan)
    assert np.array_equal(draw_overlay(FRAME), FRAME)
    assert np.array_equal(draw_overlay(FRAME, empty, missing, missing), FRAME)
    unseen = draw_overlay(FRAME, detections=JOINTS, confidence=np.zeros(16))
    assert np.array_equal(unseen, FRAME)


def test_marks_far_outside_or_unbounded_are_harmless() -> None:
    wild = JOINTS.copy()
    wild[3], wild[4], wild[5] = (1e30, 5), (np.inf, 2), (-9e3, 40)
    drawn = draw_overlay(FRAME, joints=wild, detections=wild, confidence=np.full(16, np.nan))
    assert drawn.shape == FRAME.shape and drawn.dtype == np.uint8
    assert not np.array_equal(drawn, FRAME)  # the other joints are drawn


def test_a_full_mask_has_no_outline_inside_the_frame() -> None:
    drawn = draw_overlay(FRAME, np.ones((90, 120), bool))
    assert np.array_equal(drawn, FRAME)


def test_sides_keep_their_colours() -> None:
    style = OverlayStyle(joint_radius=0.1)
    grey = np.full((90, 120, 3), 128, np.uint8)
    joints = np.full((16, 2), np.nan)
    joints[[2, 3]], joints[[5, 6]] = [[20, 20], [20, 70]], [[90, 20], [90, 70]]
    drawn = draw_overlay(grey, joints=joints, style=style)
    assert tuple(drawn[45, 20]) == style.right
    assert tuple(drawn[45, 90]) == style.left


def test_a_stroke_covers_its_area() -> None:
    image = np.zeros((60, 80, 3), np.uint8)
    stroke(image, np.array([[[20.3, 20.2], [55.8, 41.6]]]), 3.0, (255, 255, 255))
    length = np.hypot(55.8 - 20.3, 41.6 - 20.2)
    assert image[..., 0].sum() / 255 == pytest.approx(6 * length + np.pi * 9, rel=0.01)


def test_overlapping_strokes_of_one_call_do_not_add_up() -> None:
    once, twice = np.zeros((2, 40, 40, 3), np.uint8)
    line = np.array([[[5.0, 20], [35, 20]]])
    stroke(once, line, 2.0, (200, 100, 50), 0.5)
    stroke(twice, line.repeat(2, 0), 2.0, (200, 100, 50), 0.5)
    assert np.array_equal(once, twice)


def test_distance_to_the_border_of_a_disc() -> None:
    box, distance = border_distance(disc().astype(np.float32), 1.0, 2.0)
    y, x = np.mgrid[box]
    exact = np.abs(np.hypot(x - 60, y - 45) - 20)
    near = exact < 2
    assert near.sum() > 400
    assert np.abs(distance - exact)[near].max() < 0.7  # the mask itself is a staircase


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mask", np.zeros((90, 121), bool)),
        ("joints", np.zeros((17, 2))),
        ("detections", np.zeros((16, 3))),
        ("confidence", np.zeros(15)),
    ],
)
def test_wrong_shapes_are_named(name: str, value: np.ndarray) -> None:
    with pytest.raises(InputError, match=name):
        draw_overlay(FRAME, **{name: value})


def test_a_float_frame_is_refused() -> None:
    with pytest.raises(InputError, match="frame"):
        draw_overlay(FRAME.astype(np.float32))


def test_masks_of_bytes_are_no_coverage() -> None:
    """Their outline was drawn elsewhere, a third of it."""
    frame, mask = np.full((64, 64, 3), 90, np.uint8), np.zeros((64, 64))
    mask[20:40, 20:40] = 1
    for wrong in ((255 * mask).astype(np.uint8), np.where(mask > 0, np.nan, 0)):
        with pytest.raises(InputError, match=r"^mask is .* expected bool, or coverage from 0 to 1"):
            draw_overlay(frame, mask=wrong)
    assert np.array_equal(draw_overlay(frame, mask=mask), draw_overlay(frame, mask=mask > 0))
