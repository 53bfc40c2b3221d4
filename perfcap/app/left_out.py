"""How many frames a mean is of, where these are fewer than were scored: counts, and words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from torch import Tensor

from perfcap.app.truth import FoundJoints, Truth, match_frames
from perfcap.detect.joint_set import LANDMARKS
from perfcap.metrics import JointErrors, counted_joints

_HIPS = ("r_hip", "l_hip")
_RUNS = {"frames_accel": ("accelerations", 3), "frames_jerk": ("jerks", 4)}
_PLACED = {
    "frames_transl_aligned": ("two", "translation-aligned errors"),
    "frames_similarity_aligned": ("three", "similarity-aligned errors"),
}
_PICTURED = {
    "mesh_frames": ("true and captured surfaces", "surface errors"),
    "silhouette_frames": ("surfaces", "silhouette_iou"),
    "segmentation_frames": ("masks", "errors of masks"),
}


def frame_counts(
    errors: JointErrors, moving: Tensor, expected: Tensor, scored: Sequence[str] = LANDMARKS
) -> dict[str, float]:
    """Frames of the means that are of fewer than ``errors.frames``, by names of their own.

    Args:
        errors: of joints, without a batch.
        moving: joints of the result with an unknown frame in each gap, (F, 16, 3), metres.
        expected: the true ones likewise.
        scored: landmarks of the protocol; without both hips no root is expected.

    Returns:
        ``frames_root_aligned`` (also those of PCK and AUC), ``frames_transl_aligned``,
        ``frames_similarity_aligned``; ``frames_accel`` and ``frames_jerk``, of three and four
        frames in a row: how many rows have a joint that is known in all of it, where others have
        joints in each frame, but none in all.
    """
    counts = {
        "frames_root_aligned": errors.frames_root,
        "frames_transl_aligned": errors.frames_translation,
        "frames_similarity_aligned": errors.frames_similarity,
    }
    fewer = {name: float(count) for name, count in counts.items() if count < errors.frames}
    if not set(_HIPS) <= set(scored):
        fewer.pop("frames_root_aligned", None)
    valid = counted_joints(moving, expected, partial=True)
    for name, (_, length) in _RUNS.items():
        whole, possible = _runs(valid, length)
        if whole < possible:
            fewer[name] = float(whole)
    return fewer


def _runs(valid: Tensor, length: int) -> tuple[int, int]:
    """Rows of so many frames in which one joint is known throughout, and any joint in each.

    Args:
        valid: joints that count, (F, J).
        length: frames in a row.
    """
    if len(valid) < length:
        return 0, 0
    whole = valid.unfold(0, length, 1).all(-1).any(-1)
    possible = valid.any(-1).unfold(0, length, 1).all(-1)
    return int(whole.sum()), int(possible.sum())


def left_out(
    scores: Mapping[str, float], found: FoundJoints, truth: Truth, every: int = 1
) -> list[str]:
    """What says of a mean that it is of fewer frames than were scored, a sentence each.

    Args:
        scores: by their names in metrics.json.
        found: joints of the result.
        truth: what they were compared with.
        every: surfaces and silhouettes of every so many frames were compared.

    Returns:
        Nothing where nothing is left out, or where the protocol never has the joints.
    """
    said = list(_of_pictures(scores, found, truth, every))
    if truth.sequence.joints3d is None or not scores.get("frames_scored"):
        return said
    rows, others = match_frames(found.frames, truth, str(found.path))
    true = truth.scored(truth.sequence.joints3d[others])
    valid = counted_joints(found.joints[rows], true, partial=True)
    return [*_of_joints(scores, valid), *_of_images(scores, len(rows)), *said]


def _of_joints(scores: Mapping[str, float], valid: Tensor) -> Iterator[str]:
    """Of means over joints in space; which of them count, (F, 16), is known."""
    seen = valid[valid.any(-1)]
    scored = len(seen)
    lacking = [name for name in _HIPS if not bool(seen[:, LANDMARKS.index(name)].all())]
    if "frames_root_aligned" in scores:
        yield _said(
            f"{_are(lacking)} unknown in",
            scored,
            scored - int(scores["frames_root_aligned"]),
            "of the truth",
            "root-aligned errors, PCK and AUC",
        )
    for name, (least, what) in _PLACED.items():
        if name in scores:
            lost = scored - int(scores[name])
            yield _said(
                f"fewer than {least} joints are known in", scored, lost, "of the truth", what
            )
    for name, (what, length) in _RUNS.items():
        if scores.get(name):
            yield (
                f"{what} are of {int(scores[name])} rows of {length} frames: in others no joint of "
                "the truth is known throughout"
            )
        elif name in scores:
            yield f"no joint of the truth is known in {length} frames in a row: there are no {what}"
    if "frames_foot_skate" in scores:
        lost = scored - int(scores["frames_foot_skate"])
        yield _said("feet are unknown in", scored, lost, "of the truth", "foot_skate_mm")
    count = seen.sum(0)
    some = [name for name, n in zip(LANDMARKS, count.tolist(), strict=True) if 0 < n < scored]
    if some:
        most = scored - int(count[count > 0].min())
        yield (
            f"{_are(some)} unknown in {'up to ' if len(some) > 1 else ''}{most} of {scored} frames "
            "of the truth: per_joint_mm is of the frames that have the joint (per_joint_frames)"
        )


def _of_images(scores: Mapping[str, float], compared: int) -> Iterator[str]:
    """Of joints that are annotated in the images of some frames alone."""
    if "frames_reproj" in scores:
        lost = compared - int(scores["frames_reproj"])
        yield _said("no joint is annotated in", compared, lost, "of the truth", "reproj_px")


def _of_pictures(
    scores: Mapping[str, float], found: FoundJoints, truth: Truth, every: int
) -> Iterator[str]:
    """Of surfaces and silhouettes that a result has of some of its frames alone."""
    numbers = truth.sequence.frames[truth.sequence.counted(truth.protocol)]
    shared = -(-int(np.isin(found.frames, numbers.numpy()).sum()) // every)
    for name, (things, what) in _PICTURED.items():
        if scores.get(name, shared) < shared:
            lost = shared - int(scores[name])
            yield _said(f"there are no {things} in", shared, lost, "that are compared", what)


def _said(what: str, scored: int, lost: int, whose: str, means: str) -> str:
    """One sentence; a mean over nothing is not in the file."""
    if lost == scored:
        return f"{what} all {scored} frames {whose}: there are no {means}"
    verb = "is" if "_" in means else "are"
    return f"{what} {lost} of {scored} frames {whose}: {means} {verb} of the other {scored - lost}"


def _are(names: list[str]) -> str:
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"
