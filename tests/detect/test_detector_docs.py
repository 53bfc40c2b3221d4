"""The manifests of the documentation are manifests."""

import re
from pathlib import Path

import pytest
import torch

from perfcap.detect import HeatmapHead
from perfcap.detect.joint_set import JOINT_SETS
from perfcap.detect.manifest import KINDS, read_manifest
from perfcap.detect.segmenter import read_segmenter_manifest

PAGE = (Path(__file__).parents[2] / "docs" / "detectors.md").read_text(encoding="utf-8")
MANIFESTS = re.findall(r"<!-- (.*?) -->\n```toml\n(.*?)```", PAGE, re.DOTALL)
FILE = f"""[[file]]
name = "model.onnx"
size = 1
sha256 = "{64 * "0"}"
licence = "Apache-2.0"
"""


@pytest.mark.parametrize(("name", "text"), MANIFESTS, ids=[name for name, _ in MANIFESTS])
def test_manifests_of_the_page(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / "manifest.toml").write_text(text + FILE)
    if 'kind = "segmenter"' in text:
        assert read_segmenter_manifest(tmp_path).person < read_segmenter_manifest(tmp_path).classes
        return
    manifest = read_manifest(tmp_path)
    assert manifest.file.path == tmp_path / "model.onnx"
    assert manifest.joint_set in JOINT_SETS


def test_the_page_names_all_kinds_and_sets() -> None:
    assert len(MANIFESTS) == 6
    for word in (*KINDS, *(joint_set.name for joint_set in JOINT_SETS)):
        assert word in PAGE, word


def test_the_head_of_the_page() -> None:
    names = {
        "HeatmapHead": HeatmapHead,
        "features": torch.randn(2, 1, 256, 4, 3),
        "to_image": torch.eye(2, 3).expand(2, 1, 2, 3),
    }
    code = re.findall(r"```python\n(head = .*?)```", PAGE, re.DOTALL)
    exec(compile(code[0], "docs/detectors.md", "exec"), names)
    assert names["detections"].joints2d.shape == (2, 1, 16, 2)  # type: ignore[attr-defined]
