"""What docs/datasets.md says is so."""

from __future__ import annotations

import re
import types
from pathlib import Path

import numpy as np
import pytest

from perfcap.app.evaluate import _ROWS
from perfcap.io.datasets import DATASETS, Dataset
from perfcap.io.datasets.smpl_joints import read_smpl_joints

PAGE = (Path(__file__).parents[3] / "docs" / "datasets.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("dataset", DATASETS, ids=[dataset.name for dataset in DATASETS])
def test_every_data_set_has_a_section(dataset: Dataset) -> None:
    sections = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    (section,) = [s for s in sections if f"`--dataset {dataset.name}`" in s]
    for part in re.findall(r"[\w/.*]*\w\.(?:npz|json|pkl|mat|txt|xml|cal)", dataset.layout):
        assert part.rsplit("/", 1)[-1].replace("*", "") in section.replace("*", ""), part


def test_every_number_is_explained() -> None:
    for key, _, _ in _ROWS:
        assert f"`{key}`" in PAGE or f"`_{key.removeprefix('segmentation_')}`" in PAGE, key


def test_body_models_are_converted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The block of the page, on a model that is not SMPL but has its arrays."""
    rng = np.random.default_rng(0)
    model = {
        "J_regressor": types.SimpleNamespace(toarray=lambda: rng.uniform(size=(24, 50))),
        "shapedirs": rng.normal(size=(50, 3, 300)),
        "v_template": rng.normal(size=(50, 3)),
        "kintree_table": np.array([[2**32 - 1, *range(23)], list(range(24))], dtype=np.uint32),
    }
    found = re.search(r"<!-- smpl -->\n```python\n(.*?)```", PAGE, re.DOTALL)
    assert found
    monkeypatch.chdir(tmp_path)
    (tmp_path / "EMDB").mkdir()
    for name in ("SMPL_MALE.pkl", "SMPL_FEMALE.pkl"):
        (tmp_path / name).write_bytes(b"")
    monkeypatch.setattr("pickle.load", lambda *_, **__: model)
    exec(compile(found[1], "docs/datasets.md", "exec"), {})
    joints = read_smpl_joints(tmp_path / "EMDB" / "smpl" / "male.npz")
    assert joints.shapes.shape == (24, 3, 10) and joints.parents[:3] == (-1, 0, 1)
