"""What the hard z-buffer refuses, by name."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.render.label_map import rasterize

SIZE = (48, 64)


@pytest.mark.parametrize(
    ("pixels", "faces", "size", "word"),
    [
        (torch.zeros(4, 2), torch.tensor([[0, 1, 2]]), SIZE, "pixels"),
        (torch.zeros(3, 2), torch.tensor([[0, 1, 3]]), SIZE, "faces"),
        (torch.zeros(3, 2), torch.tensor([[0, 1, -1]]), SIZE, "faces"),
        (torch.zeros(3, 2), torch.tensor([[0.0, 1, 2]]), SIZE, "faces"),
        (torch.zeros(3, 2), torch.tensor([[0, 1, 2, 2]]), SIZE, "faces"),
        (torch.zeros(3, 2), torch.tensor([[0, 1, 2]]), (0, 5), "size"),
        (torch.zeros(3, 2), torch.tensor([[0, 1, 2]]), (5, 1 << 20), "size"),
    ],
)
def test_bad_input_is_named(
    pixels: Tensor, faces: Tensor, size: tuple[int, int], word: str
) -> None:
    with pytest.raises(InputError, match=word):
        rasterize(pixels, torch.ones(3), faces, size)


def test_a_part_beyond_the_image_is_refused() -> None:
    pixels, depth, faces = torch.zeros(3, 2), torch.ones(3), torch.tensor([[0, 1, 2]])
    for rows in (slice(0, SIZE[0] + 1), slice(5, 5), slice(-1, 4)):
        with pytest.raises(InputError, match="expected rows and columns within an image"):
            rasterize(pixels, depth, faces, SIZE, part=(rows, slice(0, 4)))


@pytest.mark.parametrize("size", [(48.0, 64.0), (48, 64.5), (48,), ("48", "64")])
def test_sizes_that_are_no_whole_pixels(size) -> None:
    """They ended in tracebacks."""
    pixels, depth, faces = torch.zeros(3, 2), torch.ones(3), torch.tensor([[0, 1, 2]])
    with pytest.raises(InputError, match=r"size is .*, whole numbers"):
        rasterize(pixels, depth, faces, size)


def test_meshes_without_numbers() -> None:
    pixels, depth, faces = torch.zeros(3, 2), torch.ones(3), torch.tensor([[0, 1, 2]])
    with pytest.raises(InputError, match="meta device"):
        rasterize(pixels.to("meta"), depth.to("meta"), faces, SIZE)


def test_backgrounds_that_a_type_does_not_have() -> None:
    """-1 was 255 in bytes, and any number true in flags."""
    corners = torch.tensor([[0.0, 0], [8, 0], [0, 8]], dtype=torch.float64)
    seen = rasterize(corners, torch.ones(3).double(), torch.tensor([[0, 1, 2]]), (8, 8))
    for labels, background in ((torch.ones(1, dtype=torch.uint8), -1), (torch.tensor([True]), 5)):
        with pytest.raises(InputError, match=f"^background is {background}, which torch"):
            seen.label(labels, background)
    assert seen.label(torch.ones(1, dtype=torch.int8), -1).unique().tolist() == [-1, 1]
