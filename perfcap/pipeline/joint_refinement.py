"""Motion and surface at once: joints, silhouettes, rigidity and the temporal prior in one solve."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.actor.deformed_surface import DEFORMATION, MOTION, DeformedSurface
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy.rigidity import Rigidity
from perfcap.energy.silhouette_overlap import SilhouetteOverlap
from perfcap.energy.tether import Tether
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.camera_checks import require_usable
from perfcap.pipeline.adapt import adapted
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.input_checks import require_kinds, require_trust
from perfcap.pipeline.input_doubts import warn_of_other_joints, warn_of_other_poses
from perfcap.pipeline.objective import FrameProblem, angle_bounds
from perfcap.pipeline.overlap import examined, warn_of_masks_elsewhere, warn_of_trust_within
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.prepare import prepare
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.resized_cameras import resized
from perfcap.pipeline.track_motion import MotionBlender
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.setting_checks import Settings, require_counts, require_metres
from perfcap.solve import (
    Adjoint,
    Bounds,
    Compound,
    Detached,
    Implicit,
    LevenbergMarquardt,
    Method,
    Objective,
    Solution,
    of_part,
    solve,
)
from perfcap.temporal.window import Blender, Window, mean_vectors, partition


@dataclass(frozen=True)
class JointConfig(Settings):
    """Weights and sizes of the joint refinement, in the units of ``RefineSurfaceConfig``.

    A silhouette counts as contour pairs there: by its energy for an outline that is off everywhere.
    """

    nodes: int = 40  # of the deformation graph: every frame's block is dense in them
    silhouettes: float = 1000.0  # for a band of 1 %
    bands: tuple[float, ...] = (2.5, 1.2)  # percent of the height, half the width, round by round
    rigidity: float = 0.2  # as in the last round of the surface's own method
    stretch: float = 0.003  # m, of an edge of the graph
    tether: float = 0.3
    reach: float = 0.03  # m
    method: Method = field(default_factory=lambda: LevenbergMarquardt(max_steps=8, tolerance=1e-3))

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.bands or not all(band > 0 for band in self.bands):
            raise InputError(f"bands are {self.bands}, expected one above zero for each round")
        require_counts(self, "nodes")
        require_metres(self, "stretch", "reach")


@dataclass(frozen=True)
class JointRefinement:
    """Motion and surface that one solve found.

    Attributes:
        surface: of the actor, a function of ``state``.
        state: parts ``"motion"`` and ``"deformation"`` (F,), with gradients where they were asked.
        windows: frames and solution of each window.
    """

    surface: DeformedSurface
    state: Compound
    windows: tuple[tuple[Window, Solution[Compound]], ...]

    @property
    def motion(self) -> Motion:
        """Of the skeleton, (F,)."""
        motion: Motion = self.state.parts[MOTION]
        return motion

    @property
    def deformation(self) -> Deformation:
        """Of the graph in each frame, at rest, (F, M)."""
        deformation: Deformation = self.state.parts[DEFORMATION]
        return deformation

    @property
    def frames(self) -> int:
        """F."""
        return self.motion.frames

    def vertices(self) -> Tensor:
        """The surface in the world, (F, V, 3), metres; differentiable."""
        vertices: Tensor = self.surface(self.state)
        return vertices

    def __getitem__(self, span: slice) -> Tensor:
        """The surface of some frames without gradients, as ``SurfaceFrames`` have it."""
        with torch.no_grad():
            vertices: Tensor = self.surface(self.state[span])
        return vertices


def refine_jointly(
    start: Performance,
    masks: Tensor,
    cameras: Camera | None = None,
    detections: Detections | None = None,
    config: JointConfig | None = None,
    *,
    trust: Tensor | None = None,
    adjoint: Adjoint | None = None,
) -> JointRefinement:
    """Find motion and deformation together from joints and silhouettes, window by window.

    One ``Objective`` holds the reprojected and 3D joints, the soft silhouettes of all views, the
    rigidity of the deformation graph and the trajectory prior (Xu et al. 2018, Eq. 3, 16 and 18,
    with coverage in place of contour pairs). Where masks, detections, cameras, the actor, or
    whatever made them require gradients, the result carries them through the solve. Masks and
    joints far from the captured person are warned of, unless they are being learned.

    Args:
        start: a capture of the clip: its actor, joints and motion are where this begins.
        masks: of the person, (F, C, H, W), bool or soft from 0 to 1; of any one size.
        cameras: the views in pixels of the masks, (C,) or (F, C); those of the capture, made as
            large as the masks, if not given.
        detections: (F, C, 16), where gradients are to reach them; else those of the capture.
        config: weights, sizes and method.
        trust: how much each pixel counts, 0 to 1, of a shape that broadcasts to the masks: how sure
            it is, whether it shows the person or what is behind, not how likely it is the person.
        adjoint: how the solves are differentiated: ``Implicit("products")`` where something
            requires gradients, not at all elsewhere, if not given.

    Raises:
        InputError: masks are not of these frames and views, or show nobody; cameras are of images
            of another size; or values are not from 0 to 1.
    """
    settings = config or JointConfig()
    problem = _problem(start, detections)
    actor, motion = problem.actor, start.motion.to(problem.pixel_unit)
    if not isinstance(masks, Tensor):
        raise InputError(f"masks are a {type(masks).__name__}, expected a tensor (F, C, H, W)")
    masks = masks.to(motion.angles) if masks.is_floating_point() else masks
    seen = _views(masks, start if cameras is None else cameras, problem)
    require_trust(trust, masks)
    faces = torch.as_tensor(actor.template.faces.copy())
    with torch.no_grad():
        graph = DeformationGraph.build(actor.vertices, faces, settings.nodes)
    surface = DeformedSurface(actor, graph)
    scale = float(_size(seen) / _size(problem.cameras))
    terms = _Terms(problem, surface, seen, masks, trust, settings, scale)
    wanted = _wants_gradient(masks, trust, seen, problem)
    way = adjoint or (Implicit("products") if wanted else Detached())
    windows = partition(motion.frames, problem.config.window, problem.config.overlap)
    terms.objective(windows[0], settings.bands[0])  # refuses what cannot be used, before warnings
    warn_of_other_poses(problem.cameras, seen)
    if not masks.requires_grad:
        warn_of_masks_elsewhere(masks, terms.drawn(motion), trust)
    if trust is not None and not trust.requires_grad:
        warn_of_trust_within(masks, trust)
    solved = [(window, terms.solve(window, motion[window.index], way)) for window in windows]
    return JointRefinement(surface, _blended(solved, actor), tuple(solved))


@dataclass(frozen=True)
class _Terms:
    """What the objective of every window is made of."""

    problem: ClipProblem
    surface: DeformedSurface
    cameras: Camera
    masks: Tensor
    trust: Tensor | None
    config: JointConfig
    scale: float

    def solve(self, window: Window, motion: Motion, adjoint: Adjoint) -> Solution[Compound]:
        """Round after round with narrower bands; the last one carries gradients."""
        state, bounds = self.surface.start(motion), self._bounds()
        *early, last = self.config.bands
        for band in early:
            with torch.no_grad():
                objective = self.objective(window, band)
                state = solve(objective, state, self.config.method, bounds).state
        return solve(self.objective(window, last), state, self.config.method, bounds, adjoint)

    def objective(self, window: Window, band: float) -> Objective:
        """All energies of a window, of a ``Compound``."""
        config, surface = self.config, self.surface
        pose = {n: of_part(MOTION, e) for n, e in self.problem.objective(window).items()}
        graph, nodes = surface.graph, surface.nodes((len(window),))
        unit = float(self.problem.pixel_unit.mean()) * self.scale
        silhouettes = SilhouetteOverlap(
            surface,
            self._silhouette(band * unit),
            self.cameras.frames(window.index),
            self.masks[window.index],
            None if self.trust is None else self.trust.expand(self.masks.shape)[window.index],
            config.silhouettes * band,
            points=surface.points,
        )
        rigidity = Rigidity(graph, nodes, config.rigidity, unit=config.stretch)
        tether = Tether(len(graph), config.tether, unit=config.reach)
        shape = {"rigidity": rigidity, "tether": tether}
        own = {name: of_part(DEFORMATION, each) for name, each in shape.items()}
        return Objective({**pose, "silhouettes": silhouettes, **own}).to(nodes)

    def drawn(self, motion: Motion) -> Tensor:
        """Coverage of a few frames spread over the clip by the undeformed actor, (F', C, H, W)."""
        some = examined(motion.frames).to(motion.angles.device)
        with torch.no_grad():
            surface = self.surface.actor.surface(motion[some])
            return self._silhouette(1.0).seen_by(self.cameras.frames(some), surface)

    def _silhouette(self, band: float) -> SoftSilhouette:
        template = self.surface.actor.template
        faces, weld = torch.as_tensor(template.faces.copy()), torch.as_tensor(template.weld()[0])
        height, width = self.masks.shape[-2:]
        drawn = SoftSilhouette(faces, (height, width), max(band, 1.0), weld)
        return drawn.to(self.masks.device)

    def _bounds(self) -> Bounds:
        limits, free = angle_bounds(self.surface.actor), 6 * len(self.surface.graph)
        pad = torch.nn.functional.pad
        lower = pad(limits.lower.frame, (0, free), value=-torch.inf)
        return Bounds.on_frames(lower, pad(limits.upper.frame, (0, free), value=torch.inf))


def _problem(start: Performance, detections: Detections | None) -> ClipProblem:
    """The problem of the motion, adapted to what the capture found."""
    if not isinstance(start, Performance):
        raise InputError(
            f"start is a {type(start).__name__}, expected the Performance that capture returned; "
            "of several people refine each"
        )
    if detections is not None:
        require_kinds(detections=detections)
    seen = (start.detections if detections is None else detections).finite()
    shape = (start.frames, *start.detections.joints2d.shape[1:])
    if seen.joints2d.shape != shape or start.detections.frame_count != start.frames:
        raise InputError(
            f"detections have joints {tuple(seen.joints2d.shape)} but the motion {start.frames} "
            f"frames; expected {shape}, here and in the capture: the same frames and views"
        )
    if not bool((seen.confidence2d > 0).any()):
        raise InputError("detections show nobody in any frame; expected the person's joints")
    if not isinstance(start.config, CaptureConfig):
        raise InputError("start is a retargeted motion, which no camera saw; expected a capture")
    frames = FrameProblem.of(start.actor, start.cameras, seen, start.config.pose)
    unit = frames.pixel_unit.detach()
    warn_of_other_joints(seen, start.detections.to(unit), 100 * unit)
    prepared = prepare(replace(frames, pixel_unit=unit)).problem
    return adapted(ClipProblem.of(prepared, start.rate), start.motion)


def _views(masks: Tensor, given: Performance | Camera, problem: ClipProblem) -> Camera:
    """Cameras in the pixels of the masks, all of one size."""
    views, frames = problem.cameras.views, problem.frames
    if masks.ndim != 4 or masks.shape[:2] != (frames, views):
        raise InputError(
            f"masks have shape {tuple(masks.shape)}; expected ({frames}, {views}, H, W): the "
            "frames and views of the capture"
        )
    size = (masks.shape[-2], masks.shape[-1])
    empty = (masks.detach() > 0.5).flatten(2).any(-1).any(0).logical_not().nonzero().flatten()
    if len(empty):
        raise InputError(
            f"masks of views {empty.tolist()} show nobody in any frame; expected 1 where the "
            "person is; leave such views out of the capture"
        )
    if isinstance(given, Camera):
        if given.views != views:
            raise InputError(f"cameras have {given.views} views, the capture has {views}")
        if any(own != size for own in given.size):
            raise InputError(
                f"cameras are of images of {given.size[0]} (height, width), masks are {size}; give "
                "cameras in pixels of the masks, or none, which makes those of the capture so"
            )
        require_usable("cameras", given, frames)
        return replace(given.to(problem.pixel_unit), size=(size,) * views)
    return resized(problem.cameras, size)


def _size(cameras: Camera) -> Tensor:
    """Mean focal length, pixels."""
    size: Tensor = torch.linalg.det(cameras.intrinsics[..., :2, :2]).abs().sqrt().mean()
    return size


def _wants_gradient(
    masks: Tensor, trust: Tensor | None, views: Camera, problem: ClipProblem
) -> bool:
    """Whether anything that the energies hold requires a gradient."""
    seen, actor = problem.detections, problem.actor
    held = [masks, trust, seen.joints2d, seen.confidence2d, seen.joints3d]
    for each in (views, problem.cameras):
        held += [each.intrinsics, each.rotation, each.translation, each.distortion]
    held += [*actor.parameters(), *actor.buffers()]
    return torch.is_grad_enabled() and any(x is not None and x.requires_grad for x in held)


def _blended(solved: list[tuple[Window, Solution[Compound]]], actor: Actor) -> Compound:
    """One state of overlapping windows; rotations of nodes are small, and vectors' means theirs."""
    motions, places, turns = MotionBlender(), Blender(mean_vectors), Blender(mean_vectors)
    done: tuple[list[Tensor], list[Tensor]] = ([], [])
    for window, solution in solved:
        part = solution.state.parts[DEFORMATION]
        motions.push(window, solution.state.parts[MOTION])
        done[0].append(turns.push(window, part.rotation))
        done[1].append(places.push(window, part.translation))
    done[0].append(turns.finish())
    done[1].append(places.finish())
    deformation = Deformation(torch.cat(done[0]), torch.cat(done[1]))
    return Compound({MOTION: motions.finish(actor.skeleton), DEFORMATION: deformation})
