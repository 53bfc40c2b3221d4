"""Whether masks lie where a captured person is, and which way up they are."""

import warnings

import pytest
import torch

from perfcap.pipeline.overlap import warn_of_masks_elsewhere, warn_of_trust_within


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
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_masks_elsewhere(person(), person())
        warn_of_masks_elsewhere(person().roll(2, -1), person())
    assert not caught


@pytest.mark.parametrize(("grown", "told"), [(1, False), (2, True), (-2, True)])
def test_masks_that_are_drawn_too_wide_or_too_narrow_are_told(grown: int, told: bool) -> None:
    """By columns: the arms' height is a third of the body's."""
    masks = person()
    masks[..., 6:32, 13 - max(grown, 0) : 24 + grown] = 1
    if grown < 0:
        masks[..., 10:32, 24 + 2 * grown :] = 0
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_masks_elsewhere(masks, person())
    assert ["times the area" in str(each.message) for each in caught] == [True] * told


def test_pixels_without_trust_are_not_compared() -> None:
    """As where other people stand in front: right masks leave out what they hide."""
    trust = torch.ones(3, 2, 40, 40)
    trust[..., 20:, :] = 0
    masks, strip = person() * trust, torch.ones(3, 2, 40, 40)
    strip[..., 8:, :] = 0  # hides all but the arms
    strip[..., :24] = 0  # and of these all but their end
    with pytest.warns(UserWarning, match="times the area"):
        warn_of_masks_elsewhere(masks, person())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for given in (masks, person(), 1 - (1 - masks) * trust):
            for each in (trust, trust[:1, :1], 0.5 * trust[0, 0]):
                warn_of_masks_elsewhere(given, person(), each)
        warn_of_masks_elsewhere(person().roll(3, -1), person(), strip)
    assert not caught


def test_masks_that_are_wrong_where_they_count_are_told() -> None:
    trust = torch.ones(1, 1, 40, 40)
    trust[..., 15:24, :] = 0
    wide = person()
    wide[..., 6:20, 5:34] = 1
    wrong = {
        "overlap the captured person by": 1 - person(),
        "upside down": person().flip(-2),
        "beside the captured person": person().roll(-3, -1),
        "times the area": wide,
    }
    for told, masks in wrong.items():
        with pytest.warns(UserWarning, match=told):
            warn_of_masks_elsewhere(masks, person(), trust)


def test_trust_in_the_person_alone_is_told() -> None:
    sure = torch.ones(3, 2, 40, 40)
    for trust in (person(), person()[:1, :1], 0.5 * person() + 0.01):
        with pytest.warns(UserWarning, match="the person may grow beyond the masks"):
            warn_of_trust_within(person() > 0, trust)
    box, near = 0 * sure, sure.clone()
    box[..., 4:34, 7:32] = 1
    near[..., 6:40, 13:24] = 0.1  # of who is hardly sure
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for masks, trust in ((person(), sure), (person(), sure[:1, :1, :1, :1])):
            warn_of_trust_within(masks, trust)
        for masks, trust in ((person(), box), (person(), near), (sure, sure), (0 * sure, sure)):
            warn_of_trust_within(masks, trust)
        close = sure.clone()
        close[..., :2] = 0  # the person fills the image
        warn_of_trust_within(close, sure)
    assert not caught
