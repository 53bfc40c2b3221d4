"""Several people in several views: their shuffled detections, and who is who, for scoring only."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from recordings import Recording, rendered_views
from report import data_folder

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import read_cameras
from perfcap.io.detections import read_candidates

_WHOLE = 3  # of ``detection_exchange``: the skeletons of two people are exchanged in the file
_LIMBS = ((2, 5), (5, 8), (8, 12), (12, 16))
NOBODY = -1


@dataclass(frozen=True)
class Crowd:
    """Candidates, and the answer key.

    Attributes:
        name: of the recording.
        cameras: C views.
        candidates: (P, F, C, 16).
        owner: the person whom a candidate shows, (P, F, C); -1 for others.
        rate: frames a second.
    """

    name: str
    cameras: Camera
    candidates: Detections
    owner: NDArray[np.int64]
    rate: float

    def select(self, views: Sequence[int]) -> Crowd:
        """Some of the views."""
        chosen = list(views)
        parts = self.cameras.select(chosen), self.candidates.select(chosen)
        return Crowd(self.name, *parts, self.owner[:, :, chosen], self.rate)


def people_of(data: Path, name: str) -> list[Recording]:
    """The people of a rendered sequence."""
    folder = data_folder(data, "rendered_multi") / name
    return [rendered_views(data, name, k + 1) for k in range(len(list(folder.glob("person*"))))]


def shuffled(people: Sequence[Recording], seed: int = 0) -> Crowd:
    """Detections of people in another order in every frame and view."""
    stacked = Detections.stack([each.detections for each in people])
    count, frames, views = stacked.joints2d.shape[:3]
    order = np.argsort(np.random.default_rng(seed).random((count, frames, views)), 0)
    owner = np.take_along_axis(_true_owners(people), order, 0)
    first = people[0]
    return Crowd(first.name, first.cameras, reorder(stacked, order), owner, first.rate)


def reorder(candidates: Detections, order: NDArray[np.int64]) -> Detections:
    """Slot p of the result is slot ``order[p]``, (P, F, C), of the candidates."""
    index = torch.from_numpy(order)

    def pick(values: torch.Tensor) -> torch.Tensor:
        spread = index.reshape(*index.shape, *[1] * (values.dim() - 3))
        return values.gather(0, spread.expand(len(index), *values.shape[1:]))

    return candidates.map(pick)


def _true_owners(people: Sequence[Recording]) -> NDArray[np.int64]:
    """Whom each detection shows: in files, whole skeletons may be exchanged, (K, F, C)."""
    flags = []
    for each in people:
        assert each.sequence is not None
        with np.load(each.sequence.folder / "gt.npz", allow_pickle=False) as truth:
            flags.append((truth["detection_exchange"] == _WHOLE).any(-1))
    exchanged = np.stack(flags)
    owner = np.broadcast_to(np.arange(len(people))[:, None, None], exchanged.shape).copy()
    for frame, view in np.argwhere(exchanged.sum(0) == 2):
        one, other = np.flatnonzero(exchanged[:, frame, view])
        owner[[one, other], frame, view] = owner[[other, one], frame, view]
    return owner


def pose2sim(data: Path) -> Crowd:
    """A real man and a second skeleton beside him, with passers-by; person 0 is the second one."""
    folder = data_folder(data) / "pose2sim_multi"
    rig = read_cameras(folder / "calibration" / "Calib_scene.toml")
    views = sorted((folder / "pose2d_openpose").iterdir())
    candidates, _ = read_candidates(views, views=rig.names)
    owner = np.full(candidates.joints2d.shape[:3], NOBODY)
    for c, view in enumerate(views):
        answers = sorted((folder / "pose2d_associated" / view.name).glob("*.json"))
        for f, (found, answer) in enumerate(zip(sorted(view.glob("*.json")), answers, strict=True)):
            listed = [p for p in _listed(found) if p]
            for person, true in enumerate(_listed(answer)[:2]):
                if true in listed and true:
                    owner[listed.index(true), f, c] = person
    return Crowd("pose2sim_multi", rig.cameras, candidates, owner, 60.0)


def _listed(path: Path) -> list[list[float]]:
    return [
        each["pose_keypoints_2d"] if each else [] for each in json.loads(path.read_text())["people"]
    ]


def spoiled(crowd: Crowd, seed: int, share: float = 0.3) -> tuple[Crowd, NDArray[np.bool_]]:
    """More mistakes in a share of frames and views; two views of every frame stay as they were.

    A limb of two people exchanged, one person listed twice and another not at all, one not at all.

    Returns:
        The crowd, and which candidates are as before, (P, F, C).
    """
    random = np.random.default_rng(seed)
    joints, trust = crowd.candidates.joints2d.clone(), crowd.candidates.confidence2d.clone()
    owner, right = crowd.owner.copy(), crowd.owner >= 0
    count, frames, views = owner.shape
    for f, c in np.ndindex(frames, views):
        spared = random.permutation(views)[:2]
        if c in spared or random.random() > share * views / max(1, views - 2):
            continue
        one, other = random.permutation(count)[:2]
        kind = random.integers(3)
        if kind == 0:
            limb = slice(*_LIMBS[random.integers(len(_LIMBS))])
            joints[[one, other], f, c, limb] = joints[[other, one], f, c, limb]
        elif kind == 1:
            joints[other, f, c] = joints[one, f, c] + 1
            trust[other, f, c] = trust[one, f, c]
            owner[other, f, c] = owner[one, f, c]
        else:
            trust[one, f, c] = 0
            owner[one, f, c] = NOBODY
        right[[one] if kind == 2 else [one, other], f, c] = False
    candidates = replace(crowd.candidates, joints2d=joints, confidence2d=trust)
    return replace(crowd, candidates=candidates, owner=owner), right
