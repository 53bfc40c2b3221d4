"""Photographs that cannot be used, or are shown turned, are found before the first step."""

import json
import logging
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.exif import is_turned
from perfcap.train.photographs import Photographs

WIDTH, HEIGHT = 60, 80
NAMES = [name for name in LANDMARKS if not name.endswith("toe")]
PLACES = {"head_top": 0.1, "neck": 0.3, "shoulder": 0.3, "elbow": 0.4, "wrist": 0.5, "hip": 0.55,
          "knee": 0.75, "ankle": 0.95}  # fmt: skip


def person() -> np.ndarray:
    """Joints (14, 2) of somebody who stands in the middle of a photograph."""
    across = {"l": 0.1, "r": -0.1}
    rows = [
        (0.5 + across.get(name[0] if name[1] == "_" else "", 0), PLACES[name.removeprefix(name[:2])
         if name[1] == "_" else name]) for name in NAMES
    ]  # fmt: skip
    return np.array(rows) * [WIDTH, HEIGHT]


def jpeg(width: int, height: int, orientation: int = 1) -> bytes:
    """A photograph, stored in this size, with an orientation."""
    pixels = np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)
    data = cv2.imencode(".jpg", pixels)[1].tobytes()
    tags = struct.pack(">2sHIHHHIHHI", b"MM", 42, 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    exif = b"Exif\0\0" + tags
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]


def write(folder: Path, images: dict[str, bytes], joints: dict[str, np.ndarray]) -> Path:
    (folder / "images").mkdir(parents=True)
    entries = []
    for name, data in images.items():
        (folder / "images" / name).write_bytes(data)
        rows = joints.get(name, person())
        seen = np.isfinite(rows).all(-1)
        table = np.concatenate((np.nan_to_num(rows), seen[:, None]), 1)
        entries.append({"file": name, "joints": table.tolist()})
    (folder / "annotations.json").write_text(json.dumps({"joint_names": NAMES, "images": entries}))
    return folder


def test_all_that_cannot_be_used_are_named_at_once(tmp_path: Path) -> None:
    images = {f"{k}.jpg": jpeg(WIDTH, HEIGHT) for k in range(8)}
    assert len(Photographs(write(tmp_path / "a", images, {}), 64, 1.8)) == 8
    bad = images | {"2.jpg": b"", "3.jpg": b"<html>no such page</html>", "4.jpg": b"\xff\xd8"}
    words = r"3 photographs cannot be used: 2\.jpg \(cannot be read as a photograph\), 3\.jpg "
    with pytest.raises(InputError, match=words):
        Photographs(write(tmp_path / "b", bad, {}), 64, 1.8)
    few = person()
    few[5:] = np.nan
    some = {f"{k}.jpg": few for k in range(4)}
    words = r"4 photographs cannot be used: 0\.jpg \(has 5 annotated joints .*, \.\.\.; expected"
    with pytest.raises(InputError, match=words):
        Photographs(write(tmp_path / "c", images, some), 64, 1.8)
    with pytest.raises(InputError, match=r"0\.jpg: has 5 annotated .* remove it from annotations"):
        Photographs(write(tmp_path / "d", images, {"0.jpg": few}), 64, 1.8)


def test_photographs_of_other_kinds_are_read(tmp_path: Path) -> None:
    pixels = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    images = {f"a{kind}": cv2.imencode(kind, pixels)[1].tobytes() for kind in (".bmp", ".webp")}
    found = Photographs(write(tmp_path / "a", images, {}), 64, 1.8)
    assert [found[k].image.max() for k in range(2)] == [90, 90]


@pytest.mark.parametrize("orientation", [1, 3, 5, 6, 8])
def test_orientations_that_turn_by_a_quarter(tmp_path: Path, orientation: int) -> None:
    data = jpeg(WIDTH, HEIGHT, orientation)
    (tmp_path / "a.jpg").write_bytes(data)
    image = cv2.imread(str(tmp_path / "a.jpg"))
    assert image is not None and (image.shape[0] == WIDTH) == is_turned(data)
    assert is_turned(data) == (orientation >= 5) and not is_turned(data[:30])


@pytest.mark.parametrize("count", [6, 24])
def test_joints_of_turned_photographs_as_stored(tmp_path: Path, count: int) -> None:
    """Stored lying; the person stands in the photograph as it is shown."""
    images = {f"{k}.jpg": jpeg(HEIGHT, WIDTH, 6) for k in range(count)}
    assert len(Photographs(write(tmp_path / "a", images, {}), 64, 1.8)) == count
    stored = person()[:, ::-1] * [1, -1] + [0, WIDTH]
    upright = {f"u{k}.jpg": jpeg(WIDTH, HEIGHT) for k in range(60)}  # most of a list
    folder = write(tmp_path / "b", upright | images, dict.fromkeys(images, stored))
    words = f"{count} photographs are shown turned by a quarter, as their EXIF orientation says"
    with pytest.raises(InputError, match=words):
        Photographs(folder, 64, 1.8)


def test_joints_that_are_no_landmarks_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write(tmp_path / "a", {"0.jpg": jpeg(WIDTH, HEIGHT)}, {})
    with caplog.at_level(logging.WARNING):
        Photographs(folder, 64, 1.8)
    assert not caplog.text
    path = folder / "annotations.json"
    path.write_text(path.read_text().replace('"neck"', '"collar"'))
    with caplog.at_level(logging.WARNING):
        Photographs(folder, 64, 1.8)
    assert (
        "joint_names collar are none of the landmarks and are left out, and neck, " in caplog.text
    )
