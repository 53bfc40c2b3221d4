"""``perfcap render``: a folder of results to a video."""

import json
import shutil
from pathlib import Path

import av
import numpy as np
import pytest
import torch
from runs import Command
from takes import TakeFiles, camera_entry, write_json

from perfcap.io.result import read_result
from perfcap.io.surface_file import save_surface
from perfcap.pipeline.surroundings import upright

SMALL = ("--size", 64, 48)


@pytest.fixture
def folder(captured: Path, tmp_path: Path) -> Path:
    """A copy of the one captured folder, with a blank in its name."""
    return Path(shutil.copytree(captured, tmp_path / "my result"))


def frames(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def test_an_orbit_of_the_whole_capture(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    out = tmp_path / "an orbit.mp4"
    outcome = perfcap(["render", captured, "--out", out, *SMALL])
    assert outcome.code == 0 and not outcome.said
    drawn = frames(out)
    assert len(drawn) == 24 and drawn[0].shape == (48, 64, 3)
    assert [p.name for p in tmp_path.iterdir()] == ["an orbit.mp4"]


def test_whoever_lies_in_a_retargeted_motion_lies(captured: Path) -> None:
    """A capture's up is found in the person; that of a retargeted motion is y."""
    joints = torch.from_numpy(read_result(captured).joints[..., [1, 0, 2]] * [1.0, -1.0, 1.0])
    assert abs(float(upright(joints)[0])) == 1
    assert upright(joints, level=True).tolist() == [0, 1, 0]


def test_the_same_call_makes_the_same_file(
    captured: Path, tmp_path: Path, perfcap: Command
) -> None:
    for name in ("a.mp4", "b.mp4"):
        call = ["render", captured, "--frames", "3:7", "--orbit", 90, "--out", tmp_path / name]
        assert perfcap([*call, *SMALL]).code == 0
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    assert len(frames(tmp_path / "a.mp4")) == 4


def test_a_file_that_is_replaced_is_named(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    out = tmp_path / "dance.mp4"
    call = ["render", captured, "--freeze", 0, "--seconds", 0.05, *SMALL, "--out", out]
    assert perfcap(call).out == f"{out}\n"
    out.write_bytes(b"my own film")
    assert perfcap(call).out == f"{out} (replaces an older file)\n"
    assert len(frames(out)) == 2


def test_the_camera_of_the_capture(
    captured: Path, take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    out = tmp_path / "a.mp4"
    call = ["render", captured, "--camera", take.camera, "--frames", ":5", "--out", out]
    assert perfcap(call).code == 0
    drawn = frames(out)
    assert len(drawn) == 5 and drawn[0].shape == (120, 160, 3)


def test_a_view_of_several_by_name(
    captured: Path, take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    entry = camera_entry(take.take.cameras)
    away = entry | {"t": [50.0, 0.0, 5.0]}
    write_json(tmp_path / "cameras.json", {"views": {"away": away, "cam 2": entry}})
    call = ["render", captured, "--camera", tmp_path / "cameras.json", "--freeze", 3]
    pictures = []
    for more in ((), ("--view", "cam2"), ("--view", "cam 2")):
        call_ = [*call, "--seconds", 0.1, *more, "--out", tmp_path / "a.mp4"]
        assert perfcap(call_).code == 0, more
        pictures.append(frames(tmp_path / "a.mp4"))
    assert [len(p) for p in pictures] == [3, 3, 3]
    assert np.abs(pictures[0][0].astype(int) - pictures[1][0]).max() > 60  # nobody in the first
    assert np.array_equal(pictures[1][0], pictures[2][0])
    message = perfcap([*call, "--view", "x", "--out", tmp_path / "a.mp4"]).refused()
    assert "--view x" in message and "away, cam 2" in message


def test_a_turntable(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    call = ["render", captured, "--freeze", 10, "--seconds", 0.5, "--up", "y", *SMALL]
    assert perfcap([*call, "--out", tmp_path / "a.mp4"]).code == 0
    assert len(frames(tmp_path / "a.mp4")) == 15


@pytest.mark.long
def test_the_captured_surface_is_what_is_drawn(
    folder: Path, tmp_path: Path, perfcap: Command
) -> None:
    from perfcap.io.result import read_result

    call = ["render", folder, "--freeze", 0, "--seconds", 0.05, "--out"]
    assert perfcap([*call, tmp_path / "skin.mp4"]).code == 0
    result = read_result(folder)
    middle = result.vertices(slice(0, 24)).mean(1, keepdims=True)
    thick = [middle + 1.25 * (result.vertices(slice(0, 24)) - middle)]
    faces, numbers = result.template.faces, result.frame_numbers
    save_surface(folder / "surface.npz", thick, faces, numbers, result.rate)
    assert perfcap([*call, tmp_path / "surface.mp4"]).code == 0
    plain, larger = (frames(tmp_path / f"{name}.mp4")[0] for name in ("skin", "surface"))
    assert (np.abs(plain.astype(int) - larger).max(-1) > 25).mean() > 0.01


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--out", "a.avi"), "ends in .mp4"),
        (("--out", "a"), "ends in .mp4"),
        (("--out", "missing/a.mp4"), "no folder missing"),
        (("--size", "8", "8"), "--size 8 8"),
        (("--size", "9999", "480"), "--size 9999 480"),
        (("--frames", "24:30"), "holds frames 0 to 23"),
        (("--frames", "5"), "--frames 5"),
        (("--freeze", "24"), "holds frames 0 to 23"),
        (("--freeze", "3", "--frames", "0:9"), "--frames and --freeze"),
        (("--freeze", "3", "--seconds", "0"), "--seconds 0"),
        (("--freeze", "3", "--seconds", "nan"), "--seconds nan"),
        (("--freeze", "3", "--seconds", "1e9"), "--seconds"),
        (("--seconds", "3"), "--freeze FRAME"),
        (("--orbit", "nan"), "--orbit nan"),
        (("--camera", "nowhere.json"), "nowhere.json"),
        (("--camera", "c.json", "--orbit", "90"), "--orbit and --camera"),
        (("--view", "front"), "--camera FILE"),
    ],
)
def test_wrong_calls_are_one_line_and_write_nothing(
    captured: Path,
    tmp_path: Path,
    perfcap: Command,
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    out = () if "--out" in options else ("--out", "a.mp4")
    assert message in perfcap(["render", captured, *out, *options]).refused()
    assert list(tmp_path.iterdir()) == []


def test_unfinished_folders_are_refused(folder: Path, tmp_path: Path, perfcap: Command) -> None:
    call = ["--out", tmp_path / "a.mp4", *SMALL]
    assert "no such folder" in perfcap(["render", tmp_path / "none", *call]).refused()
    (folder / "run.json").rename(folder / "other.json")
    assert "no run.json" in perfcap(["render", folder, *call]).refused()
    (folder / "run.json").write_text(json.dumps({"frames": 24, "surface": {"vertices": 1}}))
    assert "lacks surface.npz" in perfcap(["render", folder, *call]).refused()
    assert not (tmp_path / "a.mp4").exists()


def test_a_camera_that_ends_too_early_is_refused(
    captured: Path, take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    entry = camera_entry(take.take.cameras)
    moving = entry | {"t": [[0.0, 0.0, 5.0 + 0.1 * i] for i in range(10)]}
    write_json(tmp_path / "camera.json", moving)
    call = ["render", captured, "--camera", tmp_path / "camera.json", "--out", tmp_path / "a.mp4"]
    assert "has 10 frames, expected one for frame 23" in perfcap(call).refused()
    assert perfcap([*call, "--frames", "0:10"]).code == 0


def test_the_video_that_was_captured_stays(
    take: TakeFiles, captured: Path, perfcap: Command
) -> None:
    before = take.video.read_bytes()
    call = ["render", captured, "--frames", ":1", *SMALL, "--out", take.video]
    assert "was captured from; choose another name" in perfcap(call).refused()
    assert take.video.read_bytes() == before


def test_who_is_upside_down_or_lies_is_named(
    captured: Path, tmp_path: Path, perfcap: Command
) -> None:
    call = ["render", captured, "--freeze", 0, "--seconds", 0.05, "--out", tmp_path / "a.mp4"]
    told = {up: perfcap([*call, f"--up={up}", *SMALL]).out for up in ("auto", "y", "-y", "x")}
    down = {up for up, out in told.items() if "upside down" in out}
    assert len(down) == 1 and down < {"y", "-y"}
    assert {up for up, out in told.items() if "the person lies" in out} == {"x"}


def test_cameras_that_do_not_see_the_person_are_named(
    captured: Path, take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    entry = camera_entry(take.take.cameras)
    place = np.array(entry["t"])
    kinds = {
        "right": ({}, ""),
        "millimetres": ({"t": (1000 * place).tolist()}, "px tall at most"),
        "behind": ({"t": (-place).tolist()}, "no picture shows the person"),
        "beside": (
            {"t": (place + np.array([50.0, 0.0, 0.0])).tolist()},
            "no picture shows the person",
        ),
    }
    for kind, (change, said) in kinds.items():
        write_json(tmp_path / "camera.json", entry | change)
        call = ["render", captured, "--camera", tmp_path / "camera.json", "--frames", ":2"]
        done = perfcap([*call, "--out", tmp_path / "a.mp4"])
        assert done.code == 0 and said in done.out, kind
        assert ("--camera" in done.out) == bool(said), kind
