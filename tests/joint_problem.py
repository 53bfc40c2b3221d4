"""A small person whose motion and surface are sought at once."""

from __future__ import annotations

import torch
from synthetic import actor, bent_motion, cameras
from torch import Tensor

from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.actor.deformed_surface import DeformedSurface
from perfcap.detect.detections import Detections
from perfcap.energy import PosePrior, Reprojection, Rigidity, SilhouetteOverlap, Tether, Trajectory
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.solve import Compound, Objective, Step, of_part

F64 = torch.float64
FRAMES, NODES = 2, 8


class JointProblem:
    """Two frames of a person of tubes in C views, whose outline bends by a known deformation."""

    def __init__(self, views: int = 2, size: int = 96, band: float = 8.0) -> None:
        self.actor = actor()
        faces = torch.tensor(self.actor.template.faces)
        self.graph = DeformationGraph.build(self.actor.vertices, faces, NODES)
        self.surface = DeformedSurface(self.actor, self.graph)
        self.cameras = cameras(views, size, distance=3.0)
        self.silhouette = SoftSilhouette(faces, (size, size), band)
        self.start = self.surface.start(bent_motion(self.actor.skeleton, FRAMES, seed=3))
        random = torch.Generator().manual_seed(0)
        step = 0.01 * torch.randn(FRAMES, self.start.frame_dim, generator=random, dtype=F64)
        self.truth = self.moved(self.start, step)
        self.masks = self.drawn(self.truth)
        self.joints = self.cameras.project(self.actor.joints(self.truth.parts["motion"]))

    def moved(self, state: Compound, step: Tensor) -> Compound:
        return state.retract(Step(step, state.coordinates().shared))

    def drawn(self, state: Compound) -> Tensor:
        return self.silhouette.seen_by(self.cameras, self.surface(state)).clone()

    def objective(
        self, masks: Tensor, joints: Tensor, weight: float = 5.0, rigid: float = 0.5
    ) -> Objective:
        """Joints, silhouettes, rigidity and the temporal prior."""
        seen = Detections.from_joints(joints, torch.ones_like(joints[..., 0]))
        reprojection = Reprojection(self.actor.landmarks, self.cameras, seen, weight=0.1)
        silhouettes = SilhouetteOverlap(
            self.surface, self.silhouette, self.cameras, masks, None, weight,
            points=self.surface.points,
        )  # fmt: skip
        rigidity = Rigidity(self.graph, self.surface.nodes((FRAMES,)), rigid, unit=0.01)
        return Objective(
            joints=of_part("motion", reprojection),
            prior=of_part("motion", PosePrior(torch.zeros(27, dtype=F64), 1.0, 0.1)),
            trajectory=of_part("motion", Trajectory(FRAMES, 1, 0.05)),
            silhouettes=silhouettes,
            rigidity=of_part("deformation", rigidity),
            tether=of_part("deformation", Tether(NODES, 0.3, unit=0.03)),
        )
