"""How a hand is turned about its forearm, and whether the pose of the arm tells it.

Sixteen joints end at the wrists, so a hand rides on its forearm as it does at rest. In motion
capture that has hands, the angle from the elbow's axis to the thumb, about the forearm, is measured
wherever the elbow is bent, and predicted for a subject from all others: by their mean (a hand that
rides on its forearm), and by the directions of both parts of the arm and the bend between them,
linear and quadratic. Expect no prediction to be better than the mean for most subjects.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import cmu
import torch
from report import DATA, Report, Table, data_folder, main
from torch import Tensor

BENT = 0.35  # sine of the bend above which the elbow's axis is certain
RIDGE = 0.1


@dataclass(frozen=True)
class Experiment:
    """How much."""

    data: Path = DATA
    """Folder of recordings."""
    step: int = 6
    """Every so many frames of 60 a second."""


@dataclass(frozen=True)
class Arms:
    """Frames in which an elbow is bent: pose (N, 7), angle of the thumb (N,) rad, subject (N,)."""

    pose: Tensor
    angle: Tensor
    subject: Tensor


def run(config: Experiment) -> Report:
    """Every subject predicted from the others."""
    arms = _read(data_folder(config.data, "mocap_cmu_library"), config.step)
    rows = []
    for subject in sorted(set(arms.subject.tolist())):
        held = arms.subject == subject
        errors = [_median_error(arms, held, degree) for degree in (0, 1, 2)]
        rows.append((f"{subject:02d}", int(held.sum()), _degrees(_mean(arms.angle[held])), *errors))
    columns = ("subject", "arms", "its mean", "by the mean", "linear", "quadratic")
    mean = _degrees(_mean(arms.angle))
    note = f"mean of all: {mean:.0f} degrees from the elbow's axis"
    return Report(
        (Table("angle of the thumb, median error, degrees", columns, tuple(rows)),), (note,)
    )


def _read(root: Path, step: int) -> Arms:
    with (root / "clips.csv").open() as file:
        subjects = {row["clip"]: int(row["subject"]) for row in csv.DictReader(file)}
    found = []
    for clip in cmu.clip_names(root):
        for side in "lr":
            upper, fore, thumb = cmu.arms(root, clip, side, step)
            axis = torch.linalg.cross(upper, fore)
            bent = axis.norm(dim=-1) > BENT
            beside = torch.linalg.cross(fore, torch.nn.functional.normalize(axis, dim=-1))
            angle = torch.atan2(
                (thumb * beside).sum(-1) * axis.norm(dim=-1), (thumb * axis).sum(-1)
            )
            bend = torch.atan2(axis.norm(dim=-1), (upper * fore).sum(-1))
            pose = torch.cat((upper, fore, bend[:, None]), -1)
            of = torch.full_like(angle, subjects[clip]).long()
            found.append((pose[bent], angle[bent], of[bent]))
    return Arms(*(torch.cat(part) for part in zip(*found, strict=True)))


def _median_error(arms: Arms, held: Tensor, degree: int) -> float:
    """Median error on the held frames of what the others predict, degrees."""
    centre = _mean(arms.angle[~held])
    away = _wrapped(arms.angle - centre)
    if degree == 0:
        return _degrees(away[held].abs().median())
    terms = _terms(arms.pose, degree)
    matrix = terms[~held].mT @ terms[~held] + RIDGE**2 * torch.eye(terms.shape[-1]).to(terms)
    weights = torch.linalg.solve(matrix, terms[~held].mT @ away[~held])
    return _degrees(_wrapped(away[held] - terms[held] @ weights).abs().median())


def _terms(pose: Tensor, degree: int) -> Tensor:
    terms = torch.cat((torch.ones_like(pose[:, :1]), pose), -1)
    if degree == 1:
        return terms
    one, two = torch.triu_indices(terms.shape[-1], terms.shape[-1])
    return terms[:, one] * terms[:, two]


def _mean(angle: Tensor) -> Tensor:
    """Mean direction of angles (N,), radians."""
    return torch.atan2(angle.sin().mean(), angle.cos().mean())


def _wrapped(angle: Tensor) -> Tensor:
    return torch.remainder(angle + math.pi, 2 * math.pi) - math.pi


def _degrees(angle: Tensor) -> float:
    return float(torch.rad2deg(angle))


if __name__ == "__main__":
    main(run, Experiment, "hands")
