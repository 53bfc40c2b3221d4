"""A rendered sequence whose silhouettes are spoiled before its surface is refined on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from recordings import Recording
from spoiled_masks import LARGEST, Fault, Floats, spoiling
from surface_recordings import Mask, SurfaceTruth, images_of

from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.metrics import surface_error
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_silhouettes import extract_silhouettes
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine import limb_of_triangles
from perfcap.pipeline.refine_surface import refine_surface
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surface import SkinnedSurface, SurfaceFrames

TRUSTS = ("as computed", "blind", "blind, not pruned")


@dataclass(frozen=True)
class Take:
    """A sequence captured up to the second silhouettes."""

    truth: SurfaceTruth
    found: Performance
    images: Images
    sight: Sight
    graph: DeformationGraph
    skinned: SurfaceFrames
    clean: Evidence

    @classmethod
    def read(cls, recording: Recording, frames: int) -> Take:
        """Capture the first frames of a sequence."""
        span = slice(0, frames)
        images = images_of(recording).frames(span)
        found = capture(
            recording.actor,
            recording.cameras.frames(span),
            recording.detections.frames(span),
            recording.rate,
            images=images,
            until=Stage.REFINE_POSE,
        )
        assert found.refinement is not None
        faces = torch.as_tensor(found.actor.template.faces.copy())
        cameras = images.cameras.to(found.motion.angles)
        limbs = limb_of_triangles(found.actor)
        return cls(
            SurfaceTruth.read(recording),
            found,
            images,
            Sight(cameras, faces, found.actor.template.weld()[0], limbs),
            DeformationGraph.build(found.actor.vertices, faces),
            SkinnedSurface(found.actor, found.motion),
            found.refinement.evidence,
        )

    @property
    def height(self) -> float:
        """Of the person, px."""
        return float(100 * self.clean.pixel_unit)

    def spoiled(self, fault: Fault) -> Evidence:
        """The second silhouettes with a fault."""
        views = [
            self.sight.look(self.skinned[f : f + 1], slice(f, f + 1))[0][0]
            for f in range(self.found.frames)
        ]
        assert isinstance(self.found.config, CaptureConfig)
        heights, settings = 100 * self.clean.pixel_unit, self.found.config.silhouettes.again
        actor, motion, reader = self.found.actor, self.found.motion, self.images.reader
        with spoiling(fault, views), torch.no_grad():
            return extract_silhouettes(
                actor, self.sight, reader, motion, heights, settings, workers=1
            )

    def refined(self, evidence: Evidence, trust: str) -> SurfaceFrames:
        """The surface that some masks make."""
        assert isinstance(self.found.config, CaptureConfig)
        settings, actor = self.found.config.refine_surface, self.found.actor
        if trust != TRUSTS[0]:
            full = tuple(tuple(np.full_like(t, 255) for t in row) for row in evidence.confidence)
            evidence = replace(evidence, confidence=full)
        pruned = trust != TRUSTS[2]
        matching = replace(settings.contour.matching, pruned=pruned)
        settings = replace(settings, contour=replace(settings.contour, matching=matching))
        parts = actor, self.graph, self.sight, evidence, self.found.motion, settings
        with torch.no_grad():
            return refine_surface(*parts).surface

    def good(self, spoiled: Evidence, frame: int) -> Mask:
        """Vertices of the truth that the good part of a spoiled mask shows, (V',)."""
        view = self.sight.look(self.skinned[frame : frame + 1], slice(frame, frame + 1))[0][0]
        changed = self.clean.silhouettes.mask(frame) ^ spoiled.silhouettes.mask(frame)
        far = distances(changed, view.pixels) > LARGEST * self.height
        chosen: Mask = far[self.truth.order]
        return chosen

    def share(self, spoiled: Evidence) -> float:
        """Of the contours' points that lie on something spoiled, in the mean over frames."""
        shares = []
        for frame in range(self.found.frames):
            changed = self.clean.silhouettes.mask(frame) ^ spoiled.silhouettes.mask(frame)
            points = self.clean.contours(frame)[0].points
            shares.append(float((distances(changed, points) < 2).mean()))
        return float(np.mean(shares))

    def errors(self, surface: SurfaceFrames, parts: Mapping[int, Mask | None]) -> Floats:
        """Of parts of some frames, by frame, mm; NaN of no vertices."""
        return np.array([self._error(surface, f, part) for f, part in parts.items()])

    def _error(self, surface: SurfaceFrames, frame: int, part: Mask | None) -> float:
        if part is not None and not part.any():
            return float("nan")
        truth, rng = self.truth, np.random.default_rng(0)
        vertices = surface[frame : frame + 1][0].double().numpy()[truth.order]
        return surface_error(vertices, truth.vertices[frame], truth.faces, rng, part).surface


def distances(marked: Mask, points: Floats) -> Floats:
    """Of points (N, 2) px to the nearest marked pixel of a picture (H, W), (N,) px."""
    if not marked.any():
        return np.full(len(points), np.inf)
    away = cv2.distanceTransform(1 - marked.astype(np.uint8), cv2.DIST_L2, 5)
    column, row = np.rint(points).astype(int).T
    found: Floats = away[row.clip(0, len(away) - 1), column.clip(0, away.shape[1] - 1)]
    return found
