"""Every data set says what it expected where, and registers under one name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.datasets import DATASETS, Dataset, find_dataset
from perfcap.io.datasets.joint_sets import SMPL24
from perfcap.io.datasets.layout import landmarks_of

IDS = [dataset.name for dataset in DATASETS]


@pytest.mark.parametrize("dataset", DATASETS, ids=IDS)
def test_a_folder_in_another_layout(dataset: Dataset, tmp_path: Path) -> None:
    for name in ("images", "readme.txt", "a b", "ünï", "more", "and more"):
        (tmp_path / name).mkdir()
    with pytest.raises(InputError) as error:
        dataset.sequences(tmp_path)
    message = str(error.value)
    assert message.startswith(f"{tmp_path}: has no ") and dataset.layout in message
    assert "holds a b, and more" in message and "\n" not in message


@pytest.mark.parametrize("dataset", DATASETS, ids=IDS)
def test_no_folder_and_a_file(dataset: Dataset, tmp_path: Path) -> None:
    for path in (tmp_path / "none", tmp_path / "file"):
        with pytest.raises(InputError, match=f"{path.name}: no such folder; expected"):
            dataset.sequences(path)
        (tmp_path / "file").write_text("x")


@pytest.mark.parametrize("dataset", DATASETS, ids=IDS)
@pytest.mark.parametrize("name", ["/etc/passwd", "../x", "a//b", "."])
def test_names_stay_in_the_folder(dataset: Dataset, name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is no name of a sequence"):
        dataset.read(tmp_path, name)


@pytest.mark.parametrize("dataset", DATASETS, ids=IDS)
def test_protocols_name_landmarks(dataset: Dataset) -> None:
    assert set(dataset.protocol.joints) <= set(LANDMARKS)
    assert dataset.protocol.alignments and dataset.protocol.source
    assert find_dataset(dataset.name) is dataset


def test_unknown_names() -> None:
    assert len(set(IDS)) == len(IDS) == 9
    with pytest.raises(InputError, match="expected one of monoperfcap, human36m"):
        find_dataset("coco")


@pytest.mark.parametrize("far", [1e300, float("inf"), float("nan")])
def test_joints_that_are_nowhere_are_unknown(far: float) -> None:
    points = np.ones((2, 24, 3))
    points[0, :, 1] = far
    found = landmarks_of(points, SMPL24)
    assert found[0].isnan().all() and found[1].isfinite().any()
