"""Whether calibrated views agree on the person, and which one is to blame if not."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.crossed_parts import examine_crossed_parts
from perfcap.io.doctor.evidence import (
    BETTER,
    CROSSING,
    MIN_JOINTS,
    Scene,
    disagreement,
    left_out_error,
    person_height,
)
from perfcap.io.doctor.finding import Finding, Severity, doubting
from perfcap.io.doctor.hypotheses import SHORT, Hypothesis, hypotheses, late_view
from perfcap.io.doctor.late_ways import late_ways
from perfcap.io.doctor.neighbours import examine_neighbours
from perfcap.io.doctor.one_view import examine_one_view
from perfcap.io.doctor.pairs import examine_pairs
from perfcap.io.doctor.sides import examine_exchange, examine_sides, examine_sides_of_two
from perfcap.io.doctor.stretches import examine_stretches
from perfcap.io.doctor.turned_camera import LIKELIER, TurnedCamera, turned_camera
from perfcap.io.doctor.turned_parts import examine_turned_limbs

# Shares of the person's height in the image. Good calibrations with real detectors disagree by
# 0.01 to 0.02.
FINE = 0.005  # below this nothing is looked for
BAD = 0.04
CULPRIT = 0.03
HOPELESS = 0.08
# Calibration errors are alike in frames near each other, and another moment of one of two views may
# undo them. Up to the first no view of a short clip is called late, and of others it may be chance;
# it may be so up to the second in short ones
CALIBRATED, CLEARLY = 0.016, 0.023
SLACK_OF_TWO = 2.0  # two views alone place a person this much worse
OUTLIER = 1.8  # an error this many times the other views' is not noise
PREFERRED = 1.4  # a specific mistake is preferred to "a bad camera" up to this factor
# Times what is left without a view: late ones leave 1.6 at most once they are in time, one whose
# joints lie 30 or 60 px aside 1.7 or more, and often another view then seems late
IN_TIME = 1.6
COMMON = 0.25  # share of the joints that two views see
_OF_SIDES = 120  # frames in which left and right are looked at
# m, hip to ankle, of children who just stand to the tallest; triangulated from few frames of two
# views, right ones come out longer. Units that people mistake differ by 2.5 times or more
LEG = (0.3, 1.45)
_LEGS = [[LANDMARKS.index(f"{s}_{n}") for n in ("hip", "knee", "ankle")] for s in "lr"]


def examine_agreement(
    rig: CameraRig, detections: Detections, *, alone: bool = True, successive: bool = True
) -> list[Finding]:
    """Triangulate the person and explain what does not fit.

    One mistake after the other is undone as long as that reduces the disagreement markedly: a
    wrong convention, exchanged or delayed views, swapped sides, another image size, a bad camera
    (found by leaving each out).

    Args:
        rig: C views; nothing can be said of one.
        detections: (F, C).
        alone: whether nobody else is followed, so that following everybody may help.
        successive: whether frames follow one another, not picked from a clip.
    """
    if detections.views != len(rig.names) or detections.views < 2:
        return []
    if rig.cameras.moving and len(rig.cameras.rotation) != detections.frame_count:
        return []
    if bool(detections.trusted3d.any()) and not bool((detections.confidence2d > 0).any()):
        return []  # 3D poses alone: each is its view's own, and none is expected in the images
    given = Scene(rig.cameras, detections).straightened()
    names, sampled = list(rig.names), given.sampled()
    height, now = person_height(sampled), disagreement(sampled)
    if not (math.isfinite(height) and math.isfinite(now)):
        return _unknown(given.sure().detections)
    late = late_ways(given) if successive else None
    findings = [] if late is None else [late.finding(names)]
    scene = given if late is None else late.undo(given)
    for _ in rig.names:
        found = _explain(scene, names, height, alone, successive)
        if found is None:
            break
        views = [rig.names.index(name) for name in names]  # others are left out by now
        finding, scene, names = found
        findings.append(_numbered(finding, views))
    views = [rig.names.index(name) for name in names]
    sampled = scene.sampled()
    if disagreement(sampled) < BAD * height:
        # where joints of one view are exchanged, points are nowhere
        throughout = examine_one_view(sampled, names, height)
        if not throughout:
            scaled, throughout = _throughout(scene, successive)
            findings += scaled
        if successive:
            throughout += _stretches(scene.sure(), names, height, alone, bool(throughout))
        return [*findings, *(_numbered(each, views) for each in throughout)]
    # what was undone on the way explains nothing, since the views still disagree
    what = f"disagree on the person by {now:.0f} px, {now / height:.0%} of their height"
    remedy = (
        "check that calibration, videos and detections belong together and come in one order, and "
        "that joints are of one person and side; else calibrate again"
    )
    return [
        *_behind(given.sampled(), rig.names),
        Finding(Severity.ERROR, "cameras", what, remedy, views=tuple(range(len(rig.names)))),
    ]


def _unknown(detections: Detections) -> list[Finding]:
    """Why agreement on joints (F, C, 16) is not known; of a few images there are never many."""
    common = (detections.confidence2d > 0).sum(1) > 1
    if int(common.sum()) < MIN_JOINTS and float(common.double().mean()) >= COMMON:
        return []
    what = "hardly any joint is seen by two views at once; agreement cannot be checked"
    return [Finding(Severity.WARNING, "cameras", what)]


def _explain(
    scene: Scene, names: list[str], height: float, alone: bool, successive: bool
) -> tuple[Finding, Scene, list[str]] | None:
    """The mistake that explains most, and the scene without it; None when all is well."""
    now = disagreement(scene.sampled())
    if not FINE * height < now:
        return None
    short = len(scene.common()) < SHORT
    timed = not short or now > CALIBRATED * height
    best, left = best_mistake(scene, names, BAD * height, timed=timed)
    late = late_view(scene, names) if successive else None
    in_time = math.inf if late is None else disagreement(late.undo(scene).sampled())
    outcast = _outcast(scene.sampled(), now, height)
    without = math.inf if outcast is None else outcast.rest
    if late is not None and in_time < min(left, now, IN_TIME * without):
        # where the person hardly moves, joints are right at another time as well
        off = [
            view for view in late.views if left_out_error(scene.sampled(), view) > CULPRIT * height
        ]
        finding = Finding(Severity.ERROR, late.subject, late.what, late.remedy, views=tuple(off))
        return finding, late.undo(scene), names
    explained = left < min(BETTER * now, PREFERRED * without)
    turned = turned_camera(scene) if len(names) == 2 and (explained or now > BAD * height) else None
    if turned is not None and turned.rest < min(BETTER * now, left / LIKELIER):
        finding = _turned(turned, names, now, height)
        return finding, turned.undo(scene), names
    if explained:
        what = f"{best.what} (that leaves {left:.0f} of {now:.0f} px disagreement)"
        if best.delay and now < (CLEARLY if short else CALIBRATED) * height:
            what += ", which may be chance"
            what += " in so few frames" if short else ": a calibration may leave as much"
            finding = Finding(Severity.WARNING, best.subject, what, best.remedy)
            return finding, best.undo(scene), names
        # of two views it is unknown which one is wrong
        at_fault = best.views if best.views and len(names) > 2 else tuple(range(len(names)))
        finding = Finding(Severity.ERROR, best.subject, what, best.remedy, views=at_fault)
        return finding, best.undo(scene), names
    if outcast is None:
        return None
    rest = [view for view in range(len(names)) if view != outcast.view]
    finding = _accuse(outcast, names[outcast.view], height, alone)
    return finding, scene.select(rest), [names[view] for view in rest]


def best_mistake(
    scene: Scene, names: list[str], bad: float, *, timed: bool = True
) -> tuple[Hypothesis, float]:
    """The mistake without which views disagree least, and by how much, pixels; above ``bad`` they
    do not agree.

    Late views are among them where ``timed``.
    """
    views, frames = range(len(names)), len(scene.common())
    every = hypotheses(names, views, frames)
    candidates = [each for each in every if timed or not each.delay]
    undone = [each.undo(scene) for each in candidates]
    # in an image of a fourth of the size all errors are a fourth, too
    left = [
        disagreement(mended.sampled()) / each.scale
        for each, mended in zip(candidates, undone, strict=True)
    ]
    left = [
        math.inf
        if (each.settles and rest > bad) or _of_fewer(scene, mended, each.delay, rest)
        else rest
        for each, mended, rest in zip(candidates, undone, left, strict=True)
    ]
    lowest = min(range(len(left)), key=left.__getitem__)
    return candidates[lowest], left[lowest]


def _of_fewer(scene: Scene, undone: Scene, delay: int, rest: float) -> bool:
    """Whether a late view of a short clip leaves less since frames without a partner are not seen.

    These few may be the worst ones, so that the same frames are compared as they are now.
    """
    if not delay or len(scene.common()) >= SHORT:
        return False
    return not rest < BETTER * disagreement(scene.frames(undone.common()).sampled())


@dataclass(frozen=True)
class _Outcast:
    """A view that does not fit: its error and what remains without it, pixels."""

    view: int
    error: float
    rest: float


def _outcast(scene: Scene, now: float, height: float) -> _Outcast | None:
    """The view to blame: without it the rest agree, or they all see the person elsewhere.

    The first sign is sharp when a view is far off, the second when many views dilute its error.
    """
    seeing = (scene.detections.confidence2d > 0).any(-1).any(0)
    views = [view for view, sees in enumerate(seeing.tolist()) if sees]
    if len(views) < 3:
        return None
    rest = {out: disagreement(scene.select([v for v in views if v != out])) for out in views}
    errors = {view: left_out_error(scene, view) for view in views}
    enough = CULPRIT * height * (1 if len(views) > 3 else SLACK_OF_TWO)
    suspect = min(views, key=rest.__getitem__)
    if rest[suspect] < BETTER * now and errors[suspect] > enough:
        return _Outcast(suspect, errors[suspect], rest[suspect])
    known = [view for view in views if math.isfinite(errors[view])]
    if len(known) < 4:
        return None
    suspect = max(known, key=errors.__getitem__)
    others = statistics.median(errors[view] for view in known if view != suspect)
    if errors[suspect] > max(enough, OUTLIER * others):
        return _Outcast(suspect, errors[suspect], rest[suspect])
    return None


def _numbered(finding: Finding, views: Sequence[int]) -> Finding:
    """A finding of some of the views, by the numbers that these have in the capture."""
    return replace(finding, views=tuple(views[view] for view in finding.views))


def _throughout(scene: Scene, successive: bool) -> tuple[list[Finding], list[Finding]]:
    """The unit of the world, and joints that have the names of others in every view."""
    sampled = scene.sampled()
    points, _ = sampled.triangulated(rounds=6)
    # hips, a shank and its foot are rarely known together where two views see them
    more, residual = scene.sampled(_OF_SIDES).triangulated(rounds=6)
    likely: list[Finding] = []
    if scene.detections.views == 2:
        exchanged, likely = examine_sides_of_two("detections", more, residual, successive)
    else:
        exchanged = examine_sides("detections", more, successive=successive)
    exchanged = exchanged or examine_pairs("detections", points)
    if not exchanged:
        # bones have lengths where rays cross
        placed = sampled.crossing(points)[..., None] > CROSSING
        exchanged = examine_neighbours("detections", torch.where(placed, points, torch.nan))
    everywhere = tuple(range(scene.detections.views))
    # what is likely alone takes no trust from joints
    return _scale(points), [replace(each, views=everywhere) for each in exchanged] or likely


def _stretches(
    scene: Scene, names: list[str], height: float, alone: bool, throughout: bool
) -> list[Finding]:
    """What is wrong in a part of the clip alone; of single joints, where none is throughout."""
    findings = examine_stretches(scene, names, height, alone=alone)
    # views that are exchanged turn sides over as well
    seen = doubting(scene.detections, findings).undoubted()
    points, _ = Scene(scene.cameras, seen).triangulated(rounds=6)
    limbs = examine_turned_limbs("detections", seen.joints2d, seen.confidence2d > 0, points)
    if limbs:
        seen = doubting(seen, limbs).undoubted()
        points, _ = Scene(scene.cameras, seen).triangulated(rounds=6)
    sides = examine_exchange("detections", seen.joints2d, seen.confidence2d > 0, points)
    if limbs or sides or throughout:
        return [*findings, *limbs, *sides]
    return [*findings, *examine_crossed_parts("detections", points, range(len(names)))]


def _accuse(outcast: _Outcast, name: str, height: float, alone: bool) -> Finding:
    off = "elsewhere than"
    if math.isfinite(outcast.error):  # two others see them at once
        share = outcast.error / height
        off = f"{outcast.error:.0f} px ({share:.0%} of their height) from where"
    what = (
        f"sees the person {off} the other views see them, which agree within {outcast.rest:.0f} px"
    )
    follow = " (--people follows everybody)" if alone else ""
    remedy = (
        f"look whether its joints are of somebody else{follow}, and its video of this take; else "
        "calibrate this view again or leave it out"
    )
    severity = Severity.ERROR if share > HOPELESS else Severity.WARNING
    return Finding(severity, name, what, remedy, views=(outcast.view,))


def _turned(turned: TurnedCamera, names: Sequence[str], now: float, height: float) -> Finding:
    """Of two views, one of which no longer looks where it was calibrated."""
    what = (
        f"disagree on the person by {now:.0f} px, {now / height:.0%} of their height, and by "
        f"{turned.rest:.0f} px if {names[turned.view]} is turned by {turned.degrees:.1f} degrees"
    )
    remedy = (
        "was one of them moved after it was calibrated, or is its video of another size? Calibrate "
        "again, or let --refine-cameras turn them a little (solve_views with refine=True)"
    )
    subject = "cameras" if now > BAD * height else " and ".join(names)
    return Finding(Severity.ERROR, subject, what, remedy, views=tuple(range(len(names))))


def _behind(scene: Scene, names: Sequence[str]) -> list[Finding]:
    """Views with most of the person at their back."""
    points, residual = scene.triangulated(rounds=0)
    depth = scene.cameras.to_camera(points)[..., 2]  # F C J
    known = ~residual.isnan()
    findings = []
    for view, name in enumerate(names):
        inside = depth[:, view][known]
        if len(inside) and float((inside < 0).double().mean()) > 0.5:
            what = f"the person is {-inside.median():.2g} m behind this camera"
            remedy = "its z axis must point at the scene: check R and t"
            findings.append(Finding(Severity.ERROR, name, what, remedy))
    return findings


def _scale(points: Tensor) -> list[Finding]:
    """Length of the legs: calibrations can agree perfectly in the wrong unit."""
    legs = points[:, _LEGS]  # F 2 3 3
    length = legs.diff(dim=2).norm(dim=-1).sum(-1)
    length = length[~length.isnan()]
    if not len(length) or LEG[0] < float(length.median()) < LEG[1]:
        return []
    leg = float(length.median())
    guess = "millimetres" if leg > 100 else "centimetres" if leg > 20 else "another unit"
    what = f"the person's legs measure {leg:.3g} m, which looks like {guess}"
    return [Finding(Severity.ERROR, "cameras", what, "convert translations to metres")]
