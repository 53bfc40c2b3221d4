"""``perfcap capture`` of several people whom images show."""

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from crowd_files import SIZE, CrowdFiles, write_crowd
from crowds import Crowd, make_crowd
from painted_crowd import PaintedCrowd
from runs import Command

from perfcap.app import capture_checks
from perfcap.cli import main
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.io.result import read_result
from perfcap.io.result_folder import people_of

WHOLE = ("--until", "refine_surface", "--no-overlay")


@cache
def crowd() -> Crowd:
    return make_crowd(3, frames=6, views=3, size=SIZE, noise=6.0)


@cache
def painted() -> PaintedCrowd:
    return PaintedCrowd(crowd())


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> CrowdFiles:
    return write_crowd(tmp_path_factory.mktemp("painted"), crowd(), painted().pictures)


@pytest.fixture(scope="module")
def captured(pair: CrowdFiles, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("captured") / "both"
    with pytest.raises(SystemExit) as exit_:
        main(pair.command(out, *WHOLE))
    assert exit_.value.code == 0
    return out


def masks_of(folder: Path, view: int) -> list[np.ndarray]:
    paths = sorted((folder / "masks" / f"cam{view + 1}").glob("*.png"))
    return [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in paths]


@pytest.mark.long
def test_masks_say_who_is_where(captured: Path) -> None:
    for view in range(3):
        everybody = np.array(masks_of(captured, view))
        truth = painted().labels[view]
        given = (truth > 0) & (everybody > 0)
        assert (everybody == truth)[given].mean() > 0.96
        assert given.sum() > 0.85 * (truth > 0).sum()
        for number, folder in enumerate(people_of(captured), 1):
            own = np.array(masks_of(folder, view))
            np.testing.assert_array_equal(own, everybody == number)


@pytest.mark.long
def test_each_is_a_whole_result(captured: Path) -> None:
    for number, folder in enumerate(people_of(captured)):
        result = read_result(folder)
        error = np.linalg.norm(result.joints - crowd().joints[number].numpy(), axis=-1)
        assert 1000 * error.mean() < 40
        with np.load(folder / "surface.npz") as surface:
            assert len(surface["vertices"]) == 6
        report = json.loads((folder / "run.json").read_text())
        assert {"pose", "surface", "mask_confidence"} <= set(report["refinement"])
        stages = report["stages"]
        assert {"extract_silhouettes", "refine_pose", "refine_surface"} <= set(stages)


@pytest.mark.long
def test_resume_and_what_is_left(
    captured: Path, pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    before = (captured / "run.json").stat().st_mtime_ns
    assert perfcap(pair.command(captured, *WHOLE, "--resume")).code == 0
    assert (captured / "run.json").stat().st_mtime_ns == before
    for folder in people_of(captured):
        (folder / "surface.npz").rename(folder / "elsewhere.npz")
    again = perfcap(pair.command(captured, *WHOLE, "--resume"))
    assert "holds a result already" in again.refused()
    for folder in people_of(captured):
        (folder / "elsewhere.npz").rename(folder / "surface.npz")
    # joints alone leave no masks behind
    shorter = ("--until", "track_motion", "--no-overlay", "--overwrite")
    assert perfcap(pair.command(captured, *shorter)).code == 0
    assert not (captured / "masks").exists()
    assert not any((folder / "masks").exists() for folder in people_of(captured))
    assert not any((folder / "surface.npz").exists() for folder in people_of(captured))


@pytest.mark.long
def test_the_preset_of_frames(tmp_path: Path, perfcap: Command) -> None:
    # colours need more pixels than joints: in images of 120 px errors double in three frames
    larger = make_crowd(3, frames=6, views=3, size=200, noise=6.0)
    pair = write_crowd(tmp_path, larger, PaintedCrowd(larger).pictures)
    out = tmp_path / "followed"
    given = ("--preset", "liu2013", "--frames", "0:3", "--report", *WHOLE)
    found = perfcap(pair.command(out, *given))
    assert found.code in (0, 3), found
    errors = []
    for number, folder in enumerate(people_of(out)):
        result = read_result(folder)
        everybody = larger.joints[:, :3].numpy()
        error = np.linalg.norm(result.joints - everybody, axis=-1)  # person, frame, joint
        assert (error[number].mean(-1) < error[1 - number].mean(-1)).all()
        errors.append(1000 * error[number].mean())
        report = json.loads((folder / "run.json").read_text())
        assert len(report["refinement"]["tracking"]["released_share"]) == 3
        assert "follow_frames" in report["stages"]
        config = yaml.safe_load((folder / "config.yaml").read_text())
        assert config["frames"]["search"]["search"] == "misaligned"
        assert "Limbs beside their contours" in (folder / "report.html").read_text()
    # joints 2 px off, and one person is cut off: 40 and 44 mm; digits differ between processors
    assert max(errors) < 70 and sum(errors) / 2 < 60
    assert '"people":[{' in (out / "report.html").read_text()
    (out / "report.html").unlink()
    assert "report.html" in perfcap(["report", out]).out
    assert "Between people" in (out / "report.html").read_text()


@pytest.mark.long
def test_what_is_behind_one_person_is_behind_everybody(
    pair: CrowdFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who walked past another person was taken for a cut of the video."""
    seen: list[tuple[int, ...]] = []

    def examine(*_: object, everybody: Detections, **__: object) -> list[object]:
        seen.append(tuple(everybody.joints2d.shape))
        raise InputError("seen: enough; stop here")

    monkeypatch.setattr(capture_checks, "examine_take", examine)
    call = pair.command(tmp_path / "out", "--until", "initialize", "--no-overlay")
    assert "enough" in perfcap(call).refused()
    assert seen == [tuple(crowd().candidates.joints2d.shape)]
