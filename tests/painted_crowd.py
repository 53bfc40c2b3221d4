"""Images of several people, each in colours of their own, before a textured wall."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import torch
from crowds import Crowd
from numpy.typing import NDArray

from perfcap.pipeline.images import Frames
from perfcap.pipeline.pose_spread import parts_of_triangles
from perfcap.render import rasterize

_COLORS = (((150, 40, 40), (250, 120, 110)), ((40, 50, 140), (130, 150, 250)),
           ((120, 120, 20), (220, 230, 120)))  # fmt: skip
_WALL = ((70, 90, 60), (140, 170, 130))


@dataclass(frozen=True)
class PaintedCrowd:
    """A reader of frames that show a crowd, and who is where in them.

    Attributes:
        crowd: where everybody really is.
        noise: grey levels.
    """

    crowd: Crowd
    noise: float = 2.0

    def __len__(self) -> int:
        return self.crowd.candidates.frame_count

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        return self.pictures[view, start:stop]

    @cached_property
    def labels(self) -> NDArray[np.uint8]:
        """(C, F, H, W): 0 background, k the k-th person."""
        return np.stack([np.stack(row) for row in self._drawn[0]])

    @cached_property
    def pictures(self) -> NDArray[np.uint8]:
        """(C, F, H, W, 3)."""
        return np.stack([np.stack(row) for row in self._drawn[1]])

    @cached_property
    def _drawn(self) -> tuple[list[list[NDArray[np.uint8]]], list[list[NDArray[np.uint8]]]]:
        rng = np.random.default_rng(5)
        cameras, people = self.crowd.cameras, len(self.crowd.actors)
        parts = [parts_of_triangles(actor) for actor in self.crowd.actors]
        coats = [rng.uniform(*_COLORS[k], (1 + parts[k].max(), 3)) for k in range(people)]
        surfaces = [
            actor.surface(motion)
            for actor, motion in zip(self.crowd.actors, self.crowd.motions, strict=True)
        ]
        labels, pictures = [], []
        for view in range(cameras.views):
            size = cameras.size[view]
            noise = cv2.GaussianBlur(rng.normal(size=(*size, 3)), (0, 0), 3)
            wall = np.interp(noise, (noise.min(), noise.max()), (0, 1))
            wall = np.asarray(_WALL[0]) + wall * np.subtract(_WALL[1], _WALL[0])
            rows: tuple[list[NDArray[np.uint8]], list[NDArray[np.uint8]]] = ([], [])
            for frame in range(len(self)):
                image, label = wall.copy(), np.zeros(size, np.uint8)
                nearest = np.full(size, np.inf)
                for k, surface in enumerate(surfaces):
                    local = cameras.to_camera(surface[frame])[view]
                    pixels = cameras.project_camera(local[None].expand(cameras.views, -1, -1))
                    faces = torch.as_tensor(self.crowd.actors[k].template.faces.copy())
                    drawn = rasterize(pixels[view], local[:, 2], faces, size)
                    depth = drawn.depth.numpy()
                    front = depth < nearest
                    part = drawn.label(torch.from_numpy(parts[k]), 0).numpy()
                    image[front] = coats[k][part[front]]
                    label[front], nearest[front] = k + 1, depth[front]
                image += self.noise * rng.normal(size=image.shape)
                rows[0].append(label)
                rows[1].append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
            labels.append(rows[0])
            pictures.append(rows[1])
        return labels, pictures
