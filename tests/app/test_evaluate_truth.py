"""``perfcap evaluate`` against whole recordings: surfaces, silhouettes, data sets."""

from __future__ import annotations

import importlib.util
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from rendered_files import metrics_of, save_motion, write_rendered
from runs import Command

from perfcap.app.truth import FILE_PROTOCOL, FoundJoints, Truth, read_found
from perfcap.app.truth_doubts import joint_doubts
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io import models_folder
from perfcap.io.datasets import DatasetSequence
from perfcap.io.surface_file import save_surface

SHARED = Path(__file__).parents[2] / ".." / "shared"
SEQUENCE = SHARED / "data" / "rendered" / "dev_tight"
FRAMES = [60]
needs_recordings = pytest.mark.skipif(
    not (SEQUENCE / "gt.npz").exists(), reason="no rendered sequences beside the checkout"
)


@pytest.fixture
def score() -> Any:
    before = list(sys.path)
    spec = importlib.util.spec_from_file_location("score", SHARED / "tools" / "score.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)  # it puts its folder on the path
    finally:
        sys.path[:] = before
    return module


@needs_recordings
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # the scorer leaves files open
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_whole_result_equals_the_scorer(tmp_path: Path, perfcap: Command, score: Any) -> None:
    """Joints, surface, outline and masks of a frame, each disturbed in its own way."""
    with np.load(SEQUENCE / "gt.npz", allow_pickle=False) as file:
        joints, vertices = file["joints3d"][FRAMES].astype(float), file["vertices"][FRAMES]
    with np.load(SEQUENCE / "template.npz", allow_pickle=False) as file:
        places, faces = file["glb_vertex_map"], file["faces"]
    joints = joints + 0.03 * np.random.default_rng(0).normal(size=joints.shape)
    bent = vertices + 0.03 * np.sin(9 * vertices[..., [1, 2, 0]])
    masks = [cv2.imread(str(SEQUENCE / "masks" / f"{f:04d}.png"), 0) > 127 for f in FRAMES]
    moved = np.roll(np.stack(masks), 12, axis=2)
    result = tmp_path / "result"
    save_motion(result, joints, FRAMES)
    shown = {int(v): i for i, v in enumerate(places)}
    corners = np.vectorize(shown.get)(faces)
    save_surface(result / "surface.npz", [bent[:, places]], corners, np.array(FRAMES), 30.0)
    (result / "masks").mkdir()
    for frame, mask in zip(FRAMES, moved, strict=True):
        cv2.imwrite(str(result / "masks" / f"{frame:06d}.png"), mask.astype(np.uint8))
    assert perfcap(["evaluate", result, "--truth", SEQUENCE]).code == 0
    found = metrics_of(result)
    expected = score.evaluate(
        str(SEQUENCE), joints=joints, verts=bent.astype(float), masks=moved, frames=FRAMES
    )
    for name in ("mpjpe_mm", "pa_mpjpe_mm", "vertex_abs_mm", "segmentation_iou"):
        assert found[name] == pytest.approx(expected[name], rel=1e-5), name
    # pixel centres are half a pixel off each other, and samples are drawn
    assert found["silhouette_iou"] == pytest.approx(expected["silhouette_iou"], abs=0.3)
    assert found["surface_transl_mm"] == pytest.approx(expected["surface_transl_mm"], rel=0.02)
    assert found["reproj_px"] == pytest.approx(expected["reproj_px"], rel=0.01)
    (note,) = found["notes"]
    assert found["sequence"] == "dev_tight" and "the true ones lie -12, 0 px aside" in note
    assert 0 < found["segmentation_boundary_f"] < found["segmentation_iou"]
    assert set(found["per_joint_mm"]["root"]) >= {"head_top", "l_toe"}
    assert found["per_joint_mm"]["absolute"]["neck"] == pytest.approx(
        1000 * np.linalg.norm(joints[:, 1] - score_truth()[:, 1], axis=-1).mean(), rel=1e-6
    )


def score_truth() -> np.ndarray:
    with np.load(SEQUENCE / "gt.npz", allow_pickle=False) as file:
        return np.asarray(file["joints3d"][FRAMES].astype(float))


@needs_recordings
def test_another_template_is_no_surface_of_this_one(tmp_path: Path, perfcap: Command) -> None:
    save_motion(tmp_path / "r", score_truth(), FRAMES)
    triangle = np.zeros((1, 3, 3), np.float32)
    save_surface(
        tmp_path / "r" / "surface.npz", [triangle], np.array([[0, 1, 2]]), np.array(FRAMES), 30.0
    )
    outcome = perfcap(["evaluate", tmp_path / "r", "--truth", SEQUENCE])
    assert outcome.code == 0 and "surfaces were not compared" in outcome.out
    found = metrics_of(tmp_path / "r")
    assert "vertex_abs_mm" not in found and found["silhouette_iou"] == 0


@needs_recordings
def test_a_data_set_by_name(tmp_path: Path, perfcap: Command) -> None:
    data = SHARED / "data"
    save_motion(tmp_path / "r", np.random.default_rng(0).normal(size=(60, 16, 3)))
    out = tmp_path / "numbers.json"
    arguments = ["evaluate", tmp_path / "r", "--truth", data, "--dataset", "pose2sim"]
    outcome = perfcap([*arguments, "--sequence", "pose2sim_balancing", "--out", out])
    assert outcome.code == 0 and "good to some centimetres" in outcome.out
    values = json.loads(out.read_text())
    assert values["dataset"] == "pose2sim" and values["frames_scored"] == 60
    assert not (tmp_path / "r" / "metrics.json").exists()
    line = perfcap(arguments).refused()
    assert "--sequence" in line and "pose2sim_balancing" in line


@pytest.mark.parametrize("elsewhere", [0.0, 1.5])
def test_another_person_of_the_recording_is_named(elsewhere: float) -> None:
    true = torch.rand((40, 16, 3), generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    other = true + torch.tensor([1.2, 0.0, elsewhere])
    found = FoundJoints(Path("motion.npz"), other + 0.02, np.arange(40), 30.0)
    people = {"walk/1": other, "walk/2": true + 9}
    sequence = DatasetSequence(
        "3dpw", "walk/0", Path("truth"), torch.arange(40), 30.0, joints3d=true, others=people
    )
    (line,) = joint_doubts(found, Truth(sequence, FILE_PROTOCOL, strict=False))
    assert line.startswith("walk/1 of the same recording is nearer to the result")
    own = Truth(replace(sequence, joints3d=other), FILE_PROTOCOL, strict=False)
    assert not joint_doubts(found, own)


def test_joints_of_a_truth_have_their_names(tmp_path: Path, perfcap: Command) -> None:
    joints = np.random.default_rng(0).normal(size=(3, 16, 3))
    save_motion(tmp_path / "r", joints)
    order = np.random.default_rng(1).permutation(16)
    names = np.array([name.title() for name in LANDMARKS])[order]
    np.savez(tmp_path / "truth.npz", joints3d=joints[:, order], joint_names=names)
    assert perfcap(["evaluate", tmp_path / "r", "--truth", tmp_path]).code == 0
    assert metrics_of(tmp_path / "r")["mpjpe_mm"] < 1e-6
    np.savez(tmp_path / "truth.npz", joints3d=joints, joint_names=np.array(["a"] * 16))
    line = perfcap(["evaluate", tmp_path / "r", "--truth", tmp_path]).refused()
    assert "joint_names are 16 names without head_top" in line
    twice = np.array([*LANDMARKS[:-1], "R Ankle"])
    np.savez(tmp_path / "truth.npz", joints3d=joints, joint_names=twice)
    line = perfcap(["evaluate", tmp_path / "r", "--truth", tmp_path]).refused()
    assert "names without l_toe, r_ankle and R Ankle being the same joint; expected" in line


@pytest.mark.parametrize(("factor", "unit"), [(1000, "millimetres"), (1e-3, "another unit")])
def test_truths_in_metres(tmp_path: Path, perfcap: Command, factor: float, unit: str) -> None:
    joints = np.random.default_rng(0).normal(size=(3, 16, 3))
    save_motion(tmp_path / "r", joints)
    np.savez(tmp_path / "truth.npz", joints3d=factor * joints)
    line = perfcap(["evaluate", tmp_path / "r", "--truth", tmp_path]).refused()
    assert f"joints3d look like {unit}, expected metres" in line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--dataset", "coco"], "expected one of monoperfcap"),
        (["--sequence", "x"], "of which --dataset"),
        (["--dataset", "3dpw", "--sequence", "x"], "has no sequenceFiles"),
        (["--every", "0"], "--every is 0"),
    ],
)
def test_refuses(tmp_path: Path, perfcap: Command, arguments: list[str], message: str) -> None:
    save_motion(tmp_path / "r", np.zeros((3, 16, 3)))
    np.savez(tmp_path / "truth.npz", joints3d=np.zeros((3, 16, 3)))
    line = perfcap(["evaluate", tmp_path / "r", "--truth", tmp_path, *arguments]).refused()
    assert message in line


def test_surfaces_outlines_and_masks(tmp_path: Path, perfcap: Command) -> None:
    """The true surface 3 cm aside, its tip another 3 cm: known errors; true masks: no errors."""
    vertices, places = write_rendered(tmp_path / "seq")
    joints = np.load(tmp_path / "seq" / "gt.npz")["joints3d"]
    result = tmp_path / "r"
    save_motion(result, joints)
    found = vertices[:, places] + [0.03, 0, 0]
    found[:, 4, 0] += 0.03
    triangles = np.array([[5, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    save_surface(result / "surface.npz", [found], triangles, np.arange(2), 30.0)
    (result / "masks").mkdir()
    for frame in range(2):
        image = cv2.imread(str(tmp_path / "seq" / "masks" / f"{frame:04d}.png"), 0)
        cv2.imwrite(str(result / "masks" / f"{frame:06d}.png"), image // 255)
    assert perfcap(["evaluate", result, "--truth", tmp_path / "seq"]).code == 0
    values = metrics_of(result)
    assert values["mpjpe_mm"] == values["reproj_px"] == pytest.approx(0, abs=1e-9)
    assert values["vertex_abs_mm"] == pytest.approx(36, rel=1e-5)
    assert values["vertex_transl_mm"] == pytest.approx((4 * 6 + 24) / 5, rel=1e-5)
    assert values["vertex_transl_garment_mm"] == pytest.approx(24, rel=1e-5)
    assert values["segmentation_iou"] == values["segmentation_boundary_f"] == 100
    assert 85 < values["silhouette_iou"] < 99
    (note,) = values["notes"]  # the joints are the result's own
    assert "so that nothing is measured" in note and values["mesh_frames"] == 2
    assert perfcap(["evaluate", result, "--truth", tmp_path / "seq", "--every", 2]).code == 0
    assert metrics_of(result)["mesh_frames"] == 1


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("surface.npz", b"", "surface.npz: is empty"),
        ("surface.npz", b"half", "surface.npz"),
        ("masks/000000.png", b"half", "000000.png: is not an image or is damaged"),
        ("masks/000007.png", b"x", "lacks 1 of the 3 frames"),
    ],
)
def test_results_that_are_half_written(
    tmp_path: Path, perfcap: Command, name: str, content: bytes, message: str
) -> None:
    write_rendered(tmp_path / "seq")
    save_motion(tmp_path / "r", np.load(tmp_path / "seq" / "gt.npz")["joints3d"])
    (tmp_path / "r" / "masks").mkdir()
    for frame in range(2):
        source = tmp_path / "seq" / "masks" / f"{frame:04d}.png"
        (tmp_path / "r" / "masks" / f"{frame:06d}.png").write_bytes(source.read_bytes())
    (tmp_path / "r" / name).write_bytes(content)
    line = perfcap(["evaluate", tmp_path / "r", "--truth", tmp_path / "seq"]).refused()
    assert message in line and not (tmp_path / "r" / "metrics.json").exists()


def test_feet_that_slide_and_sink(tmp_path: Path, perfcap: Command) -> None:
    """A person who stands still in truth, and is found to slide 1 cm a frame, 2 cm too low."""
    rng = np.random.default_rng(0)
    pose = rng.normal(size=(16, 3))
    pose[1], pose[[8, 12]] = [0, 1.5, 0], [[0.1, 1, 0], [-0.1, 1, 0]]
    pose[[10, 11, 14, 15], 1] = [0.1, 0, 0.1, 0]
    truth = np.repeat(pose[None], 10, 0)
    found = truth + np.arange(10)[:, None, None] * [0.01, 0, 0] - [0, 0.02, 0]
    np.savez(tmp_path / "truth.npz", joints3d=truth)
    save_motion(tmp_path / "r", found)
    assert perfcap(["evaluate", tmp_path / "r", "--truth", tmp_path]).code == 0
    values = metrics_of(tmp_path / "r")
    assert values["foot_skate_mm"] == pytest.approx(10)
    assert values["penetration_mm"] == pytest.approx(20)
    assert values["bone_length_std_mm"] == pytest.approx(0, abs=1e-9)
    assert values["mpjpe_root_mm"] == pytest.approx(0, abs=1e-9)


def test_one_frame_has_no_acceleration(tmp_path: Path, perfcap: Command) -> None:
    """What is not known is left out, so that the file is JSON."""
    pose = np.random.default_rng(0).normal(size=(1, 16, 3))
    np.savez(tmp_path / "truth.npz", joints3d=pose)
    save_motion(tmp_path / "r", pose)
    assert perfcap(["evaluate", tmp_path / "r", "--truth", tmp_path]).code == 0
    text = (tmp_path / "r" / "metrics.json").read_text()
    assert "NaN" not in text and "accel_err_mm_per_frame2" not in json.loads(text)


@pytest.mark.parametrize("joints", [slice(None), [3, 5], [3]])
def test_a_truth_that_was_not_measured(tmp_path: Path, joints: Any) -> None:
    """Frames of zeros had no error once they were aligned, and made the others' mean better."""
    places = np.random.default_rng(0).uniform(0, 1.7, (6, 16, 3))
    places[:, 8] = 0  # the origin, as of a truth relative to a hip
    save_motion(tmp_path, places, frames=range(10, 16))
    assert len(read_found(tmp_path / "motion.npz").frames) == 6
    places[4, joints] = 0
    save_motion(tmp_path, places, frames=range(10, 16))
    with pytest.raises(InputError, match=r"joints3d has joints at 0, 0, 0 in 1 of 6 frames .*14"):
        read_found(tmp_path / "motion.npz")


def test_a_truth_that_was_filled_up_or_interpolated_is_named(
    tmp_path: Path, perfcap: Command
) -> None:
    with np.load(models_folder() / "demo" / "truth.npz") as file:
        joints = file["joints3d"].astype(float)
    save_motion(tmp_path / "r", joints + 0.003 * np.random.default_rng(0).normal(size=joints.shape))
    keys = np.arange(0, len(joints), 7)
    rows = np.arange(keys[-1] + 1)
    lines = [np.interp(rows, keys, track) for track in joints[keys].reshape(len(keys), -1).T]
    between = np.concatenate((np.stack(lines, -1).reshape(-1, 16, 3), joints[len(rows) :]))
    copied, (ankle, toe) = joints.copy(), map(LANDMARKS.index, ("l_ankle", "l_toe"))
    copied[:, toe] = copied[:, ankle]
    cases = (
        (joints, ""),
        (between, "its joints move along straight lines"),
        (copied, "l_ankle and l_toe lie at one place"),
    )
    for truth, words in cases:
        np.savez(tmp_path / "truth.npz", joints3d=truth)
        outcome = perfcap(["evaluate", tmp_path / "r", "--truth", tmp_path / "truth.npz"])
        assert outcome.code == 0 and words in outcome.out
        assert bool(metrics_of(tmp_path / "r")["notes"]) == bool(words)
