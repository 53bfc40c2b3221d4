"""Bare mesh in, actor's template out: orientation, joints, weights."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from perfcap.actor.anatomy import JOINTS, PARENTS
from perfcap.actor.bare_mesh import BareMesh
from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import Measurements, measure
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.template import Template
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.actor_check import examine_actor
from perfcap.io.actor_import import require_sound
from perfcap.io.actor_layers import layer_findings
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.rigging.bone_heat import HeatReport, heated
from perfcap.rigging.bones import skeleton_bones
from perfcap.rigging.fit_surface import BodyFitter, FitSettings, SurfaceFit
from perfcap.rigging.loose_parts import height_doubt
from perfcap.rigging.overrides import Override
from perfcap.rigging.scan_doubts import scan_doubts
from perfcap.rigging.surface_match import TargetSurface
from perfcap.rigging.upright import Upright, stand_up
from perfcap.rigging.view_landmarks import (
    JointDetector,
    SeenLandmarks,
    ViewSettings,
    see_landmarks,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

logger = logging.getLogger(__name__)

MOST_VERTICES = 2_000_000
# Landmarks that end bones, and the joint each rides on: bones without weights.
_ENDS = {"head_top": "head", "l_toe": "l_ankle", "r_toe": "r_ankle"}
_INWARDS = 0.1  # of a ball's volume by its surface; four people have 0.24 to 0.29, flat sheets 0
_ALIKE, _BESIDE = 0.2, 0.25  # of the extent: how like and how far apart two people are
_FAR = 0.25  # share of the mesh far from the fitted body above which it is no such person


@dataclass(frozen=True, eq=False)
class RigReport:
    """What was done to a mesh, and how well it fits.

    Attributes:
        upright: how it was turned and scaled; None where joints were given.
        fit: of the body model; None where joints were given.
        heat: of the weights.
        warnings: what to look at.
        measurements: of the body in the mesh, under its clothes, in the model's rest pose;
            None where joints were given.
        seen: landmarks that a detector saw; None without one.
        about_actor: what ``examine_actor`` finds in the rigged mesh; what is wrong is among the
            warnings, too.
    """

    upright: Upright | None
    fit: SurfaceFit | None
    heat: HeatReport
    warnings: tuple[str, ...] = ()
    measurements: Measurements | None = None
    seen: SeenLandmarks | None = None
    about_actor: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A direction in which a mesh may stand, and what fits it there."""

    upright: Upright
    mesh: BareMesh
    target: TargetSurface
    seen: SeenLandmarks | None
    distance: float
    motion: Motion


def auto_rig(
    mesh: BareMesh,
    model: BodyModel,
    height: float | None = None,
    overrides: tuple[Override, ...] = (),
    settings: FitSettings | None = None,
    detector: JointDetector | None = None,
) -> tuple[Template, RigReport]:
    """Make an actor of a bare mesh of one person in a T- or A-pose.

    The mesh is turned to y up, facing +z, and scaled to metres, and inside out where its triangles
    face inwards; a body model is fitted into it, whose joints become the skeleton; weights are heat
    from its bones. What to look at is logged.

    Args:
        mesh: what to rig.
        model: the body to look for in it.
        height: of the person with shoes and hair, metres; without it the unit is guessed.
        overrides: regions that only some bones may move; boxes are in the upright mesh.
        settings: of the fit.
        detector: of joints in images; pictures of the mesh from all sides are shown to it, and the
            body is fitted to the joints that they agree on as well as to the surface.

    Raises:
        InputError: it is no mesh, or not of one person in such a pose; the detector finds nobody.
    """
    template, report = rig_bare_mesh(mesh, model, height, overrides, settings, detector)
    for warning in report.warnings:
        logger.warning("%s: %s", mesh.name, warning)
    return template, report


def rig_bare_mesh(
    mesh: BareMesh,
    model: BodyModel,
    height: float | None = None,
    overrides: tuple[Override, ...] = (),
    settings: FitSettings | None = None,
    detector: JointDetector | None = None,
) -> tuple[Template, RigReport]:
    """As ``auto_rig``, without a word in the log: for commands, which print the report."""
    vertices, faces = _checked(mesh)
    turned = _is_inside_out(vertices, faces)
    faces = faces[:, ::-1].copy() if turned else faces
    rng = np.random.default_rng(0)
    fitter = BodyFitter(model, settings)
    samples = TargetSurface(vertices, faces, rng, dense=2400).points
    people = [fitter.surface(start)[0].numpy()[::6] for start in fitter.starts()]
    whole = replace(mesh, vertices=vertices, faces=faces)
    best = _best(fitter, whole, stand_up(samples, people, height), detector)
    fit = fitter.refine(best.motion, best.target, best.seen)
    if fit.far > _FAR:
        raise InputError(
            f"mesh {mesh.name!r}: {100 * fit.far:.0f} % of it is farther than 0.15 m from the "
            "fitted body; expected one person in a T- or A-pose, without floor or other objects"
        )
    template, heat = _rigged(best.mesh, fit.joints, overrides)
    inside = measure(model.template(fit.motion.shared[BODY]))
    found = [*_warnings(best.upright, fit, heat), *scan_doubts(template, height is not None)]
    if turned:
        found.append(
            "its triangles faced inwards and were turned round; export it with normals out"
        )
    if height is not None:
        body = fitter.surface(fit.motion)[0].numpy()
        doubt = height_doubt(best.mesh.vertices, faces, body, inside.height, height)
        found += [] if doubt is None else [doubt]
    known = replace(template, joint_bones={name: template.bone(name) for name in JOINTS})
    found += [str(finding) for finding in layer_findings(known, mesh.parts)]
    about = examine_actor(known)
    found += [str(finding) for finding in about if finding.severity is not Severity.INFO]
    return template, RigReport(best.upright, fit, heat, tuple(found), inside, best.seen, about)


def rig_with_joints(
    mesh: BareMesh, joints: Mapping[str, Floats], overrides: tuple[Override, ...] = ()
) -> tuple[Template, HeatReport]:
    """Rig an upright mesh whose joints are known.

    What looks odd of it is logged: a size that no person has, joints outside of the mesh.

    Args:
        mesh: metres, y up, facing +z.
        joints: positions of the skeleton's 16 joints and of head_top, l_toe and r_toe, (3,).
        overrides: as for ``auto_rig``.

    Raises:
        InputError: a joint is missing, joints are not those of the mesh (left and right exchanged,
            in another unit or other axes), or it cannot be rigged.
    """
    template, heat = _rigged(mesh, joints, overrides)
    found = examine_actor(template)
    require_sound(f"mesh {mesh.name!r}", found)
    for finding in found:
        if finding.severity is Severity.WARNING:
            logger.warning("%s: %s", mesh.name, finding)
    return template, heat


def _rigged(
    mesh: BareMesh, joints: Mapping[str, Floats], overrides: tuple[Override, ...]
) -> tuple[Template, HeatReport]:
    """The mesh with bones between joints, whatever they are."""
    names = (*JOINTS, *_ENDS)
    missing = [name for name in names if name not in joints]
    if missing:
        raise InputError(f"joints lack {', '.join(missing)}; give positions of {', '.join(names)}")
    weights, heat = heated(mesh.vertices, mesh.faces, skeleton_bones(joints), overrides)
    rest = np.tile(np.eye(4), (len(names), 1, 1))
    rest[:, :3, 3] = [joints[name] for name in names]
    parents = [-1 if p is None else names.index(p) for p in (*PARENTS.values(), *_ENDS.values())]
    ends = {
        end: (names.index(joint), rest[names.index(end), :3, 3]) for end, joint in _ENDS.items()
    }
    template = Template(
        vertices=mesh.vertices,
        faces=mesh.faces,
        bone_names=names,
        bone_parents=np.array(parents),
        bone_rest=rest,
        weight_bones=np.tile(np.arange(len(JOINTS)), (len(weights), 1)),
        weights=weights,
        uv=mesh.uv,
        texture=mesh.texture if mesh.uv is not None else None,
        name=mesh.name,
        landmarks=ends,
    )
    return template, heat


def _best(
    fitter: BodyFitter, mesh: BareMesh, uprights: list[Upright], detector: JointDetector | None
) -> _Candidate:
    """The direction that fits best after a first fit, among those in which a person is seen."""
    found = 0
    tried = []
    for upright in uprights:
        standing = replace(mesh, vertices=upright.apply(mesh.vertices))
        seen = None if detector is None else see_landmarks(standing, detector)
        if seen is not None:
            found = max(found, seen.found)
            if seen.found < ViewSettings().landmarks:
                continue
        target = fitter.target(standing.vertices, standing.faces)
        distance, motion = fitter.screen(target, seen)
        logger.debug("direction %s: %.1f mm", upright.rotation.tolist(), 1e3 * distance)
        tried.append(_Candidate(upright, standing, target, seen, distance, motion))
    if not tried:
        raise InputError(
            f"mesh {mesh.name!r}: the detector finds {found} of {len(LANDMARKS)} landmarks alike "
            f"in {ViewSettings().views} pictures of it, expected {ViewSettings().landmarks} or "
            "more; give the mesh with its texture, or leave the detector out"
        )
    return min(tried, key=lambda candidate: candidate.distance)


def _checked(mesh: BareMesh) -> tuple[Floats, Integers]:
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    if not len(faces) or not len(vertices):
        raise InputError(f"mesh {mesh.name!r} has no faces; give a mesh, not a point cloud")
    if len(vertices) > MOST_VERTICES:
        raise InputError(
            f"mesh {mesh.name!r} has {len(vertices)} vertices; expected at most {MOST_VERTICES}, "
            "decimate it"
        )
    if not np.isfinite(vertices).all():
        raise InputError(f"mesh {mesh.name!r} has vertices that are not finite; repair it")
    if _are_several(vertices, faces.astype(np.int64)):
        raise InputError(
            f"mesh {mesh.name!r} holds two parts of the same size side by side; expected one "
            "person a file, delete the others"
        )
    return vertices, faces.astype(np.int64)


def _is_inside_out(vertices: Floats, faces: Integers) -> bool:
    """Whether triangles face inwards, by the volume that they enclose."""
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(area, axis=1, keepdims=True)
    middle = corners.mean(1)
    out = middle - (size * middle).sum(0) / max(float(size.sum()), 1e-300)
    bulk = float((size * np.linalg.norm(out, axis=1, keepdims=True)).sum())
    return float((out * area).sum()) < -_INWARDS * bulk


def _are_several(vertices: Floats, faces: Integers) -> bool:
    """Whether the two largest connected parts are alike in size and lie apart."""
    place = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)[faces]
    edges = np.concatenate((place[:, :2], place[:, 1:]))
    count = int(place.max()) + 1
    graph = coo_array((np.ones(len(edges)), edges.T), (count, count))
    part = connected_components(graph, directed=False)[1][place[:, 0]]
    sizes = np.bincount(part)
    if len(sizes) < 2:
        return False
    one, other = (vertices[faces[part == p]].reshape(-1, 3) for p in np.argsort(-sizes)[:2])
    extents = np.sort([np.ptp(points, axis=0) for points in (one, other)], axis=1)
    alike = bool((np.abs(extents[0] - extents[1]) < _ALIKE * extents.max(0)).all())
    apart = float(np.linalg.norm(np.median(one, axis=0) - np.median(other, axis=0)))
    return alike and apart > _BESIDE * float(extents.max()) and len(other) > 0.6 * len(one)


def _warnings(upright: Upright, fit: SurfaceFit, heat: HeatReport) -> list[str]:
    found = []
    if upright.unit == "unknown":
        found.append(f"its unit is unknown; scaled to {1.72} m, give the height of the person")
    if fit.far > 0.06:
        found.append(f"{100 * fit.far:.0f} % of the surface is far from the body beneath")
    if heat.seen < 0.3:
        found.append(f"only {100 * heat.seen:.0f} % of the surface sees a bone")
    return found
