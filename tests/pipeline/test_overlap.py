"""Whether masks lie where a captured person is, and which way up they are."""

import warnings

import pytest
import torch

from perfcap.pipeline.overlap import warn_of_masks_elsewhere


def person() -> torch.Tensor:
    """A mask (3, 2, 40, 40) near the middle, unlike its mirror images."""
    mask = torch.zeros(3, 2, 40, 40)
    mask[..., 6:32, 13:24] = 1
    mask[..., 6:10, 9:30] = 1
    return mask


@pytest.mark.parametrize(
    ("axes", "how"), [((-2,), "upside down"), ((-1,), "mirrored"), ((-2, -1), "turned by 180")]
)
def test_masks_that_fit_another_way_up_are_named(axes: tuple[int, ...], how: str) -> None:
    masks = person()
    masks[:, 1] = masks[:, 1].flip(axes)
    with pytest.warns(UserWarning, match=rf"masks of views \[1\] would overlap .*100% {how}"):
        warn_of_masks_elsewhere(masks, person())


def test_masks_that_fit_as_they_are() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_masks_elsewhere(person(), person())
        warn_of_masks_elsewhere(person().roll(2, -1), person())
