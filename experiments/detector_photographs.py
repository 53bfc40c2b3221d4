"""Detectors on photographs that nobody tuned to: PCK@0.2 of 12 joints, in true crops and found.

True crops lie around the annotated joints. In the whole image the person has to be searched for, as
in the first frame of a video, by the first network of several. Annotations are used to score alone.
A joint is found when it is nearer to the truth than a fifth of the torso, left shoulder to right
hip; the truth itself is noisy, sides included.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from report import Report, Table, data_folder
from torch import Tensor

from perfcap.app.networks import open_networks
from perfcap.commands.views import DEFAULT_DETECTORS, FINDER
from perfcap.detect.crop import body_box
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.people import OnnxFinder
from perfcap.detect.person import Start, follow_person
from perfcap.errors import InputError
from perfcap.train.photographs import Annotation, read_annotations

_PCK = 0.2
_OTHERS = ("head_top", "neck", "r_toe", "l_toe")
_TWELVE = [i for i, name in enumerate(LANDMARKS) if name not in _OTHERS]
_TORSO = LANDMARKS.index("l_shoulder"), LANDMARKS.index("r_hip")
_BANDS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.01)


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings, with lspet in it."""
    networks: tuple[str, ...] = (
        *("rendered", "lightning", "thunder", f"{FINDER}+thunder"),
        "+".join(DEFAULT_DETECTORS),
        "+".join((FINDER, *DEFAULT_DETECTORS)),
    )
    """Each one network, or several with + between."""
    every: int = 4
    """Take one photograph of so many."""
    first: int = 0
    """The first that is taken."""


def run(config: Experiment) -> Report:
    """Score networks, alone and together."""
    known = read_annotations(data_folder(config.data, "lspet"))[config.first :: config.every]
    photographs = [a for a in known if np.isfinite(a.joints2d[list(_TORSO)]).all()]
    rows, trust = [], []
    for text in config.networks:
        finder, networks = open_networks(text.split("+"))
        shares: list[float] = []
        for crops in (True, False):
            began = time.process_time()
            found = [_score(networks, one, crops, finder) for one in photographs]
            spent = 1000 * (time.process_time() - began) / len(photographs)
            hits, confidence = (torch.cat(part) for part in zip(*found, strict=True))
            shares.append(100 * float(hits.double().mean()))
            if crops:
                trust.append((text, *_by_confidence(hits, confidence)))
        rows.append((text, *shares, spent))
    bands = [f"{a:g} to {min(b, 1):g}" for a, b in pairwise(_BANDS)]
    notes = (f"{len(photographs)} photographs.",)
    return Report(
        (
            Table(
                "PCK@0.2 of 12 joints, %",
                ("networks", "true crop", "whole image", "its CPU ms"),
                tuple(rows),
            ),
            Table("found by confidence, true crops, %", ("networks", *bands), tuple(trust)),
        ),
        notes,
    )


def _score(
    networks: Sequence[OnnxDetector],
    photograph: Annotation,
    crops: bool,
    finder: OnnxFinder | None,
) -> tuple[Tensor, Tensor]:
    """Which of the annotated joints are found, and how sure the networks are of them."""
    image = cv2.imread(str(photograph.path))
    assert image is not None, photograph.path
    truth = torch.from_numpy(photograph.joints2d)
    known = truth.isfinite().all(-1)
    box = body_box(truth.nan_to_num(0.0), known.float(), 0.5) if crops else None
    found = _look(networks, np.ascontiguousarray(image[..., ::-1]), Start(box, finder=finder))
    torso = (truth[_TORSO[0]] - truth[_TORSO[1]]).norm()
    near = (found.joints2d[0, 0] - truth).norm(dim=-1) <= _PCK * torso
    hits = near & (found.confidence2d[0, 0] > 0)
    chosen = [joint for joint in _TWELVE if known[joint]]
    return hits[chosen], found.confidence2d[0, 0, chosen]


def _look(networks: Sequence[OnnxDetector], image: np.ndarray, start: Start) -> Detections:
    try:
        return follow_person(networks[0], iter([image]), start, None, networks[1:])
    except InputError:  # the first network sees no person in the box
        missed = torch.zeros(1, 1, len(LANDMARKS))
        return Detections.from_joints(missed[..., None].expand(-1, -1, -1, 2), missed)


def _by_confidence(hits: Tensor, confidence: Tensor) -> list[float]:
    shares = []
    for low, high in pairwise(_BANDS):
        here = (confidence >= low) & (confidence < high)
        shares.append(100 * float(hits[here].double().mean()) if here.any() else float("nan"))
    return shares


if __name__ == "__main__":
    report.main(run, Experiment, "detector_photographs")
