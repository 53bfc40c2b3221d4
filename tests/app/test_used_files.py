"""Every file that a capture reads is known to it, so that ``--resume`` sees it change."""

from pathlib import Path
from typing import Any

import pytest

from perfcap.app.capture_folder import states_of, unchanged
from perfcap.app.capture_request import used_files
from perfcap.commands.capture import Capture
from perfcap.io import models_folder


def used(**options: Any) -> list[Path]:
    given = Capture(videos=(Path("a.mp4"),), out=Path("out"), until="track_motion", **options)
    return [path for path in used_files(given, []) if path != Path("a.mp4")]


@pytest.mark.parametrize("names", [("intri.yml", "extri.yml"), ("cameras.txt", "images.txt")])
def test_camera_files_that_are_read_together(tmp_path: Path, names: tuple[str, str]) -> None:
    paths = [tmp_path / name for name in names]
    for path in paths:
        path.write_text("old")
    for given in (*paths, tmp_path):
        before = states_of(used(cameras=given))
        assert None not in before.values()
        for path in paths:
            path.write_text(path.read_text() + "er")
            now = states_of(used(cameras=given))
            assert not unchanged(before, now)
            before = now
    alone = tmp_path / "cameras.json"
    assert [path for path in used(cameras=alone) if path.parent == tmp_path] == [alone]


def test_a_manifest_comes_with_its_network() -> None:
    folder = models_folder() / "detectors" / "thunder"
    assert used(detector=(str(folder),))[0] == folder
    found = used(detector=(str(folder / "manifest.toml"),))
    assert [path for path in found if path.suffix == ".onnx"] == sorted(folder.glob("*.onnx"))


def test_labels_of_a_run(tmp_path: Path) -> None:
    (tmp_path / "labels").mkdir()
    label = tmp_path / "labels" / "a_1.txt"
    label.write_text("0")
    before = states_of(used(detections=(tmp_path,)))
    label.write_text("0 0.5")
    assert not unchanged(before, states_of(used(detections=(tmp_path,))))
