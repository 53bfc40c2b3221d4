"""JSON whose values take far more memory than their text is refused before it is parsed."""

import json
from pathlib import Path

import pytest

from perfcap.errors import InputError
from perfcap.io import files


@pytest.mark.parametrize("part", ['{"a": [255]}', "[[[]]]", "[1]"])
def test_brackets_and_little_else_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    monkeypatch.setattr(files, "_PLENTY", 2**16)
    path = tmp_path / "a.json"
    path.write_text(f"[{', '.join([part] * 3000)}]")
    with pytest.raises(InputError, match=r"objects and \d+ lists, .* in memory; .*; split it"):
        files.read_json(path, "keypoints")
    path.write_text(f"[{', '.join([part] * 100)}]")
    assert len(files.read_json(path, "keypoints")) == 100


def test_what_detectors_write_is_far_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "_PLENTY", 2**16)
    joints = [float(f"{100 * i:.6f}") + 0.123456 for i in range(51)]
    frames = [{"people": [{"pose_keypoints_2d": joints}]} for _ in range(400)]
    path = tmp_path / "a.json"
    path.write_text(json.dumps(frames))
    assert path.stat().st_size > 2**17
    assert files.read_json(path, "keypoints") == frames
