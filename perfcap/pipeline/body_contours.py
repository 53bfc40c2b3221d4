"""Edges of raw images as evidence of a body's shape (Rhodin et al. 2016, stage II)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from torch import Tensor

from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shaped_volume import ShapedGaussians
from perfcap.energy.density_contour import DensityContour
from perfcap.errors import InputError
from perfcap.pipeline.images import Images
from perfcap.pipeline.refine_contours import ContoursConfig, ContourSight
from perfcap.temporal.window import Window

_SHORTEST = 10.0  # px, of a person whose outline shows anything


@dataclass(frozen=True)
class BodyContours:
    """Images of F frames that a body is fitted to.

    Attributes:
        images: they, and cameras in their pixels.
        heights: of the upright person in each view, (C,) px.
        config: settings of contours and edges.
    """

    images: Images
    heights: Tensor
    config: ContoursConfig = field(default_factory=ContoursConfig)

    def __post_init__(self) -> None:
        if not isinstance(self.images, Images) or not isinstance(self.heights, Tensor):
            kinds = f"{type(self.images).__name__} and {type(self.heights).__name__}"
            raise InputError(f"body contours: got {kinds}, expected Images and a tensor of heights")
        views = self.images.cameras.views
        tall = self.heights.shape == (views,) and bool((self.heights >= _SHORTEST).all())
        if not tall or not bool(self.heights.isfinite().all()):
            raise InputError(
                f"body contours: heights are {self.heights.tolist()!s:.80}, expected those of the "
                f"person in {views} views, ({views},) px, at least {_SHORTEST:.0f}"
            )

    def energy(
        self, body: ShapedGaussians, motion: Motion, pixels: float, weight: float
    ) -> DensityContour:
        """Contours of the body against edges about where it is now.

        Args:
            body: its Gaussians.
            motion: poses and shape, (F,).
            pixels: height of the person in the images that are looked at; larger ones are shrunk.
            weight: of a contour as long as one percent of the person's height.
        """
        if len(self.images.reader) != motion.frames:
            raise InputError(
                f"body contours: images have {len(self.images.reader)} frames but the motion "
                f"{motion.frames}; give those of the same frames"
            )
        config = replace(self.config, height=pixels)
        sight = ContourSight.of(self.images, self.heights, config, motion.angles)
        points, now = body(motion), body.volume(motion.shared[BODY])
        fields = sight.fields(points[..., :3], now, Window(0, motion.frames))
        contour = DensityContour(
            body, now, sight.cameras, fields, weight, sight.unit, bend=config.bend
        )
        contour.offset = -contour.lower_bound(points)
        return contour
