"""Pictures and masks of other kinds, which were taken for what they are not."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from disc_scene import disc
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.render import ModelContour
from perfcap.segment import (
    Footage,
    Silhouettes,
    extract_contour,
    find_edges,
    match,
    stack,
    survey,
)

SIZE = (60, 80)
IMAGE = np.random.default_rng(0).integers(0, 255, (*SIZE, 3), dtype=np.uint8)
MASK = disc((40, 30), 12, SIZE)
BONES = np.zeros((1, 3, 2, 2))


@pytest.mark.parametrize("image", [IMAGE / 255, IMAGE[..., 0], IMAGE.astype(np.float32)])
def test_edges_are_of_bytes(image: NDArray[np.uint8]) -> None:
    with pytest.raises(InputError, match="expected uint8"):
        find_edges(image)


def test_soft_masks_have_no_contour() -> None:
    soft = MASK * 0.6 + 0.1
    for mask in (soft, np.where(MASK, 4.0, -4.0), np.where(MASK, 1.0, np.nan)):
        with pytest.raises(InputError, match="expected bool"):
            extract_contour(mask)
    for same in (MASK.astype(np.float32), MASK * 255.0, MASK.astype(np.uint8) * 2):
        assert len(extract_contour(same)) == len(extract_contour(MASK)) > 0


def test_silhouettes_of_bytes_are_no_labels() -> None:
    with pytest.raises(InputError, match="hold 255"):
        Silhouettes.collect([[MASK.astype(np.uint8) * 255]])
    with pytest.raises(InputError, match="one size"):
        Silhouettes.collect([[MASK], [MASK.T]])
    labels = MASK.astype(np.uint8) * 3
    assert Silhouettes.collect([[labels, MASK.T], [labels, MASK.T]]).mask(0, 0, 3).any()


@pytest.mark.parametrize("use", [survey, lambda images, models: Footage(images, models, BONES)])
@pytest.mark.parametrize(
    ("image", "mask"),
    [
        (IMAGE / 255, MASK),
        (IMAGE, MASK.astype(np.uint8) * 255),
        (IMAGE, MASK * 0.9),
        (IMAGE, MASK.T),
        (IMAGE, MASK[::2, ::2]),
    ],
)
def test_footage_is_of_bytes_and_masks(
    use: Callable[..., object], image: NDArray[np.uint8], mask: NDArray[np.bool_]
) -> None:
    use([IMAGE], [MASK])
    with pytest.raises(InputError, match="expected"):
        use([image], [mask])


def test_bones_are_of_each_model() -> None:
    Footage([IMAGE], [np.stack((MASK, MASK))], np.zeros((1, 2, 3, 2, 2)))
    with pytest.raises(InputError, match="bones"):
        Footage([IMAGE], [np.stack((MASK, MASK))], BONES)


def test_sizes_of_people_are_pixels() -> None:
    image = extract_contour(MASK)
    count = len(image)
    pairs = np.zeros((count, 2), np.int64), np.tile([1.0, 0.0], (count, 1))
    model = ModelContour(image.points, image.normals, *pairs, np.ones(count, bool))
    assert len(match(model, image, size=30.0)) > 0
    with pytest.raises(InputError, match="not in metres"):
        match(model, image, size=1.7)
    with pytest.raises(InputError, match="room"):
        match(model, image, room=np.ones(1))
    with pytest.raises(InputError, match="floating"):
        stack([[match(model, image)]], torch.zeros(1, dtype=torch.int64))
