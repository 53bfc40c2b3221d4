"""``perfcap capture`` of several people, and what other commands do with them."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from crowd_files import SIZE, CrowdFiles, write_crowd
from crowds import make_crowd
from runs import Command

from perfcap.app import networks
from perfcap.app.capture_folder import named_people
from perfcap.app.networks import Detecting
from perfcap.cli import main
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.io.detections import read_candidates
from perfcap.io.gltf_document import open_document
from perfcap.io.result import read_result
from perfcap.io.result_folder import people_of

ONE = {"motion.npz", "motion.bvh", "capture.glb", "config.yaml", "run.json", "detections.npz"}
SHARED = {"people.json", "scene.glb", "run.json", "config.yaml"}


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> CrowdFiles:
    crowd = make_crowd(2, frames=20, views=3, size=SIZE, noise=2.0, spoil=0.1)
    return write_crowd(tmp_path_factory.mktemp("pair"), crowd)


@pytest.fixture(scope="module")
def captured(pair: CrowdFiles, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both, whose actors are named in the other order than the truths."""
    out = tmp_path_factory.mktemp("captured") / "both"
    with pytest.raises(SystemExit) as exit_:
        main(pair.command(out))
    assert exit_.value.code == 0
    return out


def files_of(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.is_file()}


@pytest.mark.long
def test_a_folder_each_and_what_they_share(captured: Path, pair: CrowdFiles) -> None:
    assert files_of(captured) == SHARED | {"overlay.mp4"}
    assert [path.name for path in people_of(captured)] == ["person1", "person2"]
    for number, folder in enumerate(people_of(captured)):
        assert files_of(folder) == ONE
        result = read_result(folder)
        error = np.linalg.norm(result.joints - pair.crowd.joints[number].numpy(), axis=-1)
        assert 1000 * error.mean() < 25
        assert result.report["request"]["actor"] == str(pair.actors[number])
    people = json.loads((captured / "people.json").read_text())
    assert people["K"] == 2
    for who in people["people"]:
        assert who["bones_margin"] > 0.01 and who["identity_margin_m"]["median"] > 0.1
    run = json.loads((captured / "run.json").read_text())
    assert run["people"] == 2 and run["complete"] and run["request"]["actor"] == [
        str(path) for path in pair.actors
    ]  # fmt: skip


@pytest.mark.long
def test_people_of_other_captures_are_refused(captured: Path, tmp_path: Path) -> None:
    """A folder that was put in the place of a person's."""
    together = shutil.copytree(captured, tmp_path / "both")
    assert [name for _, name in named_people(together)] == ["person1", "person2"]
    report = together / "person2/run.json"
    content = json.loads(report.read_text())
    shutil.copy(together / "person1/run.json", report)
    with pytest.raises(InputError, match=r"person2: is person 1 of the capture, as is .*person1;"):
        list(named_people(together))
    for other, said in (
        (content | {"input_files": {"video.mp4": "1"}}, "input_files"),
        (content | {"request": content["request"] | {"frames": "5:20"}}, "--frames"),
    ):
        report.write_text(json.dumps(other))
        with pytest.raises(InputError, match=rf"person2: is of another capture .*its {said} is"):
            list(named_people(together))
    del content["input_files"], content["request"]  # older versions say less
    report.write_text(json.dumps(content))
    assert len(list(named_people(together))) == 2


@pytest.mark.long
def test_what_is_doubtful_is_said_once(
    pair: CrowdFiles, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """By the names of views alone, not by their numbers once more."""
    with np.load(pair.folder / "detections.npz") as file:
        arrays = dict(file)
    arrays["joints2d"][:, 1] += 4
    np.savez(tmp_path / "moved.npz", **arrays)
    parts = pair.command(tmp_path / "out", "--until", "initialize", "--no-overlay")
    parts[-1] = str(tmp_path / "moved.npz")
    with pytest.raises(SystemExit):
        main(parts)
    said = caplog.text
    assert said.count("cam2: sees the person") == 1 and "view 1: sees" not in said


def test_everybody_moves_in_one_file(captured: Path) -> None:
    tree = open_document(captured / "scene.glb").tree
    assert len(tree["skins"]) == 2 and len(tree["animations"]) == 1
    assert {"person1", "person2"} <= {node.get("name") for node in tree["nodes"]}


def test_the_overlay_has_a_color_for_everybody(captured: Path) -> None:
    video = cv2.VideoCapture(str(captured / "overlay.mp4"))
    found, picture = video.read()
    assert found and picture.shape[1] == 3 * SIZE
    blue, green, red = (picture[..., k].astype(int) for k in range(3))
    yellow = (red > blue + 40) & (green > blue + 40)
    magenta = (red > green + 30) & (blue > green + 30)
    assert yellow.sum() > 50 and magenta.sum() > 50


@pytest.mark.long
def test_actors_in_any_order(
    captured: Path, pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    turned = pair.actors[::-1]
    assert perfcap(pair.command(tmp_path / "o", "--no-overlay", actors=turned)).code == 0
    for one, other in ((1, 2), (2, 1)):
        here, there = tmp_path / f"o/person{one}", captured / f"person{other}"
        np.testing.assert_array_equal(read_result(here).joints, read_result(there).joints)


def test_evaluate_finds_whose_truth_it_is(
    captured: Path, pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    out = tmp_path / "numbers.json"
    done = perfcap(["evaluate", captured, "--truth", pair.truth, "--out", out])
    assert done.code == 0 and "everybody: joints, absolute" in done.out
    numbers = json.loads(out.read_text())
    for folder in people_of(captured):
        alone = json.loads((folder / "metrics.json").read_text())
        assert alone["mpjpe_mm"] == numbers[folder.name]["mpjpe_mm"] < 25
    assert "count nowhere" not in done.out and "notes" not in numbers
    one = pair.truth / "person1"
    assert "the truth of everybody" in perfcap(["evaluate", captured, "--truth", one]).refused()


def test_evaluate_says_who_was_not_captured(
    captured: Path, pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    truth, out = tmp_path / "truth", tmp_path / "numbers.json"
    for name in ("person1", "person2"):
        shutil.copytree(pair.truth / name, truth / name)
    (truth / "person3").mkdir()
    with np.load(truth / "person1" / "truth.npz") as file:
        values = dict(file)
    np.savez(
        truth / "person3" / "truth.npz",
        **values | {"joints3d": values["joints3d"] + np.array([5.0, 0.0, 5.0])},
    )
    done = perfcap(["evaluate", captured, "--truth", truth, "--out", out])
    assert done.code == 0 and "count nowhere" in done.out
    (note,) = json.loads(out.read_text())["notes"]
    assert "person3 of the truth belong to none of the 2 people" in note


@pytest.mark.long
def test_commands_go_from_one_to_the_next(
    captured: Path, pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    assert perfcap(["export", captured, "--to", "bvh", "--out", tmp_path]).code == 0
    assert {p.name for p in tmp_path.iterdir()} == {"both_person1.bvh", "both_person2.bvh"}
    call = f"render {captured} --out {tmp_path}/turn.mp4 --freeze 3 --seconds 0.1 --size 64 64"
    one, two = (tmp_path / f"turn_person{number}.mp4" for number in (1, 2))
    two.write_bytes(b"of the user")
    assert f"{two} (replaces an older file)\n" in perfcap(call.split()).out and one.is_file()
    again = shutil.copytree(captured, tmp_path / "again")
    done = perfcap(["report", again, "--truth", pair.truth])
    assert done.code == 0 and not done.notes  # each page has the own truth of its person
    assert all("Joint error" in (p / "report.html").read_text() for p in people_of(again))
    assert perfcap(["export", captured / "person1", "--to", "bvh", "--out", tmp_path]).code == 0


@pytest.mark.long
def test_a_body_for_each_of_a_number(pair: CrowdFiles, tmp_path: Path, perfcap: Command) -> None:
    call = pair.command(tmp_path, "--people", "2", "--no-overlay", actors=["sam"])
    done = perfcap(call)
    assert done.code in (0, 3)
    people = json.loads((tmp_path / "people.json").read_text())["people"]
    assert [who["actor"] for who in people] == ["sam", "sam"]
    assert all(json.loads((f / "run.json").read_text())["bone_scales"] for f in people_of(tmp_path))


@pytest.mark.long
def test_what_is_said_of_fitted_bodies_is_kept(
    pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    call = pair.command(tmp_path, "--people", "2", "--no-overlay", actors=["auto"])
    done = perfcap(call)
    said = [note for note in done.notes if "a body" in note and "fitted to the joints" in note]
    kept = json.loads((tmp_path / "run.json").read_text())["warnings"]
    assert len(said) == 2 and set(said) <= set(kept), done
    assert said[1].startswith("person 2: --actor auto: a body")


@pytest.mark.long
def test_one_of_them_writes_what_one_person_writes(
    pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    options = ("--people", "1", "--no-overlay", "--until", "track_motion")
    done = perfcap(pair.command(tmp_path, *options, actors=pair.actors[:1]))
    assert done.code == 0 and not (tmp_path / "people.json").exists()
    assert {"motion.npz", "capture.glb", "detections.npz"} <= files_of(tmp_path)
    assert any("further people: 1, left out, since" in note for note in done.notes)


@pytest.mark.long
def test_another_number_of_people_leaves_nothing_behind(
    captured: Path, pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    place = tmp_path / "o"
    shutil.copytree(captured, place)
    (place / "person2" / "mine.txt").write_text("kept")
    options = ("--people", "1", "--no-overlay", "--until", "track_motion", "--overwrite")
    assert perfcap(pair.command(place, *options, actors=pair.actors[:1])).code == 0
    assert not (place / "people.json").exists() and not (place / "scene.glb").exists()
    assert not (place / "person1").exists() and files_of(place / "person2") == {"mine.txt"}
    assert perfcap(pair.command(place, "--overwrite", "--no-overlay")).code == 0
    assert files_of(place) == SHARED | {"detections.npz"}  # of the video, as one person's are


def test_resume_knows_a_whole_result(captured: Path, pair: CrowdFiles, perfcap: Command) -> None:
    before = (captured / "scene.glb").stat().st_mtime_ns
    assert perfcap(pair.command(captured, "--resume")).code == 0
    assert (captured / "scene.glb").stat().st_mtime_ns == before
    assert "holds a result already" in perfcap(pair.command(captured)).refused()


@pytest.mark.long
def test_somebody_who_leaves_is_named(tmp_path: Path, perfcap: Command) -> None:
    away = [slice(0), slice(24, 40)]
    crowd = make_crowd(3, frames=40, views=3, size=SIZE, noise=1.0, away=away)
    files = write_crowd(tmp_path / "in", crowd)
    done = perfcap(files.command(tmp_path / "out", "--no-overlay"))
    assert done.code == 3
    lost = [note for note in done.notes if "no person is detected" in note]
    assert len(lost) == 1 and lost[0].startswith("person 2: frames 24 to 39")
    assert json.loads((tmp_path / "out/run.json").read_text())["complete"] is False


@pytest.mark.long
def test_actors_that_cannot_be_told_apart(
    pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    actors = [pair.actors[0], pair.actors[0]]
    done = perfcap(pair.command(tmp_path, "--no-overlay", actors=actors))
    assert any("somebody else's bones fit it almost as well" in note for note in done.notes)


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "actors", "said"),
    [
        ((), 3, "3 are wanted, 2 are seen"),
        (("--people", "3"), 2, "--people: is 3 beside 2 actors"),
        (("--people", "3"), 1, "3 are wanted, 2 are seen"),
        (("--people", "0"), 1, "--people: is 0"),
        (("--people", "2", "--height", "1.8"), 1, "--height"),
        (("--people", "2", "--lifter", "cmu"), 1, "--lifter: is for one person"),
    ],
)
def test_numbers_that_do_not_fit(
    options: tuple[str, ...], actors: int, said: str, pair: CrowdFiles, tmp_path: Path,
    perfcap: Command,
) -> None:  # fmt: skip
    chosen = (pair.actors * 2)[:actors]
    refused = perfcap(pair.command(tmp_path / "o", *options, actors=chosen)).refused()
    assert said in refused
    assert not (tmp_path / "o").exists() or not list((tmp_path / "o").iterdir())


def test_cameras_in_millimetres(pair: CrowdFiles, tmp_path: Path, perfcap: Command) -> None:
    """Said of the cameras, before nobody is found with them."""
    cameras = json.loads((pair.folder / "cameras.json").read_text())
    for view in cameras["views"].values():
        view["t"] = (1000 * np.array(view["t"])).tolist()
    (tmp_path / "mm.json").write_text(json.dumps(cameras))
    call = pair.command(tmp_path / "o")
    call[call.index("--cameras") + 1] = tmp_path / "mm.json"
    assert "looks like millimetres" in perfcap(call).refused()


def test_auto_beside_an_actor(pair: CrowdFiles, tmp_path: Path, perfcap: Command) -> None:
    call = pair.command(tmp_path, actors=["auto", pair.actors[0]])
    assert "auto for everybody, or an actor each" in perfcap(call).refused()


def test_several_people_in_one_view(pair: CrowdFiles, tmp_path: Path, perfcap: Command) -> None:
    call = ["capture", pair.videos[0], "--people", "2", "--out", tmp_path]
    assert "one view cannot be told apart" in perfcap(call).refused()


def test_nobody_says_how_many(pair: CrowdFiles, tmp_path: Path, perfcap: Command) -> None:
    cameras = ["--cameras", pair.folder / "cameras.json"]
    call = ["capture", *pair.videos, *cameras, "--people", "auto", "--out", tmp_path]
    assert "say how many" in perfcap(call).refused()


def test_a_folder_of_several_people_is_no_result_of_one(captured: Path) -> None:
    from perfcap.errors import InputError

    with pytest.raises(InputError, match="holds several people"):
        read_result(captured)


def test_candidates_are_read_as_they_were_written(pair: CrowdFiles) -> None:
    names = [path.stem for path in pair.videos]
    found, _ = read_candidates(pair.folder / "detections.npz", views=names)
    true = pair.crowd.candidates
    for one, other in ((found, true), (true, found)):
        for slot, frame, view in np.argwhere((one.confidence2d > 0).any(-1).numpy()):
            sought = one.joints2d[slot, frame, view]
            apart = (other.joints2d[:, frame, view] - sought).abs().amax((-1, -2))
            assert apart.min() < 1e-4


def test_networks_follow_somebody_else_in_every_slot(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, str]] = []

    def detect(clip: object, detecting: Detecting, cameras: object) -> Detections:
        asked.append((detecting.person, detecting.checkpoint.prefix))
        joints = torch.full((3, 2, 16, 2), float(detecting.person))
        return Detections.from_joints(joints, torch.ones(3, 2, 16))

    monkeypatch.setattr(networks, "detect_clip", detect)
    found = networks.detect_everybody(None, Detecting((), people=3), None)  # type: ignore[arg-type]
    assert found.joints2d.shape == (3, 3, 2, 16, 2)
    assert found.joints2d[:, 0, 0, 0, 0].tolist() == [1, 2, 3]
    assert asked == [(k, f"slot{k}_") for k in (1, 2, 3)]


def test_networks_are_not_told_where_one_of_several_is(
    pair: CrowdFiles, tmp_path: Path, perfcap: Command
) -> None:
    cameras = ["--cameras", pair.folder / "cameras.json", "--people", "2", "--out", tmp_path]
    call = ["capture", *pair.videos, *cameras, "--person", "2"]
    assert "--person: is for one person" in perfcap(call).refused()
