"""Silhouettes of one person as a body is fitted to them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import torch
from torch import Tensor, nn

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera

_ROUNDING = 1e-3  # of a value, as of masks that were resized


@dataclass(frozen=True, eq=False)
class PersonMasks:
    """Where a person is in images.

    Attributes:
        cameras: C views in pixels of the masks, (C,) or (F, C).
        inside: (F, C, H, W), bool or 0 to 1; views of other sizes are padded.
        known: which pixels say anything, of a shape that broadcasts to ``inside``; all if None.
            What lies beyond an image is unknown rather than empty.
    """

    cameras: Camera
    inside: Tensor
    known: Tensor | None = None

    def __post_init__(self) -> None:
        if self.inside.ndim != 4 or self.inside.shape[1] != self.cameras.views:
            raise InputError(
                f"masks have shape {tuple(self.inside.shape)}; expected (F, C, H, W) of "
                f"{self.cameras.views} views"
            )
        ends = self.inside.detach()
        low, high = (float(x) for x in ends.aminmax()) if ends.numel() else (0.0, 1.0)
        if not -_ROUNDING <= low <= high <= 1 + _ROUNDING:
            raise InputError(
                f"masks have values from {low:g} to {high:g}; expected bool, or 0 to 1: divide "
                "bytes by 255"
            )

    @classmethod
    def padded(cls, cameras: Camera, views: list[Tensor]) -> PersonMasks:
        """Of views of any sizes.

        Args:
            cameras: C views in pixels of the images.
            views: C masks, (F, H_c, W_c) each, bool or 0 to 1; soft ones stay soft.

        Raises:
            InputError: they are of another number of views, or have other values.
        """
        height, width = (max(view.shape[axis] for view in views) for axis in (1, 2))
        kind = reduce(torch.promote_types, (view.dtype for view in views))
        size = (len(views), height, width)
        inside = torch.zeros(len(views[0]), *size, dtype=kind, device=views[0].device)
        known = torch.zeros(size, dtype=torch.bool, device=views[0].device)
        for number, view in enumerate(views):
            rows, columns = view.shape[1:]
            inside[:, number, :rows, :columns] = view
            known[number, :rows, :columns] = True
        return cls(replace(cameras, size=((height, width),) * len(views)), inside, known)

    def frames(self, index: slice) -> PersonMasks:
        """Those of some frames."""
        own = self.known
        known = own[index] if own is not None and own.ndim == 4 and len(own) > 1 else own
        return PersonMasks(self.cameras.frames(index), self.inside[index], known)

    def shrunk(self, factor: int) -> PersonMasks:
        """Averages over blocks of ``factor`` pixels, with the cameras of the small images."""
        small = _averaged(self.inside, factor)
        known = None if self.known is None else _averaged(self.known, factor)
        intrinsics = self.cameras.intrinsics.clone()
        # pixel centres are integers: the image corner is half a pixel before the first of them
        intrinsics[..., :2, 2] += 0.5
        intrinsics[..., :2, :] /= factor
        intrinsics[..., :2, 2] -= 0.5
        sizes = ((small.shape[-2], small.shape[-1]),) * self.cameras.views
        return PersonMasks(replace(self.cameras, intrinsics=intrinsics, size=sizes), small, known)


def _averaged(images: Tensor, factor: int) -> Tensor:
    height, width = (size // factor * factor for size in images.shape[-2:])
    cut = images[..., :height, :width].double()
    small = nn.functional.avg_pool2d(cut.reshape(-1, 1, height, width), factor)
    return small.reshape(*cut.shape[:-2], *small.shape[-2:])
