"""Masks that end elsewhere than the images have edges."""

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from perfcap.detect.detections import Detections
from perfcap.io.doctor.mask_outlines import (
    MaskedFrames,
    outline_doubts,
    outline_edges,
    registration,
)
from perfcap.io.doctor.moved_outlines import moved_sentences, register
from perfcap.rigging.fit_doubts import Overlap, mask_doubts

FRAMES, HEIGHT, WIDTH = 4, 260, 200
TALL = 200.0  # px, of the person
Mask = NDArray[np.uint8]


def person(frame: int) -> Mask:
    """A trunk, a head and two arms, from row 30 to row 230."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.rectangle(mask, (75 + frame, 70), (125 + frame, 230), 1, -1)
    cv2.circle(mask, (100 + frame, 50), 20, 1, -1)
    cv2.line(mask, (60 + frame, 80), (140 + frame, 150), 1, 12)
    return mask


def chosen(contrast: float) -> Any:
    """Frames of that person over a textured ground, in noisy clothes."""
    rng = np.random.default_rng(0)
    images = []
    for frame in range(FRAMES):
        ground = cv2.GaussianBlur(rng.normal(0, 60, (HEIGHT, WIDTH)), (0, 0), 2)
        cloth = cv2.GaussianBlur(rng.normal(0, 60, (HEIGHT, WIDTH)), (0, 0), 2) + contrast
        image = 90 + np.where(person(frame) > 0, cloth, ground)
        images.append(np.repeat(image.clip(0, 255).astype(np.uint8)[..., None], 3, -1))
    joints = torch.zeros(FRAMES, 1, 16, 2)
    joints[..., 1] = torch.linspace(30, 30 + TALL, 16)
    return type(
        "Chosen",
        (),
        {
            "__len__": lambda self: FRAMES,
            "read_view": lambda self, view, start, stop: np.stack(images[start:stop]),
            "detections": Detections.from_joints(joints, torch.ones(FRAMES, 1, 16)),
            "clip": SimpleNamespace(names=("front",)),
        },
    )()


def shown(inside: torch.Tensor) -> MaskedFrames:
    """These frames with masks."""
    given = chosen(80)
    return MaskedFrames(("front",), given, given.detections, inside)


def masks(moved: int = 0) -> Any:
    """Those of the person, larger by some pixels, or smaller."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * abs(moved) + 1,) * 2)
    change = cv2.dilate if moved > 0 else cv2.erode
    inside = np.stack([change(person(frame), kernel) for frame in range(FRAMES)])
    return SimpleNamespace(inside=torch.from_numpy(inside)[:, None] > 0)


@pytest.mark.parametrize("moved", [-6, -3, 0, 1, 3, 6, 9])
def test_where_the_edges_are(moved: int) -> None:
    (found,) = outline_edges(shown(masks(moved).inside))
    assert abs(found.offset - moved) <= 1 and found.clarity > 1.5 and found.size == TALL
    told = list(outline_doubts(shown(masks(moved).inside)))
    assert len(told) == (abs(moved) > 2)
    if told:
        side, kind = ("outside", "larger") if moved > 0 else ("inside", "smaller")
        assert told[0].startswith("masks of front: end about")
        assert f"{side} the edges" in told[0] and f"girths are {kind}" in told[0]


def placed(wide: float, tall: float, right: float, down: float) -> Any:
    """Those of the person, stretched about the image's middle and moved by some pixels."""
    matrix = np.array(
        [
            [wide, 0.0, 0.5 * WIDTH * (1 - wide) + right],
            [0.0, tall, 0.5 * HEIGHT * (1 - tall) + down],
        ]
    )
    inside = np.stack(
        [
            cv2.warpAffine(255 * person(frame), matrix, (WIDTH, HEIGHT)) > 127
            for frame in range(FRAMES)
        ]
    )
    return SimpleNamespace(inside=torch.from_numpy(inside)[:, None])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((1.0, 0.9375, 0.0, 0.0), ("times as tall",)),
        ((1.0, 1.0, 0.0, 8.0), ("% of the person's height further up",)),
        ((1.0, 1.0, 0.0, -8.0), ("% of the person's height further down",)),
        ((1.0, 1.0, 8.0, 0.0), ("% of the person's height to the left",)),
        ((1.0, 1.0, -8.0, 8.0), ("height to the right", "height further up")),
        ((1.0, 1.0, 0.0, 0.0), ()),
        ((1.0, 1.0, 1.0, -1.0), ()),
    ],
)
def test_masks_of_other_pixels_are_named(
    change: tuple[float, float, float, float], words: tuple[str, ...]
) -> None:
    """As of a segmenter's input with borders, resized straight to the video: nothing was said."""
    told = list(moved_sentences("front", registration(shown(placed(*change).inside), 0, TALL)))
    assert len(told) == bool(words)
    for line in told:
        assert line.startswith("masks of front: would end at the edges")
        assert all(each in line for each in words)


def test_both_axes_are_alike() -> None:
    given = placed(1.0, 0.9375, 4.0, 0.0)
    pairs = [
        (chosen(80).read_view(0, frame, frame + 1)[0], given.inside[frame, 0].numpy())
        for frame in range(FRAMES)
    ]
    turned = [(image.transpose(1, 0, 2).copy(), mask.T.copy()) for image, mask in pairs]
    across, down = register(pairs, TALL)
    other_across, other_down = register(turned, TALL)
    assert down.moved and down.stretch > 0.03 and across.shift == pytest.approx(-0.02, abs=0.006)
    for one, other in ((across, other_down), (down, other_across)):
        assert (one.shift, one.stretch) == (other.shift, other.stretch)
        assert one.gain == pytest.approx(other.gain, rel=1e-5)
    assert "times as wide" in "".join(moved_sentences("front", (other_across, other_down)))


@pytest.mark.parametrize("same", [False, True])
def test_masks_of_nothing_are_nowhere_else(same: bool) -> None:
    image = np.random.default_rng(0).integers(0, 255, (40, 50, 3), np.uint8)
    for found in register([(image, np.full((40, 50), same))], 30.0):
        assert found.gain == 1.0 and not found.moved


def test_what_is_said_of_a_view_has_it() -> None:
    (line,) = outline_doubts(shown(placed(1.0, 0.9375, 0.0, 0.0).inside))
    assert "times as tall; were they resized with borders" in line


@pytest.mark.parametrize("down", [-8, 8])
def test_how_far_masks_are_off_is_measured(down: int) -> None:
    """In steps of half a hundredth of the person's height."""
    given = placed(1.0, 1.0, 0.0, down)
    across, along = registration(shown(given.inside), 0, TALL)
    assert abs(along.shift + down / TALL) < 0.012 and along.moved and not across.moved


def test_boxes_end_at_no_edges() -> None:
    boxes = torch.zeros(FRAMES, 1, HEIGHT, WIDTH, dtype=torch.bool)
    boxes[..., 10:250, 30:170] = True
    (line,) = outline_doubts(shown(boxes))
    assert "end at no edges" in line


@pytest.mark.parametrize("value", [False, True])
def test_masks_of_nothing_and_of_all_say_nothing_of_edges(value: bool) -> None:
    same = torch.full((FRAMES, 1, HEIGHT, WIDTH), value)
    (found,) = outline_edges(shown(same))
    assert found.offset == 0


def test_masks_that_are_wrong_in_some_frames_are_named() -> None:
    """A third of the frames does not move a median."""
    shares = torch.tensor([0.05, 0.06, 0.5, 0.05, 0.07, 0.45], dtype=torch.float64)
    beyond = torch.stack((shares, torch.full_like(shares, 0.06)), 1)
    found = Overlap(torch.ones(2), beyond, 0.04 + 0 * beyond, beyond > 1)
    (told,) = mask_doubts(found, ("front", "left"), range(100, 118, 3))
    assert "masks of front: miss the body by 54 %" in told and "frames 106, 115" in told
