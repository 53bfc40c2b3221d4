"""Cameras of images that were stretched to another size."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera

_SHAPE = 0.02  # by which width by height may differ: images are of whole pixels


def resized(cameras: Camera, size: tuple[int, int]) -> Camera:
    """Cameras whose images are stretched to one size (height, width).

    Warns where the size keeps the shape of the images once height and width are exchanged.

    Raises:
        InputError: cameras do not say how large their images are, or the size is none.
    """
    if len(size) != 2 or not all(side == int(side) and side > 0 for side in size):
        raise InputError(f"size is {size}, expected whole pixels of (height, width)")
    if not cameras.size:
        raise InputError(
            "cameras do not know the size of their images; give cameras in pixels of the masks"
        )
    for line in exchanged_sides(size, cameras.size):
        warnings.warn(line, stacklevel=2)
    own = cameras.intrinsics.new_tensor(cameras.size)  # C 2
    ratio = cameras.intrinsics.new_tensor(size) / own
    stretch = torch.diag_embed(torch.cat((ratio.flip(-1), torch.ones_like(ratio[:, :1])), -1))
    # pixel centres are integers: x' + 0.5 = ratio (x + 0.5)
    stretch[:, :2, 2] = 0.5 * (ratio.flip(-1) - 1)
    return replace(cameras, intrinsics=stretch @ cameras.intrinsics, size=(size,) * cameras.views)


def exchanged_sides(size: Sequence[int], own: Sequence[Sequence[int]]) -> Iterator[str]:
    """A sentence where another size keeps the shape of images only as width and height.

    Args:
        size: (height, width) asked for.
        own: (height, width) of the images of each view.
    """
    height, width = size
    for rows, columns in own:
        shape = abs(height * columns / (width * rows) - 1)
        exchanged = abs(width * columns / (height * rows) - 1)
        if exchanged < _SHAPE < shape:
            yield (
                f"size is {height} rows and {width} columns for images of {rows} rows and "
                f"{columns} columns, whose shape it keeps as ({width}, {height}) alone; expected "
                "(height, width), not (width, height)"
            )
            return
