"""``perfcap actor fit``: views to an actor, its measurements and a picture; what is refused."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from project_files import SIZE, write_pose2sim
from runs import Command
from takes import TakeFiles, detect, make_take, shrunk, write_detections

from perfcap.app import actor_sheet, fit_views
from perfcap.io import load_actor
from perfcap.rigging import BodyFit, ViewFitSettings, fit_body

QUICK = ViewFitSettings(heights=(50.0,), steps=(8, 2), edge_heights=(50.0,), edge_steps=(2,))


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small pictures and few steps."""
    monkeypatch.setattr(actor_sheet, "_LARGE", 48)
    monkeypatch.setattr(actor_sheet, "_SMALL", 32)
    monkeypatch.setattr(fit_views, "fit_body", quick_fit)


def quick_fit(
    *arguments: Any, settings: ViewFitSettings | None = None, contours: Any = None
) -> BodyFit:
    assert settings is None
    return fit_body(*arguments, settings=QUICK, contours=contours)


def call(take: TakeFiles, out: Path, *more: object) -> list[object]:
    options = ["--cameras", take.camera, "--detections", take.detections, "--out", out]
    return ["actor", "fit", take.video, *options, "--count", 3, *more]


@pytest.mark.long
def test_a_person_becomes_a_folder(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    done = perfcap(call(take, tmp_path / "me", "--height", 1.7, "--name", "me"))
    assert done.code == 0, done
    actor = load_actor(tmp_path / "me")
    assert actor.template.name == "me"
    assert float(np.ptp(actor.template.vertices[:, 1])) == pytest.approx(1.7, abs=0.02)
    known = json.loads((tmp_path / "me" / "measurements.json").read_text())
    assert known["height"]["metres"] == pytest.approx(1.7, abs=0.02)
    assert 0 < known["waist"]["deviation"] < 0.3
    assert "joints and silhouettes of 3 frames in 1 view" in known["source"]
    for picture in ("fit.jpg", "contact_sheet.jpg"):
        assert cv2.imread(str(tmp_path / "me" / picture)) is not None
    again = ["actor", "build", "--body", "--height", 1.6, "--name", "me", "--out", tmp_path / "me"]
    assert perfcap(again).code == 0
    files = {"actor.glb", "manifest.toml", "contact_sheet.jpg", "measurements.json"}
    assert {file.name for file in (tmp_path / "me").iterdir()} == files


def test_the_body_of_a_capture_is_not_replaced(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    (tmp_path / "body.npz").write_bytes(b"of a capture")
    line = perfcap(call(take, tmp_path, "--height", 1.7)).refused()
    assert "holds body.npz but no actor that perfcap has built" in line
    assert (tmp_path / "body.npz").read_bytes() == b"of a capture"


@pytest.mark.long
@pytest.mark.parametrize(
    ("evidence", "words"), [("contours", "joints and contours"), ("joints", "joints")]
)
def test_what_is_looked_at(
    take: TakeFiles, tmp_path: Path, perfcap: Command, evidence: str, words: str
) -> None:
    done = perfcap(call(take, tmp_path / "me", "--height", 1.7, "--from", evidence))
    assert done.code == 0, done
    known = json.loads((tmp_path / "me" / "measurements.json").read_text())
    assert known["source"].startswith(f"body fitted to {words} of 3 frames")


@pytest.mark.long
def test_masks_are_taken_from_folders(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    masks = tmp_path / "masks"
    masks.mkdir()
    for frame in range(24):
        cv2.imwrite(str(masks / f"{frame:06d}.png"), np.full((120, 160), 255, np.uint8))
    done = perfcap(call(take, tmp_path / "me", "--masks", masks))
    assert done.code == 0, done
    assert any("give --height" in note for note in done.notes)  # one camera
    assert any("masks are the same in frames 0-23" in note for note in done.notes)
    cv2.imwrite(str(masks / "000000.png"), np.zeros((60, 80), np.uint8))
    line = perfcap(call(take, tmp_path / "out", "--masks", masks)).refused()
    assert "80x60" in line and "160x120" in line and not (tmp_path / "out").exists()


@pytest.mark.long
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_masks_that_end_at_half_the_height_are_named(
    take: TakeFiles, tmp_path: Path, perfcap: Command, share: float
) -> None:
    masks = tmp_path / "masks"
    masks.mkdir()
    for frame, joints in enumerate(take.take.detections.joints2d[:, 0]):
        low, high = joints[:, 1].amin(), joints[:, 1].amax()
        picture = np.full((120, 160), 255, np.uint8)
        if share < 1:
            picture[round(float(low + share * (high - low))) :] = 0
        cv2.imwrite(str(masks / f"{frame:06d}.png"), picture)
    call_ = call(take, tmp_path / "me", "--masks", masks, "--count", 6, "--height", 1.7)
    done = perfcap(call_)
    assert done.code == 0, done
    told = [
        note for note in done.notes if "leave out" in note and f"masks of {take.video.stem}" in note
    ]
    assert bool(told) == (share < 1), done.notes
    assert not told or ("l_knee" in told[0] and "r_ankle" in told[0])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--height", "17"], "expected 1.3 to 2.2 metres"),
        (["--count", "0"], "expected 1 to 100"),
        (["--detector", "pose"], "both given"),
        (["--masks", "a", "--from", "joints"], "leave one"),
        (["--masks", "a", "b"], "are 2 folders, expected one for each of 1 views"),
        (["--masks", "nowhere"], "no such folder"),
        (["--body-model", "nobody"], "ada"),
    ],
)
def test_what_cannot_be_fitted_is_told(
    take: TakeFiles, tmp_path: Path, perfcap: Command, more: list[str], words: str
) -> None:
    line = perfcap(call(take, tmp_path / "out", *more)).refused()
    assert words in line and not (tmp_path / "out").exists()


@pytest.mark.parametrize("change", ["exchanged", "normalised"])
def test_joints_that_a_capture_refuses_are_refused(
    take: TakeFiles, tmp_path: Path, perfcap: Command, change: str
) -> None:
    given = take.take.detections
    wrong = given.joints2d.flip(-1) if change == "exchanged" else given.joints2d / 160
    write_detections(tmp_path / "wrong.npz", replace(given, joints2d=wrong))
    options = ["--cameras", take.camera, "--detections", tmp_path / "wrong.npz"]
    files = ["actor", "fit", take.video, *options, "--out", tmp_path / "out"]
    line = perfcap([*files, "--from", "joints", "--height", 1.7]).refused()
    assert change in line and not (tmp_path / "out").exists()


@pytest.mark.long
def test_a_project_is_read(tmp_path: Path, perfcap: Command) -> None:
    made = make_take(10, views=2, lifted=False)
    cameras = shrunk(made.cameras, SIZE)
    seen = detect(made.actor, cameras, made.truth, False)
    project = write_pose2sim(tmp_path / "walk", replace(made, cameras=cameras, detections=seen))
    out = tmp_path / "me"
    done = perfcap(["actor", "fit", project, "--out", out, "--from", "joints", "--count", 3])
    assert done.code == 0 and "a project of Pose2Sim with 2 videos" in done.out, done
    assert "in 2 views" in (out / "measurements.json").read_text()
