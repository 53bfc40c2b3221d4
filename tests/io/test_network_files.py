"""Bodies of SAM 3D Body, GVHMR and WHAM as detections: places, gaps, and what is refused."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from network_bodies import (
    FRAMES,
    LANDMARKS,
    RNG,
    K,
    centred,
    landmarks,
    projected,
    sam,
    smpl,
    smpl_arrays,
)

from perfcap.errors import InputError
from perfcap.io.detections import read_detections


def write(path: Path, arrays: dict[str, Any]) -> Path:
    if path.suffix == ".json":
        path.write_text(json.dumps({name: np.asarray(v).tolist() for name, v in arrays.items()}))
    else:
        np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("name", ["a.npz", "a.json"])
def test_joints_of_smpl(tmp_path: Path, name: str) -> None:
    points = landmarks()
    crown = points[:, LANDMARKS.index("head_top")]
    arrays = {"smpl_joints": smpl(points), "camera": K, "head_top": crown}
    found, notes = read_detections(write(tmp_path / name, arrays))
    np.testing.assert_allclose(found.joints2d[:, 0], projected(points), atol=1e-9)
    assert found.joints3d is not None and bool(found.trusted3d.all())
    np.testing.assert_allclose(found.joints3d[:, 0], centred(points), atol=1e-9)
    assert (found.confidence2d == 1).all()
    assert any("--fov 39.1" in note for note in notes)  # 2 atan(320 / 900)


def test_the_crown_is_the_top_of_the_head_in_any_pose(tmp_path: Path) -> None:
    points = landmarks()
    joints = smpl(points)
    up = RNG.normal(size=(FRAMES, 3))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    joints[:, 15] = joints[:, 12] + 0.1 * up
    crown = joints[:, 15] + 0.2 * up
    around = joints[:, 15, None] + 0.15 * RNG.uniform(-1, 1, (FRAMES, 50, 3)) / np.sqrt(3)
    hands = joints[:, 15, None] + 0.6 * up[:, None]  # raised above the head
    vertices = np.concatenate((around, hands, crown[:, None], around), 1)
    path = write(
        tmp_path / "a.npz", {"smpl_joints": joints, "camera": K, "smpl_vertices": vertices}
    )
    found, _ = read_detections(path)
    hips = joints[:, [1, 2]].mean(1)
    assert found.joints3d is not None
    np.testing.assert_allclose(
        found.joints3d[:, 0, LANDMARKS.index("head_top")], crown - hips, atol=1e-9
    )


@pytest.mark.parametrize("people", [False, True])
def test_points_of_sam_3d_body(tmp_path: Path, people: bool) -> None:
    points = landmarks()
    arrays = sam(points, projected(points))
    if people:  # as a stack of lists of one person
        arrays = {name: values[:, None] for name, values in arrays.items()}
    found, notes = read_detections(write(tmp_path / "a.npz", arrays))
    known = [i for i, name in enumerate(LANDMARKS) if name != "head_top"]
    np.testing.assert_allclose(found.joints2d[:, 0, known], projected(points)[:, known], atol=1e-9)
    assert found.joints3d is not None and bool(found.trusted3d.all())
    np.testing.assert_allclose(found.joints3d[:, 0, known], centred(points)[:, known], atol=1e-9)
    assert any("focal length of 900 px" in note for note in notes)


def test_frames_without_anybody(tmp_path: Path) -> None:
    points = landmarks()
    arrays = sam(points, projected(points))
    arrays["pred_keypoints_3d"][2] = np.nan
    arrays["pred_keypoints_2d"][4] = np.nan
    found, _ = read_detections(write(tmp_path / "a.npz", arrays))
    seen = (found.confidence2d[:, 0] > 0).any(-1)
    assert seen.tolist() == [True, True, False, True, False, True]
    assert found.trusted3d[:, 0].tolist() == seen.tolist()
    assert bool(found.joints2d.isfinite().all())


def test_rows_of_some_frames(tmp_path: Path) -> None:
    points = landmarks()
    crown = points[:, LANDMARKS.index("head_top")]
    arrays = {"smpl_joints": smpl(points), "camera": np.tile(K, (FRAMES, 1, 1)), "head_top": crown}
    arrays["frame_ids"] = np.array([7, 2, 3, 4, 5, 9])
    path = write(tmp_path / "a.npz", arrays)
    found, _ = read_detections(path, frames=12)
    assert found.frame_count == 12
    assert [f for f in range(12) if found.confidence2d[f].any()] == [2, 3, 4, 5, 7, 9]
    np.testing.assert_allclose(found.joints2d[7, 0], projected(points)[0], atol=1e-9)
    assert read_detections(path)[0].frame_count == 10


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"camera": None}, "has no camera"),
        ({"camera": np.eye(4)}, r"camera has shape \(4, 4\)"),
        ({"camera": np.zeros((3, 3))}, "holds no focal lengths"),
        ({"head_top": None}, "neither head_top nor smpl_vertices"),
        ({"head_top": np.zeros((2, 3))}, r"head_top has shape \(2, 3\), expected \(6, 3\)"),
        ({"smpl_joints": np.zeros((FRAMES, 17, 3))}, "has 17 joints, expected SMPL's 24"),
        ({"smpl_joints": np.zeros((FRAMES, 24))}, "smpl_joints has shape"),
        ({"smpl_joints": np.full((FRAMES, 24, 3), np.nan)}, "holds nobody"),
        ({"smpl_joints": -smpl_arrays()["smpl_joints"]}, "behind the camera"),
        ({"frame_ids": np.array([0, 1])}, "frame_ids are 2, expected 6"),
        ({"frame_ids": np.array([0, 1, 2, 3, 4, 4])}, "name a frame twice"),
        ({"frame_ids": np.array([0, 1, 2, 3, 4, -4])}, "frame_ids are 6, expected 6 frames from"),
        ({"camera": np.array([["a"] * 3] * 3)}, "camera holds <U1"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    arrays = {name: value for name, value in (smpl_arrays() | change).items() if value is not None}
    with pytest.raises(InputError, match=words):
        read_detections(write(tmp_path / "a.npz", arrays))


def test_millimetres_are_named(tmp_path: Path) -> None:
    arrays = smpl_arrays()
    for name in ("smpl_joints", "head_top"):
        arrays[name] = 1000 * arrays[name]
    with pytest.raises(InputError, match="expected a person in metres; it looks like millimetres"):
        read_detections(write(tmp_path / "a.npz", arrays))


def test_lists_of_uneven_length_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"smpl_joints": [[1, 2], [3]], "camera": K.tolist()}))
    with pytest.raises(InputError, match="smpl_joints is no list of numbers"):
        read_detections(path)


@pytest.mark.parametrize("name", ["wham_output.pkl", "hmr4d_results.pt"])
def test_pickles_are_not_opened(tmp_path: Path, name: str) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (tmp_path / "run",)

    (tmp_path / name).write_bytes(pickle.dumps(Trap()))
    with pytest.raises(InputError, match=r"is a pickle, .* three lines in docs/coming_from\.md"):
        read_detections(tmp_path / name)
    np.savez(
        tmp_path / "a.npz", **smpl_arrays(), frame_ids=np.array([Trap()] * FRAMES, dtype=object)
    )
    with pytest.raises(InputError, match=r"a\.npz"):
        read_detections(tmp_path / "a.npz")
    assert not (tmp_path / "run").exists()
