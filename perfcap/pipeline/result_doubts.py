"""Doubts of a result: what no person is (so tall, so far, so fast), what images did not show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.view_words import view_words
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.evidence import beside
from perfcap.io.doctor.finding import counted, ranges
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.evidence import AGREES, Evidence
from perfcap.pipeline.look import Looked
from perfcap.pipeline.track_motion import WindowReport
from perfcap.pipeline.way_length import way_doubts
from perfcap.solve import Status

FASTEST = 12.5
"""m/s, of hips; no runner is faster."""

_SOLVED = (1.0, 2.15)  # m, crown to soles, of a person whose bones are solved
_ELSEWHERE = 0.5  # usual overlap with a network that finds as much wrongly as rightly
_BESIDE = 1.0  # percent of the height; cameras that stand as stated have 0.5 at most
_OVERLAPS = 0.6  # of masks with who was captured by them; 0.8 is little already
_BESIDE_JOINTS = 0.06  # of a person's box: 0.01 is usual, 0.1 and more in a wrong order
_FAR = 100.0  # m, from a camera: nobody is filmed from there
# Cosines: of what is said to be up with bodies and images, and of these with each other
_NOT_UP, _ALIKE = 0.5, 0.7
_ORDER = "check that these are in the order of the joint set, unless the estimator errs by as much"
_OWN = "check axes, unit and frames of what your own energies want, in the world of the cameras"
_WAY = "check unit and frames of the poses of the moving cameras, if they were given"
_TRUNK = [LANDMARKS.index(name) for name in ("neck", "l_hip", "r_hip")]


def joint_doubts(
    detections: Detections, windows: Sequence[WindowReport], names: Sequence[str] | None = None
) -> Iterator[str]:
    """Views (F, C), by name where known, that detect nobody, and windows that were not solved."""
    for view in torch.nonzero(~detections.views_with_person()).flatten().tolist():
        yield f"{view_words([view], names)} detects nobody; the other views place the joints"
    for report in windows:
        if report.status == Status.NOT_FINITE:
            yield (
                f"frames {report.window.start} to {report.window.stop - 1} could not be solved: "
                f"{report.status.sentence}"
            )


def fit_doubts(
    cameras: Camera, detections: Detections, joints: Tensor, remedy: str = _ORDER
) -> Iterator[str]:
    """Whether a solved person is far from the joints that they were solved from.

    Args:
        cameras: C views, (C,) or (F, C).
        detections: (F, C).
        joints: landmarks of the person, (F, 16, 3).
        remedy: what to do.
    """
    off = beside(cameras, detections, joints)
    if not bool(off.isfinite().any()):
        return
    usual = float(off.nanmedian())
    if usual > _BESIDE_JOINTS:
        yield f"the person lies {usual:.0%} of their size from the joints; {remedy}"


def result_doubts(problem: ClipProblem, motion: Motion, solved_bones: bool) -> Iterator[str]:
    """A sentence for each way in which a captured motion (F,) is none of a person.

    Args:
        problem: in the world of the motion.
        motion: (F,).
        solved_bones: whether the actor's bone lengths were solved, so that the calibration of
            several views says how tall it is.
    """
    if solved_bones:
        yield from _stature(problem.actor)
    yield from _distance(problem.cameras, motion)
    yield from _jumps(motion, problem.rate)
    if problem.terms or problem.cameras.moving:  # else detections alone say where the person is
        seen, joints = problem.detections, problem.actor.joints(motion)
        remedy = _OWN if problem.terms else _WAY
        yield from fit_doubts(problem.cameras, seen, joints, remedy)
    yield from way_doubts(problem.actor, motion, problem.cameras, problem.rate)
    if problem.up is not None:
        yield from _upright(problem.actor.joints(motion), problem.cameras, problem.up)


def hip_speed(motion: Motion, rate: float) -> Tensor:
    """Speed of the hips from each frame to the next, (F - 1,) m/s; none is above ``FASTEST``."""
    speed: Tensor = motion.translation.diff(dim=0).norm(dim=-1) * rate
    return speed


def _stature(actor: Actor) -> Iterator[str]:
    rest = actor.skeleton.rest_landmarks
    height = float(rest[:, 1].max() - rest[:, 1].min())
    if not _SOLVED[0] < height < _SOLVED[1]:
        yield (
            f"the person is {height:.3g} m tall by the cameras; expected {_SOLVED[0]} to "
            f"{_SOLVED[1]}, check the units and focal lengths of the calibration"
        )


def _distance(cameras: Camera, motion: Motion) -> Iterator[str]:
    local = cameras.to_camera(motion.translation.unsqueeze(-2))
    distance = float(local[..., 0, 2].abs().median())
    if not distance <= _FAR:
        yield (
            f"the person is {distance:.3g} m from the cameras; check the focal length and the "
            "units of cameras and actor"
        )


def _upright(joints: Tensor, cameras: Camera, up: Tensor) -> Iterator[str]:
    """Whether people (F, 16, 3) and images both have another direction up than is given, (3,).

    Who lies is upright in no image, and a camera on its side has people across it.
    """
    neck, *hips = joints.detach()[:, _TRUNK].unbind(1)
    body, images = _mean(neck - sum(hips) / len(hips)), _mean(-cameras.rotation.detach()[..., 1, :])
    given = up.detach()
    if max(float(body @ given), float(images @ given)) < _NOT_UP and float(body @ images) > _ALIKE:
        shown = ", ".join(f"{part:.2g}" for part in (body + images).div(2).tolist())
        yield (
            f"up is given as {[round(part, 2) for part in given.tolist()]}, but the person's trunk "
            f"and the images both have ({shown}) up, in the world of the cameras; check axis and "
            "sign, since feet are put on a floor there"
        )


def _mean(directions: Tensor) -> Tensor:
    """Mean direction of vectors (..., 3), (3,); shorter than one where they differ."""
    return torch.nn.functional.normalize(directions, dim=-1).reshape(-1, 3).mean(0)


def _jumps(motion: Motion, rate: float) -> Iterator[str]:
    """Where the hips are elsewhere a frame later: detections that went over to another person."""
    speed = hip_speed(motion, rate)
    fast = (speed > FASTEST).nonzero()[:, 0].tolist()
    if fast:
        where = ranges([frame + 1 for frame in fast])
        yield (
            f"the person jumps up to {float(speed.max()) / rate:.2g} m within a frame "
            f"(frames {where} of the capture, counted from 0); do detections go over to somebody "
            "else there, or does the video cut?"
        )


# --- What images did not show of a capture, in words ----------------------------------------------


_MANY = 0.1  # share of frames with odd masks that is worth a warning


def doubts(looked: Looked) -> Iterator[str]:
    """What the images did not show, or showed against the model."""
    refinement = looked.refinement
    if looked.contours is not None and looked.contours.doubtful.any():
        yield (
            f"in {counted(int(looked.contours.doubtful.sum()))} hardly any edge of the images lies "
            "along the body's outline: little light, blur, clothes like the background, or an "
            "actor of another size; there the motion is about that of the joints alone"
        )
    if refinement is None:
        return
    yield from _of_frames(refinement.evidence)
    if refinement.views is not None:
        moved = refinement.views.sentences(refinement.views.numbers)
        yield from (f"by silhouettes, {sentence}" for sentence in moved)
    elif refinement.offsets is not None:
        yield from offset_doubts(refinement.offsets)
    for limb in dict.fromkeys(each.words for each in refinement.pose.limbs):
        frames = sum(e.stop - e.start for e in refinement.pose.limbs if e.words == limb)
        yield (
            f"in {counted(frames)} the {limb} is where silhouettes show it, not where its joints "
            "were detected; how far in front or behind is a guess (lost_limbs in run.json)"
        )
    # a good mask in twenty is named, too: no reason to warn
    beside, frames = refinement.evidence.beside, len(refinement.pose.after)
    doubtful = len(np.setdiff1d(refinement.doubtful_masks, beside))
    contradicted = len(refinement.evidence.doubtful) or doubtful > _MANY * frames
    yield from mask_doubts(refinement.evidence, doubtful if contradicted else 0)
    if len(beside):
        yield (
            f"in {counted(len(beside))} given masks lie beside the captured person, and are not "
            "used, as those of who is mostly hidden: else, are they of these frames and this "
            "person, true inside? run.json names them (doubtful_masks)"
        )
    yield from overlap_doubts(refinement.pose.after)
    parts = (("motion", refinement.pose), ("surface", refinement.surface))
    for name, part in parts:
        if part is not None and not part.kept.all():
            yield (
                f"in {counted(int((~part.kept).sum()))} silhouettes did not improve the {name}; it "
                "is kept, or filled in from frames around them"
            )


def offset_doubts(offsets: NDArray[np.float64]) -> Iterator[str]:
    """Whether masks lie beside the body (C, 2), percent of its height, each view its own way."""
    far = np.linalg.norm(np.nan_to_num(offsets), axis=-1)
    if (far > _BESIDE).any():
        yield (
            f"silhouettes lie beside the captured body all the time, by {far.max():.1f} % of its "
            f"height in view {far.argmax()}, counted from 0, and elsewhere in other views: the "
            "calibration may be slightly wrong; --refine-cameras puts cameras where they agree"
        )


def overlap_doubts(overlap: NDArray[np.float64]) -> Iterator[str]:
    """Whether the masks are of the captured person, by the overlap of each frame, (F,)."""
    usual = float(np.median(overlap)) if len(overlap) else 1.0
    if usual < _OVERLAPS:
        yield (
            f"the masks overlap the captured person by {usual:.0%} only in most frames; if they "
            "were given, are they of these frames and this person, true inside, and neither "
            "mirrored nor boxes? Look at masks"
        )


def _of_frames(evidence: Evidence) -> Iterator[str]:
    """What the images themselves do not show."""
    report = evidence.report()
    if report["scene_cuts"]:
        yield f"the scene changes at frames {report['scene_cuts']}; nothing is carried across"
    if report["nobody_in_view"]:
        yield (
            f"in {counted(len(report['nobody_in_view']))} the person is outside every image; "
            "nothing refines them"
        )
    if report["cropped"]:
        yield (
            f"in {counted(len(report['cropped']))} the border of an image cuts the person off; "
            "what lies outside follows as it can"
        )
    if report["no_contour"]:
        yield (
            f"in {counted(len(report['no_contour']))} the masks are empty or fill the image; "
            "nothing refines them"
        )
    if report["blank_images"]:
        yield (
            f"in {counted(len(report['blank_images']))} an image is of one color around the "
            "person; it shows nothing, and its mask is empty (blank_images in run.json)"
        )


def mask_doubts(evidence: Evidence, doubtful: int) -> Iterator[str]:
    """What a network says against the masks, and how many frames of them are doubtful."""
    usual = evidence.usual_agreement
    if usual < _ELSEWHERE:
        yield (
            f"the network of the segmenter overlaps the masks by {usual:.0%} only, and counts for "
            "little; are the joints those of the images (look at masks), and if the network is "
            "yours, is output.person of its manifest the person, and do size and colors fit?"
        )
    elif usual < AGREES:
        yield (
            f"a network and the masks overlap by {usual:.0%} in most frames, they may be wrong "
            "throughout: people, a mirror or colors like the person's behind? Look at masks"
        )
    if doubtful:
        yield (
            f"in {counted(doubtful)} masks may be wrong: a network contradicts them, or they are "
            "less sure and less like the posed body than is usual here; run.json names them "
            "(doubtful_masks)"
        )
