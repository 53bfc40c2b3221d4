"""Limbs that detectors put elsewhere in one view, searched for in the silhouettes.

A leg that is raised behind, or an arm before a pattern, is often seen by no network: its joints are
found on the other leg, or at rest. The mask shows it all the same. Local solves cannot bring it
there, so poses of each limb are searched among many, as Liu et al. 2013 do where limbs are astray.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.pipeline.beyond_masks import frame_excess
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, tensors
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.frame_view import Flags, FrameView
from perfcap.pipeline.gaps import ranges
from perfcap.pipeline.overlap import clip_measures
from perfcap.pipeline.pose_search import GlobalConfig, PoseSearch, released_unknowns
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.surface import SkinnedSurface
from perfcap.setting_checks import Settings
from perfcap.solve.particles import ParticleSettings

_LIMBS = (
    ("r_arm", ("shoulder", "elbow", "wrist"), ("elbow", "wrist")),
    ("l_arm", ("shoulder", "elbow", "wrist"), ("elbow", "wrist")),
    ("r_leg", ("hip", "knee", "ankle"), ("knee", "ankle", "toe")),
    ("l_leg", ("hip", "knee", "ankle"), ("knee", "ankle", "toe")),
)
_WORDS = {"r": "right", "l": "left"}
_SAMPLES = 8  # frames of a stretch in which every limb is tried


@dataclass(frozen=True)
class LostLimbsConfig(Settings):
    """When a limb is searched for, and how.

    Attributes:
        enabled: whether it is at all; of one view alone, since several show where a limb is.
        unexplained: percent of the squared height that masks show beside the body at least.
        beyond: likewise that the body shows beside the masks.
        shortest: seconds of a stretch of such frames.
        longest: frames of one; in a longer one more is wrong than a limb, and a search takes long.
        bridge: seconds between stretches that are one.
        unsure: confidence of joints below which no network sees them.
        together: percent of the height within which joints are those of the other side.
        doubted: share of a stretch's frames in which both joints of a limb must be either: where
            networks see it apart and surely, what masks show beside the body is cloth.
        explained: share of what masks show beside the body that a limb elsewhere must explain;
            what it shows beside the masks may not grow. Skirts and coats stay unexplained.
        smooth: seconds, deviation of the filter over the angles found.
        search: of the poses of a limb.
    """

    enabled: bool = True
    unexplained: float = 0.4
    beyond: float = 0.25
    shortest: float = 0.1
    longest: int = 80
    bridge: float = 0.15
    unsure: float = 0.3
    together: float = 6.0
    doubted: float = 0.5
    explained: float = 0.3
    smooth: float = 0.05
    search: GlobalConfig = field(
        default_factory=lambda: GlobalConfig(
            missed=100.0,
            smoothness=0.3,
            spread=(0.03, 0.1, 0.4),
            particles=ParticleSettings(per_dimension=40, most=400),
        )
    )


@dataclass(frozen=True)
class FoundLimb:
    """A limb that silhouettes show elsewhere in frames ``start`` to ``stop``."""

    start: int
    stop: int
    limb: str

    @property
    def words(self) -> str:
        """The limb, in words."""
        side, limb = self.limb.split("_")
        return f"{_WORDS[side]} {limb}"

    def report(self, first_frame: int = 0) -> dict[str, Any]:
        """Plain values."""
        return {"frames": [self.start + first_frame, self.stop + first_frame], "limb": self.limb}


@dataclass(frozen=True)
class LostLimbs:
    """A motion with limbs where silhouettes show them.

    Attributes:
        motion: (F,).
        problem: without the detections that contradict it.
        found: stretches of frames.
    """

    motion: Motion
    problem: ClipProblem
    found: tuple[FoundLimb, ...] = ()


def find_lost_limbs(
    problem: ClipProblem,
    sight: Sight,
    evidence: Evidence,
    motion: Motion,
    config: LostLimbsConfig,
    workers: int | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> LostLimbs:
    """Search for limbs where the body stands out of the masks and the masks out of the body.

    In every stretch of such frames the limb is taken that explains most when it is elsewhere.
    Its 2D joints count no more there, nor do 3D poses, which were made of them.

    Args:
        problem: the actor, and what the motion was found from.
        sight: cameras in the pixels of the masks.
        evidence: masks.
        motion: (F,).
        config: settings.
        workers: threads; all cores when not given. The result does not depend on it.
        checkpoint: keeps finished stretches.
    """
    if sight.views != 1 or not config.enabled:
        return LostLimbs(motion, problem)

    def excess(motion: Motion, name: str) -> NDArray[np.float64]:
        surface, kept = SkinnedSurface(problem.actor, motion), checkpoint.kept(name)
        return clip_measures(surface, sight, evidence, frame_excess, workers, kept)

    odd = excess(motion, "lost_limbs_excess")
    parts = list(_stretches(odd, problem.rate, config))
    if not parts:
        return LostLimbs(motion, problem)
    search = _LimbSearch(problem, sight, evidence, motion, config)
    kept = checkpoint.kept("lost_limbs").each(
        tensors(motion.angles), search.stretch, parts, workers
    )
    results = list(zip(parts, kept, strict=True))
    angles = motion.angles.clone()
    for (start, stop), (posed, _) in results:
        angles[start:stop] = posed
    tried = excess(_with_angles(motion, angles), "lost_limbs_tried")
    angles, detections, found = motion.angles.clone(), problem.detections, []
    for (start, stop), (posed, limb) in results:
        before, after = (each[start:stop].mean(0) for each in (odd, tried))
        if after[0] > before[0] or after[1] > (1 - config.explained) * before[1]:
            continue
        name, _, marks = _LIMBS[int(limb)]
        if not _is_doubted(problem, slice(start, stop), _LIMBS[int(limb)], config):
            continue
        angles[start:stop] = posed
        lost = [LANDMARKS.index(f"{name[0]}_{mark}") for mark in marks]
        seen, trusted = detections.confidence2d.clone(), detections.trusted3d.clone()
        seen[start:stop, :, lost] = 0
        trusted[start:stop] = False
        detections = replace(detections, confidence2d=seen, trusted3d=trusted)
        found.append(FoundLimb(start, stop, name))
    if not found:
        return LostLimbs(motion, problem)
    moved = _with_angles(motion, angles)
    return LostLimbs(moved, replace(problem, detections=detections), tuple(found))


def _is_doubted(
    problem: ClipProblem,
    part: slice,
    limb: tuple[str, tuple[str, ...], tuple[str, ...]],
    config: LostLimbsConfig,
) -> bool:
    """Whether detections of one view often see nothing of a limb, or the other one twice."""
    name, _, marks = limb
    other = "l" if name[0] == "r" else "r"
    own, twin = ([LANDMARKS.index(f"{side}_{m}") for m in marks[:2]] for side in (name[0], other))
    seen = problem.detections.frames(part)
    sure, places = seen.confidence2d[:, 0], seen.joints2d[:, 0]
    near = (places[:, own] - places[:, twin]).norm(dim=-1) < config.together * problem.pixel_unit[0]
    lost = near | (sure[:, own] < config.unsure)
    return float(lost.all(-1).double().mean()) >= config.doubted


def _with_angles(motion: Motion, angles: Tensor) -> Motion:
    return Motion(motion.translation, motion.rotation, angles, motion.shared)


def _stretches(
    excess: NDArray[np.float64], rate: float, config: LostLimbsConfig
) -> Iterator[tuple[int, int]]:
    """Frames in a row in which a limb may be elsewhere, from ``frame_excess`` (F, 2)."""
    beyond, unexplained = torch.from_numpy(excess).unbind(-1)
    odd = (beyond >= config.beyond) & (unexplained >= config.unexplained)
    for start, stop in ranges(~odd):  # short gaps
        if start > 0 and stop < len(odd) and stop - start <= config.bridge * rate:
            odd[start:stop] = True
    for start, stop in ranges(odd):
        if config.shortest * rate <= stop - start <= config.longest:
            yield start, stop


class _LimbSearch:
    """Poses of limbs in the frames of a clip."""

    def __init__(
        self,
        problem: ClipProblem,
        sight: Sight,
        evidence: Evidence,
        motion: Motion,
        config: LostLimbsConfig,
    ) -> None:
        self.actor, self.sight, self.evidence = problem.actor, sight, evidence
        self.motion, self.config = motion, config
        self.smooth = config.smooth * problem.rate
        self.search = PoseSearch(self.actor, evidence.heights, config.search)
        rig = self.actor.skeleton.rig
        self.joints = [
            np.array([joint in {f"{name[0]}_{part}" for part in parts} for joint in rig.joints])
            for name, parts, _ in _LIMBS
        ]

    def stretch(self, part: tuple[int, int]) -> tuple[Tensor, Tensor]:
        """Angles (f, A) with the limb that explains most, and its number, ()."""
        start, stop = part
        step = max(1, (stop - start) // _SAMPLES)
        tried = [self._walk(range(start, stop, step), joints)[1] for joints in self.joints]
        limb = int(np.argmax(tried))
        frames = range(start, stop)
        walks = [self._walk(order, self.joints[limb]) for order in (frames, frames[::-1])]
        angles, _ = max(walks, key=lambda walk: walk[1])
        columns = self._columns(self.joints[limb])
        posed = self.motion.angles[start:stop].clone()
        path = torch.stack([angles[frame] for frame in frames])[:, columns]
        smooth = ndimage.gaussian_filter1d(
            path.numpy(force=True), self.smooth, axis=0, mode="nearest"
        )
        posed[:, columns] = torch.from_numpy(smooth).to(posed)
        return posed, posed.new_tensor(limb)

    def _columns(self, joints: Flags) -> Tensor:
        unknowns = released_unknowns(self.actor.skeleton.rig, joints) - 6
        return torch.from_numpy(unknowns).to(self.motion.angles.device)

    def _walk(self, frames: Sequence[int], joints: Flags) -> tuple[dict[int, Tensor], float]:
        """Angles (A,) of each frame, begun where the one before ended, and the mean gain."""
        columns = self._columns(joints)
        found: dict[int, Tensor] = {}
        gains = []
        before: Tensor | None = None
        for frame in frames:
            here = self.motion[frame : frame + 1]
            guess = here
            if before is not None:
                angles = here.angles.clone()
                angles[:, columns] = before[columns]
                guess = Motion(here.translation, here.rotation, angles)
            seen = self._seen(frame)
            best = self.search.search(self.actor, seen, (here, guess), joints, frame)
            as_given, now = self.search.costs(self.actor, seen, joints, (here, best))
            before = found[frame] = best.angles[0]
            gains.append(as_given - now)
        return found, float(np.mean(gains))

    def _seen(self, frame: int) -> FrameView:
        cameras = self.sight.cameras.frames(slice(frame, frame + 1)).every_frame(1)
        visible = np.ones((1, len(self.joints[0])), np.bool_)
        return FrameView(cameras, (), self.evidence.masks(frame), None, visible)
