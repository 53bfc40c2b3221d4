"""Skeleton motion whose contours meet the edges of raw images (Rhodin et al. 2016, stage II).

Nothing is segmented and no background is known. The body is a volume of Gaussians; the objective is
that of the windows, detections and temporal prior included, and the contours' energy beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.volume import GAUSSIANS, GaussianCentres, Volume
from perfcap.actor.volume_fit import VolumeFit, fit_volume
from perfcap.energy.density_contour import DensityContour
from perfcap.geometry.camera import Camera
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, Codec, motions, tensors
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.images import Images
from perfcap.pipeline.objective import angle_bounds
from perfcap.pipeline.track_motion import MotionBlender, Progress
from perfcap.pipeline.volume_colors import color_volume
from perfcap.render.density import Splats
from perfcap.segment.edge_field import EdgeField, EdgeSettings, find_edges, shrunk
from perfcap.segment.edge_network import EdgeNetwork
from perfcap.setting_checks import Settings, require_counts, require_sizes
from perfcap.solve import LevenbergMarquardt, Objective, solve
from perfcap.temporal.window import Window, partition

_EDGE = 3.5  # deviations of a Gaussian that are sure to hold its contour
_RIM = 8  # px around a crop, for the filters


@dataclass(frozen=True)
class ContoursConfig(Settings):
    """Stage II of Rhodin et al. 2016; tuned on takes of ``experiments/contour_takes.py``."""

    enabled: bool = False
    gaussians: int = GAUSSIANS
    fit: VolumeFit = field(default_factory=VolumeFit)
    height: float = 240.0  # px, of the person where contours are compared; taller ones are shrunk
    weight: float = 1.0  # of a contour as long as one percent of the person's height
    bend: float = 0.25  # px^-2, curvature of an edge of strength one
    margin: float = 10.0  # percent of the person's height around the body, in which edges are known
    edges: EdgeSettings = field(default_factory=EdgeSettings)
    max_steps: int = 20
    tolerance: float = 1e-4
    support: float = 0.15  # share of the contour on edges below which a frame is not believed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "gaussians")
        require_sizes(self, "height", "bend")


@dataclass(frozen=True)
class ContourRefinement:
    """The refined motion, and what edges say of it.

    Attributes:
        motion: (F,).
        volume: the Gaussians whose contours met the images, with their colours (stage III).
        before: share of the contour on edges under the motion given, (F,), -1 to 1.
        after: under the refined one.
        least: share below which a frame is not believed.
    """

    motion: Motion
    volume: Volume
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    least: float

    @property
    def doubtful(self) -> NDArray[np.bool_]:
        """Frames in which contours met next to no edges, (F,)."""
        found: NDArray[np.bool_] = self.after < self.least
        return found

    def report(self) -> dict[str, list[float]]:
        """Shares of the contour on edges, as plain values."""
        return {
            name: [round(float(value), 4) for value in values]
            for name, values in (("support_before", self.before), ("support_after", self.after))
        }


def refine_contours(
    problem: ClipProblem,
    images: Images,
    heights: Tensor,
    motion: Motion,
    config: ContoursConfig,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> ContourRefinement:
    """Minimise the objective of the motion and the contours' energy, window by window.

    Args:
        problem: the actor, and the windows, detections and prior of its motion.
        images: F frames and the cameras in their pixels.
        heights: of the upright person in each image, (C,) px.
        motion: (F,).
        config: settings.
        workers: threads; all cores when not given.
        progress: called with (frames done, frames).
        checkpoint: keeps the volume and finished windows.
    """
    volume = _volume(problem, config, checkpoint)
    sight = ContourSight.of(images, heights.to(motion.angles), config, motion.angles)
    points = GaussianCentres(problem.actor.skeleton, volume)
    windows = partition(motion.frames, problem.config.window, problem.config.overlap)

    def seen(done: int) -> Iterator[tuple[Window, list[list[Patch]]]]:
        for window in windows[done:]:  # by one thread: a video is read in order
            yield window, sight.patches(points(motion[window.index]), volume, window)

    def refined(task: tuple[Window, list[list[Patch]]]) -> tuple[Motion, Tensor]:
        window, patches = task
        return _solve(problem, sight, points, volume, motion[window.index], window, patches)

    blender, shares = MotionBlender(), np.zeros((2, motion.frames))
    kept = checkpoint.kept("refine_contours")
    parts = kept.rest(_codec(motion.angles), refined, seen, len(windows), workers)
    for window, (part, support) in zip(windows, parts, strict=True):
        blender.push(window, part)
        shares[:, window.index] = support.numpy(force=True)
        if progress is not None:
            progress(window.stop, motion.frames)
    found = blender.finish(problem.actor.skeleton)
    (colors,) = checkpoint.kept("volume_colors").once(
        tensors(motion.angles), lambda: (_colors(volume, points, found, images),)
    )
    volume = replace(volume, colors=colors)
    return ContourRefinement(found, volume, shares[0], shares[1], config.support)


def _solve(
    problem: ClipProblem,
    sight: ContourSight,
    points: GaussianCentres,
    volume: Volume,
    motion: Motion,
    window: Window,
    patches: list[list[Patch]],
) -> tuple[Motion, Tensor]:
    """The motion of a window, and the share of contours on edges before and after, (2, W)."""
    cameras, config = sight.cameras.frames(window.index), sight.config
    fields = [[sight.edges(patch) for patch in row] for row in patches]
    start = points(motion)
    shift = sight.shift(start, window)
    contour = DensityContour(
        points, volume, cameras, fields, config.weight, sight.unit, bend=config.bend, shift=shift
    )
    contour.offset = -contour.lower_bound(start)
    terms = dict(problem.objective(window).items())
    method = LevenbergMarquardt(max_steps=config.max_steps, tolerance=config.tolerance)
    objective = Objective({"contours": contour, **terms})
    found: Motion = solve(objective, motion, method, angle_bounds(problem.actor)).state
    if sight.images.edges is not None:  # shares are of edges as they are
        contour.fields = [[patch.edges(config.edges) for patch in row] for row in patches]
    return found, torch.stack([contour.support(each) for each in (start, points(found))])


@dataclass(frozen=True)
class ContourSight:
    """Images in which the person is no taller than needed.

    Attributes:
        images: as they are.
        cameras: of the shrunk ones.
        unit: one percent of the person's height in each, (C,) px.
        config: settings.
    """

    images: Images
    cameras: Camera
    unit: Tensor
    config: ContoursConfig

    @classmethod
    def of(
        cls, images: Images, heights: Tensor, config: ContoursConfig, like: Tensor
    ) -> ContourSight:
        """Shrink every view in which the person is taller than ``config.height``."""
        cameras = images.cameras.to(like)
        shrink = (config.height / heights).clamp(max=1.0).tolist()
        sizes = tuple(
            (max(1, round(height * factor)), max(1, round(width * factor)))
            for (height, width), factor in zip(cameras.size, shrink, strict=True)
        )
        ratio = like.new_tensor(sizes) / like.new_tensor(cameras.size)  # C (rows, columns)
        lens = cameras.intrinsics.clone()
        # pixel centres are integers: the image corner is half a pixel before the first of them
        lens[..., :2, 2] += 0.5
        lens[..., :2, :] *= ratio.flip(-1)[..., None]
        lens[..., :2, 2] -= 0.5
        unit = 0.01 * heights * like.new_tensor(shrink)
        return cls(images, replace(cameras, intrinsics=lens, size=sizes), unit, config)

    def fields(self, points: Tensor, volume: Volume, window: Window) -> list[list[EdgeField]]:
        """Edges about the Gaussians at points (W, Q, 3), ``[W][C]``."""
        rows = self.patches(points, volume, window)
        return [[self.edges(patch) for patch in row] for row in rows]

    def edges(self, patch: Patch) -> EdgeField:
        """Edges of a part of an image, by the network of the images if they have one."""
        return patch.edges(self.config.edges, self.images.edges)

    def patches(self, points: Tensor, volume: Volume, window: Window) -> list[list[Patch]]:
        """Parts of the images about the Gaussians at points (W, Q, 3), ``[W][C]``."""
        cameras = self.cameras.frames(window.index)
        splats = Splats.seen_by(cameras, points, volume.deviations, volume.densities)
        wide = torch.stack((splats.form[..., 2], splats.form[..., 0]), -1)
        determinant = splats.form[..., 0] * splats.form[..., 2] - splats.form[..., 1].square()
        reach = _EDGE * (wide / determinant[..., None]).sqrt()
        pad = self.config.margin * self.unit[:, None]
        low = (splats.centre - reach).amin(-2) - pad
        high = (splats.centre + reach).amax(-2) + pad
        columns = [
            self._view(view, low[:, view].tolist(), high[:, view].tolist(), window)
            for view in range(cameras.views)
        ]
        return [list(row) for row in zip(*columns, strict=True)]

    def shift(self, points: Tensor, window: Window) -> Tensor | None:
        """How far Gaussians at points (W, Q, 3) are moved in images of another time, or None.

        On parabolas through each frame and those about it; (W, C, Q, 2) px.
        """
        if self.images.lag is None or len(points) < 2:
            return None
        lag = self.images.lag[window.index].nan_to_num().to(points)[..., None, None]
        (speed,) = torch.gradient(points, dim=0)
        bend = torch.zeros_like(points)
        bend[1:-1] = points[2:] - 2 * points[1:-1] + points[:-2]
        moved = lag * speed[:, None] + 0.5 * lag.square() * bend[:, None]
        _, slope = self.cameras.frames(window.index).linearize(points)
        return (slope @ moved[..., None]).squeeze(-1)

    def _view(
        self, view: int, low: list[list[float]], high: list[list[float]], window: Window
    ) -> list[Patch]:
        found, size, lag = [], self.cameras.size[view], self.images.lag
        for frame in range(window.start, window.stop):
            if lag is not None and bool(lag[frame, view].isnan()):
                found.append(Patch.none())
                continue
            (image,) = self.images.reader.read_view(view, frame, frame + 1)
            box = _clamped(low[frame - window.start], high[frame - window.start], size)
            found.append(Patch.cut(shrunk(image, size), box))
        return found


def _clamped(
    low: list[float], high: list[float], size: tuple[int, int]
) -> tuple[int, int, int, int]:
    """Top, left, bottom and right of a box (x, y) within an image; empty where it is outside."""
    far = np.array(size[::-1], dtype=np.float64)
    first = np.clip(np.nan_to_num(low), 0, far)
    last = np.clip(np.ceil(np.nan_to_num(high)), first, far)
    return int(first[1]), int(first[0]), int(last[1]), int(last[0])


@dataclass(frozen=True)
class Patch:
    """A part of an image.

    Attributes:
        pixels: RGB, with a rim for the filters where the image goes on.
        corner: row and column of the part's first pixel in the image.
        first: those of the first of ``pixels``.
        size: height and width of the part.
    """

    pixels: NDArray[np.uint8]
    corner: tuple[int, int]
    first: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def none(cls) -> Patch:
        """No pixel."""
        return cls(np.zeros((0, 0, 3), np.uint8), (0, 0), (0, 0), (0, 0))

    @classmethod
    def cut(cls, image: NDArray[np.uint8], box: tuple[int, int, int, int]) -> Patch:
        """Rows and columns of a box: top, left, bottom, right."""
        top, left, bottom, right = box
        if bottom <= top or right <= left:
            return cls.none()
        first = max(0, top - _RIM), max(0, left - _RIM)
        pixels = image[first[0] : bottom + _RIM, first[1] : right + _RIM].copy()
        return cls(pixels, (top, left), first, (bottom - top, right - left))

    def edges(self, settings: EdgeSettings, network: EdgeNetwork | None = None) -> EdgeField:
        """Edges of the part, as they are or as a network weighs them."""
        height, width = self.size
        if not height:
            none = np.zeros((2, 0, 0), np.float32)
            return EdgeField(none, none[0], self.corner)
        if network is None:
            plain = find_edges(self.pixels, settings)
            whole = np.concatenate((plain.edges, plain.flat[None]))
        else:
            whole = network.look(self.pixels)
        top, left = self.corner[0] - self.first[0], self.corner[1] - self.first[1]
        found = np.ascontiguousarray(whole[:, top : top + height, left : left + width])
        return EdgeField(found[:2], found[2], self.corner)


def _colors(volume: Volume, points: GaussianCentres, motion: Motion, images: Images) -> Tensor:
    colors = color_volume(volume, points, motion, images).colors
    assert colors is not None
    return colors


def _volume(problem: ClipProblem, config: ContoursConfig, checkpoint: Checkpoint) -> Volume:
    like = problem.pixel_unit

    def parts() -> tuple[Tensor, ...]:
        found = fit_volume(problem.actor, config.gaussians, config.fit)
        return found.centres, found.deviations, found.densities, found.joints

    return Volume(*checkpoint.kept("volume").once(tensors(like), parts)).to(like)


def _codec(like: Tensor) -> Codec[tuple[Motion, Tensor]]:
    motion = motions(like)
    return Codec(
        lambda result: {**motion.pack(result[0]), "support": result[1].numpy(force=True)},
        lambda record: (
            motion.unpack({k: v for k, v in record.items() if k != "support"}),
            torch.from_numpy(record["support"]),
        ),
    )
