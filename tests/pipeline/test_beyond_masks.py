"""Limbs that stand out of a silhouette, measured in the person's size."""

import numpy as np
import pytest
import torch

from perfcap.pipeline.beyond_masks import frame_excess
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_silhouettes import given_record
from perfcap.pipeline.sight import Outline

HEIGHT = 200  # px


def person(scale: int = 1, limb: int = 0) -> np.ndarray:
    """A trunk of 60 x 200, and a limb of 20 x ``limb`` to its right, in 240 x 240 pixels."""
    mask = np.zeros((240 * scale, 240 * scale), np.bool_)
    mask[20 * scale : 220 * scale, 40 * scale : 100 * scale] = True
    mask[60 * scale : 80 * scale, 100 * scale : (100 + limb) * scale] = True
    return mask


def evidence(*masks: np.ndarray, scale: int = 1) -> Evidence:
    views = [[given_record(mask)] for mask in masks]
    return Evidence.collect(views, torch.full((len(masks),), float(HEIGHT * scale)))


def drawn(mask: np.ndarray) -> Outline:
    part = (slice(10, mask.shape[0] - 10), slice(5, mask.shape[1] - 5))
    return Outline(mask[part], part, mask.shape)


@pytest.mark.parametrize("scale", [1, 2])
def test_a_limb_that_no_mask_explains(scale: int) -> None:
    """Of 20 x 60 pixels of a person of 200, all but the four nearest columns."""
    with_limb, without = person(scale, 60), person(scale)
    beyond, left = frame_excess([drawn(with_limb)], evidence(without, scale=scale), 0)
    assert beyond == pytest.approx(100 * 20 * 56 / HEIGHT**2, rel=0.03) and left == 0.0
    # and the other way round
    beyond, left = frame_excess([drawn(without)], evidence(with_limb, scale=scale), 0)
    assert left == pytest.approx(100 * 20 * 56 / HEIGHT**2, rel=0.03) and beyond == 0.0


def test_a_person_in_their_mask_and_in_a_larger_one() -> None:
    for worn in (0, 60):  # a mask may have more, such as clothes
        assert frame_excess([drawn(person())], evidence(person(limb=worn)), 0)[0] == 0.0
    assert frame_excess([drawn(person(limb=3))], evidence(person()), 0) == (0, 0)  # near enough


def test_views_are_averaged_and_empty_ones_say_nothing() -> None:
    views = [drawn(person(limb=60)), drawn(person(limb=60))]
    both, _ = frame_excess(views, evidence(person(), person(limb=60)), 0)
    alone, _ = frame_excess(views[:1], evidence(person()), 0)
    assert both == pytest.approx(0.5 * alone) and alone > 1
    assert frame_excess(views[:1], evidence(np.zeros_like(person())), 0) == (0, 0)
