"""Whether 3D poses belong to the 2D joints of their view: their axes and their frames."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from perfcap.detect.extent import end_to_end
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.geometry.triangulation import translation_from_plane
from perfcap.io.doctor.finding import Finding, Severity

# Shares of the person's height in the image. Good detectors and lifters leave 0.036 to 0.047.
FINE = 0.01  # below this nothing is looked for
LOST = 0.15  # more is no pose of these joints
FAR = 0.3  # errors beyond this count as this: a joint behind the camera has any
NEARER = 0.8  # a shift explains a misfit if undoing it leaves at most this share
# In clips of fewer frames the best shift leaves less by accident: then this share, and a warning,
# unless little is left (``late_poses.py``)
_NEARER_OF = ((20, 0.6), (40, 0.7))
_SURELY = 0.5
# Of clips of 60 frames and more that are 2 or 3 frames late, misfits lessen by less and do so all
# along; of 266 sound ones of recorded motion none does both (``late_poses.py``)
STEADILY, _ALONG, _STRETCH, _LASTING, _LEAST = 0.92, 0.75, 10, 56, 2
EXCHANGED = 0.5
MIRRORED = 0.7  # of 40 frames of six recordings and of lifters on six more it is 1.5 and more
# Of single images that are mirrored, by how much they miss, and the share that is no accident:
# 0.01 at most of 14 sound recordings, 0.29 to 0.47 of such of which half are mirrored
_MISSED, _PARTLY, _SOME = 0.06, 0.15, 4
# Degrees that poses are turned back by, and what may be left then. Of sound views 24 fit best
# within 5 degrees, and parts of them have 0.79, 0.88 and 0.93 left (10, 20 and 40 frames); turned
# by 20 to 30 they have 0.3 to 0.84 left of real and rendered people
_TURNS, _TURNED, _TURNED_SHORT, _LONG = (10, 15, 20, 30, 40), 0.88, 0.7, 30
SHIFTS = 30  # frames looked at, both ways
_COARSE = (2, 3, 5, 8, 12, 16, 20, 25, SHIFTS)
_FRAMES = 240  # looked at, evenly spread
_FEWEST = 10  # frames that say something
_CONFIDENT = 0.3
_NEAREST = 0.3  # m from the camera


def examine_lifted(
    name: str,
    pose: Tensor,
    plane: Tensor,
    confidence: Tensor,
    trusted: Tensor,
    *,
    successive: bool = True,
) -> list[Finding]:
    """Place each 3D pose where it projects best onto its 2D joints, and explain what is left.

    Args:
        name: of the view.
        pose: in camera axes, relative to the middle of the hips, (F, 16, 3), metres.
        plane: undistorted image coordinates of the joints, (F, 16, 2).
        confidence: of the joints, (F, 16).
        trusted: frames of which there is a pose, (F,), bool.
        successive: whether frames follow one another; of images in any order some may be mirrored.
    """
    view = _View(pose, plane, confidence * trusted[:, None])
    now = view.misfit(0)
    if not now > FINE:  # also where there is nothing to compare
        return []
    exchanged = _View(pose[..., [1, 0, 2]], plane, view.confidence).misfit(0)
    if exchanged < EXCHANGED * now:
        what = "x and y look exchanged between the 2D joints and the 3D poses"
        remedy = "expected x to the right and y down in both"
        return [Finding(Severity.ERROR, name, f"{what} ({now:.0%} misfit)", remedy)]
    # sides exchanged as well, as where images are mirrored to have more of them to train on
    other = (pose * pose.new_tensor([-1.0, 1.0, 1.0]))[:, list(LANDMARKS16.mirrored())]
    turned = _View(other, plane, view.confidence)
    what = "3D poses look like mirror images of the 2D joints, left and right exchanged"
    remedy = "mirror both or neither: x in the image, x in camera axes, and sides of joints"
    if turned.misfit(0) < MIRRORED * now:
        return [Finding(Severity.ERROR, name, f"{what} ({now:.0%} misfit)", remedy)]
    if not successive and (share := _partly_turned(view, turned)):
        return [Finding(Severity.WARNING, name, f"{what}, in {share} images", remedy)]
    shift, least = _best_shift(view)
    own = min(now, _of_these(view, shift))  # frames that are left may fit better anyway
    way = "late" if shift > 0 else "early"
    what = f"3D poses look {abs(shift)} frames {way} against the 2D joints"
    remedy = "give 2D and 3D joints of the same frames"
    frames = int((view.confidence > 0).any(-1).sum())
    nearer = next((share for most, share in _NEARER_OF if frames < most), NEARER)
    if least < nearer * own:
        sure = nearer == NEARER or least < _SURELY * own
        severity = Severity.ERROR if sure else Severity.WARNING
        return [Finding(severity, name, f"{what} ({now:.0%} misfit)", remedy)]
    if successive and least < STEADILY * own and _steadily(view, shift):
        what = f"{what} (that leaves {least:.1%} of {now:.1%} misfit, in most of the clip)"
        return [Finding(Severity.WARNING, name, what, remedy)]
    if turn := _turn(view, now):
        what, rest = turn
        what = f"3D poses look turned by {what} (that leaves {rest:.1%} of {now:.1%} misfit)"
        remedy = (
            "give them in the axes of this camera, not those of gravity, the world or a crop; "
            "poses of other frames look like this, too"
        )
        return [Finding(Severity.WARNING, name, what, remedy)]
    if now > LOST:
        what = f"3D poses miss the 2D joints by {now:.0%} of the person's height"
        remedy = (
            "a lifter's do where few joints are seen, as legs alone; check that others are of this "
            "view, in its camera's axes, and in the same frames"
        )
        return [Finding(Severity.WARNING, name, what, remedy)]
    return []


class _View:
    """The poses and joints of one view, frame by frame."""

    def __init__(self, pose: Tensor, plane: Tensor, confidence: Tensor) -> None:
        self.pose, self.plane = pose, plane
        seen = confidence > _CONFIDENT
        self.confidence = torch.where(seen, confidence, 0)
        height = end_to_end(plane, seen)[seen.sum(-1) > 8]
        self.height = float(height.median()) if len(height) else math.nan

    def parts(self) -> tuple[Tensor, Tensor, Tensor]:
        """Poses, joints and confidence, each of all frames."""
        return self.pose, self.plane, self.confidence

    def misfit(self, shift: int) -> float:
        """Mean distance of poses ``shift`` frames later from the joints, in heights; NaN if none.

        ``shift`` is how many frames the poses are late.
        """
        error = self.misfits(shift)
        known = error.isfinite()
        enough = int(known.any(-1).sum()) >= _FEWEST
        return float(error[known].mean()) if enough else math.nan

    def misfits(self, shift: int) -> Tensor:
        """The same of every joint, (N, 16), NaN where unknown, of some frames that are left."""
        count = len(self.pose) - abs(shift)
        if count < _FEWEST:
            return self.plane.new_zeros(0, 16)
        index = torch.linspace(0, count - 1, min(count, _FRAMES)).round().long()
        frames, poses = index + max(0, -shift), index + max(0, shift)
        pose, plane, weight = self.pose[poses], self.plane[frames], self.confidence[frames]
        weight = weight * (self.confidence[poses] > 0).any(-1, keepdim=True)
        place, _ = translation_from_plane(pose, plane, weight)
        points = pose + place[:, None]
        error = (points[..., :2] / points[..., 2:] - plane).norm(dim=-1) / self.height
        error = torch.where(points[..., 2] > _NEAREST, error, FAR).nan_to_num(FAR).clamp(max=FAR)
        return torch.where(weight > 0, error, torch.nan)


def _of_these(view: _View, shift: int) -> float:
    """Misfit as they are of the frames that poses so many frames later are compared with."""
    start = max(0, -shift)
    stop = start + len(view.pose) - abs(shift)
    left = _View(*(part[start:stop] for part in view.parts()))
    left.height = view.height
    return left.misfit(0)


def _steadily(view: _View, shift: int) -> bool:
    """Whether poses so many frames later fit better in most stretches of a clip's beginning."""
    first = _View(*(part[:_FRAMES] for part in view.parts()))
    own, later = (first.misfits(each).nanmean(-1) for each in (0, shift))
    start = max(0, -shift)
    gain = own[start : start + len(later)] - later
    if abs(shift) < _LEAST or len(gain) < _LASTING:
        return False
    better = [float(each.nanmean()) > 0 for each in torch.split(gain, _STRETCH)]
    return sum(better) >= _ALONG * len(better)


def _turn(view: _View, now: float) -> tuple[str, float] | None:
    """By how much all poses are turned about an axis, in words, and the misfit without that."""
    rest: dict[tuple[int, int], float] = {}
    for axis in range(3):
        for degrees in (*_TURNS, *(-each for each in _TURNS)):
            about = view.pose.new_zeros(3)
            about[axis] = math.radians(degrees)
            # rows are turned by the transposed
            back = view.pose @ rotvec_to_matrix(about)
            rest[axis, degrees] = _View(back, view.plane, view.confidence).misfit(0)
    axis, degrees = min(rest, key=lambda each: rest[each] if rest[each] > 0 else math.inf)
    least = rest[axis, degrees]
    frames = int((view.confidence > 0).any(-1).sum())
    most = min(LOST, (_TURNED if frames >= _LONG else _TURNED_SHORT) * now)
    if not least < most:
        return None
    return f"about {abs(degrees)} degrees about {'xyz'[axis]}", least


def _partly_turned(view: _View, turned: _View) -> str:
    """How many images fit markedly better in the mirror, in words, where that is no accident."""
    own, other = (each.misfits(0).nanmean(-1) for each in (view, turned))
    known = own.isfinite() & other.isfinite()
    better = int(((own > _MISSED) & (other < MIRRORED * own))[known].sum())
    many = better >= max(_SOME, _PARTLY * int(known.sum()))
    return f"{better} of {int(known.sum())}" if many else ""


def _best_shift(view: _View) -> tuple[int, float]:
    """The shift of least misfit that is not zero, and that; searched for coarsely, then finely."""
    found: dict[int, float] = {}

    def measure(shift: int) -> float:
        if shift not in found:
            misfit = view.misfit(shift)
            found[shift] = misfit if math.isfinite(misfit) else math.inf
        return found[shift]

    best = min((way * step for step in _COARSE for way in (1, -1)), key=measure)
    near = [shift for shift in range(best - 4, best + 5) if 0 < abs(shift) <= SHIFTS]
    best = min(near, key=measure)
    return best, found[best]
