"""Errors larger than a capture expects of itself are named, whatever is wrong with the truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rendered_files import metrics_of
from runs import Command
from takes import make_take

from perfcap.app.expected_doubts import surface_doubt

EXPECTED = 12.0  # mm


@pytest.fixture(scope="module")
def joints() -> np.ndarray:
    take = make_take(60)
    return take.actor.joints(take.truth).numpy()


def captured(folder: Path, joints: np.ndarray, size: float = 0.006, **changes: Any) -> Path:
    """A capture with as large an error as it expects."""
    rng = np.random.default_rng(0)
    noise = size * rng.normal(size=joints.shape)
    folder.mkdir()
    np.savez(
        folder / "motion.npz",
        joints3d=joints + noise,
        frames=np.arange(len(joints)),
        fps=30.0,
        trust=changes.pop("trust", np.full(len(joints), 0.9)),
    )
    quality = {"expected_error_mm": [EXPECTED] * len(joints), "threshold": 0.7}
    report = {"views": ["one", "two"], "quality": quality | changes.pop("quality", {})}
    (folder / "run.json").write_text(json.dumps(report | changes))
    return folder


def notes(perfcap: Command, folder: Path, truth: np.ndarray) -> list[str]:
    path = folder.parent / "truth.npz"
    np.savez(path, joints3d=truth, frames=np.arange(len(truth)), fps=30.0)
    assert perfcap(["evaluate", folder, "--truth", path]).code == 0
    found = metrics_of(folder)["notes"]
    assert isinstance(found, list)
    return found


def exchanged(joints: np.ndarray, first: int, last: int, pairs: list[tuple[int, int]]) -> Any:
    truth = joints.copy()
    for a, b in pairs:
        truth[first:last, [a, b]] = joints[first:last, [b, a]]
    return truth


def test_a_right_truth_says_nothing(tmp_path: Path, perfcap: Command, joints: np.ndarray) -> None:
    result = captured(tmp_path / "result", joints)
    assert notes(perfcap, result, joints) == []
    # programs place joints differently in the body
    apart = np.random.default_rng(1).normal(size=(1, 16, 3))
    assert notes(perfcap, result, joints + 0.01 * apart) == []


def test_joints_that_wander(tmp_path: Path, perfcap: Command, joints: np.ndarray) -> None:
    """No mistake that is known: joints of another program, say, with errors of its own."""
    result = captured(tmp_path / "result", joints)
    time = np.arange(60)[:, None, None] / 7
    wander = 0.03 * np.sin(time + np.random.default_rng(1).uniform(0, 6, (1, 16, 3)))
    (line,) = notes(perfcap, result, joints + wander)
    assert "mm off, and the report of the capture expects 12; the truth is of other" in line


def test_joints_that_wander_for_a_while(
    tmp_path: Path, perfcap: Command, joints: np.ndarray
) -> None:
    result = captured(tmp_path / "result", joints)
    wander = np.zeros((60, 1, 1))
    wander[24:36] = 0.06 * np.sin(np.arange(1, 13) / 13 * np.pi)[:, None, None]
    move = wander * np.random.default_rng(1).normal(size=(1, 16, 3))
    (line,) = notes(perfcap, result, joints + move)
    assert line.startswith("in frames 25 to 34, aligned frame by frame, joints are")
    doubted = np.where((np.arange(60) >= 20) & (np.arange(60) < 40), 0.2, 0.9)
    warned = captured(tmp_path / "warned", joints, trust=doubted)
    assert notes(perfcap, warned, joints + move) == []


def test_another_place(tmp_path: Path, perfcap: Command, joints: np.ndarray) -> None:
    """Several views know where the person is; one view only across its sight."""
    several = captured(tmp_path / "several", joints)
    (line,) = notes(perfcap, several, joints + np.array([0, 0.15, 0.1]))
    assert line.startswith("the person of the truth is 0.18 m from that of the result, and several")
    one = captured(tmp_path / "one", joints, views=["one"])
    assert notes(perfcap, one, joints + np.array([0, 0.15, 0.1])) == []


@pytest.mark.parametrize("moving", [False, True])
def test_beside_the_sight_of_one_camera(
    tmp_path: Path, perfcap: Command, joints: np.ndarray, moving: bool
) -> None:
    camera = make_take(60).cameras
    poses = [camera.rotation[0].tolist(), camera.translation[0].tolist()]
    entry = {"K": camera.intrinsics[0].tolist(), "R": poses[0], "t": poses[1]}
    if moving:
        entry = {name: [value] * 60 for name, value in entry.items()}
    size = {"pixel_centre": 0, "width": 600, "height": 600}
    (tmp_path / "camera.json").write_text(json.dumps(entry | size))
    request = {"cameras": str(tmp_path / "camera.json")}
    result = captured(tmp_path / "result", joints, views=["one"], request=request)
    away = joints - camera.centre[0].numpy()
    assert notes(perfcap, result, joints + 0.05 * away) == []
    across = np.cross(away.mean((0, 1)), [0.0, 1, 0])
    (line,) = notes(perfcap, result, joints + 0.3 * across / np.linalg.norm(across))
    assert line.startswith("the person of the truth is 0.30 m beside that of the result as the")
    (tmp_path / "camera.json").write_text("{}")  # another file by now
    assert notes(perfcap, result, joints + 0.3 * across / np.linalg.norm(across)) == []


def test_another_size(tmp_path: Path, perfcap: Command, joints: np.ndarray) -> None:
    result = captured(tmp_path / "result", joints)
    middle = joints.mean(1, keepdims=True)
    (line,) = notes(perfcap, result, middle + 1.2 * (joints - middle))
    assert line.startswith("the person of the truth is 1.20 times as large as that of the result")
    growth = np.interp(np.arange(60), [20, 24, 36, 40], [1, 1.3, 1.3, 1])[:, None, None]
    part = joints + 0.001 * np.random.default_rng(1).normal(size=joints.shape)
    (line,) = notes(perfcap, result, middle + growth * (part - middle))
    assert "the person of the truth is 1.30 times as large as that of the result, and 1.0" in line
    assert notes(perfcap, result, middle + 1.05 * (joints - middle)) == []


@pytest.mark.parametrize(
    "changes",
    [
        {"quality": {"expected_error_mm": None}},
        {"quality": {"expected_error_mm": [12.0] * 59}},
        {"quality": {"expected_error_mm": ["12"] * 60}},
        {"quality": {"expected_error_mm": [10**400] * 60}},
        {"quality": {"expected_error_mm": [float("nan")] * 60}},
        {"quality": {"threshold": None}},
        {"quality": {"threshold": 10**400}},
        {"views": 1, "request": {"cameras": 5000 * "a"}},
        {"views": None, "request": {"cameras": "a\0b"}},
        {"trust": np.full(60, 1)},
    ],
)
def test_a_report_that_expects_nothing(
    tmp_path: Path, perfcap: Command, joints: np.ndarray, changes: dict[str, Any]
) -> None:
    result = captured(tmp_path / "result", joints, **changes)
    assert notes(perfcap, result, joints + np.array([0, 0.15, 0.1])) == []


@pytest.mark.parametrize("joints_known", [False, True])
def test_surfaces_that_joints_do_not_explain(tmp_path: Path, joints_known: bool) -> None:
    folder = captured(tmp_path / "result", np.random.default_rng(0).normal(size=(9, 16, 3)))
    scores = {"mpjpe_transl_mm": 40.0} if joints_known else {}
    usual = 40.0 if joints_known else EXPECTED
    what = "true joints 40;" if joints_known else "its report expects joints at 12;"
    (line,) = surface_doubt(folder, scores | {"surface_transl_mm": usual + 25})
    assert line.startswith(f"true surfaces are {usual + 25:.0f} mm from") and what in line
    assert surface_doubt(folder, scores | {"surface_transl_mm": usual + 15}) == []
    far = {"vertex_transl_mm": 2.5 * usual + 40}
    assert len(surface_doubt(folder, scores | far)) == 1
    assert surface_doubt(folder, scores | {"vertex_transl_mm": 2 * usual}) == []
    (folder / "run.json").unlink()  # joints alone
    assert len(surface_doubt(folder, scores | far)) == joints_known


def test_known_mistakes_stand_alone(tmp_path: Path, perfcap: Command, joints: np.ndarray) -> None:
    result = captured(tmp_path / "result", joints)
    (line,) = notes(perfcap, result, joints + np.array([3.0, 0, 0]))
    assert line.startswith("after one shift of all frames by 3 m")


@pytest.mark.parametrize("relative", [False, True])
def test_other_worlds_leave_poses_to_compare(
    tmp_path: Path, perfcap: Command, joints: np.ndarray, relative: bool
) -> None:
    """Where the person stands says nothing there; how large and in which pose still does."""
    walk = np.linspace(0, 0.6, 60)[:, None, None] * np.array([1.0, 0, 0.4])
    joints = joints + walk
    result = captured(tmp_path / "result", joints)
    hips = joints[:, [8, 12]].mean(1, keepdims=True)
    true = joints - hips if relative else joints + np.array([3.0, 0, 4.0])
    (world,) = notes(perfcap, result, true)
    assert "only aligned errors count" in world or "after one shift of all frames by 5 m" in world
    middle = true[:, [8, 12]].mean(1, keepdims=True)
    _, line = notes(perfcap, result, middle + 1.3 * (true - middle))
    assert line.startswith("the person of the truth is 1.30 times as large as that of the result")
    if relative:
        _, line = notes(perfcap, result, true / 1.7)
        assert line.startswith("the person of the truth is 0.59 times as large as")
    wander = 0.03 * np.sin(
        np.arange(60)[:, None, None] / 7 + np.random.default_rng(1).uniform(0, 6, (1, 16, 3))
    )
    _, line = notes(perfcap, result, true + wander - wander[:, [8, 12]].mean(1, keepdims=True))
    assert "mm off, and the report of the capture expects 12; the truth is of other" in line
