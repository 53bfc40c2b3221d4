"""``perfcap capture`` into a folder that holds an older result, or the inputs themselves."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from openpose_take import write_openpose
from runs import Command
from takes import TakeFiles, write_detections
from written_files import motion

from perfcap.app.capture_folder import (
    spare_inputs,
    spare_others,
    spare_result,
    state_of,
    states_of,
    unchanged,
)
from perfcap.cli import main
from perfcap.errors import InputError
from perfcap.io.actor import models_folder

QUICK = ("--no-overlay", "--until", "initialize", "--frames", "0:6")


# --- inputs in the folder -------------------------------------------------------------------------


def test_detections_are_not_replaced_by_those_of_a_part(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    mine = out / "detections.npz"
    flat = replace(take.take.detections, joints3d=None)
    write_detections(mine, flat)
    before = mine.read_bytes()
    lifted = ("--lifter", models_folder() / "lifters" / "cmu", *QUICK)
    link = tmp_path / "link.npz"
    link.symlink_to(mine)
    for given in (mine, tmp_path / "out" / ".." / "out" / "detections.npz", link):
        for more in ((), ("--resume",)):
            call = take.command(out, *lifted, *more, detections=given)
            assert "detections.npz of the result would replace" in perfcap(call).refused()
    assert mine.read_bytes() == before and os.listdir(out) == ["detections.npz"]


@pytest.mark.long
def test_detections_in_the_folder_of_a_capture_that_writes_none(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    """Also again and again: nothing is in the way."""
    mine = tmp_path / "detections.npz"
    shutil.copy(take.detections, mine)
    before = mine.read_bytes()
    for more in ((), ("--resume",), ("--overwrite",)):
        assert perfcap(take.command(tmp_path, *QUICK, *more, detections=mine)).code == 0
    assert mine.read_bytes() == before


@pytest.mark.parametrize("name", ["capture.glb", "overlay.mp4", "run.json", "masks"])
def test_no_input_has_the_place_of_a_result(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir() if name == "masks" else (tmp_path / name).write_bytes(b"x")
    spare_inputs(tmp_path, [tmp_path / "other", tmp_path / "detections.npz"], detected=True)
    with pytest.raises(InputError, match=f"{name} of the result would replace the input"):
        spare_inputs(tmp_path, [tmp_path / "." / name], detected=False)


def test_own_files_stay(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    """Before, masks were removed and other files replaced where there was no result."""
    out = tmp_path / "mine"
    (out / "masks" / "left").mkdir(parents=True)
    kept = (out / "overlay.mp4", out / "masks" / "left" / "000000.png", out / "camera.json")
    for path in kept:
        path.write_bytes(b"mine")
    for more in ((), ("--resume",)):
        line = perfcap(take.command(out, *QUICK, *more)).refused()
        assert "holds overlay.mp4, masks/ but no result; choose another folder" in line
    assert all(path.read_bytes() == b"mine" for path in kept)
    assert sorted(os.listdir(out)) == ["camera.json", "masks", "overlay.mp4"]
    assert perfcap(take.command(out, *QUICK, "--overwrite")).code == 0


def test_own_folders_of_people_stay(tmp_path: Path) -> None:
    (tmp_path / "person1").mkdir()
    spare_others(tmp_path, overwrite=False, detected=True)
    (tmp_path / "person1" / "motion.npz").write_bytes(b"mine")
    with pytest.raises(InputError, match=r"holds person1/motion\.npz but no result"):
        spare_others(tmp_path, overwrite=False, detected=True)
    spare_others(tmp_path, overwrite=True, detected=True)


def test_a_result_and_what_it_was_captured_from_are_spared(tmp_path: Path) -> None:
    video, folder = tmp_path / "dance.mp4", tmp_path / "dance"
    folder.mkdir()
    for path in (video, folder / "motion.npz", folder / "metrics.json", tmp_path / "other.mp4"):
        path.write_bytes(b"x")
    (folder / "run.json").write_text(json.dumps({"input_files": {str(video): "1 byte"}}))
    spare_result(folder, tmp_path / "other.mp4")
    spare_result(folder, folder / "metrics.json", "metrics.json")
    for target in (video, folder / "motion.npz", folder / "metrics.json"):
        with pytest.raises(InputError, match="consists of or was captured from"):
            spare_result(folder, target)
    another = tmp_path / "another"
    another.mkdir()
    (another / "run.json").write_text("{}")
    spare_result(folder, another / "scores.json")
    for name in ("run.json", "metrics.json", "motion.bvh", "overlay.mp4"):
        with pytest.raises(InputError, match=r"is a file of another result, .*another"):
            spare_result(folder, another / name)


# --- resume ---------------------------------------------------------------------------------------


@pytest.mark.long
def test_files_in_a_folder_that_have_changed_since(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    seen, out = tmp_path / "json", tmp_path / "out"
    write_openpose(seen, take.take, range(24))
    call = take.command(out, *QUICK, "--resume", detections=seen)
    assert perfcap(call).code == 0
    first = motion(out)["joints3d"]
    done = (out / "run.json").stat().st_mtime
    assert perfcap(call).code == 0
    assert (out / "run.json").stat().st_mtime == done  # nothing was to do
    write_openpose(seen, take.take, range(24), shift=9.0)
    for path in (*seen.iterdir(), seen):  # of another take, made long before
        os.utime(path, (done - 500, done - 500))
    assert "inputs that have changed since" in perfcap(call).refused()
    assert np.array_equal(motion(out)["joints3d"], first)
    assert perfcap([*call, "--overwrite"]).code == 0
    assert np.abs(motion(out)["joints3d"] - first).max() > 0.01


def test_the_state_of_files_and_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = tmp_path / "a.txt", tmp_path / "b.txt"
    for path in (first, second):
        path.write_text("x")
        os.utime(path, (300, 300))

    def changes(path: Path, *, touches: Path) -> bool:
        before = state_of(path)
        assert before == state_of(path)
        os.utime(touches, (200, 200))  # older than before, as a file from a backup
        return state_of(path) != before

    assert changes(first, touches=first) and changes(tmp_path, touches=second)
    before = states_of([tmp_path, first])
    (tmp_path / "out").mkdir()  # where the result lies
    (tmp_path / "out" / "run.json").write_text("x")
    assert unchanged(before, states_of([tmp_path, first])) and not unchanged(None, before)
    second.rename(tmp_path / "c.txt")
    assert not unchanged(before, states_of([tmp_path, first]))
    first.write_text("xy")
    os.utime(first, (200, 200))
    assert state_of(first) != before[str(first)]
    nothing = states_of([tmp_path / "none"])
    assert not unchanged(nothing, nothing)
    monkeypatch.setattr("perfcap.app.capture_folder._MOST_FILES", 1)
    assert state_of(tmp_path) is None  # as good as changed


# --- what an older result left --------------------------------------------------------------------


@pytest.mark.long
def test_nothing_tells_of_an_older_result(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    first = take.command(tmp_path, "--report", "--frames", "0:3", "--until", "initialize")
    assert perfcap(first).code == 0
    assert perfcap(["evaluate", tmp_path, "--truth", take.truth]).code == 0
    for name in ("textured.mp4", "detections.npz", "notes.txt"):
        (tmp_path / name).write_text("x")
    older = ("overlay.mp4", "report.html", "metrics.json")
    assert all((tmp_path / name).is_file() for name in older)
    assert perfcap(take.command(tmp_path, *QUICK, "--overwrite")).code == 0
    assert sorted(os.listdir(tmp_path)) == [
        *("capture.glb", "config.yaml", "detections.npz", "motion.bvh", "motion.npz"),
        *("notes.txt", "run.json"),
    ]


def test_where_no_result_lies_nothing_else_is_removed(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    (tmp_path / "metrics.json").write_text("x")
    assert perfcap(take.command(tmp_path, *QUICK)).code == 0
    assert (tmp_path / "metrics.json").read_text() == "x"


# --- never overwritten without being told ---------------------------------------------------------


@pytest.mark.long
def test_a_result_is_not_overwritten(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    assert perfcap(take.command(tmp_path, *QUICK)).code == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert "--overwrite" in perfcap(take.command(tmp_path, *QUICK)).refused()
    other = take.command(tmp_path, "--resume", "--no-overlay", "--frames", "0:4")
    assert "of another call" in perfcap(other).refused()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert perfcap([*other, "--overwrite"]).code == 0
    assert len(motion(tmp_path)["frames"]) == 4


def test_links_and_folders_are_refused_before_the_solve(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    from perfcap.app import capture as module

    def never(*_: object, **__: object) -> None:
        raise AssertionError("it was solved")

    monkeypatch.setattr(module, "capture", never)
    for name in ("run.json", "surface.npz", "overlay.mp4"):
        (tmp_path / name).mkdir()
        assert f"{name}: is a folder" in perfcap(take.command(tmp_path, *QUICK)).refused()
        (tmp_path / name).rmdir()
    (tmp_path / "masks").symlink_to(take.folder)
    assert "masks: is a link" in perfcap(take.command(tmp_path, *QUICK)).refused()


@pytest.mark.long
def test_two_captures_into_one_folder(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    from perfcap.io.result_folder import locked

    with locked(tmp_path):
        assert "another perfcap" in perfcap(take.command(tmp_path, *QUICK)).refused()
    assert perfcap(take.command(tmp_path, *QUICK)).code == 0
    other = tmp_path / "other"
    assert perfcap([*take.command(other, *QUICK)[:-1], "0:5"]).code == 0
    shutil.copy(other / "motion.npz", tmp_path / "motion.npz")
    evaluate = ["evaluate", tmp_path, "--truth", take.truth]
    assert "different captures" in perfcap(evaluate).refused()
    assert "run.json says 6" in perfcap(["report", tmp_path]).refused()
    assert perfcap(take.command(tmp_path, *QUICK, "--resume")).code == 2


# --- unfinished work ------------------------------------------------------------------------------


class Killed(BaseException):
    """Nothing in the program may catch it."""


def result(folder: Path) -> dict[str, object]:
    """All files, without the times that run.json and zip archives hold."""
    found: dict[str, object] = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    run = json.loads((folder / "run.json").read_text())
    run["request"]["out"] = None
    for name in ("wall_s", "peak_memory_mib", "stages"):
        del run[name]
    return found | {"run.json": run, "motion.npz": repr(motion(folder))}


def test_a_killed_capture_goes_on(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever stage it is killed in; an older result stays until then."""
    from perfcap.app import capture as module

    out, whole = tmp_path / "out", tmp_path / "whole"
    assert perfcap(take.command(whole)).code == 0
    assert perfcap(take.command(out, *QUICK)).code == 0
    older = result(out)

    def kill(*_: object, **__: object) -> None:
        raise Killed

    call = take.command(out)
    for where in ("_draw", "write_result"):
        monkeypatch.setattr(module, where, kill)
        with pytest.raises(Killed):
            main([*call, "--overwrite" if where == "_draw" else "--resume"])
        monkeypatch.undo()
        assert result(out) == older
        assert "go on with --resume" in perfcap(call).refused()
        other = take.command(out, "--resume", "--frames", "0:9")
        assert "differs in options: frames" in perfcap(other).refused()
    monkeypatch.setattr("perfcap.pipeline.track_motion._solve_group", kill)  # nothing is solved
    assert perfcap([*call, "--resume"]).code == 0
    assert result(out) == result(whole) and not (out / ".perfcap").exists()


@pytest.mark.long
def test_unfinished_work_can_be_dropped(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    from perfcap.app import capture as module

    def kill(*_: object, **__: object) -> None:
        raise Killed

    monkeypatch.setattr(module, "write_result", kill)
    with pytest.raises(Killed):
        main(take.command(tmp_path, "--frames", "0:9"))
    monkeypatch.undo()
    assert perfcap(take.command(tmp_path, *QUICK, "--overwrite")).code == 0
    assert len(motion(tmp_path)["frames"]) == 6 and not (tmp_path / ".perfcap").exists()


def test_inputs_that_have_changed_end_what_is_kept(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    from perfcap.app import capture as module

    def kill(*_: object, **__: object) -> None:
        raise Killed

    mine = tmp_path / "mine.npz"
    shutil.copy(take.detections, mine)
    call = take.command(tmp_path / "out", *QUICK, detections=mine)
    monkeypatch.setattr(module, "write_result", kill)
    with pytest.raises(Killed):
        main(call)
    monkeypatch.undo()
    os.utime(mine, (1, 1))
    assert f"differs in inputs: {mine}" in perfcap([*call, "--resume"]).refused()


def test_a_link_in_place_of_the_work_folder(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".perfcap").symlink_to(tmp_path / "elsewhere")
    assert "is a link" in perfcap(take.command(tmp_path / "out", *QUICK)).refused()
    assert list((tmp_path / "elsewhere").iterdir()) == []
