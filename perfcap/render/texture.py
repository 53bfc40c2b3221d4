"""Textures: colour space, filtering and look-up."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import cv2
import numpy as np
import torch
from torch import Tensor

from perfcap.array_checks import require_indices, require_shape
from perfcap.errors import InputError

_FARTHEST = 1e6  # of a uv from the image, in images; whole numbers and fractions are told apart
_ROUNDING = 1e-2  # of light
COARSEST = 16  # px; smaller levels mix parts of the body that are neighbours in the atlas only


def to_linear(color: Tensor) -> Tensor:
    """Light intensity in [0, 1], float32, of sRGB values, uint8 (IEC 61966-2-1).

    Raises:
        InputError: values of another type: fractions from 0 to 1 were all black.
    """
    if color.dtype != torch.uint8:
        raise InputError(f"color is {color.dtype}, expected uint8 from 0 to 255")
    value = torch.arange(256, dtype=torch.float32, device=color.device) / 255
    curve = torch.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return curve[color.long()]


def to_srgb(light: Tensor) -> Tensor:
    """The nearest sRGB value, uint8, of light intensities; what exceeds [0, 1] is clipped."""
    light = light.clamp(0, 1)
    # the power of a clamped base keeps the branch not taken free of its infinite slope at zero
    curve = torch.where(
        light <= 0.0031308, 12.92 * light, 1.055 * light.clamp_min(1e-4) ** (1 / 2.4) - 0.055
    )
    return (255 * curve).round().to(torch.uint8)


def _is_light(level: Tensor) -> bool:
    """Whether a picture, which may be empty, is from 0 to 1, but for rounding."""
    if not level.numel():
        return True
    low, high = (float(end) for end in level.detach().aminmax())
    return low >= -_ROUNDING and high <= 1 + _ROUNDING


@dataclass(frozen=True)
class Texture:
    """An image that is mapped onto a mesh, as glTF defines it.

    Attributes:
        levels: linear light (h, w, 3) at full size, then each half the size of the one before.
        uv: (N, 2), origin at the top left corner of the image, repeated outside [0, 1].
        faces: indices into ``uv`` of each face's corners, (T, 3).

    Raises:
        InputError: arrays of other shapes, levels that are no light from 0 to 1, faces that index
            no uv, or uv of faces that are not finite, or a million images away.
    """

    levels: tuple[Tensor, ...]
    uv: Tensor
    faces: Tensor

    def __post_init__(self) -> None:
        for level in self.levels:
            require_shape(level, "texture level", (None, None, 3), "(h, w, 3)")
            if not level.is_floating_point() or not _is_light(level):
                raise InputError(
                    f"texture level is {level.dtype} beyond 0 to 1, expected linear light from 0 "
                    "to 1; Texture.from_image makes it of an image in bytes"
                )
        if not self.levels or any(0 in level.shape for level in self.levels):
            raise InputError("texture has no image, or an empty one; expected a pixel at least")
        require_shape(self.uv, "texture uv", (None, 2), "(N, 2)")
        require_shape(self.faces, "texture faces", (None, 3), "(T, 3)")
        require_indices(self.faces, "texture faces", len(self.uv), "uv")
        corners = self.uv.detach()[self.faces.long()].abs()
        if not bool((corners <= _FARTHEST).all()):
            raise InputError(
                "texture uv of faces are not numbers or beyond a million; expected 0 to 1 within "
                "the image"
            )

    @classmethod
    def from_image(cls, image: Tensor, uv: Tensor, faces: Tensor) -> Self:
        """Map an sRGB image (h, w, 3) uint8 onto faces (T, 3) that index uv (N, 2).

        Raises:
            InputError: the image is not (h, w, 3) uint8, or of faces and uv as of the class.
        """
        if image.ndim != 3 or image.shape[-1] != 3 or image.dtype != torch.uint8:
            raise InputError(
                f"texture image has shape {tuple(image.shape)} and dtype {image.dtype}; "
                "expected (h, w, 3) uint8"
            )
        levels = [to_linear(image)]
        while min(levels[-1].shape[:2]) >= 2 * COARSEST:
            half = torch.nn.functional.avg_pool2d(levels[-1].movedim(-1, 0), 2)
            levels.append(half.movedim(0, -1).contiguous())
        return cls(tuple(levels), uv, faces)

    @classmethod
    def decode(cls, encoded: bytes, uv: Tensor, faces: Tensor, owner: str) -> Self:
        """Map a JPEG or PNG onto faces (T, 3) that index uv (N, 2).

        Raises:
            InputError: it cannot be decoded; ``owner`` says whose it is.
        """
        try:
            image = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)
        except cv2.error:  # empty, or larger than OpenCV is willing to decode
            image = None
        if image is None:
            raise InputError(
                f"{owner}: its texture cannot be decoded; export it again as JPEG or PNG"
            )
        return cls.from_image(torch.tensor(image[..., ::-1].copy()), uv, faces)

    @classmethod
    def plain(cls, color: tuple[int, int, int], faces: int) -> Self:
        """One sRGB colour for all of a number of faces."""
        image = torch.tensor(color, dtype=torch.uint8).expand(1, 1, 3)
        return cls.from_image(image, torch.zeros(1, 2), torch.zeros(faces, 3, dtype=torch.int64))

    @cached_property
    def packed(self) -> tuple[Tensor, Tensor]:
        """Texels of all levels (S, 3), and first texel, height and width of each level (L, 3)."""
        shapes, first = [], 0
        for image in self.levels:
            height, width, _ = image.shape
            shapes.append((first, height, width))
            first += height * width
        return torch.cat([image.reshape(-1, 3) for image in self.levels]), torch.tensor(shapes)

    def sample(self, uv: Tensor, level: Tensor) -> Tensor:
        """Trilinear look-up: linear light (N, 3) at uv (N, 2) and pyramid level (N,), 0 finest."""
        level = level.clamp(0, len(self.levels) - 1)
        color = uv.new_zeros(len(uv), 3)
        for position, image in enumerate(self.levels):
            share = (1 - (level - position).abs()).clamp_min(0)
            here = torch.nonzero(share).squeeze(-1)
            color = color.index_add(0, here, share[here, None] * bilinear(image, uv[here]))
        return color

    def level_of_detail(self, doubled_area: Tensor) -> Tensor:
        """Pyramid level (T,) at which a texel is about a pixel, for faces of 2 x area (T,) px²."""
        height, width, _ = self.levels[0].shape
        scale = self.uv.new_tensor([width, height])
        a, b, c = (self.uv * scale)[self.faces.long()].unbind(-2)
        texels = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).abs()
        return 0.5 * torch.log2(texels.clamp_min(1e-6) / doubled_area.clamp_min(1e-6))


def bilinear(image: Tensor, uv: Tensor) -> Tensor:
    """Bilinear look-up (N, 3) in an image (h, w, 3) that repeats; texels end at integers."""
    height, width, _ = image.shape
    x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
    left, top = x.floor(), y.floor()
    across, down = (x - left)[:, None], (y - top)[:, None]
    columns = [(left.long() + step) % width for step in (0, 1)]
    rows = [(top.long() + step) % height for step in (0, 1)]
    upper = torch.lerp(image[rows[0], columns[0]], image[rows[0], columns[1]], across)
    lower = torch.lerp(image[rows[1], columns[0]], image[rows[1], columns[1]], across)
    return torch.lerp(upper, lower, down)
