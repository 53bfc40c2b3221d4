"""Captures that end early, and frames that cannot be captured."""

import os
from pathlib import Path

import av
import numpy as np
import pytest
from runs import Command
from takes import (
    TakeFiles,
    without,
    write_detections,
    write_video,
)
from written_files import FILES, motion, report

# --- when something goes wrong on the way ---------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("where", ["save_overlay", "capture"])
def test_a_crash_leaves_nothing_half_written(
    take: TakeFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    from perfcap.app import capture as module
    from perfcap.cli import main

    def crash(*_: object, **__: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr(module, where, crash)
    with pytest.raises(RuntimeError, match="boom"):
        main(take.command(tmp_path / "out"))
    out = tmp_path / "out"
    kept = os.listdir(out) if out.exists() else None
    assert kept == ([".perfcap"] if where == "save_overlay" else None)  # what was solved before


@pytest.mark.long
@pytest.mark.parametrize("where", ["save_bvh", "save_animation", "bvh_motion"])
def test_a_crash_while_saving_leaves_the_older_result(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    from perfcap.cli import main
    from perfcap.pipeline import result_files as module

    assert perfcap(take.command(tmp_path, "--frames", "0:12")).code == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def crash(*_: object, **__: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr(module, where, crash)
    with pytest.raises(RuntimeError, match="boom"):
        main(take.command(tmp_path, "--frames", "0:9", "--overwrite"))
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()} == before


def test_a_disk_that_fills_up_is_one_line(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    import errno

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "savez_compressed", full)
    line = perfcap(take.command(tmp_path, "--no-overlay")).refused()
    assert "motion.npz" in line and "No space left" in line
    assert os.listdir(tmp_path) == [".perfcap"]  # what was solved is kept
    monkeypatch.undo()
    assert perfcap(take.command(tmp_path, "--no-overlay", "--resume")).code == 0
    assert sorted(os.listdir(tmp_path)) == [f for f in FILES if f != "overlay.mp4"]


def test_ctrl_c(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    from perfcap.app import capture as module

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "capture", interrupt)
    outcome = perfcap(take.command(tmp_path))
    assert (outcome.code, outcome.err) == (130, "perfcap: interrupted\n")
    assert os.listdir(tmp_path) == []


# --- frames that cannot be captured ---------------------------------------------------------------


@pytest.mark.long
def test_frames_without_a_person_are_named(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    write_detections(tmp_path / "gap.npz", without(take.take.detections, slice(9, 12)))
    call = take.command(tmp_path / "out", detections=tmp_path / "gap.npz")
    outcome = perfcap([*call, "--frames", "4:"])
    assert outcome.code == 3
    assert [n for n in outcome.notes if n.startswith("frames 9 to 11: no person is detected")]
    run = report(tmp_path / "out")
    assert run["not_captured"] == [[9, 12]] and run["complete"] is False
    arrays = motion(tmp_path / "out")
    assert arrays["frames"].tolist() == list(range(4, 24))
    assert take.take.error_mm(take.take.actor.joints(take.take.truth)).max() == 0
    truth = take.take.actor.joints(take.take.truth)[4:].numpy()
    assert np.linalg.norm(arrays["joints3d"] - truth, axis=-1).mean() < 0.03
    # what is not complete is done again
    assert perfcap([*call, "--frames", "4:", "--resume"]).code == 3


@pytest.mark.long
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e200])
def test_wild_coordinates_are_left_out(
    take: TakeFiles, tmp_path: Path, perfcap: Command, value: float
) -> None:
    pixels = take.take.detections.joints2d[:, 0].numpy().copy()
    pixels[5, 3] = value
    pixels[11] = value
    write_detections(tmp_path / "wild.npz", take.take.detections, joints2d=pixels)
    outcome = perfcap(take.command(tmp_path / "out", detections=tmp_path / "wild.npz"))
    assert outcome.code == 3
    run = report(tmp_path / "out")
    assert run["not_captured"] == [[11, 12]]
    assert any("17 joints in 2 frames" in note for note in run["input_warnings"])  # type: ignore[attr-defined]
    assert np.isfinite(motion(tmp_path / "out")["joints3d"]).all()


@pytest.mark.long
def test_3d_joints_that_are_not_finite_are_left_out(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    poses = 1000 * take.take.detections.joints3d[:, 0].numpy()  # type: ignore[index]
    poses[5, 3], poses[9], poses[12] = np.nan, np.inf, 1e200
    write_detections(tmp_path / "wild.npz", take.take.detections, joints3d_mm=poses)
    assert perfcap(take.command(tmp_path / "out", detections=tmp_path / "wild.npz")).code == 0
    truth = take.take.actor.joints(take.take.truth).numpy()
    found = motion(tmp_path / "out")["joints3d"]
    assert np.linalg.norm(found - truth, axis=-1).mean() < 0.02


@pytest.mark.long
@pytest.mark.parametrize("share", [0.9, 0.5])
def test_a_truncated_video_is_captured_as_far_as_it_goes(
    take: TakeFiles, tmp_path: Path, perfcap: Command, share: float
) -> None:
    data = take.video.read_bytes()
    (tmp_path / "cut.mp4").write_bytes(data[: int(len(data) * share)])
    outcome = perfcap(take.command(tmp_path / "out", video=tmp_path / "cut.mp4"))
    if share < 0.9:  # so much is missing that these may be detections of another video
        assert "numbers of frames differ" in outcome.refused()
        return
    # a decoder of one thread fails at the broken frame, one of several stops before it
    words = ("cut short", "decoding broke off")
    assert outcome.code == 3 and any(each in outcome.notes[0] for each in words)
    ((start, stop),) = report(tmp_path / "out")["not_captured"]  # type: ignore[misc]
    assert 15 < start < 24 and stop == 24
    assert len(motion(tmp_path / "out")["frames"]) == start


@pytest.mark.long
def test_a_few_frames_without_detections_at_the_end_are_named(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    write_detections(tmp_path / "short.npz", take.take.detections.frames(slice(0, 22)))
    for part in ((), ("--frames", "3:")):
        call = take.command(
            tmp_path / "out", "--overwrite", *part, detections=tmp_path / "short.npz"
        )
        outcome = perfcap(call)
        assert outcome.code == 3
        assert report(tmp_path / "out")["not_captured"] == [[22, 24]]
        assert motion(tmp_path / "out")["frames"][-1] == 21
    with av.open(str(tmp_path / "out/overlay.mp4")) as container:
        assert sum(1 for _ in container.decode(video=0)) == 19


@pytest.mark.long
def test_a_few_detections_more_than_frames_are_left_out(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    write_video(tmp_path / "short.mp4", 22, (120, 160))
    outcome = perfcap(take.command(tmp_path / "out", video=tmp_path / "short.mp4"))
    assert outcome.code == 0 and "numbers of frames differ" in outcome.notes[0]
    assert len(motion(tmp_path / "out")["frames"]) == 22
