"""``perfcap evaluate`` says what ``perfcap.metrics`` says."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from runs import Command
from takes import TakeFiles

from perfcap.metrics import joint_errors


def arrays(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as data:
        return {name: data[name] for name in data.files}


@pytest.fixture
def result(captured: Path, tmp_path: Path) -> Path:
    """A folder with the motion only, to write metrics beside."""
    folder = tmp_path / "result"
    folder.mkdir()
    (folder / "motion.npz").write_bytes((captured / "motion.npz").read_bytes())
    return folder


def test_tables_of_markers_are_no_truth(result: Path, tmp_path: Path, perfcap: Command) -> None:
    (tmp_path / "a.trc").write_text("PathFileType\t4")
    line = perfcap(["evaluate", result, "--truth", tmp_path / "a.trc"]).refused()
    assert "--dataset pose2sim reads a project" in line


def test_the_numbers_are_those_of_the_metrics(
    take: TakeFiles, result: Path, perfcap: Command
) -> None:
    outcome = perfcap(["evaluate", result, "--truth", take.truth])
    assert outcome.code == 0
    found = torch.tensor(arrays(result / "motion.npz")["joints3d"])
    truth = torch.tensor(arrays(take.truth)["joints3d"])
    expected = joint_errors(found, truth, 30.0)
    metrics = json.loads((result / "metrics.json").read_text())
    assert metrics["mpjpe_mm"] == float(expected.mpjpe)
    assert metrics["pa_mpjpe_mm"] == float(expected.mpjpe_similarity)
    assert metrics["pck3d_150"] == float(expected.pck)
    assert metrics["jitter_jerk_m_s3"] == float(expected.jerk)
    assert metrics["frames_scored"] == 24
    assert metrics["mpjpe_mm"] == pytest.approx(float(take.take.error_mm(found).mean()))
    assert f"{metrics['mpjpe_mm']:.1f}" in outcome.out


@pytest.mark.parametrize("name", ["truth.npz", "gt.npz"])
def test_truth_may_be_a_folder(
    take: TakeFiles, result: Path, tmp_path: Path, perfcap: Command, name: str
) -> None:
    (tmp_path / name).write_bytes(take.truth.read_bytes())
    assert perfcap(["evaluate", result, "--truth", tmp_path]).code == 0


def test_a_truth_of_another_world_is_told(
    take: TakeFiles, result: Path, tmp_path: Path, perfcap: Command
) -> None:
    truth = arrays(take.truth)
    z_up = truth | {"joints3d": truth["joints3d"][..., [0, 2, 1]] * [1.0, -1.0, 1.0]}
    np.savez(tmp_path / "z_up.npz", **z_up)
    outcome = perfcap(["evaluate", result, "--truth", tmp_path / "z_up.npz"])
    assert outcome.code == 0 and "rotation of all frames by 90 degrees" in outcome.out
    (note,) = json.loads((result / "metrics.json").read_text())["notes"]
    assert "world of the cameras" in note
    assert "rotation" not in perfcap(["evaluate", result, "--truth", take.truth]).out


def test_frames_are_matched_by_number(
    take: TakeFiles, result: Path, tmp_path: Path, perfcap: Command
) -> None:
    """A result of frames 6 to 14 is compared with these, whatever the order of the truth's."""
    whole = arrays(result / "motion.npz")
    part = whole | {"joints3d": whole["joints3d"][6:15], "frames": whole["frames"][6:15]}
    np.savez(result / "motion.npz", **part)
    truth = arrays(take.truth)
    backwards = {"joints3d": truth["joints3d"][::-1], "frames": truth["frames"][::-1]}
    np.savez(tmp_path / "back.npz", **backwards)
    assert perfcap(["evaluate", result, "--truth", tmp_path / "back.npz"]).code == 0
    metrics = json.loads((result / "metrics.json").read_text())
    expected = joint_errors(
        torch.tensor(part["joints3d"]), torch.tensor(truth["joints3d"][6:15]), 30.0
    )
    assert metrics["mpjpe_mm"] == float(expected.mpjpe) and metrics["frames_scored"] == 9


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints3d": np.zeros((24, 15, 3))}, "(24, 15, 3)"),
        ({"joints3d": np.zeros((0, 16, 3))}, "(0, 16, 3)"),
        ({"joints3d": np.full((24, 16, 3), np.nan)}, "finite"),
        ({"joints3d": np.full((24, 16, 3), "x")}, "joints3d holds <U1"),
        ({"frames": np.arange(20)}, "frames is int64 (20,)"),
        ({"frames": np.linspace(0, 1, 24)}, "frames is float64"),
        ({"frames": np.arange(7, 31)}, "lacks 7 of the 24 frames"),
        ({"frames": np.arange(24).clip(1)}, "frames names 1 2 times"),
        ({"joints3d": None}, "joints3d is missing"),
        ({"fps": np.array(60.0)}, "runs at 60 frames a second, "),
    ],
)
def test_truth_that_cannot_be_used(
    take: TakeFiles,
    result: Path,
    tmp_path: Path,
    perfcap: Command,
    changes: dict[str, Any],
    message: str,
) -> None:
    values = {k: v for k, v in (arrays(take.truth) | changes).items() if v is not None}
    np.savez(tmp_path / "bad.npz", **values)
    line = perfcap(["evaluate", result, "--truth", tmp_path / "bad.npz"]).refused()
    assert message in line and "bad.npz" in line
    assert not (result / "metrics.json").exists()


@pytest.mark.parametrize("fps", [29.97, None])
def test_truth_of_the_same_rate_or_none(
    take: TakeFiles, result: Path, tmp_path: Path, perfcap: Command, fps: float | None
) -> None:
    values = {k: v for k, v in arrays(take.truth).items() if k != "fps"}
    np.savez(tmp_path / "truth.npz", **values, **({} if fps is None else {"fps": fps}))
    assert perfcap(["evaluate", result, "--truth", tmp_path / "truth.npz"]).code == 0


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04 and so on", b"nonsense" * 50])
def test_files_that_are_no_npz(
    take: TakeFiles, result: Path, perfcap: Command, data: bytes
) -> None:
    (result / "motion.npz").write_bytes(data)
    assert "motion.npz" in perfcap(["evaluate", result, "--truth", take.truth]).refused()


def test_missing_files(take: TakeFiles, result: Path, tmp_path: Path, perfcap: Command) -> None:
    line = perfcap(["evaluate", result, "--truth", tmp_path / "none"]).refused()
    assert "--truth" in line and "none" in line
    (result / "motion.npz").unlink()
    assert "motion.npz" in perfcap(["evaluate", result, "--truth", take.truth]).refused()


def test_numbers_replace_no_other_file(take: TakeFiles, result: Path, perfcap: Command) -> None:
    call = ["evaluate", result, "--truth", take.truth, "--out"]
    assert (
        "expected the name of a file that ends in .json" in perfcap([*call, take.truth]).refused()
    )
    (result / "run.json").write_text("{}")
    assert "choose another name" in perfcap([*call, result / "run.json"]).refused()
    assert (result / "run.json").read_text() == "{}" and arrays(take.truth)
    assert perfcap([*call, result / "metrics.json"]).code == 0


def test_a_file_that_is_replaced_is_named(
    take: TakeFiles, result: Path, tmp_path: Path, perfcap: Command
) -> None:
    notes = tmp_path / "notes.json"
    call = ["evaluate", result, "--truth", take.truth]
    assert str(result) not in perfcap(call).out  # its own metrics.json
    assert f"{notes}\n" in perfcap([*call, "--out", notes]).out
    notes.write_text("of mine")
    assert f"{notes} (replaces an older file)\n" in perfcap([*call, "--out", notes]).out
    assert "mpjpe_mm" in json.loads(notes.read_text())


def test_a_result_is_no_truth_of_its_own(result: Path, perfcap: Command) -> None:
    """All errors were 0, and nothing said why."""
    outcome = perfcap(["evaluate", result, "--truth", result / "motion.npz"])
    assert outcome.code == 0 and "has the joints of the result itself" in outcome.out
