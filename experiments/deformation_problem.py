"""A surface to be deformed onto the silhouette of another: one frame of refinement, as data."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.actor import DeformationGraph, EmbeddedPoints
from perfcap.energy import ContourAlignment, Rigidity
from perfcap.geometry import Camera
from perfcap.io import load_actor
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.surface_config import ContourConfig
from perfcap.segment import Correspondences, extract_contour, stack
from perfcap.solve import GemanMcClure, Objective


@dataclass(frozen=True)
class Scene:
    """A posed surface (1, V, 3), its graph, and the camera that sees it."""

    graph: DeformationGraph
    posed: Tensor
    sight: Sight
    height: float  # px

    @classmethod
    def of(cls, nodes: int, size: int) -> Scene:
        """The default actor in its rest pose, four fifths of an image's side tall."""
        actor = load_actor("sam").double()
        vertices, faces = actor.vertices, torch.tensor(actor.template.faces)
        tall = float(vertices[:, 1].max() - vertices[:, 1].min())
        turn = torch.diag(torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64))
        middle = (vertices.amax(0) + vertices.amin(0)) / 2
        focal, half = 1.6 * size, size / 2
        camera = Camera(
            torch.tensor([[[focal, 0, half], [0, focal, half], [0, 0, 1]]], dtype=torch.float64),
            turn[None],
            (torch.tensor([0, 0, 2 * tall], dtype=torch.float64) - turn @ middle)[None],
            size=((size, size),),
        )
        graph = DeformationGraph.build(vertices, faces, nodes)
        sight = Sight(camera, faces, actor.template.weld()[0])
        return cls(graph, vertices[None], sight, focal / 2)

    def waves(self, amplitude: float, seed: int) -> Tensor:
        """The surface moved by a few smooth waves."""
        random = torch.Generator().manual_seed(seed)
        wave, phase = torch.randn(2, 3, 3, generator=random, dtype=torch.float64)
        return self.posed + amplitude * torch.sin(self.posed @ (4 * wave) + 6 * phase[0])

    def match(self, surface: Tensor, target: Tensor) -> Correspondences:
        """Pairs of the surface's contour with the silhouette of a target surface."""
        (seen,), (aim,) = (self.sight.look(x, slice(0, 1)) for x in (surface, target))
        contours = [extract_contour(view.mask) for view in aim]
        pairs = self.sight.correspond(seen, contours, ContourConfig(), [self.height])
        return stack([pairs], self.posed)

    def objective(self, pairs: Correspondences, weight: float, stretch: float) -> Objective:
        """Both energies of a round."""
        places = pairs.vertices.flatten(-3, -2), pairs.weights.flatten(-3, -2)
        points = EmbeddedPoints(self.graph, self.posed, *places)
        settings = ContourConfig()
        contour = ContourAlignment(
            points,
            self.sight.cameras,
            pairs,
            settings.weight,
            None if settings.scale is None else GemanMcClure(settings.scale),
            settings.deviation / 100 * self.height,
        )
        nodes = self.graph.nodes(self.posed)
        return Objective(
            contour=contour, rigidity=Rigidity(self.graph, nodes, weight, unit=stretch)
        )
