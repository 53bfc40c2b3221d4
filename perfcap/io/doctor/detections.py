"""Checks of detections on their own and against their images."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.backwards import examine_backwards
from perfcap.io.doctor.crossed_parts import examine_crossed_parts
from perfcap.io.doctor.depth import examine_depth
from perfcap.io.doctor.doubled import examine_doubled
from perfcap.io.doctor.edges import examine_edges
from perfcap.io.doctor.empty_joints import examine_empty, examine_placeholders
from perfcap.io.doctor.faint import examine_faint
from perfcap.io.doctor.finding import Finding, Severity, of_view, ranges
from perfcap.io.doctor.grid import examine_grid
from perfcap.io.doctor.jumps import examine_jumps
from perfcap.io.doctor.lifted import examine_lifted
from perfcap.io.doctor.neighbours import examine_crown, examine_neighbours
from perfcap.io.doctor.order import examine_order, examine_shuffled
from perfcap.io.doctor.pairs import examine_pairs
from perfcap.io.doctor.repeated import examine_held, examine_repeated
from perfcap.io.doctor.seams import examine_seams
from perfcap.io.doctor.shrunk import examine_shrunk
from perfcap.io.doctor.sides import examine_limbs_of_view, examine_sides
from perfcap.io.doctor.sparse import examine_sparse
from perfcap.io.doctor.straight import examine_straight
from perfcap.io.doctor.turned_parts import examine_turned_poses, examine_turned_view
from perfcap.io.doctor.unsteady import examine_unsteady

CONFIDENT = 0.3
EXTENT = (0.3, 3.0)  # m, of a person's 3D pose
ROOT_TOLERANCE = 0.05  # m
_LYING, _LEANING = 0.9, 0.5  # shares of frames; who dances leans to the side in some
_FEWEST = 10  # frames
_SOME = 4  # joints that tell a copied view
_NECK = LANDMARKS.index("neck")
_ANKLES = [LANDMARKS.index(name) for name in ("r_ankle", "l_ankle")]
_HIPS = [LANDMARKS.index(name) for name in ("r_hip", "l_hip")]


def examine_detections(
    rig: CameraRig,
    detections: Detections,
    *,
    coverage: bool = True,
    faint: bool = True,
    detected: bool = False,
    alone: bool = True,
    successive: bool = True,
) -> list[Finding]:
    """Coverage, image size, and units, axes and frames of 3D poses.

    Args:
        rig: C views.
        detections: (F, C).
        coverage: whether to list frames in which nobody is detected.
        faint: whether to tell that all confidences are next to nothing.
        detected: whether they were found in the images of these cameras, so that sizes fit.
        alone: whether nobody else is followed.
        successive: whether frames follow one another, not picked from a clip.
    """
    if detections.views != len(rig.names):
        what = f"{detections.views} views for {len(rig.names)} cameras"
        return [Finding(Severity.ERROR, "detections", what, "give one a camera")]
    findings = _moving(rig, detections)
    if findings:
        return findings
    findings += _copied(rig.names, detections)
    plane = rig.cameras.to_plane(detections.joints2d)
    orders = _orders(rig, detections, alone=alone, successive=successive)
    again = [examine_repeated(name, i, *_given(i, detections)) for i, name in enumerate(rig.names)]
    if successive and not (rig.cameras.moving or all(orders) or any(again)):
        findings += examine_seams(rig.names, detections.joints2d, detections.confidence2d)
    for view, (name, order, repeated) in enumerate(zip(rig.names, orders, again, strict=True)):
        if coverage:
            findings += _coverage(name, detections.confidence2d[:, view])
        shown = detections.joints2d[:, view], detections.confidence2d[:, view]
        findings += order + repeated + examine_grid(name, *shown)
        confident = detections.confidence2d[:, view] > CONFIDENT
        findings += examine_doubled(name, detections.joints2d[:, view], confident)
        if successive:
            findings += examine_shrunk(name, view, *shown)
            straight = examine_straight(name, view, shown[0], confident)
            findings += straight or examine_sparse(name, shown[0], confident)
            findings += [] if order else examine_unsteady(name, shown[0], confident)
        pixels = detections.joints2d[:, view][confident]
        findings += examine_placeholders(name, pixels)
        findings += examine_faint(name, detections.confidence2d[:, view]) if faint else []
        if not detected:
            findings += _image_size(name, pixels, rig.cameras.size[view])
            findings += examine_edges(name, pixels, rig.cameras.size[view])
        if detections.joints3d is not None and detections.trusted3d[:, view].any():
            findings += _poses3d(name, view, plane[:, view], detections, bool(repeated), successive)
        elif len(rig.names) == 1:
            findings += examine_turned_view(name, *shown) if successive else []
            findings += examine_limbs_of_view(name, shown[0], confident)
            findings += examine_crown(name, *shown)
            return findings + _upright(name, detections.joints2d[:, view], confident)
    return findings + _headlong(detections)


def _poses3d(
    name: str, view: int, plane: Tensor, detections: Detections, repeated: bool, successive: bool
) -> list[Finding]:
    """Units, axes, sides and frames of the 3D poses of a view; of what is wrong, the first.

    Args:
        name: of the view.
        view: its number.
        plane: its joints on the plane at distance 1, (F, 16, 2).
        detections: (F, C), with 3D poses.
        repeated: whether frames are known to repeat others.
        successive: whether frames follow one another.
    """
    assert detections.joints3d is not None
    every, trusted = detections.joints3d[:, view], detections.trusted3d[:, view]
    joints, confidence = shown = detections.joints2d[:, view], detections.confidence2d[:, view]
    pose = every[trusted]
    wrong = (
        examine_empty(name, pose)
        or examine_doubled(name, pose, pose.isfinite().all(-1))
        or _axes3d(name, pose, joints[trusted], (confidence > CONFIDENT)[trusted])
        or examine_lifted(name, every, plane, confidence, trusted, successive=successive)
        or examine_sides(name, pose, successive=successive)
        or examine_pairs(name, pose)
        or examine_neighbours(name, pose)
        or examine_crown(name, *shown)
        or examine_depth(name, pose)
    )
    wrong = of_view(view, wrong)
    if not repeated:
        held = examine_held(name, *_poses(view, detections), "3D joints", found=True)
        wrong = wrong or of_view(view, held, partly=True)
    if successive:
        known = torch.where(trusted[:, None, None], every, torch.nan)
        there = known.isfinite().all(-1)
        wrong = wrong or examine_straight(name, view, known, there, "3D joints")
        wrong = wrong or examine_turned_poses(name, view, *shown, every, trusted)
        wrong = wrong or examine_crossed_parts(name, known, (view,))
    return [*_pose3d(name, pose), *wrong]


def _orders(
    rig: CameraRig, detections: Detections, *, alone: bool, successive: bool
) -> list[list[Finding]]:
    """Of each view, frames in a wrong order, or joints that go over to another person."""
    orders = []
    for view, name in enumerate(rig.names):
        found = _order(name, view, detections, successive)
        if successive and not rig.cameras.moving:
            shown = detections.joints2d[:, view], detections.confidence2d[:, view]
            found = found or examine_jumps(name, *shown, alone=alone)
        orders.append(found)
    return orders


def _order(name: str, view: int, detections: Detections, successive: bool) -> list[Finding]:
    """Frames of a view in a wrong order."""
    given = _given(view, detections)
    order = examine_order(name, *given)
    if not successive:
        return of_view(view, order)
    order = of_view(view, order or examine_shuffled(name, *given))
    return order or examine_backwards(name, view, *given, LANDMARKS16.mirrored())


def _given(view: int, detections: Detections) -> tuple[Tensor, Tensor]:
    """Joints of a view and confidence (F, 16): of 3D poses where none is seen in its images."""
    joints, sure = detections.joints2d[:, view], detections.confidence2d[:, view]
    if detections.joints3d is not None and not bool((sure > 0).any()):
        return _poses(view, detections)
    return joints, sure


def _poses(view: int, detections: Detections) -> tuple[Tensor, Tensor]:
    """3D poses of a view, (F, 16, 3), and 1 where they are trusted, (F, 16)."""
    assert detections.joints3d is not None
    poses = detections.joints3d[:, view]
    trusted = detections.trusted3d[:, view, None].expand(poses.shape[:-1])
    return poses, trusted.to(poses)


def examine_places(rig: CameraRig, detections: Detections) -> list[Finding]:
    """Joints of everybody, (P, F, C, 16), against the images of C views.

    Args:
        rig: C views.
        detections: of several people.
    """
    findings = []
    for view, name in enumerate(rig.names):
        confident = detections.confidence2d[..., view, :] > CONFIDENT
        pixels = detections.joints2d[..., view, :, :][confident]
        findings += _image_size(name, pixels, rig.cameras.size[view])
    return findings


def _headlong(detections: Detections) -> list[Finding]:
    """Somebody who stands on their head in every view (F, C), in nearly all frames."""
    seen = detections.confidence2d > CONFIDENT
    downs = [_down(detections.joints2d[:, view], seen[:, view]) for view in range(detections.views)]
    downs = [down for down in downs if len(down) >= _FEWEST]
    shares = [float((down[:, 1] < 0).double().mean()) for down in downs]
    steep = [float((down[:, 1] < -down[:, 0].abs()).double().mean()) for down in downs]
    if not shares or min(shares) < _LYING or min(steep) < _LEANING:
        return []
    what = f"the person stands on their head in every view, in {min(shares):.0%} of the frames"
    remedy = (
        "if they do not, check whether videos are upside down, names and order of joints (the "
        "joint set), and axes: y down"
    )
    return [Finding(Severity.WARNING, "detections", what, remedy)]


def _down(pixels: Tensor, confident: Tensor) -> Tensor:
    """From neck to ankles (N, 2) in the frames (F, 16) that show both."""
    both = confident[:, _NECK] & confident[:, _ANKLES].all(-1)
    return pixels[both][:, _ANKLES].mean(1) - pixels[both, _NECK]


def _upright(name: str, pixels: Tensor, confident: Tensor) -> list[Finding]:
    """Somebody who lies on their side in nearly all frames (F, 16), where nothing else tells."""
    down = _down(pixels, confident)
    lying = float((down[:, 1] < 0.5 * down[:, 0].abs()).double().mean())
    if len(down) < _FEWEST or lying < _LYING:
        return []
    what = f"the person lies or stands on their head in {lying:.0%} of the frames"
    remedy = "if they do not, check whether x and y are exchanged, or the video is turned"
    return [Finding(Severity.WARNING, name, what, remedy)]


def _moving(rig: CameraRig, detections: Detections) -> list[Finding]:
    """Frames of moving cameras against those of the detections."""
    poses = len(rig.cameras.rotation) if rig.cameras.moving else detections.frame_count
    if poses == detections.frame_count:
        return []
    what = f"{poses} camera poses for {detections.frame_count} frames of detections"
    remedy = "give one pose a frame, or a single one for a camera at rest"
    return [Finding(Severity.ERROR, "cameras", what, remedy)]


def _coverage(name: str, confidence: Tensor) -> list[Finding]:
    """Frames without any joint."""
    empty = (confidence <= 0).all(-1)
    if not empty.any():
        return []
    frames = empty.nonzero()[:, 0].tolist()
    share = f"{len(frames)} of {len(confidence)} frames"
    if empty.all():
        remedy = "check the file, or leave the view out"
        return [Finding(Severity.WARNING, name, "nothing is detected in any frame", remedy)]
    what = f"nothing is detected in {share}: {ranges(frames)}"
    severity = Severity.WARNING if len(frames) > len(confidence) / 10 else Severity.INFO
    return [Finding(severity, name, what, "such frames are bridged from their neighbours")]


def _copied(names: Sequence[str], detections: Detections) -> list[Finding]:
    """Views with the 2D or 3D joints of another one, to the last digit."""
    findings = []
    seen, trusted, poses = detections.confidence2d > 0, detections.trusted3d, detections.joints3d
    for first, second in combinations(range(len(names)), 2):
        pair = f"{names[first]} and {names[second]}"
        both = seen[:, first] & seen[:, second]
        same = (detections.joints2d[:, first] == detections.joints2d[:, second]).all(-1)
        if int(both.sum()) >= _SOME and bool(same[both].all()):
            what = "have the same joints to the last digit"
            remedy = "give the detections of each view"
            findings.append(Finding(Severity.ERROR, pair, what, remedy))
        both = trusted[:, first] & trusted[:, second]
        if poses is None or not bool(both.any()):
            continue
        if bool((poses[:, first] == poses[:, second])[both].all()):
            what = "have the same 3D joints to the last digit"
            remedy = (
                "give them in the axes of each view's camera (cameras.to_camera takes them there)"
            )
            findings.append(Finding(Severity.ERROR, pair, what, remedy))
    return findings


def _image_size(name: str, pixels: Tensor, size: tuple[int, int]) -> list[Finding]:
    """Joints against the image they should lie in."""
    if not len(pixels):
        return []
    height, width = size
    low, high = pixels.amin(0), pixels.amax(0)
    extent = f"x {low[0]:.4g} to {high[0]:.4g}, y {low[1]:.4g} to {high[1]:.4g}"
    image = f"the image of {width}x{height}"
    if float(pixels.abs().max()) <= 2:
        what = f"joints look normalised ({extent}), expected pixels"
        return [Finding(Severity.ERROR, name, what, "multiply by the image size")]
    limits = pixels.new_tensor([width, height])
    outside = ((pixels < -0.5) | (pixels > limits - 0.5)).any(-1).double().mean()
    remedy = "check that detections, calibration and video have the same size and orientation"
    if outside > 0.5:
        what = f"most joints ({extent}) lie outside {image}"
        return [Finding(Severity.ERROR, name, what, remedy)]
    if outside > 0.1:
        what = f"{outside:.0%} of the joints ({extent}) lie outside {image}"
        return [Finding(Severity.WARNING, name, what, remedy)]
    if bool((high < limits / 2).all()):
        what = f"all joints ({extent}) lie in the top left quarter of {image}"
        remedy = "check that they were not detected in a video of half the size"
        return [Finding(Severity.WARNING, name, what, remedy)]
    return []


def _pose3d(name: str, pose: Tensor) -> list[Finding]:
    """Size and origin of 3D poses (F, 16, 3)."""
    findings = []
    size = (pose.amax(1) - pose.amin(1)).norm(dim=-1).median()
    if not EXTENT[0] < float(size) < EXTENT[1]:
        what = f"3D poses span {size:.3g} m, expected {EXTENT[0]} to {EXTENT[1]}"
        remedy = "joints3d must be metres (joints3d_mm in files millimetres)"
        findings.append(Finding(Severity.ERROR, name, what, remedy))
    offset = pose[:, _HIPS].mean(1).norm(dim=-1).median()
    if float(offset) > ROOT_TOLERANCE * max(1.0, float(size)):
        what = f"3D poses have the middle of the hips {offset:.3g} m from the origin"
        remedy = "subtract it: 3D joints are relative to it"
        findings.append(Finding(Severity.WARNING, name, what, remedy))
    return findings


def _axes3d(name: str, pose: Tensor, pixels: Tensor, confident: Tensor) -> list[Finding]:
    """Whether x and y of 3D poses run as in the image: correlation over joints and frames."""
    findings = []
    for axis, word, expected in ((0, "x", "to the right"), (1, "y", "down")):
        correlation = _correlation(pose[..., axis], pixels[..., axis], confident)
        if correlation < -0.5:
            what = f"3D {word} runs against the image's {word} (correlation {correlation:.2f})"
            remedy = f"3D joints are in camera axes, {word} {expected}; check flipped axes or sides"
            findings.append(Finding(Severity.ERROR, name, what, remedy))
    return findings


def _correlation(first: Tensor, second: Tensor, mask: Tensor) -> float:
    """Correlation (F, J) of deviations from each frame's mean over the joints in the mask."""
    weights = mask.to(first)
    total = weights.sum(-1, keepdim=True).clamp(min=1)
    a = weights * (first - (weights * first).sum(-1, keepdim=True) / total)
    b = weights * (second - (weights * second).sum(-1, keepdim=True) / total)
    scale = torch.sqrt(a.square().sum() * b.square().sum())
    return float((a * b).sum() / scale) if float(scale) > 0 else 0.0
