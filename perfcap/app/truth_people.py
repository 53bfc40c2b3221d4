"""The truth of several people, and which of them a result shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from perfcap.app.truth import Truth, match_frames, read_found, read_truth
from perfcap.errors import InputError
from perfcap.io.datasets import find_dataset
from perfcap.io.result_folder import MOTION, PERSON

_RIG, _UNKNOWN = "cameras.json", 1e6


def read_truths(path: Path, dataset: str | None, sequence: str | None) -> list[Truth]:
    """The truths of everybody of a take.

    Args:
        path: a folder with ``person1/gt.npz``, ...; or that of a data set.
        dataset: which data set it is.
        sequence: of the data set, ``NAME`` for everybody in it.

    Raises:
        InputError: there is none, or it cannot be used.
    """
    if dataset is not None:
        if sequence is None:
            return [read_truth(path, dataset)]  # says which there are
        names = find_dataset(dataset).people(path, sequence)
        return [read_truth(path, dataset, each) for each in names]
    if sequence is not None or not path.is_dir():
        return [read_truth(path, dataset, sequence)]
    people = _people(path)
    if not people:
        return [read_truth(path)]
    if (path / _RIG).is_file():
        whole = path.resolve()
        return read_truths(whole.parent, "rendered", whole.name)
    return [read_truth(person) for person in people]


def match_truths(folders: Sequence[Path], truths: Sequence[Truth]) -> list[Truth]:
    """The truth of each person: those whose joints are nearest, everybody another one.

    Raises:
        InputError: there are fewer truths than people, or frames do not belong together.
    """
    if len(truths) < len(folders):
        raise InputError(
            f"--truth: has {len(truths)} people, the result {len(folders)}; expected the truth of "
            f"everybody{_everybody(truths)}, or name the folder of one person"
        )
    cost = np.array([[_distance(folder, truth) for truth in truths] for folder in folders])
    _, columns = linear_sum_assignment(np.nan_to_num(cost, nan=_UNKNOWN))
    return [truths[column] for column in columns]


def own_truths(folders: Sequence[Path], path: Path) -> list[Path]:
    """Where the truth of each person lies, as ``match_truths`` finds them.

    Args:
        folders: of the people of a result.
        path: a truth where there is one person; of several a folder with ``person1``, ...

    Raises:
        InputError: there are fewer truths than people, or one cannot be used.
    """
    if len(folders) == 1:
        return [path]
    places = _people(path) or [path]
    truths = [read_truth(place) for place in places]
    chosen = match_truths(folders, truths)
    return [places[truths.index(truth)] for truth in chosen]


def _people(path: Path) -> list[Path]:
    """Folders of people in a folder; none where it is a file."""
    entries = path.iterdir() if path.is_dir() else ()
    return sorted(each for each in entries if PERSON.fullmatch(each.name))


def _everybody(truths: Sequence[Truth]) -> str:
    """How to ask a data set for everybody, where one of several people was named."""
    sequence = truths[0].sequence
    if len(truths) > 1 or not sequence.others or sequence.dataset == "file":
        return ""
    return f" (--sequence {sequence.name.partition('/')[0]})"


def _distance(folder: Path, truth: Truth) -> float:
    """Mean distance of the joints, m; NaN where the truth has none."""
    found, sequence = read_found(folder / MOTION), truth.sequence
    if sequence.joints3d is None:
        return float("nan")
    rows, others = match_frames(found.frames, truth, str(found.path))
    apart = (found.joints[rows] - sequence.joints3d[others]).norm(dim=-1)
    return float(apart.nanmean())
