"""Photographs with joints, good and bad."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.train.photographs import Photographs, read_annotations

NAMES = [name for name in LANDMARKS if not name.endswith("toe")]
LSPET = Path(__file__).parents[3] / "shared" / "data" / "lspet"


def write(folder: Path, joints: Any = None, **other: Any) -> Path:
    (folder / "images").mkdir(parents=True)
    image = np.zeros((80, 60, 3), np.uint8)
    rng = np.random.default_rng(0)
    rows = np.concatenate([rng.uniform(20, 50, (14, 2)), np.ones((14, 1))], 1)
    rows[3] = (-9, -9, 0)
    for x, y, _ in rows:
        cv2.circle(image, (int(x), int(y)), 1, (255, 255, 255), -1)
    cv2.imwrite(str(folder / "images" / "one.png"), image)
    entry = {"file": "one.png", "joints": rows.tolist() if joints is None else joints}
    table = {"joint_names": NAMES, "images": [entry]} | other
    (folder / "annotations.json").write_text(json.dumps(table))
    return folder


def test_people_fill_their_shots(tmp_path: Path) -> None:
    photographs = Photographs(write(tmp_path / "p"), 96, 1.8)
    shot = photographs[0]
    assert len(photographs) == 1 and shot.image.shape == (96, 96, 3) and shot.present
    known = np.isfinite(shot.joints2d).all(-1)
    missing = {LANDMARKS[j] for j in np.flatnonzero(~known)}
    assert missing == {"l_toe", "r_toe", NAMES[3]} and np.isnan(shot.joints3d).all()
    for x, y in shot.joints2d[known]:
        assert shot.image[round(float(y)), round(float(x))].mean() > 60
    low, high = shot.joints2d[known].min(0), shot.joints2d[known].max(0)
    np.testing.assert_allclose(0.5 * (low + high), 47.5, atol=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joints": [[1, 2, 1]]}, r"one\.png have shape \(1, 3\); expected \(14, 3\)"),
        ({"joints": [[float("nan"), 2, 1]] * 14}, r"not finite; mark them"),
        ({"joint_names": ["nose"] * 14}, "lack shoulders or hips"),
        ({"joint_names": [*NAMES[:-1], "RHip"]}, "has r_hip and RHip, the same joint"),
        ({"images": []}, "names no photograph"),
        ({"images": 3}, "is malformed"),
        ({"images": [{"file": "../../etc/passwd", "joints": []}]}, "a name inside images"),
    ],
)
def test_bad_annotations(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    folder = write(tmp_path / "p", **change)
    with pytest.raises(InputError, match=message):
        Photographs(folder, 64, 1.8)


@pytest.mark.parametrize("spoil", ["normalised", "turned", "exchanged", "none"])
def test_joints_of_nobody(tmp_path: Path, spoil: str) -> None:
    heights = {"head_top": 0, "neck": 10, "ankle": 60}
    joints = np.array([[30, heights.get(n, heights.get(n[2:], 35)), 1] for n in NAMES], float)
    joints[:, 0] += 0.5 * np.arange(len(NAMES))  # no two lie at one place
    if spoil == "normalised":
        joints[:, :2] /= 80
    elif spoil == "turned":
        joints[:, 1] = 80 - joints[:, 1]
    elif spoil == "exchanged":
        joints[:, :2] = joints[:, 1::-1]
    images = [{"file": "one.png", "joints": joints.tolist()}] * 20
    folder = write(tmp_path / "p", images=images)
    if spoil == "none":
        assert len(Photographs(folder, 64, 1.8)) == 20
        return
    words = "expected pixels" if spoil == "normalised" else "feet below their necks"
    with pytest.raises(InputError, match=words):
        Photographs(folder, 64, 1.8)


def test_photographs_that_are_not_there(tmp_path: Path) -> None:
    images = [{"file": name, "joints": [[30, 35, 1]] * 14} for name in ("one.png", "two.png")]
    with pytest.raises(InputError, match=r"two\.png: no such file; the annotations name it"):
        Photographs(write(tmp_path / "p", images=images), 64, 1.8)


@pytest.mark.parametrize("spoil", ["smaller", "larger", "said", "turned", "none"])
def test_annotations_of_copies_of_another_size(tmp_path: Path, spoil: str) -> None:
    rng = np.random.default_rng(0)
    images: list[dict[str, Any]] = []
    for _ in range(20):
        joints = np.concatenate([rng.uniform(5, 55, (14, 2)), np.ones((14, 1))], 1)
        if spoil == "smaller":
            joints[:, :2] /= 2
        elif spoil == "larger":
            joints[:, :2] *= 2
        images.append({"file": "one.png", "joints": joints.tolist()})
        sizes = {"said": (120, 160), "turned": (80, 60), "none": (60, 80)}
        if spoil in sizes:
            images[-1] |= dict(zip(("width", "height"), sizes[spoil], strict=True))
    folder = write(tmp_path / "p", images=images)
    if spoil in ("turned", "none"):
        assert len(Photographs(folder, 64, 1.8)) == 20
        return
    words = {"smaller": "upper left quarter", "larger": "lie outside of their photographs"}.get(
        spoil, "120x160 pixels, it has 60x80"
    )
    with pytest.raises(InputError, match=words):
        Photographs(folder, 64, 1.8)


@pytest.mark.parametrize("nowhere", [(0, 0), (-1, -1)])
def test_unknown_joints_that_count_as_visible(tmp_path: Path, nowhere: tuple[int, int]) -> None:
    joints = [[30, 35, 1]] * 13 + [[*nowhere, 1]]
    with pytest.raises(InputError, match=f"is visible at {nowhere[0]}, {nowhere[1]}; expected a"):
        Photographs(write(tmp_path / "p", joints), 64, 1.8)
    joints[-1][2] = 0
    assert len(Photographs(write(tmp_path / "q", joints), 64, 1.8)) == 1


def test_other_joints_are_other_data(tmp_path: Path) -> None:
    one = Photographs(write(tmp_path / "a", [[30, 35, 1]] * 14), 64, 1.8)
    same = Photographs(write(tmp_path / "b", [[30, 35, 1]] * 14), 64, 1.8)
    other = Photographs(write(tmp_path / "c", [[30, 36, 1]] * 14), 64, 1.8)
    assert one.digest == same.digest != other.digest


def test_bad_pictures(tmp_path: Path) -> None:
    folder = write(tmp_path / "nobody", joints=[[-5, -5, 0]] * 14)
    with pytest.raises(InputError, match="has 0 annotated joints in the image"):
        Photographs(folder, 64, 1.8)[0]
    (folder / "images" / "one.png").write_bytes(b"x")
    with pytest.raises(InputError, match="cannot be read as a photograph"):
        Photographs(folder, 64, 1.8)[0]
    (folder / "images" / "one.png").unlink()
    with pytest.raises(InputError, match="no such file; the annotations name it"):
        Photographs(folder, 64, 1.8)[0]
    with pytest.raises(InputError, match="expected photographs with annotated joints"):
        Photographs(tmp_path, 64, 1.8)


@pytest.mark.long
@pytest.mark.skipif(not LSPET.is_dir(), reason="needs shared/data/lspet")
def test_sports_people() -> None:
    photographs = Photographs(LSPET, 128, 1.8)
    assert len(photographs) == 1200
    for number in range(0, 1200, 150):
        shot = photographs[number]
        assert np.isfinite(shot.joints2d).all(-1).sum() >= 10 and shot.image.std() > 5


def test_confidences_in_place_of_marks_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = np.concatenate([np.random.default_rng(0).uniform(20, 50, (14, 2)), np.ones((14, 1))], 1)
    for name, few, visible in (("marks", 14, 2.0), ("few", 5, 0.5)):
        rows[:few, 2] = visible
        read_annotations(write(tmp_path / name, rows.tolist()))
        rows[:, 2] = 1
    assert "fraction" not in caplog.text
    rows[:6, 2] = 0.15
    read_annotations(write(tmp_path / "network", rows.tolist()))
    assert "visible is a fraction for 6 of 14 joints" in caplog.text
