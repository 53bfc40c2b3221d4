"""Errors of a result by name: joints, how it moves, surfaces, silhouettes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.app.truth import FoundJoints, Truth, match_frames, require_rate
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.io.datasets import SurfaceTruth
from perfcap.io.doctor.body_size import body_size
from perfcap.io.doctor.doubled import examine_doubled
from perfcap.io.doctor.sparse import detected_period
from perfcap.io.doctor.straight import examine_straight
from perfcap.io.image_file import read_silhouette
from perfcap.io.surface_file import SurfaceFile
from perfcap.metrics import (
    SilhouetteScores,
    aligned_distances,
    bone_length_variation,
    counted_joints,
    floor_contact,
    foot_skate,
    joint_errors,
    joint_table,
    mismatches,
    penetration,
    reprojection_error,
    silhouette_scores,
    surface_error,
    vertex_error,
)
from perfcap.render import rasterize

Scores = dict[str, float]
Pairs = list[tuple[int, int]]  # rows of a result and of the truth

_FAR, _NEARER = 0.1, 0.5  # m off, and share of it that another person leaves
_TALL = 500.0  # px, of a person in the images for which interpolation is looked for
_WHATS, _PARTS = ("vertex", "surface"), ("", "_garment")
_FEET = [LANDMARKS.index(f"{side}_{joint}") for side in "rl" for joint in ("ankle", "toe")]
_LIMBS = [
    (LANDMARKS.index(f"{side}_{a}"), LANDMARKS.index(f"{side}_{b}"))
    for side in "rl"
    for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
]


def joint_scores(found: FoundJoints, truth: Truth) -> Scores:
    """Errors of joints and of their motion; nothing where the truth has no joints.

    Raises:
        InputError: the frames do not belong together.
    """
    sequence = truth.sequence
    require_rate(found, truth.fps, sequence.folder)
    if sequence.joints3d is None:
        return {}
    rows, others = match_frames(found.frames, truth, str(found.path))
    estimate, true = found.joints[rows], _scored(sequence.joints3d[others], truth)
    errors = joint_errors(estimate, true, found.rate, partial=True)
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
        "accel_err_mm_per_frame2": errors.acceleration_error,
        "jitter_jerk_m_s3": errors.jerk,
        "jitter_jerk_gt_m_s3": errors.jerk_truth,
        "bone_length_std_mm": bone_length_variation(estimate, _LIMBS),
        **_contact(estimate, true, found.rate),
        **_reprojection(estimate, truth, others),
    }
    return {name: float(value) for name, value in named.items() if value.isfinite()}


def joint_tables(found: FoundJoints, truth: Truth) -> dict[str, Scores]:
    """Error of each landmark after each alignment of the protocol, mm."""
    if truth.sequence.joints3d is None:
        return {}
    rows, others = match_frames(found.frames, truth, str(found.path))
    estimate, true = found.joints[rows], _scored(truth.sequence.joints3d[others], truth)
    valid = counted_joints(estimate, true, partial=True)
    tables = {}
    for alignment in truth.protocol.alignments:
        means = joint_table(aligned_distances(estimate, true, valid, alignment), LANDMARKS)
        tables[str(alignment)] = {n: float(v) for n, v in means.items() if v.isfinite()}
    return tables


def joint_doubts(found: FoundJoints, truth: Truth) -> list[str]:
    """Mistakes in the truth that its joints show; see ``mismatches``."""
    if truth.sequence.joints3d is None:
        return []
    rows, others = match_frames(found.frames, truth, str(found.path))
    estimate, true = found.joints[rows], _scored(truth.sequence.joints3d[others], truth)
    valid = counted_joints(estimate, true, partial=True)
    if bool(valid.any()) and torch.equal(estimate[valid], true[valid]):
        return [
            f"{truth.sequence.folder}: has the joints of the result itself, to the last bit, so "
            "that nothing is measured; give the truth"
        ]
    nearer = list(_others(estimate, true, valid, truth, others))
    if nearer:
        return nearer
    numbers = found.frames[rows].tolist()
    order = LANDMARKS16.mirrored()
    told = mismatches(estimate, true, valid, order, frames=numbers, joints=LANDMARKS)
    return [*told, *_made_up(true, valid)]


def _others(
    estimate: Tensor, true: Tensor, valid: Tensor, truth: Truth, rows: list[int]
) -> Iterator[str]:
    """That another person of the recording is the one whom a result shows."""
    for name, joints in truth.sequence.others.items():
        other = _scored(joints[rows], truth)
        both = valid & other.isfinite().all(-1)
        if 2 * int(both.sum()) < int(valid.sum()):
            continue
        own, left = (float((estimate - each)[both].norm(dim=-1).mean()) for each in (true, other))
        if own > _FAR and left < _NEARER * own:
            yield (
                f"{name} of the same recording is nearer to the result: {left / own:.0%} of the "
                f"error is left; --sequence {name} compares with that person"
            )


def _made_up(true: Tensor, valid: Tensor) -> Iterator[str]:
    """That joints of a truth are copies of others, or were put in between for some frames."""
    for copied in examine_doubled("", true, valid, true=True):
        yield (
            f"the truth: {copied.what}, and its error says nothing; give the places that were "
            "measured, or look at per_joint_mm alone"
        )
    size = body_size(true, valid)
    said = [finding.what for finding in examine_straight("", 0, true, valid, "its joints")]
    if not said and size is not None and (period := detected_period(_TALL * true / size, valid)):
        said = [f"one in {period} frames was measured, it seems, and the others lie on curves"]
    for what in said:
        yield (
            f"the truth: {what}; errors there are those of what was put in between, give what was "
            "measured in every frame"
        )


def surface_scores(surface: SurfaceFile, truth: Truth, every: int = 1) -> tuple[Scores, list[str]]:
    """Errors of the surface where the truth is on the same template, and its outline's overlap.

    Returns:
        The errors, and what could not be compared.
    """
    rows, others = match_frames(surface.frames, truth, str(surface.path))
    pairs = list(zip(rows, others, strict=True))[::every]
    scores: Scores = {}
    notes: list[str] = []
    if truth.sequence.surface is not None:
        true = truth.sequence.surface()
        if surface.vertices.shape[1] == true.shown:
            scores |= _vertex_scores(surface, true, pairs)
        else:
            notes.append(
                f"{surface.path}: has {surface.vertices.shape[1]} vertices, the true template "
                f"{true.shown}; surfaces were not compared"
            )
    return scores | _outline_scores(surface, truth, pairs), notes


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


def _outline_scores(surface: SurfaceFile, truth: Truth, pairs: Pairs) -> Scores:
    """Overlap of the drawn surface with the true silhouettes of the first view."""
    masks, rig = truth.sequence.masks, truth.sequence.rig
    if not masks or rig is None:
        return {}
    drawn = (
        (_draw(surface, row, rig.cameras, other), read_silhouette(masks[other]))
        for row, other in pairs
    )
    return {"silhouette_iou": _mean(drawn)["iou"]}


def mask_scores(folder: Path, truth: Truth, every: int = 1) -> Scores:
    """How well the masks of a result, ``masks/%06d.png``, cover the true silhouettes."""
    files = {int(path.stem): path for path in folder.glob("[0-9]*.png") if path.stem.isdecimal()}
    if not files or not truth.sequence.masks:
        return {}
    frames = np.array(sorted(files))
    rows, others = match_frames(frames, truth, str(folder))
    pairs = list(zip(rows, others, strict=True))[::every]
    read = (
        (
            read_silhouette(files[int(frames[row])], person=1),
            read_silhouette(truth.sequence.masks[other]),
        )
        for row, other in pairs
    )
    return {f"segmentation_{name}": value for name, value in _mean(read).items()}


def _mean(pairs: Iterable[tuple[NDArray[np.bool_], NDArray[np.bool_]]]) -> Scores:
    """Mean of each score over pairs of masks and truth, percent."""
    found: list[SilhouetteScores] = [
        silhouette_scores(torch.tensor(mask), torch.tensor(true)) for mask, true in pairs
    ]
    names = ("iou", "precision", "recall", "boundary_f")
    return {name: 100 * float(np.mean([getattr(s, name) for s in found])) for name in names}


def _draw(surface: SurfaceFile, row: int, cameras: Camera, other: int) -> NDArray[np.bool_]:
    """Silhouette of a frame's surface in the first view."""
    camera = cameras.frames(slice(other, other + 1)) if cameras.moving else cameras
    first = Camera(
        camera.intrinsics.reshape(-1, *camera.intrinsics.shape[-3:])[0, :1],
        camera.rotation.reshape(-1, *camera.rotation.shape[-3:])[0, :1],
        camera.translation.reshape(-1, *camera.translation.shape[-2:])[0, :1],
        size=camera.size[:1],
    )
    vertices = torch.from_numpy(surface.read(slice(row, row + 1))[0].astype(float))
    local = first.to_camera(vertices)
    faces = torch.tensor(surface.faces)
    drawn = rasterize(first.project_camera(local)[0], local[0, :, 2], faces, first.size[0])
    mask: NDArray[np.bool_] = drawn.mask.numpy()
    return mask


def _scored(joints: Tensor, truth: Truth) -> Tensor:
    """True joints without those that the protocol does not score."""
    counted = torch.tensor([name in truth.protocol.joints for name in LANDMARKS])
    return torch.where(counted[:, None], joints, torch.nan)


def _contact(estimate: Tensor, true: Tensor, rate: float) -> dict[str, Tensor]:
    """Feet that slide while the true ones stand, and how deep they sink below all true ones."""
    up = _up(true)
    if up is None or not true[:, _FEET].isfinite().any():
        return {}
    feet, standing = estimate[:, _FEET], true[:, _FEET]
    heights = standing @ up
    known = heights.isfinite().any(0)
    feet, standing, heights = feet[:, known], standing[:, known], heights[:, known]
    contact = floor_contact(standing, heights, rate)
    floor = torch.where(heights.isfinite(), heights, torch.inf).amin(0)
    return {
        "foot_skate_mm": foot_skate(feet, contact, up),
        "penetration_mm": penetration(feet @ up - floor).depth,
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
    """Distance in the images from the annotated joints, where there are any."""
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
    known = true.isfinite().all(-1).any((0, 1))
    if not known.any():
        return {}
    flat = (points[..., known, :].flatten(0, 1) for points in (projected, true))
    return {"reproj_px": reprojection_error(*flat)}
