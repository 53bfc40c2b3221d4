"""``perfcap doctor`` finds what would spoil a capture and says so by its exit code."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from runs import Command
from takes import TakeFiles, write_detections

import perfcap.app.doctor as module
from perfcap.io import Clip
from perfcap.io.doctor import Finding, Severity


def test_an_installation_without_errors_is_code_0(
    perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    fine = [Finding(Severity.INFO, "python", "3"), Finding(Severity.WARNING, "cv2", "two of them")]
    monkeypatch.setattr(module, "examine_installation", lambda: fine)
    outcome = perfcap(["doctor"])
    assert outcome.code == 0 and "0 errors, 2 other findings" in outcome.out


def test_a_missing_package_is_code_2(perfcap: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = [Finding(Severity.ERROR, "av", "is not installed", "pip install av")]
    monkeypatch.setattr(module, "examine_installation", lambda: missing)
    outcome = perfcap(["doctor"])
    assert outcome.code == 2 and "pip install av" in outcome.out


def test_this_installation_can_be_examined(perfcap: Command) -> None:
    outcome = perfcap(["doctor"])
    assert outcome.code in (0, 2) and "python" in outcome.out


def test_good_inputs_are_code_0(
    take: TakeFiles, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    files = ["--cameras", take.camera, "--detections", take.detections]
    outcome = perfcap(["doctor", take.video, *files])
    assert outcome.code == 0, outcome.out


def test_bad_inputs_are_code_2_and_all_named(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    (tmp_path / "c.json").write_text("{")
    (tmp_path / "v.mp4").write_bytes(b"")
    files = ["--cameras", tmp_path / "c.json", "--detections", take.detections]
    outcome = perfcap(["doctor", tmp_path / "v.mp4", *files])
    assert outcome.code == 2 and "Traceback" not in outcome.err
    text = "".join(outcome.out.split())
    assert "c.json" in text and "v.mp4" in text and "2errors" in text


def test_nobody_in_the_detections(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    empty = replace(take.take.detections, confidence2d=0 * take.take.detections.confidence2d)
    write_detections(tmp_path / "none.npz", empty)
    files = ["--cameras", take.camera, "--detections", tmp_path / "none.npz"]
    assert perfcap(["doctor", *files]).code == 2


@pytest.mark.parametrize("option", ["--detections", "--video-map"])
def test_files_without_cameras_are_not_passed_over(
    take: TakeFiles, perfcap: Command, option: str
) -> None:
    line = perfcap(["doctor", option, take.detections]).refused()
    assert "--cameras" in line


# --- what a capture says of the same files, before any of it is detected or solved ----------------


def moving(take: TakeFiles, poses: int, **more: object) -> dict[str, object]:
    """The take's camera as one that turns a little in every frame."""
    known = json.loads(take.camera.read_text())
    turns = [euler(0.001 * frame) @ np.array(known["R"]) for frame in range(poses)]
    return {**known, "R": [turn.tolist() for turn in turns], "t": [known["t"]] * poses, **more}


def euler(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


@pytest.mark.parametrize(
    ("poses", "more", "words"),
    [
        (24, {"fps": 60.0}, "run at 60 frames a second, the video at 30"),
        (23, {}, "has 23 frames, the clip needs 24"),
        (40, {}, "has 40 frames, the video 24"),
        (25, {}, None),
    ],
)
def test_moving_cameras_are_judged_alike(
    take: TakeFiles,
    tmp_path: Path,
    perfcap: Command,
    monkeypatch: pytest.MonkeyPatch,
    poses: int,
    more: dict[str, object],
    words: str | None,
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    (tmp_path / "camera.json").write_text(json.dumps(moving(take, poses, **more)))
    files = ["--cameras", tmp_path / "camera.json", "--detections", take.detections]
    outcome = perfcap(["doctor", take.video, *files])
    assert (outcome.code, words is None or words in outcome.out) == (2 if words else 0, True)
    if words is not None:
        call = take.command(tmp_path / "out", cameras=tmp_path / "camera.json")
        assert words in perfcap(call).refused()


def test_cameras_of_another_rate_and_joints_of_another_view(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    known = json.loads(take.camera.read_text())
    known.pop("fps", None)
    views = {"left": known, "right": {**known, "t": [0.5, 0.0, 4.0]}}
    (tmp_path / "cameras.json").write_text(json.dumps({"fps": 60.0, "views": views}))
    shutil.copy(take.video, tmp_path / "left.mp4")
    shutil.copy(take.detections, tmp_path / "right.npz")
    files = ["--cameras", tmp_path / "cameras.json", "--detections", tmp_path / "right.npz"]
    outcome = perfcap(["doctor", tmp_path / "left.mp4", *files])
    assert outcome.code == 0
    assert "warning: --cameras: run at 60 frames a second, the video at 30" in outcome.out
    assert "is named after the view right, the videos are of left" in outcome.out


@pytest.mark.long
def test_images_have_the_rate_of_their_cameras(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    (tmp_path / "images").mkdir()
    clip = Clip.open(take.video)
    for frame in range(len(clip)):
        image = clip.read_view(0, frame, frame + 1)[0][..., ::-1]
        cv2.imwrite(str(tmp_path / "images" / f"{frame:03d}.png"), image)
    files = ["--cameras", take.camera, "--detections", take.detections]
    known = json.loads(take.camera.read_text())
    for rate, words in ((25.0, 0), (None, 1)):
        (tmp_path / "camera.json").write_text(json.dumps({**known, "fps": rate}))
        if rate is None:
            (tmp_path / "camera.json").write_text(
                json.dumps({name: value for name, value in known.items() if name != "fps"})
            )
        files[1] = tmp_path / "camera.json"
        outcome = perfcap(["doctor", tmp_path / "images", *files])
        assert outcome.code == 0 and outcome.out.count("30 a second assumed") == words


@pytest.mark.long
def test_joints_in_pixels_of_the_video(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "examine_installation", list)
    known = json.loads(take.camera.read_text())
    lens = (4 * np.array(known["K"])).tolist()
    lens[2][2] = 1.0
    size = {"width": 4 * known["width"], "height": 4 * known["height"]}
    (tmp_path / "camera.json").write_text(json.dumps({**known, "K": lens, **size}))
    table = {"video_px_to_native_px": {"camera": [[4.0, 0, 0], [0, 4.0, 0]]}}
    (tmp_path / "map.json").write_text(json.dumps(table))
    files = ["--cameras", tmp_path / "camera.json", "--detections", take.detections]
    call = ["doctor", take.video, *files, "--video-map", tmp_path / "map.json"]
    assert "0 errors, 0 other" in perfcap([*call, "--detections-in", "video"]).out
    assert "in a video of half the size" in perfcap(call).out


@pytest.mark.parametrize("count", [1, 2])
def test_videos_without_cameras(count: int, perfcap: Command) -> None:
    refused = perfcap(["doctor", *["dance.mp4"] * count]).refused()
    assert "--cameras: is missing" in refused
    assert ("one video needs none: perfcap capture" in refused) == (count == 1)
