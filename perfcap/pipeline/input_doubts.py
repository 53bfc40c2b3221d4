"""What ``perfcap doctor`` would say of inputs that are given in Python, and of an actor."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_correction import SHORTEST, TALLEST
from perfcap.detect.association import bone_lengths, tracked_bones
from perfcap.detect.association.tracks import bone_difference
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.actor_check import examine_joints
from perfcap.io.doctor import Finding, Severity
from perfcap.io.doctor.agreement import examine_agreement
from perfcap.io.doctor.given import examine_given, examine_images, given_rig
from perfcap.io.doctor.legs import triangulated
from perfcap.io.doctor.same_poses import pose_doubts
from perfcap.pipeline.bone_doubts import bone_doubts
from perfcap.pipeline.image_doubts import image_doubts, mask_sentences
from perfcap.pipeline.images import Images
from perfcap.pipeline.other_frames import Pair, other_frames
from perfcap.pipeline.people import Person, Scene
from perfcap.rates import rate_doubts

_HEIGHT = (0.5, 2.6)  # m, of people
_APART = 0.1  # of the person's height: more than detectors differ in the median
_CLEARLY = 0.01  # of bone lengths, by which exchanged actors fit better
_EXCHANGED = 0.7  # of the difference that is left; where more is, neither fits
_OTHER = 0.05  # of bone lengths, by which people who have one actor differ
_NO_POSE = (
    "3D joints are given but no pose of them counts: in each a joint is not a finite number, or it "
    "is not trusted; leave out what the estimator does not have"
)


def warn_of_other_joints(given: Detections, kept: Detections, height: Tensor) -> None:
    """Warn of views whose joints are of other frames than the capture's, or far from its own.

    Joints that are learned may be far for a while, so that of these other frames alone are told.

    Args:
        given: (F, C), in the pixels of the capture.
        kept: (F, C), those of the capture.
        height: of the person, (C,), pixels.
    """
    counts = given.confidence2d > 0, kept.confidence2d > 0
    pixels = given.joints2d.detach(), kept.joints2d.detach()
    own, others = (part / height.detach()[:, None, None] for part in pixels)
    shifted = other_frames(Pair(own, others, *counts))
    for words in dict.fromkeys(each.words for each in shifted.values()):
        views = [view for view, each in shifted.items() if each.words == words]
        there, here = (max(getattr(shifted[v], at) for v in views) for at in ("there", "here"))
        warnings.warn(
            f"detections of views {views} look like those of other frames: {there:.1%} of the "
            f"person's height from those of the capture {words}, {here:.1%} from those of the same "
            "frames; give the joints of the frames that were captured, in their order",
            stacklevel=3,
        )
    if given.joints2d.requires_grad:
        return
    apart = (own - others).norm(dim=-1)
    usual = apart.where(counts[0] & counts[1], torch.nan).transpose(0, 1).flatten(1)
    usual = usual.nanmedian(1).values  # C
    far = [view for view in (usual > _APART).nonzero().flatten().tolist() if view not in shifted]
    if far:
        warnings.warn(
            f"detections of views {far} are {float(usual[far].max()):.0%} of the person's height "
            "from those of the capture; check that they are of the same frames and in its pixels",
            stacklevel=3,
        )


def warn_of_other_poses(cameras: Camera, others: Camera) -> None:
    """Warn of views whose cameras of masks stand elsewhere than the capture's, and not learned.

    Args:
        cameras: of the capture, (C,) or (F, C).
        others: of the masks, likewise.
    """
    learned = cameras.rotation, cameras.translation, others.rotation, others.translation
    if any(each.requires_grad for each in learned):
        return
    for line in pose_doubts([f"view {k}" for k in range(cameras.views)], cameras, others, "masks"):
        warnings.warn(line, stacklevel=3)


class Doubts(NamedTuple):
    """Sentences about a capture, and the findings of its inputs that some of them say."""

    sentences: tuple[str, ...]
    findings: tuple[Finding, ...]


def scene_doubts(scene: Scene, person: Person, looked_at: bool) -> Doubts:
    """What may be wrong with a person, their joints, the cameras and the images of a capture.

    Args:
        scene: where they are.
        person: with joints that are finite.
        looked_at: whether a stage looks at the images; else they only say whether joints fit.

    Raises:
        InputError: most images of a view are of one color, and a stage looks at them.
    """
    cameras, images, joints = scene.cameras, scene.images, person.detections
    told = rate_doubts(scene.rate)
    told += tuple(actor_doubts(person.actor, cameras, joints, person.solve_bones))
    found: tuple[Finding, ...] = ()
    if images is None or not images.examined:
        found = examine_given(cameras, joints)
        told += _input_sentences(joints, found)
    if images is not None and not images.examined:
        seen = _of_images(images, scene, joints, looked_at)
        told, found = told + seen.sentences, found + seen.findings
    return Doubts(told, found)


def _of_images(images: Images, scene: Scene, joints: Detections, looked_at: bool) -> Doubts:
    """What images and their masks say; those that no stage looks at refuse nothing."""
    names = images.names or [f"view {view}" for view in range(joints.views)]
    apart = tuple(pose_doubts(names, scene.cameras, images.cameras, "the images"))
    try:
        found = tuple(image_doubts(images, scene, joints, looked_at))
    except InputError as error:
        if looked_at:
            raise
        return Doubts((*apart, str(error)), ())
    told = apart + tuple(f"{each.subject}: {each.what}; {each.remedy}" for each in found)
    return Doubts(told + (tuple(mask_sentences(images, scene, joints)) if looked_at else ()), found)


def input_doubts(cameras: Camera, detections: Detections, faint: bool = True) -> tuple[str, ...]:
    """A sentence for each mistake in units, axes, lenses, views and frames that numbers show.

    Args:
        cameras: C views, (C,) or (F, C); the middle of an image without a size is taken to be
            where its lens looks.
        detections: (F, C).
        faint: whether to tell that all confidences are next to nothing.
    """
    return _input_sentences(detections, examine_given(cameras, detections, faint=faint))


def images_doubts(cameras: Camera, detections: Detections) -> tuple[str, ...]:
    """What joints of many images in any order, (F, C), show together; see ``examine_images``."""
    return _input_sentences(detections, examine_images(cameras, detections))


def agreement_doubts(cameras: Camera, detections: Detections) -> tuple[str, ...]:
    """What ``input_doubts`` says of how several views agree, (C,) or (F, C), alone."""
    return _input_sentences(detections, examine_agreement(*given_rig(cameras, detections)))


def _input_sentences(detections: Detections, findings: Sequence[Finding]) -> tuple[str, ...]:
    told = () if detections.joints3d is None or bool(detections.trusted3d.any()) else (_NO_POSE,)
    return told + tuple(
        "; ".join(part for part in (f"{found.subject}: {found.what}", found.remedy) if part)
        for found in findings
        if found.severity is not Severity.INFO
    )


def actor_doubts(
    actor: Actor, cameras: Camera, detections: Detections, solve_bones: bool
) -> Iterator[str]:
    """Whether the actor has joints and size of a person, and of this one where views show it.

    Args:
        actor: who is to be captured.
        cameras: C views, (C,) or (F, C).
        detections: (F, C).
        solve_bones: whether bone lengths are solved, so that the actor's own do not matter.
    """
    template = getattr(actor, "template", None)  # joints alone ask for a skeleton, and no surface
    if template is not None and actor.skeleton.rig.joints[: len(JOINTS)] == JOINTS:
        for found in examine_joints(template):
            if found.severity is Severity.ERROR:  # actors of files that have any are refused
                yield f"the actor's {found.subject}: {found.what}; {found.remedy}"
    rest = actor.skeleton.rest_landmarks.detach().double().cpu()
    height = float(rest[:, 1].max() - rest[:, 1].min())
    if not _HEIGHT[0] < height < _HEIGHT[1]:
        yield (
            f"the actor is {height:.3g} m tall, expected {_HEIGHT[0]} to {_HEIGHT[1]}; scale it to "
            "metres, or places and sizes are wrong by that factor"
        )
        return
    if detections.views < 2 and not SHORTEST <= height <= TALLEST:
        yield (
            f"the actor is {height:.3g} m tall, a grown person {SHORTEST} to {TALLEST}; from one "
            "view distances and sizes follow it, scale it unless the person is so tall"
        )
    if not solve_bones:
        yield from bone_doubts(actor, cameras, detections)


def exchanged_actors(scene: Scene) -> list[tuple[str, ...]]:
    """Sentences about each person whose actor fits another one's bones, and theirs this one's.

    And about people of different sizes who are given one actor.
    """
    told: list[tuple[str, ...]] = [()] * len(scene.people)
    if len(told) < 2 or scene.cameras.views < 2:
        return told
    rest = [each.actor.skeleton.rest_landmarks.detach().double().cpu() for each in scene.people]
    own = torch.stack([bone_lengths(each) for each in rest])
    seen = (triangulated(scene.cameras, each.detections.finite()) for each in scene.people)
    shown = torch.stack([tracked_bones(each) for each in seen])
    off = bone_difference(own[:, None], shown)
    for i, j in combinations(range(len(told)), 2):
        given, other = (((a.square() + b.square()) / 2).sqrt() for a, b in _pairs(off, i, j))
        better = float(other) < min(float(given) - _CLEARLY, _EXCHANGED * float(given))
        if better and not _solved(scene.people[i], scene.people[j]):
            for k in (i, j):
                told[k] += (
                    f"the actors of people {i + 1} and {j + 1} look exchanged: bones differ by "
                    f"{float(given):.1%}, the other way by {float(other):.1%}",
                )
        if torch.equal(own[i], own[j]) and not _solved(scene.people[i], scene.people[j]):
            longer = _longer(shown[i], shown[j])
            if abs(longer) > _OTHER:
                for k in (i, j):
                    told[k] += (
                        f"people {i + 1} and {j + 1} have one actor, but the bones of person "
                        f"{i + 1 if longer > 0 else j + 1} are {abs(longer):.1%} longer; give each "
                        "one of their own, or solve the bone lengths (--bones solve, "
                        "solve_bones=True)",
                    )
    return told


def _longer(one: Tensor, other: Tensor) -> float:
    """How much longer bones (7,) are than others; 0 where less than half are in common.

    Mistakes of a detector and of the calibration's scale are in both.
    """
    common = (one / other).log()
    known = common[common.isfinite()]
    return math.expm1(float(known.mean())) if 2 * len(known) >= len(common) else 0.0


def _pairs(off: Tensor, i: int, j: int) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
    return (off[i, i], off[j, j]), (off[i, j], off[j, i])


def _solved(*people: Person) -> bool:
    return any(each.solve_bones for each in people)
