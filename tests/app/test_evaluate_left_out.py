"""Truths that lack joints in some frames: what means are of, and that it is said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from rendered_files import metrics_of, save_motion, write_rendered
from runs import Command
from synthetic import cameras

from perfcap.app.evaluate import compare
from perfcap.app.truth import FILE_PROTOCOL, Truth
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.calibration import CameraRig
from perfcap.io.datasets import DatasetSequence
from perfcap.metrics import Alignment

FRAMES = 40
L_HIP, R_HIP = LANDMARKS.index("l_hip"), LANDMARKS.index("r_hip")
ANKLES = [LANDMARKS.index("l_ankle"), LANDMARKS.index("r_ankle")]
FEET = [*ANKLES, LANDMARKS.index("l_toe"), LANDMARKS.index("r_toe")]
COUNTS = {
    *(f"frames_{name}_aligned" for name in ("root", "transl", "similarity")),
    *(f"frames_{name}" for name in ("accel", "jerk", "foot_skate", "reproj")),
    "per_joint_frames",
}


def person() -> np.ndarray:
    """Joints that swing, each in its own way, on feet that stand, (F, 16, 3) m."""
    rng = np.random.default_rng(0)
    rest = rng.uniform(0, 1, (16, 3)) * [0.5, 1.7, 0.4]
    time = np.arange(FRAMES)[:, None, None] / 5
    joints = rest + 0.1 * np.sin(time + rng.uniform(0, 6, (16, 3)))
    joints[:, LANDMARKS.index("neck"), 1] = 1.8
    joints[:, FEET] = rest[FEET] * [1.0, 0.02, 1.0]
    return joints


def estimate() -> np.ndarray:
    """The person with errors that grow over the take, so that half of it has another mean."""
    noise = np.random.default_rng(1).normal(size=(FRAMES, 16, 3))
    return person() + np.linspace(0.005, 0.2, FRAMES)[:, None, None] * noise


def truth_of(joints: np.ndarray | None, **more: Any) -> Truth:
    sequence = DatasetSequence(
        "3dpw",
        "walk",
        Path("truth"),
        torch.arange(FRAMES),
        30.0,
        joints3d=None if joints is None else torch.tensor(joints),
        **more,
    )
    return Truth(sequence, FILE_PROTOCOL, strict=False)


def scored(folder: Path, truth: Truth) -> tuple[dict[str, Any], list[str]]:
    """Metrics of the estimate, and what they say of means over fewer frames."""
    save_motion(folder, estimate())
    values = compare(folder, truth)
    words = (" of the other ", "there are no ", "per_joint_frames", " rows of ")
    return values, [n for n in values["notes"] if any(each in n for each in words)]


def apart_mm(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    errors: np.ndarray = 1000 * np.linalg.norm(found - true, axis=-1)
    return errors


def test_frames_without_a_hip_are_counted_and_named(tmp_path: Path) -> None:
    true = person()
    true[20:, L_HIP] = np.nan
    values, notes = scored(tmp_path, truth_of(true))
    first, found = slice(0, 20), estimate()
    centred = [
        points[first] - points[first][:, [L_HIP, R_HIP]].mean(1, keepdims=True)
        for points in (found, true)
    ]
    errors = apart_mm(*centred)
    assert values["frames_scored"] == 40 and values["frames_missing"] == 0
    assert values["frames_root_aligned"] == 20
    assert values["mpjpe_root_mm"] == pytest.approx(errors.mean())
    assert values["pck3d_150"] == pytest.approx(100 * (errors < 150).mean())
    shares = [(errors <= at).mean() for at in range(0, 151, 5)]
    assert values["auc3d"] == pytest.approx(100 * np.mean(shares))
    assert values["mpjpe_mm"] == pytest.approx(np.nanmean(apart_mm(found, true)))
    assert notes[0] == (
        "l_hip is unknown in 20 of 40 frames of the truth: root-aligned errors, PCK and AUC are of "
        "the other 20"
    )
    assert notes[1].startswith("l_hip is unknown in 20 of 40 frames of the truth: per_joint_mm is")
    assert len(notes) == 2 and COUNTS & values.keys() == {"frames_root_aligned", "per_joint_frames"}
    tables = values["per_joint_frames"]
    assert tables["absolute"] == {"l_hip": 20} and set(tables["root"].values()) == {20}
    neck = errors[:, LANDMARKS.index("neck")]
    assert values["per_joint_mm"]["root"]["neck"] == pytest.approx(neck.mean())


def axes_of(points: np.ndarray) -> np.ndarray:
    """Right, up and back of a trunk as columns, (F, 3, 3)."""
    right, left, neck = (points[:, LANDMARKS.index(name)] for name in ("r_hip", "l_hip", "neck"))
    up = neck - (right + left) / 2
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    across = right - left
    across -= (across * up).sum(-1, keepdims=True) * up
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return np.stack([across, up, np.cross(across, up)], -1)


@pytest.mark.parametrize("lost", [slice(20, 40), slice(0, 3), slice(0, 0)])
def test_offsets_of_the_first_frame_need_no_hip_of_the_truth(tmp_path: Path, lost: slice) -> None:
    true, found = person(), estimate()
    true[lost, L_HIP] = np.nan
    values, _ = scored(tmp_path, truth_of(true))
    axes = axes_of(found)
    offset = np.einsum("fji,fkj->fki", axes, true - found)  # in the body
    first = np.isfinite(offset).all(-1).argmax(0)
    kept = offset[first, np.arange(16)]
    moved = found + np.einsum("fij,kj->fki", axes, kept)
    assert values["mpjpe_first_frame_mm"] == pytest.approx(np.nanmean(apart_mm(moved, true)))


def test_every_annotated_joint_counts_in_the_images(tmp_path: Path) -> None:
    camera = cameras(2)
    rig = CameraRig(("a", "b"), camera)
    pixels = camera.project(torch.tensor(person())).numpy()
    pixels[20:, :, ANKLES] = np.nan
    pixels[5, 0, 3] = np.nan
    seen = camera.project(torch.tensor(estimate())).numpy()
    mean = np.nanmean(np.linalg.norm(seen - pixels, axis=-1))
    values, notes = scored(
        tmp_path, truth_of(person(), rig=rig, pixels=torch.tensor(pixels.copy()))
    )
    assert values["reproj_px"] == pytest.approx(mean)
    assert not notes and not COUNTS & values.keys()
    pixels[30:] = np.nan
    mean = np.nanmean(np.linalg.norm(seen - pixels, axis=-1))
    values, (note,) = scored(tmp_path, truth_of(person(), rig=rig, pixels=torch.tensor(pixels)))
    assert values["reproj_px"] == pytest.approx(mean) and values["frames_reproj"] == 30
    assert note == (
        "no joint is annotated in 10 of 40 frames of the truth: reproj_px is of the other 30"
    )


@pytest.mark.parametrize(
    ("lose", "counts", "said"),
    [
        (lambda true: None, {}, ()),
        (
            lambda true: (true[:5, L_HIP].fill(np.nan), true[3:9, R_HIP].fill(np.nan)),
            {"frames_root_aligned": 31},
            (
                "r_hip, l_hip are unknown in 9 of 40 frames",
                "r_hip, l_hip are unknown in up to 6 of 40 frames",
            ),
        ),
        (
            lambda true: true[30:, FEET[0]].fill(np.nan),
            {},
            ("l_ankle is unknown in 10 of 40 frames",),
        ),
        (
            lambda true: [true[30:, foot].fill(np.nan) for foot in FEET],
            {"frames_foot_skate": 30},
            (
                "feet are unknown in 10 of 40 frames of the truth: foot_skate_mm is of the other",
                "r_ankle, r_toe, l_ankle, l_toe are unknown in up to 10",
            ),
        ),
        (
            lambda true: true[37:, 2:].fill(np.nan),
            {
                "frames_root_aligned": 37,
                "frames_similarity_aligned": 37,
                "frames_foot_skate": 37,
            },
            (
                "r_hip, l_hip are unknown in 3 of 40 frames",
                "fewer than three joints are known in 3 of 40 frames of the truth: similarity-",
                "feet are unknown in 3 of 40 frames",
                "are unknown in up to 3 of 40 frames",
            ),
        ),
        (
            lambda true: (true[::2, :8].fill(np.nan), true[1::2, 8:].fill(np.nan)),
            {"frames_root_aligned": 20, "frames_accel": 0, "frames_jerk": 0},
            (
                "r_hip, l_hip are unknown in 20 of 40",
                "is known in 3 frames in a row: there are no accelerations",
                "is known in 4 frames in a row: there are no jerks",
                "are unknown in up to 20",
            ),
        ),
        (
            lambda true: true[:, L_HIP].fill(np.nan),
            {"frames_root_aligned": 0},
            ("l_hip is unknown in all 40 frames of the truth: there are no root-aligned errors",),
        ),
        (
            lambda true: (true[:3, :8].fill(np.nan), true[3:6, 8:].fill(np.nan)),
            {
                "frames_root_aligned": 37,
                "frames_accel": 36,
                "frames_jerk": 34,
                "frames_foot_skate": 37,
            },
            (
                "r_hip, l_hip are unknown in 3 of 40",
                "accelerations are of 36 rows of 3 frames: in others no joint of the truth is",
                "jerks are of 34 rows of 4 frames",
                "feet are unknown in 3 of 40 frames",
                "are unknown in up to 3",
            ),
        ),
        (lambda true: true[7].fill(np.nan), {}, ()),
    ],
    ids=[
        "whole",
        "hips",
        "ankle",
        "feet",
        "two joints",
        "in turns",
        "never",
        "a change",
        "a frame",
    ],
)
def test_what_is_left_out_is_counted(
    tmp_path: Path,
    lose: Callable[[np.ndarray], object],
    counts: dict[str, int],
    said: tuple[str, ...],
) -> None:
    true = person()
    lose(true)
    values, notes = scored(tmp_path, truth_of(true))
    assert {name: values[name] for name in COUNTS - {"per_joint_frames"} & values.keys()} == counts
    assert len(notes) == len(said) and all(a in b for a, b in zip(said, notes, strict=True)), notes


def test_a_joint_that_the_protocol_never_has_is_not_missed(tmp_path: Path) -> None:
    names = tuple(name for name in LANDMARKS if name != "l_hip")
    truth = truth_of(person())
    truth = replace(truth, protocol=replace(FILE_PROTOCOL, joints=names))
    values, notes = scored(tmp_path, truth)
    assert not notes and not COUNTS & values.keys() and "mpjpe_root_mm" not in values
    assert set(values["per_joint_mm"][Alignment.ABSOLUTE]) == set(names)


def test_notes_stand_below_the_table(tmp_path: Path, perfcap: Command) -> None:
    """A hip that was not measured in one of two frames, and masks of one frame alone."""
    truth, result = tmp_path / "seq", tmp_path / "r"
    write_rendered(truth)
    with np.load(truth / "gt.npz") as file:
        values = dict(file)
    save_motion(result, values["joints3d"] + 0.004)
    values["joints3d"][1, L_HIP] = 0
    np.savez(truth / "gt.npz", **values)
    (result / "masks").mkdir()
    mask = cv2.imread(str(truth / "masks" / "0000.png"), 0)
    cv2.imwrite(str(result / "masks" / "000000.png"), mask // 255)
    outcome = perfcap(["evaluate", result, "--truth", truth])
    found = metrics_of(result)
    root = "l_hip is unknown in 1 of 2 frames of the truth: root-aligned errors, PCK and AUC"
    masks = "there are no masks in 1 of 2 frames that are compared: errors of masks are of the"
    for line in (root, masks):
        assert line in outcome.out and any(note.startswith(line) for note in found["notes"])
    assert found["frames_root_aligned"] == found["segmentation_frames"] == 1
