"""Masks of a result whose video has other pixels than its calibration, and the true silhouettes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rendered_files import metrics_of, save_motion, write_rendered
from runs import Command
from takes import (
    camera_entry,
    silhouettes,
    write_json,
    write_take,
    write_video,
)

# from video to calibration: twice as large with bars of 40 and 20 px; the left half cropped away
BARS = ([[0.5, 0, -20.25], [0, 0.5, -10.25]], (440, 480))
CROP = ([[1.0, 0, 100.0], [0, 1.0, 0]], (200, 100))
MOVED = ([[1.0, 0, -30.0], [0, 1.0, 12.0]], (200, 200))
KEY = "video_px_to_native_px"


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    write_rendered(tmp_path / "seq")
    return tmp_path / "seq"


def seen(mask: np.ndarray, matrix: Any, size: tuple[int, int]) -> np.ndarray:
    """A mask of the calibration in the pixels of a video, bright where the bars are."""
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    shown: np.ndarray = cv2.warpAffine(
        mask, np.array(matrix), size[::-1], flags=flags, borderValue=1
    )
    return shown


def write_result(
    folder: Path, truth: Path, matrix: Any, size: tuple[int, int], **request: object
) -> Path:
    """A result that is the truth, with masks as a video of other pixels shows them."""
    with np.load(truth / "gt.npz") as file:
        save_motion(folder, file["joints3d"] + 0.004)
    (folder / "masks").mkdir()
    for frame in range(2):
        mask = cv2.imread(str(truth / "masks" / f"{frame:04d}.png"), 0) // 255
        cv2.imwrite(str(folder / "masks" / f"{frame:06d}.png"), seen(mask, matrix, size))
    path = folder / "map.json"
    write_json(path, {KEY: {"cam": matrix}})
    asked = {"video_map": "map.json", "cameras": str(truth / "camera.json")} | request
    state = {"map.json": f"{path.stat().st_size} bytes of 1"}
    write_json(folder / "run.json", {"request": asked, "views": ["cam"], "input_files": state})
    return folder


@pytest.mark.parametrize(("matrix", "size"), [BARS, CROP, MOVED], ids=["bars", "crop", "moved"])
def test_masks_are_compared_through_the_map_of_the_capture(
    tmp_path: Path, truth: Path, perfcap: Command, matrix: Any, size: tuple[int, int]
) -> None:
    result = write_result(tmp_path / "r", truth, matrix, size)
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    found = metrics_of(result)
    assert found["segmentation_iou"] > 99 and found["segmentation_frames"] == 2
    assert not found["notes"]


def test_true_silhouettes_of_the_video_are_compared_as_they_are(
    tmp_path: Path, truth: Path, perfcap: Command
) -> None:
    result = write_result(tmp_path / "r", truth, *BARS)
    for frame in range(2):
        mask = cv2.imread(str(result / "masks" / f"{frame:06d}.png"), 0)
        cv2.imwrite(str(truth / "masks" / f"{frame:04d}.png"), 255 * mask)
    write_json(tmp_path / "own.json", json.loads((truth / "camera.json").read_text()))
    camera = json.loads((truth / "camera.json").read_text())
    to_video = np.linalg.inv(np.vstack((BARS[0], [0, 0, 1])))
    camera["K"] = [(to_video @ np.array(each)).tolist() for each in camera["K"]]
    write_json(truth / "camera.json", camera | {"width": 480, "height": 440})
    report = json.loads((result / "run.json").read_text())
    report["request"]["cameras"] = str(tmp_path / "own.json")
    write_json(result / "run.json", report)
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    assert metrics_of(result)["segmentation_iou"] == 100


@pytest.mark.parametrize("times", [0.5, 1.5, 3.0])
def test_true_silhouettes_of_another_scale_need_no_map(
    tmp_path: Path, truth: Path, perfcap: Command, times: float
) -> None:
    matrix = [[1 / times, 0, (1 / times - 1) / 2], [0, 1 / times, (1 / times - 1) / 2]]
    side = round(200 * times)
    result = write_result(tmp_path / "r", truth, matrix, (side, side), video_map=None)
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    assert metrics_of(result)["segmentation_iou"] > 97
    assert not metrics_of(result)["notes"]


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ({"video_map": "lost.json"}, "lost.json: no such file"),
        ({"cameras": "lost.json"}, "lost.json: no such file or folder"),
        ({"cameras": None}, "does not say which cameras the capture had"),
        ({"video_map": None}, "masks of the result are 480x440 and true silhouettes 200x200"),
    ],
)
def test_masks_whose_pixels_are_not_known_are_left_out(
    tmp_path: Path, truth: Path, perfcap: Command, request_: dict[str, object], said: str
) -> None:
    result = write_result(tmp_path / "r", truth, *BARS, **request_)
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    found = metrics_of(result)
    (note,) = found["notes"]
    assert "masks are not compared with true silhouettes: " in note and said in note
    assert not any(name.startswith("segmentation") for name in found)
    assert found["mpjpe_mm"] == pytest.approx(4 * 3**0.5)


def test_a_map_that_was_written_anew_is_not_used(
    tmp_path: Path, truth: Path, perfcap: Command
) -> None:
    result = write_result(tmp_path / "r", truth, *BARS)
    write_json(result / "map.json", {KEY: {"cam": [[0.5, 0, 0], [0, 0.5, 0]]}})
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    (note,) = metrics_of(result)["notes"]
    assert "map.json: has " in note and "that of the capture had " in note


@pytest.mark.long
def test_a_capture_with_a_map_is_evaluated(tmp_path: Path, perfcap: Command) -> None:
    """Bars beside a picture of twice the size: as the capture of the picture itself."""
    files = write_take(tmp_path, 6)
    matrix, size = [[0.5, 0, -20.25], [0, 0.5, -10.25]], (280, 400)
    masks = [each.astype(np.uint8) for each in silhouettes(files.take)]
    pixels = files.take.detections.joints2d[:, 0]
    write_video(tmp_path / "bars.mp4", 6, size, seen=2 * pixels + pixels.new_tensor([40.5, 20.5]))
    write_json(tmp_path / "map.json", {KEY: {"camera": matrix, "bars": matrix}})
    true = tmp_path / "true"
    for folder in (tmp_path / "given", true, true / "masks"):
        folder.mkdir()
    joints = files.take.actor.joints(files.take.truth).numpy()
    surface, faces = files.take.actor.surface(files.take.truth), files.take.actor.template.faces
    shown = {"joints2d": pixels.numpy(), "vertices": surface.numpy()}
    np.savez(true / "gt.npz", joints3d=joints, **shown)
    parts = {"part": np.zeros(surface.shape[1], int), "part_names": np.array(["skin"])}
    places = np.arange(surface.shape[1])
    np.savez(true / "template.npz", faces=faces, glb_vertex_map=places, **parts)
    entry = camera_entry(files.take.cameras)
    many = {key: [entry[key]] * 6 for key in ("K", "R", "t")}
    write_json(true / "camera.json", {**entry, **many, "fps": 30, "pixel_centre": 0})
    for frame, mask in enumerate(masks):
        cv2.imwrite(str(true / "masks" / f"{frame:04d}.png"), 255 * mask)
        given = seen(mask, matrix, size)
        given[:20], given[260:], given[:, :40], given[:, 360:] = 0, 0, 0, 0
        cv2.imwrite(str(tmp_path / "given" / f"{frame:06d}.png"), 255 * given)
    options = ("--video-map", tmp_path / "map.json", "--masks", tmp_path / "given")
    options = (*options, "--until", "refine_pose", "--segmenter", "none", "--no-overlay")
    call = files.command(tmp_path / "out", *map(str, options), video=tmp_path / "bars.mp4")
    assert perfcap(call).code in (0, 3)
    assert perfcap(["evaluate", tmp_path / "out", "--truth", true]).code == 0
    found = metrics_of(tmp_path / "out")
    assert found["segmentation_iou"] > 97 and found["segmentation_frames"] == 6
