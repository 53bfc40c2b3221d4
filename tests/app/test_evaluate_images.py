"""What a truth holds beside its joints: silhouettes, cameras, joints in images, surfaces."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from rendered_files import metrics_of, save_motion, write_rendered
from runs import Command

from perfcap.io.surface_file import save_surface

TRIANGLES = np.array([[5, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    write_rendered(tmp_path / "seq")
    return tmp_path / "seq"


@pytest.fixture
def result(tmp_path: Path, truth: Path) -> Path:
    """A result that is the truth, its joints some millimetres off."""
    folder = tmp_path / "r"
    with np.load(truth / "gt.npz") as file:
        save_motion(folder, file["joints3d"] + 0.004)
        vertices = file["vertices"]
    with np.load(truth / "template.npz") as file:
        places = file["glb_vertex_map"]
    save_surface(folder / "surface.npz", [vertices[:, places]], TRIANGLES, np.arange(2), 30.0)
    (folder / "masks").mkdir()
    for frame in range(2):
        image = cv2.imread(str(truth / "masks" / f"{frame:04d}.png"), 0)
        cv2.imwrite(str(folder / "masks" / f"{frame:06d}.png"), image // 255)
    return folder


def redraw(truth: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    for path in (truth / "masks").iterdir():
        cv2.imwrite(str(path), change(cv2.imread(str(path), 0)))


@pytest.mark.parametrize("person", [1, 2, 127, 255])
def test_true_masks_of_any_brightness_are_read(
    truth: Path, result: Path, perfcap: Command, person: int
) -> None:
    redraw(truth, lambda mask: (mask // 255) * np.uint8(person))
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    found = metrics_of(result)
    assert found["segmentation_iou"] == found["segmentation_boundary_f"] == 100
    assert found["silhouette_iou"] == 100 and not found["notes"]


def test_outlines_of_the_surface_are_drawn_through_the_lens(
    truth: Path, result: Path, perfcap: Command
) -> None:
    lens = [-1.0, 0.1, 0.02, -0.01, 0.0]
    camera = json.loads((truth / "camera.json").read_text())
    # to one side, where lenses bend
    camera["t"] = (np.array(camera["t"]) + np.array([1.4, 0, 0])).tolist()
    (truth / "camera.json").write_text(json.dumps(camera | {"distortion": lens}))
    with np.load(truth / "gt.npz") as file:
        vertices = file["vertices"]
    faces = np.load(truth / "template.npz")["faces"]
    for frame, places in enumerate(vertices):
        turn, move, matrix = (np.array(camera[name][frame]) for name in ("R", "t", "K"))
        pixels = cv2.projectPoints(places, cv2.Rodrigues(turn)[0], move, matrix, np.array(lens))[0]
        mask = np.zeros((200, 200), np.uint8)
        for corners in np.round(pixels[:, 0])[faces].astype(int):
            cv2.fillConvexPoly(mask, corners, 255)
        cv2.imwrite(str(truth / "masks" / f"{frame:04d}.png"), mask)
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    # polygons of OpenCV hold the pixels of their edges, too
    assert metrics_of(result)["silhouette_iou"] > 90


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda mask: 255 - mask, "instead of 0% if they are inverted"),
        (lambda mask: np.roll(mask, 9, 1), "if the true ones lie 9, 0 px aside"),
        (np.zeros_like, "the true silhouettes of 2 of 2 frames are empty, and count as 0 %"),
    ],
)
def test_wrong_true_masks_are_named(
    truth: Path,
    result: Path,
    perfcap: Command,
    change: Callable[[np.ndarray], np.ndarray],
    said: str,
) -> None:
    redraw(truth, change)
    outcome = perfcap(["evaluate", result, "--truth", truth])
    (note,) = metrics_of(result)["notes"]
    assert outcome.code == 0 and said in note and said in outcome.out


def test_another_camera_in_the_truth_is_named(truth: Path, result: Path, perfcap: Command) -> None:
    camera = json.loads((truth / "camera.json").read_text())
    # to one side, where lenses bend
    camera["t"] = (np.array(camera["t"]) + np.array([0.4, 0, 0])).tolist()
    (truth / "camera.json").write_text(json.dumps(camera))
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    pixels, surface = metrics_of(result)["notes"]
    assert "annotated joints lie" in pixels and "belong together" in pixels
    assert "masks of the result overlap with the true ones at 100 %, its surface" in surface


def test_a_surface_with_other_triangles_is_not_compared(
    truth: Path, result: Path, perfcap: Command
) -> None:
    order = np.array([3, 4, 0, 5, 1, 2])  # as a program that sorts vertices by first use
    with np.load(truth / "gt.npz") as file:
        vertices = file["vertices"]
    with np.load(truth / "template.npz") as file:
        shown = vertices[:, file["glb_vertex_map"]]
    faces = np.argsort(order)[TRIANGLES]
    save_surface(result / "surface.npz", [shown[:, order]], faces, np.arange(2), 30.0)
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    found = metrics_of(result)
    (note,) = found["notes"]
    assert "its triangles are not those of the true template" in note
    assert "vertex_abs_mm" not in found and found["silhouette_iou"] == 100


def test_a_true_surface_in_millimetres_is_named(
    truth: Path, result: Path, perfcap: Command
) -> None:
    with np.load(truth / "gt.npz") as file:
        arrays = dict(file)
    arrays["vertices"] = 1000 * arrays["vertices"]
    np.savez(truth / "gt.npz", **arrays)
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    (note,) = metrics_of(result)["notes"]
    assert "times as large as its joints from end to end; expected metres" in note


@pytest.mark.parametrize("captured", [False, True])
def test_motion_on_another_actor_is_named(
    truth: Path, result: Path, perfcap: Command, captured: bool
) -> None:
    source = result if captured else "takes/walk.bvh"
    (result / "run.json").write_text(json.dumps({"retargeted_from": str(source)}))
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    (note,) = metrics_of(result)["notes"]
    assert f"is the motion of {source} on another actor" in note
    assert note.endswith(f"evaluate {source} for those of the capture") is captured


def test_a_surface_without_the_person_s_clothes_is_not_the_camera_s_fault(
    truth: Path, result: Path, perfcap: Command
) -> None:
    with np.load(truth / "gt.npz") as file:
        vertices = file["vertices"]
    with np.load(truth / "template.npz") as file:
        shown = vertices[:, file["glb_vertex_map"]]
    middle = shown.mean(1, keepdims=True)
    thin = middle + (shown - middle) * [0.5, 0.7, 0.7]
    save_surface(result / "surface.npz", [thin], TRIANGLES, np.arange(2), 30.0)
    assert perfcap(["evaluate", result, "--truth", truth]).code == 0
    found = metrics_of(result)
    assert found["silhouette_iou"] < 60 < 100 == found["segmentation_iou"]
    (note,) = found["notes"]
    assert note.startswith("true surfaces are 178 mm from those of the capture")
