"""How far each body part may be from where a motion has it."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS, PARENTS
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.trust import frame_curvature

_STRETCH = 200  # frames whose covariances are held at once
_DAMPING = 1e-6  # relative to the largest curvature
_TRUNK = ("pelvis", "spine", "neck", "head")
_PARTS = len(JOINTS)


def parts_of_triangles(actor: Actor) -> NDArray[np.int64]:
    """The joint of ``JOINTS`` that moves each triangle most, (T,): its body part."""
    own = np.array(actor.skeleton.rig.without_clavicles)
    heaviest = own[actor.skin.rows()[2].cpu().numpy()]
    found: NDArray[np.int64] = np.sort(heaviest[actor.template.faces], 1)[:, 1]
    return found


@torch.no_grad()
def part_deviations(problem: ClipProblem, motion: Motion, most: float = 0.1) -> Tensor:
    """Deviation of each part along an axis of the world, (F, 16) metres, in the order of JOINTS.

    From the covariance of each frame's pose, the inverse curvature of its data and its prior: what
    neighbours in time say is not in it, so that it is rather too large. Errors that all detections
    of a frame share are not, either.

    Args:
        problem: what the motion was found from.
        motion: (F,).
        most: m; larger ones say that nothing is known.
    """
    parts = [_landmark_variance(problem, motion[span], span) for span in _spans(motion)]
    variance = torch.cat(parts)[:, None] * _shares().to(motion.angles)  # F P L
    return variance.sum(-1).clamp(min=0).sqrt().clamp(max=most)


@torch.no_grad()
def pose_factors(problem: ClipProblem, motion: Motion, most: float = 1.0) -> Tensor:
    """Factors L of the covariance L L^T of each frame's pose, (F, D, D), see ``part_deviations``.

    Args:
        problem: what the motion was found from.
        motion: (F,).
        most: m or rad; larger deviations say that nothing is known.
    """
    found = []
    for span in _spans(motion):
        covariance = _covariance(problem, motion[span], span)
        variance, axes = torch.linalg.eigh((covariance + covariance.mT) / 2)
        found.append(axes * variance.clamp(0, most**2).sqrt()[:, None])
    return torch.cat(found)


def _spans(motion: Motion) -> list[slice]:
    return [slice(start, start + _STRETCH) for start in range(0, motion.frames, _STRETCH)]


def _landmark_variance(problem: ClipProblem, motion: Motion, span: slice) -> Tensor:
    """Mean variance along an axis of every landmark, (F, L) square metres."""
    covariance = _covariance(problem, motion, span)
    _, slope, _ = problem.actor.skeleton.linearize(motion)  # F L 3 D
    variance: Tensor = ((slope @ covariance[:, None]) * slope).sum((-2, -1)) / 3
    return variance[:, : len(LANDMARKS)]


def _covariance(problem: ClipProblem, motion: Motion, span: slice) -> Tensor:
    """Of the unknowns of each pose, (F, D, D)."""
    objective = problem.apart(span).objective()
    total = torch.stack([frame_curvature(energy, motion) for _, energy in objective.items()]).sum(0)
    scale = total.diagonal(dim1=-2, dim2=-1).amax(-1)[:, None, None].clamp(min=1e-9)
    eye = torch.eye(total.shape[-1]).to(total)
    covariance: Tensor = torch.linalg.inv(total + _DAMPING * scale * eye)
    return covariance


def _shares() -> Tensor:
    """How much each landmark says of each part, (P, L); rows have sum one."""
    shares = torch.zeros(_PARTS, len(LANDMARKS))
    for part, joint in enumerate(JOINTS):
        below = [name for name in JOINTS if PARENTS[name] == joint and joint not in _TRUNK]
        ends = {"head": ["head_top"], "r_ankle": ["r_toe"], "l_ankle": ["l_toe"]}.get(joint, [])
        names = [n for n in (joint, *below, *ends) if n in LANDMARKS]
        if joint in ("pelvis", "spine"):
            names = ["neck", "r_shoulder", "l_shoulder", "r_hip", "l_hip"]
        shares[part, [LANDMARKS.index(n) for n in names]] = 1 / len(names)
    return shares
