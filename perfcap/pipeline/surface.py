"""The captured surface: vertices of the template in the world, for any span of frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.io.written_checks import SURFACE_APART

BLOCK = 16  # frames in memory at once
_LOOKED_AT = 9  # frames that are compared with the motion


class SurfaceFrames(Protocol):
    """Vertices of every frame, computed or kept.

    ``surface[span]`` are those of a span of frames, (f, V, 3) m in the world, in the order of the
    template's vertices; of any floating type and on any device.
    """

    @property
    def frames(self) -> int:
        """F."""
        ...

    def __getitem__(self, span: slice) -> Tensor: ...


@dataclass(frozen=True, eq=False)
class SkinnedSurface:
    """The surface that a motion gives an actor, skinned when it is asked for."""

    actor: Actor
    motion: Motion

    @property
    def frames(self) -> int:
        """F."""
        return self.motion.frames

    def __getitem__(self, span: slice) -> Tensor:
        with torch.no_grad():
            return self.actor.surface(self.motion[span])


@dataclass(frozen=True, eq=False)
class StoredSurface:
    """Vertices kept in memory, (F, V, 3) m."""

    vertices: Tensor

    @classmethod
    def empty(cls, frames: int, vertices: int) -> Self:
        """Room for a clip, float32 on the CPU, to be filled by ``write``; NaN until then."""
        return cls(torch.full((frames, vertices, 3), torch.nan, dtype=torch.float32))

    def write(self, start: int, vertices: Tensor) -> None:
        """Keep the vertices (f, V, 3) of frames ``start ...``."""
        self.vertices[start : start + len(vertices)] = vertices.detach()

    @property
    def frames(self) -> int:
        """F."""
        return len(self.vertices)

    def __getitem__(self, span: slice) -> Tensor:
        return self.vertices[span]


def surface_blocks(surface: SurfaceFrames, size: int = BLOCK) -> Iterator[NDArray[np.float32]]:
    """All frames in order as arrays (f, V, 3) float32, for files."""
    for start in range(0, surface.frames, size):
        yield surface[start : start + size].detach().cpu().float().numpy()


def surface_doubts(surface: SurfaceFrames, actor: Actor, motion: Motion) -> Iterator[str]:
    """Whether a captured surface is that of another motion: far from the skin in most frames.

    A few frames are looked at, and no more of the surface is read.

    Args:
        surface: F frames.
        actor: whom the motion moves.
        motion: (F,).
    """
    frames = min(surface.frames, motion.frames)
    some = torch.linspace(0, frames - 1, min(frames, _LOOKED_AT)).round().long().tolist()
    rest = actor.skeleton.rest_landmarks.detach()
    height = float(rest[:, 1].max() - rest[:, 1].min())
    apart = []
    for frame in some:
        with torch.no_grad():
            skin = actor.surface(motion[frame : frame + 1])
            kept = surface[frame : frame + 1].to(skin)
        if kept.shape != skin.shape:  # files refuse it
            return
        apart.append(float((kept - skin).norm(dim=-1).nanmedian()) / height)
    far = [each for each in apart if each > SURFACE_APART]
    if 2 * len(far) > len(apart):
        yield (
            f"the surface is not that of the motion: {len(far)} of {len(apart)} frames looked at "
            f"are up to {max(far):.0%} of the person's height from it; capture again, or leave out "
            "what is of the motion before: replace(..., surface=None, trust=None, contact=None)"
        )
