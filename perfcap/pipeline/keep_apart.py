"""People whose skins pass through each other are moved apart, as little as that takes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy.joint_target import JointTarget
from perfcap.energy.skin_contact import SkinContact
from perfcap.geometry.signed_gap import Mesh, signed_gap
from perfcap.pipeline.objective import angle_bounds
from perfcap.render.projected_mesh import vertex_normals
from perfcap.setting_checks import Settings, require_metres
from perfcap.solve import Bounds, Energy, LevenbergMarquardt, Objective, Step, solve
from perfcap.solve.compound import Compound, of_part

_REACH = 0.35  # m around landmarks within which all skin is
_SWEEPS = 3  # over all pairs: who steps back from one may step into another
_PAIRS = 96  # of points in contact, of one person in another and a frame
_CELL = 0.02  # m: one point in contact for each such cube
_SPREAD = 0.15  # m: one point that stays for each such cube of the rest pose
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class ApartConfig(Settings):
    """How skins of several people are kept apart."""

    enabled: bool = True
    tolerance: float = 0.005  # m: skins may be as deep in each other; they are not that exact
    rounds: int = 12  # of looking for what touches, for each length of steps
    # m of depth that a round takes away; other lengths are for frames that stay deep
    steps: tuple[float, ...] = (0.02, 0.01, 0.04)
    max_steps: int = 10  # of the solver in each round
    depth: float = 0.002  # m of contact that count as much as
    moved: float = 0.02  # m by which joints and skin are moved

    def __post_init__(self) -> None:
        super().__post_init__()
        require_metres(self, "depth", "moved", "steps")
        require_metres(self, "tolerance", zero=True)


def keep_apart(
    actors: Sequence[Actor], motions: Sequence[Motion], config: ApartConfig
) -> tuple[Motion, ...]:
    """Motions (F,) whose skins are at most a tolerance deep in each other, where poses allow.

    Frames in which two people touch are solved for both at once: depth of contact against how far
    joints and skin are moved. Depth grows from nothing where a contact begins, and so does what is
    changed. All other frames are as given, to the bit; so are those in which depth cannot be
    halved: people who are in the middle of each other are mistaken in another way.

    Args:
        actors: K people.
        motions: theirs, (F,) each, without shared unknowns.
        config: tolerance, rounds, units.
    """
    if not config.enabled:
        return tuple(motions)
    found, pairs = list(motions), list(combinations(range(len(actors)), 2))
    for _ in range(_SWEEPS if len(pairs) > 1 else 1):
        before = list(found)
        for pair in pairs:
            own = [actors[k] for k in pair]
            for k, motion in zip(pair, _both(own, [found[k] for k in pair], config), strict=True):
                found[k] = motion
        if all(new is old for new, old in zip(found, before, strict=True)):
            break
    return tuple(found)


def _both(
    actors: Sequence[Actor], motions: Sequence[Motion], config: ApartConfig
) -> Sequence[Motion]:
    """Two people kept apart; what one length of steps leaves deep is tried with the next."""
    near = _near(*(actor.joints(motion) for actor, motion in zip(actors, motions, strict=True)))
    touches = _touching(actors, motions, near, config.tolerance)
    for step in config.steps:
        if not touches:
            break
        stepped, left = _stepped(actors, motions, touches, step, config)
        touches = {f: touch for f, touch in touches.items() if 2 * left.get(f, 0) > touch.depth}
        back = torch.tensor(sorted(touches), dtype=torch.int64)
        motions = [_put(new, back, old[back]) for new, old in zip(stepped, motions, strict=True)]
    return motions


def _stepped(
    actors: Sequence[Actor],
    motions: Sequence[Motion],
    touches: Touches,
    step: float,
    config: ApartConfig,
) -> tuple[Sequence[Motion], dict[int, float]]:
    """Both after rounds that take away so much depth, m, and what is left of it by frame, m."""
    found = motions
    for _ in range(config.rounds):
        if not touches:
            break
        frames = torch.tensor(sorted(touches))
        goals = [
            _Stay.of(actor, motion[frames], config)
            for actor, motion in zip(actors, motions, strict=True)
        ]
        parts = [motion[frames] for motion in found]
        solved = _parted(goals, parts, [touches[int(f)] for f in frames], step, config)
        found = [_put(whole, frames, part) for whole, part in zip(found, solved, strict=True)]
        touches = _touching(actors, found, frames.tolist(), config.tolerance)
    return found, {frame: touch.depth for frame, touch in touches.items()}


# --- Who is in whom -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Inside:
    """Vertices of one person in another, (n,), those of the other next to them, (n,), and the
    normals there, (n, 3), and how deep, (n,), m.
    """

    points: Rows
    skin: Rows
    depth: NDArray[np.floating]
    normals: NDArray[np.floating]


@dataclass(frozen=True)
class _Touch:
    """Two people in one frame: how deep, m; what of the first is in the other, and the reverse."""

    depth: float
    inside: tuple[_Inside, _Inside]


Touches = dict[int, _Touch]  # by frame


def _touching(
    actors: Sequence[Actor], motions: Sequence[Motion], frames: Sequence[int], tolerance: float
) -> Touches:
    """Where two people touch, in stretches of these frames that exceed the tolerance."""
    touches = {}
    for frame in frames:
        one, other = (
            _skin(actor, motion[frame : frame + 1])
            for actor, motion in zip(actors, motions, strict=True)
        )
        inside = _inside(one, other), _inside(other, one)
        depth = max(each[0] for each in inside)
        if depth > 0:
            touches[frame] = _Touch(depth, (inside[0][1], inside[1][1]))
    return {f: touches[f] for run in _stretches(touches, tolerance) for f in run}


def _near(one: Tensor, other: Tensor) -> list[int]:
    """Frames in which landmarks (F, L, 3) of two people are so near that skins may touch."""
    low, high = one.amin(1) - 2 * _REACH, one.amax(1) + 2 * _REACH
    apart = (other.amax(1) < low) | (other.amin(1) > high)
    near: list[int] = (~apart.any(-1)).nonzero()[:, 0].tolist()
    return near


def _skin(actor: Actor, motion: Motion) -> Mesh:
    """Vertices and normals of one frame."""
    vertices = actor.surface(motion)[0].detach().double().cpu()
    faces = torch.as_tensor(actor.template.faces.copy())
    return vertices.numpy(), vertex_normals(vertices, faces).numpy()


def _inside(one: Mesh, other: Mesh) -> tuple[float, _Inside]:
    """How deep a person is in another, m, and the deepest points of every small cube."""
    low, high = other[0].min(0), other[0].max(0)
    rows = np.flatnonzero(((one[0] > low) & (one[0] < high)).all(-1))
    if not len(rows):
        return 0.0, _Inside(rows, rows, np.empty(0), np.empty((0, 3)))
    gap, nearest = signed_gap(one[0][rows], other)
    order = np.argsort(gap)[: int((gap < 0).sum())]
    order = order[_first_of_cubes(one[0][rows[order]], _CELL)[:_PAIRS]]
    skin = nearest[order]
    return max(-float(gap.min()), 0.0), _Inside(rows[order], skin, -gap[order], other[1][skin])


def _first_of_cubes(places: NDArray[np.floating], size: float) -> Rows:
    """The first of the places (N, 3) in every cube, in their order."""
    cubes = np.floor(places / size).astype(np.int64)
    return np.sort(np.unique(cubes, axis=0, return_index=True)[1])


def _stretches(touches: Mapping[int, _Touch], tolerance: float) -> Iterator[list[int]]:
    """Runs of frames one after the other, in some of which the tolerance is exceeded."""
    run: list[int] = []
    for frame in [*sorted(touches), -1]:
        if run and frame != run[-1] + 1:
            if max(touches[f].depth for f in run) > tolerance:
                yield run
            run = []
        run.append(frame)


# --- Both moved at once ---------------------------------------------------------------------------


@dataclass(frozen=True)
class _Stay:
    """A person who is to stay where they are, (F,)."""

    actor: Actor
    energies: Mapping[str, Energy[Motion]]

    @classmethod
    def of(cls, actor: Actor, motion: Motion, config: ApartConfig) -> _Stay:
        spread = _first_of_cubes(actor.vertices.detach().cpu().numpy(), _SPREAD)
        corners = torch.as_tensor(spread).unsqueeze(-1)
        energies = {}
        for name, points in (
            ("joints", actor.landmarks),
            ("skin", SkinnedPoints(actor, corners, torch.ones(corners.shape))),
        ):
            goal = points(motion).detach().unsqueeze(-3)
            mean = 1 / points.count
            energies[name] = JointTarget(points, goal, weight=mean, unit=config.moved)
        return cls(actor, energies)


def _parted(
    people: Sequence[_Stay],
    motions: Sequence[Motion],
    touches: Sequence[_Touch],
    step: float,
    config: ApartConfig,
) -> list[Motion]:
    """Both people (F,) as far apart as contact and their own places want them."""
    names = "one", "other"
    energies: dict[str, Energy[Compound]] = {
        f"{name}_{own}": of_part(name, energy)
        for name, each in zip(names, people, strict=True)
        for own, energy in each.energies.items()
    }
    for first in (0, 1):
        inside = [touch.inside[first] for touch in touches]
        if any(len(each.points) for each in inside):
            second = 1 - first
            energies[f"{names[first]}_inside"] = _contact(
                (names[first], names[second]),
                (people[first].actor, people[second].actor),
                inside,
                step,
                config.depth,
            )
    state = Compound(dict(zip(names, motions, strict=True)))
    limits = [angle_bounds(each.actor) for each in people]
    like = motions[0].angles
    bounds = Bounds(
        Step(torch.cat([each.lower.frame for each in limits]), like.new_empty(0)),
        Step(torch.cat([each.upper.frame for each in limits]), like.new_empty(0)),
    )
    method = LevenbergMarquardt(max_steps=config.max_steps)
    solved = solve(Objective(energies).to(like), state, method, bounds).state
    return [solved.parts[name] for name in names]


def _contact(
    names: tuple[str, str],
    actors: tuple[Actor, Actor],
    inside: Sequence[_Inside],
    step: float,
    unit: float,
) -> SkinContact:
    """The mean over what touches in each frame."""
    shape = len(inside), max(len(each.points) for each in inside)
    points, skin = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    normals, share, depth = np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape)
    for frame, each in enumerate(inside):
        own = frame, slice(len(each.points))
        points[own], skin[own], normals[own] = each.points, each.skin, each.normals
        share[own], depth[own] = 1 / max(len(each.points), 1), each.depth
    meant = torch.as_tensor(share > 0).unsqueeze(-1)
    first, second = (
        SkinnedPoints(actor, torch.as_tensor(rows).unsqueeze(-1), meant.to(actor.vertices))
        for actor, rows in zip(actors, (points, skin), strict=True)
    )
    allowed = torch.as_tensor(np.maximum(depth - step, 0))
    given = torch.as_tensor(normals), torch.as_tensor(share), allowed
    return SkinContact(names, first, second, *given, unit=unit)


def _put(motion: Motion, frames: Tensor, part: Motion) -> Motion:
    """A motion (F,) with some of its frames replaced."""
    index = frames.to(motion.angles.device)
    return motion.map(lambda whole, some: whole.index_copy(0, index, some.detach()), part)
