"""Everybody in the detections files, before anybody says who is who."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from detection_files import FRAMES, moving, person, write_json, write_npz, write_openpose

from perfcap.detect import joint_set as sets
from perfcap.errors import InputError
from perfcap.io.detections import read_candidates, read_detections
from perfcap.io.detections.listing import MOST_CANDIDATES


def crowd(*shifts: float) -> list[list[np.ndarray]]:
    """People of COCO's joints in each frame, each to the side of the others."""
    return [[person(sets.COCO17, 3.0 * f + s) for s in shifts] for f in range(FRAMES)]


def check(path: Path, shifts: tuple[float, ...], **options: Any) -> list[str]:
    found, warnings = read_candidates(path, **options)
    assert found.joints2d.shape == (len(shifts), FRAMES, 1, 16, 2)
    for slot, shift in enumerate(shifts):
        values = torch.from_numpy(np.stack([p[slot] for p in crowd(*shifts)]))
        joints, confidence = sets.map_to_landmarks(values[..., :2], values[..., 2], sets.COCO17)
        assert torch.equal(found.joints2d[slot, :, 0], joints), shift
        assert torch.equal(found.confidence2d[slot, :, 0], confidence)
    return warnings


def test_openpose_lists_everybody(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "a", crowd(0, 400, -300))
    warnings = check(folder, (0, 400, -300), frames=FRAMES)
    assert not any("prominent" in line for line in warnings)


def test_keypoint_json_lists_everybody(tmp_path: Path) -> None:
    entries = [
        {"image_id": f, "keypoints": p.reshape(-1).tolist(), "score": 1.0}
        for f, people in enumerate(crowd(0, 400))
        for p in people
    ]
    check(write_json(tmp_path / "a.json", entries), (0, 400), frames=FRAMES)
    frames = [
        {"frame_id": f, "instances": [
            {"keypoints": p[:, :2].tolist(), "keypoint_scores": p[:, 2].tolist()} for p in people
        ]}
        for f, people in enumerate(crowd(0, 400))
    ]  # fmt: skip
    check(write_json(tmp_path / "b.json", frames), (0, 400), frames=FRAMES)


def candidates_npz(path: Path, views: int = 2, **change: Any) -> np.ndarray:
    """Two people in all views but the last, which shows one; returns [F, C, P, J, 3]."""
    one = moving(sets.LANDMARKS16)
    people = np.stack((one, one + np.array((200, 50, 0))), 1)
    values = np.repeat(people[:, None], views, 1)
    values[:, -1, 1] = 0
    write_npz(path, joints2d=values[..., :2], confidence2d=values[..., 2], **change)
    return values


def test_npz_of_several_people(tmp_path: Path) -> None:
    values = candidates_npz(tmp_path / "a.npz", view_names=np.array(["left", "right"]))
    found, warnings = read_candidates(tmp_path / "a.npz", views=["left", "right"])
    assert found.joints2d.shape == (2, FRAMES, 2, 16, 2) and warnings == []
    expected = torch.from_numpy(values.transpose(2, 0, 1, 3, 4))
    assert torch.equal(found.joints2d, expected[..., :2])
    assert torch.equal(found.confidence2d, expected[..., 2])
    turned, _ = read_candidates(tmp_path / "a.npz", views=["right", "left"])
    assert torch.equal(turned.joints2d, found.joints2d.flip(2))


def test_npz_of_several_people_without_their_3d(tmp_path: Path) -> None:
    candidates_npz(tmp_path / "a.npz", joints3d_mm=np.zeros((FRAMES, 2, 2, 16, 3)))
    found, warnings = read_candidates(tmp_path / "a.npz", views=2)
    assert found.joints3d is None and any("3D joints of several" in line for line in warnings)


def test_one_person_is_followed_as_before(tmp_path: Path) -> None:
    candidates_npz(tmp_path / "a.npz")
    found, warnings = read_detections(tmp_path / "a.npz", views=2)
    assert found.joints2d.shape == (FRAMES, 2, 16, 2)
    assert "up to 2 people in a frame; the most prominent one is followed" in warnings[0]
    assert "--people 1 follows the same person in all views" in warnings[-1]
    alone = write_npz(tmp_path / "b.npz")
    one, _ = read_detections(alone)
    candidates, _ = read_candidates(alone)
    assert torch.equal(candidates.joints2d[0], one.joints2d)
    assert torch.equal(candidates.confidence2d[0], one.confidence2d)


def test_a_crowd_is_bounded(tmp_path: Path) -> None:
    shifts = tuple(10.0 * k for k in range(MOST_CANDIDATES + 3))
    found, warnings = read_candidates(write_openpose(tmp_path / "a", crowd(*shifts)))
    assert len(found.joints2d) == MOST_CANDIDATES
    assert any(f"the {MOST_CANDIDATES} most prominent" in line for line in warnings)


@pytest.mark.parametrize("people", [0, 1001])
def test_impossible_numbers_of_people(tmp_path: Path, people: int) -> None:
    shape = (1, 1, people, 16)
    path = write_npz(
        tmp_path / "a.npz", joints2d=np.zeros((*shape, 2)), confidence2d=np.ones(shape)
    )
    with pytest.raises(InputError, match=r"joints2d has .*expected"):
        read_candidates(path)


def test_views_of_different_length(tmp_path: Path) -> None:
    write_openpose(tmp_path / "a", crowd(0, 400))
    write_openpose(tmp_path / "b", crowd(0)[:-1])
    write_openpose(tmp_path / "c", crowd(0)[:2])
    found, warnings = read_candidates([tmp_path / "a", tmp_path / "b"], views=2)
    assert found.frame_count == FRAMES - 1 and "numbers of frames differ" in warnings[-1]
    assert (found.confidence2d[1, :, 1] == 0).all()
    with pytest.raises(InputError, match="numbers of frames differ"):
        read_candidates([tmp_path / "a", tmp_path / "c"], views=2, frames=40)
