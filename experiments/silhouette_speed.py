"""CPU time of soft silhouettes, forward and backward to the projected vertices.

A person in random poses within the limits, filling the image height, band 2 px, float32, one
thread. Times are process CPU time a frame, which other programs on the same cores still lengthen:
compare rows of one run. The first call of a process also compiles the kernels.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import report
import torch
import trimesh
from report import Report, Table
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.geometry.camera import Camera
from perfcap.io.actor import load_actor
from perfcap.render.soft_silhouette import SoftSilhouette

_SKIRT = report.DATA / "rendered" / "dev_skirt" / "template.glb"
_REPEATS = 5
_Result = TypeVar("_Result")
_COLUMNS = ("vertices", "image", "forward, median ms", "least", "most", "backward, median ms",
            "least", "most", "both, median ms")  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    actor: str = str(_SKIRT) if Path(_SKIRT).is_file() else "sam"
    """Name or file of an actor; its mesh, and the same with every triangle split in four."""
    sizes: tuple[int, ...] = (256, 512, 1000)
    """Sides of the square image, px."""
    poses: int = 8
    """Random poses."""
    seed: int = 0
    """Of the poses."""


@dataclass(frozen=True)
class Timing:
    """CPU milliseconds of every frame and repeat."""

    forward: tuple[float, ...]
    backward: tuple[float, ...]

    def row(self) -> tuple[float, ...]:
        """Columns of the table after the first two."""
        both = [f + b for f, b in zip(self.forward, self.backward, strict=True)]
        spreads = ((statistics.median(t), min(t), max(t)) for t in (self.forward, self.backward))
        return (*(value for spread in spreads for value in spread), statistics.median(both))


def run(config: Experiment) -> Report:
    """Time every mesh and size."""
    torch.set_num_threads(1)
    actor = load_actor(config.actor)
    motion = random_motion(actor, config)
    place, first = (torch.tensor(index) for index in actor.template.weld())
    faces = place[torch.tensor(actor.template.faces)]
    posed = actor.surface(motion)[:, first].float()
    fine = [trimesh.remesh.subdivide(v.numpy(), faces.numpy()) for v in posed]
    meshes = (
        (posed, faces),
        (torch.stack([torch.tensor(v) for v, _ in fine]).float(), torch.tensor(fine[0][1])),
    )
    rows = tuple(
        (f"{vertices.shape[1]:,}", f"{size} px", *timed(vertices, triangles, size).row())
        for vertices, triangles in meshes
        for size in config.sizes
    )
    outline = outline_share(*meshes[0], config.sizes[-1])
    return Report(
        (Table(f"{actor.template.name}, {len(posed)} poses", _COLUMNS, rows),),
        (f"{100 * outline:.1f} % of the vertices have a gradient in the last of the sizes",),
    )


def outline_share(vertices: Tensor, faces: Tensor, size: int) -> float:
    """Part of the vertices that the outline of the silhouette sees."""
    local = camera(size).to(vertices).to_camera(vertices)[:, 0]
    pixels = camera(size).to(vertices).project_camera(local[:, None])[:, 0].requires_grad_()
    SoftSilhouette(faces, (size, size))(pixels, local[..., 2]).sum().backward()
    assert pixels.grad is not None
    return float(pixels.grad.any(-1).float().mean())


def random_motion(actor: Actor, config: Experiment) -> Motion:
    """Poses anywhere within the limits, turned about the vertical, feet about on the ground."""
    rng = torch.Generator().manual_seed(config.seed)
    lower, upper = actor.skeleton.lower, actor.skeleton.upper

    def uniform(*size: int) -> Tensor:
        return torch.rand(config.poses, *size, generator=rng, dtype=lower.dtype)

    upright = torch.tensor([0.0, 1.0, 0.0]).to(lower)
    return Motion(
        translation=0.1 * (uniform(3) - 0.5),
        rotation=6 * (uniform(1) - 0.5) * upright,
        angles=lower + (upper - lower) * uniform(len(lower)),
    )


def camera(size: int) -> Camera:
    """A view from 3 m in which 2.2 m fill the image height."""
    middle, focal = (size - 1) / 2, size * 3 / 2.2
    intrinsics = [[[focal, 0.0, middle], [0.0, focal, middle], [0.0, 0.0, 1.0]]]
    return Camera(
        torch.tensor(intrinsics).double(),
        torch.diag(torch.tensor([1.0, -1.0, -1.0]))[None].double(),
        torch.tensor([[0.0, 0.0, 3.0]]).double(),
        size=((size, size),),
    )


def timed(vertices: Tensor, faces: Tensor, size: int) -> Timing:
    """Each frame (F, V, 3) by itself; the first run, which compiles, does not count."""
    local = camera(size).to(vertices).to_camera(vertices)[:, 0]
    pixels = camera(size).to(vertices).project_camera(local[:, None])[:, 0]
    silhouette = SoftSilhouette(faces, (size, size))
    weight = torch.ones(size, size)
    forward, backward = [], []
    for frame in [0, *range(len(pixels))] * _REPEATS:
        inputs = pixels[frame].requires_grad_()
        coverage, one = _cpu(partial(silhouette, inputs, local[frame, :, 2]))
        _, other = _cpu(partial(torch.autograd.grad, coverage, inputs, weight))
        forward.append(one)
        backward.append(other)
    return Timing(tuple(forward[1:]), tuple(backward[1:]))


def _cpu(function: Callable[[], _Result]) -> tuple[_Result, float]:
    start = time.process_time()
    result = function()
    return result, 1e3 * (time.process_time() - start)


if __name__ == "__main__":
    report.main(run, Experiment, "silhouette_speed")
