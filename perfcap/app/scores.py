"""Errors of a result by name: joints, how it moves, surfaces."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.app.left_out import frame_counts
from perfcap.app.truth import FoundJoints, Truth, match_frames, require_rate
from perfcap.app.truth_doubts import mesh_doubts, surface_doubts
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.io.datasets import SurfaceTruth
from perfcap.io.surface_file import SurfaceFile
from perfcap.metrics import (
    aligned_distances,
    bone_length_variation,
    counted_joints,
    floor_contact,
    foot_skate,
    joint_errors,
    joint_table,
    penetration,
    reprojection_error,
    surface_distance,
    surface_error,
    vertex_error,
)

Scores = dict[str, float]
Pairs = list[tuple[int, int]]  # rows of a result and of the truth

_WHATS, _PARTS = ("vertex", "surface"), ("", "_garment")
_FEET = [LANDMARKS.index(f"{side}_{joint}") for side in "rl" for joint in ("ankle", "toe")]
_LIMBS = [
    (LANDMARKS.index(f"{side}_{a}"), LANDMARKS.index(f"{side}_{b}"))
    for side in "rl"
    for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
]


def joint_scores(found: FoundJoints, truth: Truth) -> Scores:
    """Errors of joints and of their motion; nothing where the truth has no joints.

    A mean that is of fewer frames than ``frames_scored`` comes with how many: see ``frame_counts``,
    and ``frames_foot_skate`` (a foot of the truth is known) and ``frames_reproj`` (any joint is
    annotated, in any view).

    Raises:
        InputError: the frames do not belong together.
    """
    sequence = truth.sequence
    require_rate(found, truth.fps, sequence.folder)
    if sequence.joints3d is None:
        return {}
    rows, others = match_frames(found.frames, truth, str(found.path))
    estimate, true = found.joints[rows], truth.scored(sequence.joints3d[others])
    errors = joint_errors(estimate, true, found.rate, partial=True)
    # frames beside a gap are no neighbours
    moving, expected = (_with_gaps(points, found.frames[rows]) for points in (estimate, true))
    motion = joint_errors(moving, expected, found.rate, partial=True)
    named = {
        "frames_scored": errors.frames,
        "frames_missing": errors.missing,
        "joints_missing": errors.missing_joints,
        "mpjpe_mm": errors.mpjpe,
        "mpjpe_root_mm": errors.mpjpe_root,
        "mpjpe_transl_mm": errors.mpjpe_translation,
        "pa_mpjpe_mm": errors.mpjpe_similarity,
        "mpjpe_first_frame_mm": errors.mpjpe_first_frame,
        "pck3d_150": errors.pck,
        "auc3d": errors.auc,
        "accel_err_mm_per_frame2": motion.acceleration_error,
        "jitter_jerk_m_s3": motion.jerk,
        "jitter_jerk_gt_m_s3": motion.jerk_truth,
        "bone_length_std_mm": bone_length_variation(estimate, _LIMBS),
        **_contact(moving, expected, found.rate, errors.frames),
        **_reprojection(estimate, truth, others),
    }
    scores = {name: float(value) for name, value in named.items() if value.isfinite()}
    return scores | frame_counts(errors, moving, expected, truth.protocol.joints)


def _with_gaps(points: Tensor, frames: NDArray[np.int64]) -> Tensor:
    """Joints (F, 16, 3) with an unknown frame wherever the numbers of their frames jump."""
    jumps = (np.diff(frames) != 1).nonzero()[0] + 1
    unknown = torch.full_like(points[:1], torch.nan)
    pieces = torch.tensor_split(points, jumps.tolist())
    return torch.cat([part for piece in pieces for part in (piece, unknown)][:-1])


def joint_tables(
    found: FoundJoints, truth: Truth
) -> tuple[dict[str, Scores], dict[str, dict[str, int]]]:
    """Error of each landmark after each alignment of the protocol, mm, and of how many frames.

    Returns:
        The errors, and the frames of landmarks that count in fewer than are scored.
    """
    if truth.sequence.joints3d is None:
        return {}, {}
    rows, others = match_frames(found.frames, truth, str(found.path))
    estimate, true = found.joints[rows], truth.scored(truth.sequence.joints3d[others])
    valid = counted_joints(estimate, true, partial=True)
    known, scored = estimate.isfinite().all(-1), int(valid.any(-1).sum())
    tables, fewer = {}, {}
    for alignment in truth.protocol.alignments:
        apart = aligned_distances(estimate, true, valid, alignment, known=known)
        means = joint_table(apart, LANDMARKS)
        tables[str(alignment)] = {n: float(v) for n, v in means.items() if v.isfinite()}
        frames = zip(LANDMARKS, apart.isfinite().sum(0).tolist(), strict=True)
        some = {name: count for name, count in frames if 0 < count < scored}
        if some:
            fewer[str(alignment)] = some
    return tables, fewer


def surface_scores(surface: SurfaceFile, truth: Truth, every: int = 1) -> tuple[Scores, list[str]]:
    """Errors of the surface where the truth is on the same template, or has any surfaces.

    Returns:
        The errors, and what could not be compared or looks wrong in the true surfaces.
    """
    rows, others = match_frames(surface.frames, truth, str(surface.path))
    if truth.sequence.meshes:
        pairs = list(zip(rows, others, strict=True))[::every]
        return _mesh_scores(surface, truth, pairs), list(mesh_doubts(surface, truth, pairs))
    if truth.sequence.surface is None:
        return {}, []
    true = truth.sequence.surface()
    count = surface.vertices.shape[1]
    if count != len(true.places):
        return {}, [
            f"{surface.path}: has {count} vertices, the true template {len(true.places)}; "
            "surfaces were not compared"
        ]
    if not true.has_faces(surface.faces):
        return {}, [
            f"{surface.path}: its triangles are not those of the true template, as where a program "
            "put vertices in another order; surfaces were not compared"
        ]
    pairs = list(zip(rows, others, strict=True))[::every]
    return _vertex_scores(surface, true, pairs), surface_doubts(true, truth, others)


def _mesh_scores(surface: SurfaceFile, truth: Truth, pairs: Pairs) -> Scores:
    """Distances to true surfaces whose vertices are not the actor's."""
    rng = np.random.default_rng(0)
    errors = []
    for row, other in pairs:
        vertices = surface.read(slice(row, row + 1))[0].astype(float)
        expected, faces = truth.sequence.mesh(other)
        errors.append(
            [
                surface_distance(vertices, surface.faces, expected, faces, rng, translated=aligned)
                for aligned in (True, False)
            ]
        )
    transl, absolute = np.mean(errors, 0).tolist()
    return {
        "surface_transl_mm": transl,
        "surface_abs_mm": absolute,
        "mesh_frames": float(len(pairs)),
    }


def _vertex_scores(surface: SurfaceFile, true: SurfaceTruth, pairs: Pairs) -> Scores:
    rng = np.random.default_rng(0)
    errors = []
    for row, other in pairs:
        vertices = surface.read(slice(row, row + 1))[0, true.order].astype(float)
        expected = true.vertices[other]
        parts = [None, true.loose] if true.loose.any() else [None]
        aligned = [surface_error(vertices, expected, true.faces, rng, part) for part in parts]
        found, known = (torch.from_numpy(v)[None] for v in (vertices, expected))
        absolute = vertex_error(found, known, translated=False)
        errors.append([float(absolute), *(v for e in aligned for v in (e.vertex, e.surface))])
    names = ("vertex_abs_mm", *(f"{what}_transl{of}_mm" for of in _PARTS for what in _WHATS))
    means = np.mean(errors, 0).tolist()
    return {**dict(zip(names, means, strict=False)), "mesh_frames": float(len(pairs))}


def _contact(estimate: Tensor, true: Tensor, rate: float, scored: Tensor) -> dict[str, Tensor]:
    """Feet that slide while the true ones stand, and how deep they sink below all true ones.

    And in how many frames feet were known, where that is in fewer than are scored.
    """
    up = _up(true)
    if up is None or not true[:, _FEET].isfinite().any():
        return {}
    feet, standing = estimate[:, _FEET], true[:, _FEET]
    heights = standing @ up
    known = heights.isfinite().any(0)
    feet, standing, heights = feet[:, known], standing[:, known], heights[:, known]
    contact = floor_contact(standing, heights, rate)
    floor = torch.where(heights.isfinite(), heights, torch.inf).amin(0)
    skate, frames = foot_skate(feet, contact, up), heights.isfinite().any(-1).sum()
    fewer = {"frames_foot_skate": frames} if skate.isfinite() and frames < scored else {}
    return {
        "foot_skate_mm": skate,
        "penetration_mm": penetration(feet @ up - floor).depth,
        **fewer,
    }


def _up(joints: Tensor) -> Tensor | None:
    """The axis of the world along which the person stands, as a unit vector."""
    trunk = (joints[:, LANDMARKS.index("neck")] - mid_hip(joints)).nanmean(0)
    if not trunk.isfinite().all() or not trunk.any():
        return None
    up = torch.zeros_like(trunk)
    axis = int(trunk.abs().argmax())
    up[axis] = trunk[axis].sign()
    return up


def _reprojection(estimate: Tensor, truth: Truth, others: list[int]) -> dict[str, Tensor]:
    """Distance in the images from the annotated joints, where there are any.

    Each joint, view and frame that is annotated counts alike.
    """
    sequence = truth.sequence
    if sequence.rig is None or sequence.pixels is None:
        return {}
    cameras = sequence.rig.cameras
    if cameras.moving:
        cameras = Camera(
            cameras.intrinsics[others],
            cameras.rotation[others],
            cameras.translation[others],
            None if cameras.distortion is None else cameras.distortion[others],
            cameras.size,
        )
    projected, true = cameras.project(estimate), sequence.pixels[others]
    known = true.isfinite().all(-1) & projected.isfinite().all(-1)
    frames = known.any(-1).any(-1).sum()
    if not frames:
        return {}
    error = reprojection_error(projected.flatten(0, 1), true.flatten(0, 1), partial=True)
    fewer = {"frames_reproj": frames} if frames < len(known) else {}
    return {"reproj_px": error, **fewer}
