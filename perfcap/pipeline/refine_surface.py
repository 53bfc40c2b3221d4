"""The surface pulled onto the silhouettes by a deformation graph (Xu et al. 2018, Sec. 5.3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.actor.embedded_points import EmbeddedPoints
from perfcap.actor.motion import Motion
from perfcap.energy.contour_alignment import ContourAlignment
from perfcap.energy.rigidity import Rigidity
from perfcap.energy.tether import Tether
from perfcap.geometry.folding import find_folds
from perfcap.memory import give_back
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, Codec, Kept
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.objective import kernel
from perfcap.pipeline.overlap import (
    blocks,
    clip_overlaps,
    frame_overlap,
    frame_overlaps,
    keep_better,
)
from perfcap.pipeline.sight import Sight, View
from perfcap.pipeline.surface import SurfaceFrames
from perfcap.pipeline.surface_config import RefineSurfaceConfig
from perfcap.pipeline.track_motion import Progress
from perfcap.segment import Contour, Correspondences, stack
from perfcap.solve import Energy, Objective, TruncatedNewton, solve
from perfcap.temporal.smoothing import binomial, smooth_vectors


@dataclass(frozen=True, eq=False)
class DeformedSurface:
    """The skinned surface carried along by a deformation graph, computed when it is asked for.

    Attributes:
        actor: whose surface.
        graph: of its template.
        motion: (F,).
        layers: deformations (F, M), each of the surface that the ones before it make.
        share: of every deformation that counts, (F,); all of it when None.
    """

    actor: Actor
    graph: DeformationGraph
    motion: Motion
    layers: tuple[Deformation, ...] = ()
    share: Tensor | None = None

    @property
    def frames(self) -> int:
        """F."""
        return self.motion.frames

    def __getitem__(self, span: slice) -> Tensor:
        with torch.no_grad():
            vertices = self.actor.surface(self.motion[span])
            for layer in self.layers:
                vertices = self.graph(vertices, self._part(layer, span).to(vertices))
            return vertices

    def deformed(self, layer: Deformation) -> DeformedSurface:
        """This surface with one more layer."""
        return replace(self, layers=(*self.layers, layer))

    def faded(self, share: Tensor) -> DeformedSurface:
        """This surface with a share (F,) of every deformation."""
        return replace(self, share=None if bool((share == 1).all()) else share)

    def _part(self, layer: Deformation, span: slice) -> Deformation:
        """A layer of some frames, as far as it counts: clips are long, and copies of them large."""
        part = layer[span]
        if self.share is None:
            return part
        each = self.share[span, None, None].to(part.rotation)
        return Deformation(each * part.rotation, each * part.translation)


@dataclass(frozen=True)
class SurfaceRefinement:
    """The deforming surface, and how well it overlaps its masks.

    Attributes:
        surface: of every frame.
        before: intersection over union of the skinned surface with the masks, (F,).
        after: of the refined surface, (F,).
        kept: False in frames that a layer would have made worse, or folded, and that have the
            deformation of their neighbours in it; and in frames that this would have made worse,
            and that are the skinned surface, (F,).
        folded: share of each frame's surface that the deformation folded over, (F,).
    """

    surface: SurfaceFrames
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    kept: NDArray[np.bool_]
    folded: NDArray[np.float64]


def refine_surface(
    actor: Actor,
    graph: DeformationGraph,
    sight: Sight,
    evidence: Evidence,
    motion: Motion,
    config: RefineSurfaceConfig,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> SurfaceRefinement:
    """Minimise E_con + w_arap E_arap in every frame, smooth over a centred window, and settle.

    Smoothing takes fast cloth off its silhouette. So the smoothed surface is pulled back onto it,
    as a stiff whole that keeps its shape, and what that adds is smoothed as well, some times over
    (``config.settle``; none in the paper): n layers leave (1 - H)^(n + 1) of a movement of which
    one keeps H, which passes what is slow and stops jitter more sharply than one narrow window.

    Args:
        actor: skinned by the motion, which gives the canonical surface of each frame.
        graph: of the actor's template.
        sight: cameras in the pixels of the masks.
        evidence: masks and their contours.
        motion: (F,).
        config: rounds, weights, units.
        workers: threads; all cores when not given.
        progress: called with (frames done, frames).
        checkpoint: keeps finished blocks.
    """
    surface = DeformedSurface(actor, graph, motion)
    passes = [(config.rigidity, config.smoothing)]
    passes += [((rigidity,), config.settle_smoothing) for rigidity in config.settle]
    outcomes: list[_Outcome] = []
    for number, (rigidity, width) in enumerate(passes):
        solver = _Solver(surface, sight, evidence, config, rigidity)

        def tell(done: int, before: int = motion.frames * number) -> None:
            if progress is not None:
                progress(before + done, motion.frames * len(passes))

        layer, outcome = _solved(solver, workers, tell, checkpoint.kept(f"refine_surface_{number}"))
        outcomes.append(outcome)
        _smooth(surface, layer, outcome.kept, width)
        surface = surface.deformed(layer)
        give_back()

    rounds = count()

    def overlaps(surface: DeformedSurface) -> NDArray[np.float64]:
        kept = checkpoint.kept(f"refine_surface_overlap_{next(rounds)}")
        return clip_overlaps(surface, sight, evidence, workers, kept)

    before = outcomes[0].before
    surface, after, better = keep_better(surface.faded, overlaps, before)
    kept = np.logical_and.reduce([better, *(outcome.kept for outcome in outcomes)])
    folded = np.max([outcome.folded for outcome in outcomes], axis=0)
    return SurfaceRefinement(surface, before, after, kept, folded)


@dataclass(frozen=True)
class _Outcome:
    """Whether deformations of some frames did any good, and what they folded over."""

    before: NDArray[np.float64]
    kept: NDArray[np.bool_]
    folded: NDArray[np.float64]


def _solved(
    solver: _Solver, workers: int | None, tell: Callable[[int], None], kept: Kept
) -> tuple[Deformation, _Outcome]:
    """One layer of the whole clip, written block after block where it stays."""
    graph, frames = solver.surface.graph, solver.surface.frames
    device = solver.surface.motion.angles.device
    layer = Deformation(*torch.zeros(2, frames, len(graph), 3, device=device))
    parts = blocks(0, frames)
    outcomes = []
    results = kept.each(_BLOCK, solver.solve, parts, workers)
    for span, (part, outcome) in zip(parts, results, strict=True):
        layer.rotation[span.start : span.stop] = part.rotation
        layer.translation[span.start : span.stop] = part.translation
        outcomes.append(outcome)
        tell(span.stop)
    names = ("before", "kept", "folded")
    return layer, _Outcome(*(np.concatenate([getattr(o, n) for o in outcomes]) for n in names))


_BLOCK: Codec[tuple[Deformation, _Outcome]] = Codec(
    lambda result: {
        "rotation": result[0].rotation.numpy(force=True),
        "translation": result[0].translation.numpy(force=True),
        **vars(result[1]),
    },
    lambda record: (
        Deformation(*(torch.from_numpy(record.pop(name)) for name in ("rotation", "translation"))),
        _Outcome(**record),
    ),
)


@dataclass(frozen=True)
class _Solver:
    """Rounds of correspondence and deformation.

    Every frame is a batch element of its own: a block of frames is work shared out, and which
    frames share it must not change a surface.
    """

    surface: DeformedSurface
    sight: Sight
    evidence: Evidence
    config: RefineSurfaceConfig
    rigidity: tuple[float, ...]

    def solve(self, frames: range) -> tuple[Deformation, _Outcome]:
        """One block of frames; those without a contour are not kept."""
        span = slice(frames.start, frames.stop)
        graph, sight = self.surface.graph, self.sight
        canonical = deformed = self.surface[span]
        contours = [self.evidence.contours(f) for f in frames]
        deformation = graph.identity(canonical)
        before = np.empty(len(frames))
        drawn = self._measured(sight.stream(canonical, span), frames, before)
        for weight in self.rigidity:
            pairs = self._pairs(drawn, contours, canonical)
            objective = self._objective(canonical, pairs, span, weight)
            method = TruncatedNewton(max_steps=self.config.max_steps)
            apart = solve(objective, _apart(deformation), method).state
            deformation = Deformation(apart.rotation.squeeze(1), apart.translation.squeeze(1))
            deformed = graph(canonical, deformation)
            drawn = sight.stream(deformed, span)
        folds = find_folds(canonical, deformed, sight.faces).share.numpy(force=True)
        seen = np.array([any(len(line) for line in row) for row in contours])
        outlines = sight.outlines(deformed, span)
        better = frame_overlaps(outlines, self.evidence, frames) >= before
        kept = seen & better & (folds <= self.config.folds)
        return deformation, _Outcome(before, kept, folds)

    def _measured(
        self, drawn: Iterable[list[View]], frames: range, overlaps: NDArray[np.float64]
    ) -> Iterator[list[View]]:
        """The same views, and on their way their overlap with masks, written to (f,)."""
        for place, (frame, row) in enumerate(zip(frames, drawn, strict=True)):
            outlines = [view.outline for view in row]
            overlaps[place] = frame_overlap(outlines, self.evidence, frame)
            yield row

    def _pairs(
        self, drawn: Iterable[list[View]], contours: list[list[Contour]], like: Tensor
    ) -> Correspondences:
        config, heights = self.config.contour, self.evidence.heights
        return stack(
            [
                self.sight.correspond(row, lines, config, heights)
                for row, lines in zip(drawn, contours, strict=True)
            ],
            like,
        )

    def _objective(
        self, canonical: Tensor, pairs: Correspondences, span: slice, weight: float
    ) -> Objective:
        graph, config = self.surface.graph, self.config.contour
        canonical, pairs = canonical.unsqueeze(1), pairs.apart()
        corners, shares = pairs.vertices.flatten(-3, -2), pairs.weights.flatten(-3, -2)
        contour = ContourAlignment(
            EmbeddedPoints(graph, canonical, corners, shares),
            self.sight.cameras.frames(span).apart(),
            pairs,
            config.weight,
            kernel(config.scale),
            config.deviation * self.evidence.pixel_unit,
        )
        nodes = graph.nodes(canonical)
        rigidity = Rigidity(graph, nodes, weight, unit=self.config.stretch)
        energies: dict[str, Energy[Deformation]] = {"contour": contour, "rigidity": rigidity}
        if self.config.tether > 0:
            energies["tether"] = Tether(len(graph), self.config.tether, unit=self.config.reach)
        return Objective(energies).to(canonical)


def _apart(deformation: Deformation) -> Deformation:
    """Every frame as a batch element of one frame."""
    return Deformation(deformation.rotation.unsqueeze(1), deformation.translation.unsqueeze(1))


def _smooth(
    surface: DeformedSurface, layer: Deformation, kept: NDArray[np.bool_], width: int
) -> None:
    """Average a layer over the frames kept in a centred window (MPC-31), in place.

    Averaged as seen from the bone that carries each node: a fold that rides on a swinging leg
    stands still there, and a mean in world axes would pull it back to where the leg was.
    Rotations of nodes are small, and means of their vectors means of rotations.
    """
    actor = surface.actor
    joints = actor.skin.rows()[2][surface.graph.node_vertex]  # the heaviest of each node
    turns = actor.joint_transforms(surface.motion)[0].to(layer.rotation)  # F J 3 3
    weights, taps = torch.from_numpy(kept).to(layer.rotation), binomial(width)
    for joint in set(joints.tolist()):
        nodes, turn = joints == joint, turns[:, joint]
        for values in (layer.rotation, layer.translation):
            local = values[:, nodes] @ turn  # rows: turn' v
            values[:, nodes] = smooth_vectors(local, taps, weights) @ turn.mT
