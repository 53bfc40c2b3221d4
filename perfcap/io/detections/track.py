"""One person's joints in one view, as a file gives them: what every detections reader produces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.detections import not_found
from perfcap.detect.joint_set import LANDMARKS16, JointSet, map_to_landmarks
from perfcap.errors import InputError

Array = NDArray[np.float64]

MAX_FRAMES = 1_000_000
FARTHEST = 1e6  # px; nothing is seen out there, and squares of larger numbers overflow


@dataclass(frozen=True)
class Track:
    """A person through the frames of a view.

    Attributes:
        where: the file or folder, for messages.
        joint_set: names of the J joints.
        joints2d: (F, J, 2), pixels as in the file.
        confidence: (F, J); 0 where nothing was detected.
        joints3d: (F, J, 3), metres in camera axes, NaN where unknown; or None.
        warnings: what a user should know about how the file was read.
        video_frames: of the video these were detected in, where the file says so.
    """

    where: str
    joint_set: JointSet
    joints2d: Array
    confidence: Array
    joints3d: Array | None = None
    warnings: tuple[str, ...] = ()
    video_frames: int | None = None


@dataclass(frozen=True)
class LandmarkTrack:
    """A track mapped to the 16 landmarks: (F, 16, 2), (F, 16), (F, 16, 3) or None, (F,)."""

    joints2d: Tensor
    confidence: Tensor
    joints3d: Tensor | None
    trusted3d: Tensor
    warnings: tuple[str, ...]


ROOT = tuple(LANDMARKS16.joints.index(hip) for hip in ("r_hip", "l_hip"))
ROOT_TOLERANCE = 0.05  # m; rounding and a differently placed pelvis stay below


def to_landmarks(track: Track, pixel_offset: float) -> LandmarkTrack:
    """Map a track to the landmarks, in pixels with centres at integers, 3D about the mid-hip.

    Entries that are not finite are dropped and counted in a warning; confidences above 1, which
    some detectors write, become 1.
    """
    warnings = list(track.warnings)
    usable = np.abs(track.joints2d).max(-1) < FARTHEST  # false for NaN
    broken = ~usable & (track.confidence != 0)
    broken |= ~np.isfinite(track.confidence)
    if broken.any():
        frames = int(broken.any(-1).sum())
        warnings.append(
            f"{track.where}: {int(broken.sum())} joints in {frames} frames are NaN or infinite; "
            "they are taken as not detected"
        )
    confidence = torch.from_numpy(track.confidence)
    places = torch.from_numpy(np.where(usable[..., None], track.joints2d, np.nan))
    joints2d, confidence = map_to_landmarks(places, confidence, track.joint_set)
    missing = track.joint_set.missing()
    if missing:
        warnings.append(f"{track.where}: {track.joint_set.name} has no {', '.join(missing)}")
    if (confidence > 1).any():
        warnings.append(
            f"{track.where}: confidences up to {confidence.max():.3g}, expected 0 to 1; cut at 1"
        )
    shifted = torch.where(confidence[..., None] > 0, joints2d + pixel_offset, 0)
    joints3d, trusted, note = _pose3d(track)
    return LandmarkTrack(shifted, confidence.clamp(max=1), joints3d, trusted, (*warnings, *note))


def _pose3d(track: Track) -> tuple[Tensor | None, Tensor, list[str]]:
    """3D landmarks about the mid-hip; a frame is trusted when all of them are there.

    Joints that were ``not_found`` are not, which zeros say before they are shifted.
    """
    if track.joints3d is None:
        return None, torch.zeros(len(track.joints2d), dtype=torch.bool), []
    values = torch.from_numpy(track.joints3d)
    missing = not_found(values, torch.from_numpy(track.confidence))
    known = values.isfinite().all(-1) & ~missing
    mapped, seen = map_to_landmarks(values, known.to(values), track.joint_set)
    trusted = (seen > 0).all(-1) & (mapped != 0).any(-1).any(-1)
    root = mapped[:, ROOT].mean(-2, keepdim=True)
    offset = root[trusted].norm(dim=-1)
    notes = []
    if not trusted.any():
        notes.append(f"{track.where}: no frame has a complete 3D pose; only 2D is used")
    if len(offset) and offset.median() > ROOT_TOLERANCE:
        notes.append(
            f"{track.where}: 3D joints are not relative to the middle of the hips (it lies "
            f"{offset.median():.3g} m from the origin); it was subtracted"
        )
    centred = torch.where((seen > 0)[..., None], mapped - root, 0)
    return torch.where(trusted[:, None, None], centred, 0), trusted, notes


# --- One person as MMPose writes them, and what builds on it: keypoints and scores apart ----------


def parse_instance(path: object, instance: Any) -> Array:
    """Keypoints and scores of a person, (J, 3), apart or, as in MMPose before 1.0, side by side.

    Raises:
        InputError: there are none, or not as many of each.
    """
    where = f"{path}: an instance"
    if not isinstance(instance, dict) or "keypoints" not in instance:
        raise InputError(f"{where} has no keypoints; expected keypoints and keypoint_scores")
    try:
        points = np.asarray(instance["keypoints"], np.float64)
        scores = np.asarray(instance.get("keypoint_scores", instance.get("scores", ())), np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where} has keypoints that are not numbers") from error
    if points.ndim == 2 and points.shape[1] == 3 and not scores.size:
        return points
    if points.ndim != 2 or points.shape[1] != 2 or scores.shape != points.shape[:1]:
        raise InputError(
            f"{where} has keypoints {points.shape} and keypoint_scores {scores.shape}, expected "
            "(J, 2) and (J,)"
        )
    return np.concatenate((points, scores[:, None]), 1)
