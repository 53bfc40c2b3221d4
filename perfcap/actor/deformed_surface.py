"""A surface that a graph deforms at rest and a skeleton then poses: of two unknowns, not one."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from types import ModuleType

import torch
from torch import Tensor, nn

from perfcap.actor._skinned_points_torch import Chosen, Skin, blended
from perfcap.actor.actor import Actor
from perfcap.actor.deformation import BLOCK, Deformation
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.actor.embedded_points import EmbeddedPoints
from perfcap.actor.motion import Motion
from perfcap.actor.points import Linearized
from perfcap.actor.surface_points import SkinnedPoints, joint_table
from perfcap.geometry.rotation import quaternion_to_matrix
from perfcap.solve.compound import Compound

# --- Chosen vertices that rest elsewhere than the template has them, frame by frame ---------------


class RestingPoints(SkinnedPoints):
    """Vertices of an actor's surface, skinned from other places at rest.

    Args:
        actor: whose skin.
        corners: vertices, (*b, F, N, 1) integer.
        rest: where they rest in each frame, (*b, F, N, 3), metres.
    """

    def __init__(self, actor: Actor, corners: Tensor, rest: Tensor) -> None:
        super().__init__(actor, corners, torch.ones_like(rest[..., :1]))
        self.rest = rest

    def turns(self, motion: Motion) -> Tensor:
        """Derivative of the points in where they rest, (*b, F, N, 3, 3): blended rotations."""
        table = joint_table(*self.actor.joint_transforms(motion))
        real = blended(super()._skin(), super()._chosen(motion), table)[..., 0, :4]
        return quaternion_to_matrix(real / real.norm(dim=-1, keepdim=True))

    def _twin(self, *given: Tensor) -> ModuleType:
        return super()._twin(*given, self.rest)

    def _skin(self) -> Skin:
        template, corners = super()._skin(), self.corners.flatten()
        return Skin(self.rest.reshape(-1, 3), *(rows[corners] for rows in template[1:]))

    def _chosen(self, motion: Motion) -> Chosen:
        chosen = super()._chosen(motion)
        count = chosen.corners.numel()
        own = torch.arange(count, device=chosen.corners.device)
        return Chosen(own.reshape(chosen.corners.shape), chosen.weights)


# --------------------------------------------------------------------------------------------------
# A surface that a graph deforms at rest and a skeleton then poses: of two unknowns, not one.

MOTION, DEFORMATION = "motion", "deformation"
"""The parts of a state that a deformed surface sees."""


class DeformedSurface(nn.Module):
    """Vertices ``skin(motion, deform(template))`` of a ``Compound`` of motion and deformation.

    The graph deforms the template as it rests, frame by frame, and dual quaternions pose what it
    makes of it. A fold thus rides on the limb it belongs to, and what a deformation costs does not
    depend on the pose. Both maps are known in closed form: for a vertex of a pose, skinning is an
    affine map of its place at rest.

    Args:
        actor: whose surface.
        graph: of its template, (V,) vertices.
    """

    sees: Collection[str] = ()

    def __init__(self, actor: Actor, graph: DeformationGraph) -> None:
        super().__init__()
        self.actor, self.graph = actor, graph

    def start(self, motion: Motion) -> Compound:
        """The state of a motion (*b, F) without deformation."""
        lead = motion.angles.shape[:-1]
        still = Deformation.identity(lead, len(self.graph), motion.angles)
        return Compound({MOTION: motion, DEFORMATION: still})

    def forward(self, state: Compound) -> Tensor:
        """Vertices in the world, (*b, F, V, 3), metres."""
        motion, deformation = state.parts[MOTION], state.parts[DEFORMATION]
        lead = motion.angles.shape[:-1]
        rest = self.actor.vertices.expand(*lead, *self.actor.vertices.shape)
        return self.actor.surface(motion, self.graph(rest, deformation))

    def nodes(self, lead: tuple[int, ...]) -> Tensor:
        """Rest positions of the graph's nodes for frames (*b, F), (*b, F, M, 3), metres."""
        nodes = self.actor.vertices[self.graph.node_vertex]
        return nodes.expand(*lead, *nodes.shape)

    @property
    def points(self) -> ChosenOf:
        """What makes ``DeformedPoints`` of vertices and weights."""
        return ChosenOf(self)


@dataclass(frozen=True)
class ChosenOf:
    """Makes points of a deformed surface; they tell what each of them sees (``in_parts``)."""

    surface: DeformedSurface
    in_parts = True

    def __call__(self, corners: Tensor, weights: Tensor) -> DeformedPoints:
        """Points with these corners."""
        return DeformedPoints(self.surface, corners, weights)


@dataclass(frozen=True)
class PointParts:
    """Points and their derivative in what each of them sees.

    Attributes:
        points: in the world, (*b, F, N, 3), metres.
        motion: derivative in the motion's unknowns, (*b, F, N, 3, 6 + A).
        blocks: nodes that a point sees, (*b, F, N, k), -1 for none.
        nodes: derivative in their rotations and translations, (*b, F, N, k, 3, 6), zero for none.
        motion_at: where the motion's unknowns are among all of a frame.
        nodes_at: where those of the nodes are.
        dim: D, all unknowns of a frame.
    """

    points: Tensor
    motion: Tensor
    blocks: Tensor
    nodes: Tensor

    motion_at: slice
    nodes_at: slice
    dim: int

    def dense(self) -> Tensor:
        """The derivative in all unknowns of a frame, (*b, F, N, 3, D)."""
        whole = self.motion.new_zeros(*self.motion.shape[:-1], self.dim)
        whole[..., self.motion_at] = self.motion
        nodes = self.nodes.transpose(-3, -2).flatten(-2)  # *b F N 3 6k
        index = self.nodes_at.start + BLOCK * self.blocks.clamp(min=0).unsqueeze(-1)
        index = (index + torch.arange(BLOCK).to(index)).flatten(-2).unsqueeze(-2)
        return whole.scatter_add(-1, index.expand_as(nodes), nodes)

    def frames(self) -> Iterator[PointParts]:
        """Those of every frame alone, without its axes; batches one after another."""
        each = (self.points, 3), (self.motion, 4), (self.blocks, 3), (self.nodes, 5)
        flat = [tensor.flatten(0, -axes) for tensor, axes in each]
        for points, motion, blocks, nodes in zip(*flat, strict=True):
            yield replace(self, points=points, motion=motion, blocks=blocks, nodes=nodes)


class DeformedPoints(nn.Module):
    """Chosen vertices of a deformed surface, as the ``Points`` that energies take.

    Equal to the same vertices of ``DeformedSurface.forward``, at the cost of these only.

    Args:
        surface: whose points.
        corners: vertices, (*b, F, N, 1) integer; leading axes may be left out down to (N, 1).
        weights: ones, the shape of ``corners``.
    """

    sees: Collection[str] = ()
    corners: Tensor

    def __init__(self, surface: DeformedSurface, corners: Tensor, weights: Tensor) -> None:
        super().__init__()
        if corners.shape[-1] != 1:
            raise ValueError(
                f"deformed points have {corners.shape[-1]} corners each; expected single vertices"
            )
        self.surface = surface
        self.register_buffer("corners", corners)

    @property
    def count(self) -> int:
        """N."""
        return self.corners.shape[-2]

    def forward(self, state: Compound) -> Tensor:
        """Points in the world, (*b, F, N, 3), metres."""
        motion = state.parts[MOTION]
        points: Tensor = self._posed(motion, self._embedded(motion)(state.parts[DEFORMATION]))(
            motion
        )
        return points

    def linearize(self, state: Compound) -> Linearized:
        """Points, and their derivative in all D unknowns of a frame."""
        parts = self.linearize_parts(state)
        return parts.points, parts.dense(), None

    def linearize_parts(self, state: Compound) -> PointParts:
        """Points, and their derivative in closed form where it is not zero."""
        motion = state.parts[MOTION]
        rest, blocks, deformed = self._embedded(motion).linearize_blocks(state.parts[DEFORMATION])
        posed = self._posed(motion, rest)
        points, moved, _ = posed.linearize(motion)
        turn = posed.turns(motion)  # *b F N 3 3
        places = state.columns(MOTION), state.columns(DEFORMATION), state.frame_dim
        return PointParts(points, moved, blocks, turn.unsqueeze(-3) @ deformed, *places)

    def _each(self, motion: Motion) -> Tensor:
        """Corners of every frame, (*b, F, N, 1)."""
        return self.corners.expand(*motion.angles.shape[:-1], *self.corners.shape[-2:])

    def _posed(self, motion: Motion, rest: Tensor) -> RestingPoints:
        return RestingPoints(self.surface.actor, self._each(motion), rest)

    def _embedded(self, motion: Motion) -> EmbeddedPoints:
        vertices, corners = self.surface.actor.vertices, self._each(motion)
        posed = vertices.expand(*corners.shape[:-2], *vertices.shape)
        return EmbeddedPoints(self.surface.graph, posed, corners, torch.ones_like(corners) + 0.0)
