"""``perfcap capture --detector``: from images and a network alone."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from runs import Command
from takes import TakeFiles, camera_entry, detect, make_take, shrunk, write_json, write_take
from tiny_networks import MANIFESTS, draw, vitpose, write_model
from tiny_people import write_people
from written_files import motion

from perfcap.detect.detections import Detections
from perfcap.detect.lifter import OnnxLifter
from perfcap.io.detections import read_detections, save_detections
from perfcap.train.config import LifterConfig
from perfcap.train.export import export_lifter
from perfcap.train.lifter import Lifter

SIZE = (240, 320)
UNTIL = ("--until", "track_motion", "--no-overlay")


def write_images(folder: Path, detections: Detections, view: int = 0) -> Path:
    """Frames in which each landmark is a dot of its colour."""
    folder.mkdir(parents=True)
    for f, places in enumerate(detections.joints2d[:, view].numpy()):
        image = draw(SIZE, places, 2.5)
        cv2.imwrite(str(folder / f"{f:06d}.png"), np.ascontiguousarray(image[..., ::-1]))
    return folder


@pytest.fixture(scope="session")
def dots(tmp_path_factory: pytest.TempPathFactory) -> TakeFiles:
    """A take whose images show the joints."""
    folder = tmp_path_factory.mktemp("dots")
    files = write_take(folder, 12, size=SIZE)
    write_images(folder / "images", files.take.detections)
    return files


@pytest.fixture(scope="session")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    text = MANIFESTS["vitpose"].replace("COCO-17", "landmarks16")
    return write_model(tmp_path_factory.mktemp("models") / "dots", vitpose(16), text)


def located(found: Detections, truth: Detections) -> float:
    """Mean error of joints that are seen, pixels; few are hidden by other dots."""
    seen = found.confidence2d > 0.3
    assert seen.double().mean() > 0.9
    return float((found.joints2d - truth.joints2d)[seen].norm(dim=-1).mean())


def call(dots: TakeFiles, network: Path | str, out: Path, *more: str) -> list[str]:
    parts = {"actor": dots.actor, "cameras": dots.camera, "detector": network, "out": out}
    options = [str(text) for key, value in parts.items() for text in (f"--{key}", value)]
    alone = () if "--lifter" in more else ("--lifter", "none")
    return ["capture", str(dots.folder / "images"), *options, *UNTIL, *alone, *more]


def test_images_and_a_network_are_enough(
    dots: TakeFiles, network: Path, tmp_path: Path, perfcap: Command
) -> None:
    outcome = perfcap(call(dots, network, tmp_path))
    assert outcome.code == 0, outcome
    found, _ = read_detections(tmp_path / "detections.npz")
    truth = dots.take.detections
    assert located(found, truth) < 0.5
    assert found.joints3d is None
    run = json.loads((tmp_path / "run.json").read_text())
    assert run["request"]["detector"] == [str(network)]
    with np.load(tmp_path / "motion.npz") as motion:
        pixels = dots.take.cameras.project(torch.tensor(motion["joints3d"]))
    # one view and no 3D joints: depth is a guess, the image is not
    assert (pixels - truth.joints2d).norm(dim=-1).mean() < 4
    again = [*call(dots, network, tmp_path), "--resume"]
    before = (tmp_path / "run.json").stat().st_mtime_ns
    assert perfcap(again).code == 0
    assert (tmp_path / "run.json").stat().st_mtime_ns == before


def test_detections_written_are_detections_read(
    dots: TakeFiles, network: Path, tmp_path: Path, perfcap: Command
) -> None:
    """A part keeps the frame numbers of the video, so its file serves a later call."""
    part = ("--frames", "3:9")
    # a few frames of one view without depth are captured, and most of them not trusted
    outcome = perfcap(call(dots, network, tmp_path / "a", *part))
    assert outcome.code == 3 and any("not to be trusted" in note for note in outcome.notes)
    with np.load(tmp_path / "a" / "detections.npz") as written:
        assert written["joints2d"].shape == (9, 16, 2)
        assert (written["confidence2d"][:3] == 0).all()
    files = [str(a) for a in call(dots, network, tmp_path / "b", *part)]
    place = files.index("--detector")
    files[place : place + 2] = ["--detections", str(tmp_path / "a" / "detections.npz")]
    assert perfcap(files).code in (0, 3)
    motions = [np.load(tmp_path / name / "motion.npz")["joints3d"] for name in "ab"]
    assert np.abs(motions[0] - motions[1]).max() < 2e-3  # the file holds single precision


def test_several_views(tmp_path: Path, network: Path, dots: TakeFiles, perfcap: Command) -> None:
    take = make_take(6, views=2, actor=dots.take.actor)
    cameras = shrunk(take.cameras, SIZE)
    truth = detect(take.actor, cameras, take.truth, lifted=False)
    folders = [write_images(tmp_path / name, truth, c) for c, name in enumerate("ab")]
    entries = {name: camera_entry(cameras, c) for c, name in enumerate("ab")}
    write_json(tmp_path / "cameras.json", {"views": entries})
    line = call(dots, network, tmp_path / "out", "--box", *["0", "0", "319", "239"] * 2)
    line[1:2] = [str(folder) for folder in folders]
    line[line.index("--cameras") + 1] = str(tmp_path / "cameras.json")
    outcome = perfcap(line)
    assert outcome.code in (0, 3), outcome  # so few frames need not be trusted
    found, _ = read_detections(tmp_path / "out" / "detections.npz", views=["a", "b"])
    assert located(found, truth) < 0.5
    with np.load(tmp_path / "out" / "motion.npz") as motion:
        error = take.error_mm(torch.tensor(motion["joints3d"]))
    assert error.mean() < 25


@pytest.mark.long
def test_more_people_than_there_are(
    tmp_path: Path, network: Path, dots: TakeFiles, perfcap: Command
) -> None:
    """The option that was given is named."""
    take = make_take(6, views=2, actor=dots.take.actor)
    cameras = shrunk(take.cameras, SIZE)
    truth = detect(take.actor, cameras, take.truth, lifted=False)
    entries = {name: camera_entry(cameras, c) for c, name in enumerate("ab")}
    write_json(tmp_path / "cameras.json", {"views": entries})
    line = call(dots, network, tmp_path / "out", "--people", "3")
    line[1:2] = [str(write_images(tmp_path / name, truth, c)) for c, name in enumerate("ab")]
    line[line.index("--cameras") + 1] = str(tmp_path / "cameras.json")
    place = line.index("--lifter")
    del line[place : place + 2]
    outcome = perfcap(line)
    assert outcome.code == 2 and "--people 3: fewer people" in outcome.err, outcome
    assert "--person" not in outcome.err


def test_a_damaged_actor_is_told_before_anybody_is_looked_for(
    dots: TakeFiles,
    network: Path,
    tmp_path: Path,
    perfcap: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unwanted(*_: object, **__: object) -> None:
        raise AssertionError("somebody was looked for")

    monkeypatch.setattr("perfcap.app.capture.read_inputs", unwanted)
    (tmp_path / "me.glb").write_bytes(b"glTF")
    arguments = call(dots, network, tmp_path / "out")
    arguments[arguments.index("--actor") + 1] = str(tmp_path / "me.glb")
    assert "me.glb" in perfcap(arguments).refused()


def test_people_who_are_not_there(
    dots: TakeFiles,
    network: Path,
    tmp_path: Path,
    perfcap: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("perfcap.app.console._SILENCE", 0.0)  # as on a busy machine
    line = perfcap(call(dots, network, tmp_path / "out", "--person", "3")).refused()
    assert "--person 3: fewer people are seen in every frame" in line


MISTAKES = {
    "detections in the pixels of the video": (
        ("--detections-in", "video"),
        "says which pixels files of --detections are in, and none are given",
    ),
    "both": (("--detections", "x.npz"), "both given"),
    "a short box": (("--box", "1", "2", "3"), "LEFT TOP RIGHT BOTTOM"),
    "an empty box": (("--box", "9", "2", "3", "8"), "is no box"),
    "nobody": (("--person", "0"), "expected 1 for the surest"),
    "a box and a number": (("--person", "2", "--box", "1", "2", "8", "9"), "both given"),
    "two lenses": (("--fov", "60"), "--fov: and --cameras are both given"),
    "a height of a character": (("--height", "1.8"), "--height: is for --actor auto"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes(
    dots: TakeFiles, network: Path, tmp_path: Path, perfcap: Command, mistake: str
) -> None:
    more, words = MISTAKES[mistake]
    assert words in perfcap(call(dots, network, tmp_path, *more)).refused()
    assert not list(tmp_path.iterdir())


def test_no_such_network(dots: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    line = perfcap(call(dots, "none", tmp_path)).refused()
    assert "--detector none: no such folder" in line


def test_nobody_in_the_images(
    dots: TakeFiles, network: Path, tmp_path: Path, perfcap: Command
) -> None:
    grey = tmp_path / "grey"
    grey.mkdir()
    for f in range(3):
        cv2.imwrite(str(grey / f"{f}.png"), np.full((*SIZE, 3), 90, np.uint8))
    line = call(dots, network, tmp_path / "out")
    line[1] = str(grey)
    assert "nobody is found in any frame" in perfcap(line).refused()


@pytest.mark.long
def test_what_was_detected_before_a_kill_is_not_detected_again(
    dots: TakeFiles,
    network: Path,
    tmp_path: Path,
    perfcap: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from perfcap.detect.onnx import OnnxDetector

    asked, genuine, tried = [0], OnnxDetector.estimate, 20  # frames of the shipped clip

    def estimate(self: OnnxDetector, crops: np.ndarray) -> object:
        asked[0] += 1
        if asked[0] == tried + 9:
            raise KeyboardInterrupt
        return genuine(self, crops)

    monkeypatch.setattr(OnnxDetector, "estimate", estimate)
    out = tmp_path / "out"
    assert perfcap(call(dots, network, out)).code == 130
    before, asked[0] = asked[0], 100
    assert perfcap([*call(dots, network, out), "--resume"]).code == 0
    again, asked[0] = asked[0] - 100, 100
    assert perfcap(call(dots, network, tmp_path / "whole")).code == 0
    # every run asks once when it opens the network, and tries it; one answer was lost
    assert again == asked[0] - 100 - (before - tried - 2)
    kept, whole = motion(out), motion(tmp_path / "whole")
    assert all(np.array_equal(kept[name], whole[name]) for name in whole)


@pytest.mark.long
def test_joints_without_poses_are_lifted_unless_told(
    dots: TakeFiles, network: Path, tmp_path: Path, perfcap: Command
) -> None:
    """Of a network of one's own and of a file: one view says nothing of depth, and nobody asked."""
    line = call(dots, network, tmp_path / "alone", "--frames", "0:9", "--lifter", "none")
    assert perfcap(line).code in (0, 3)
    place = line.index("--lifter")
    own, line = line[place : place + 2], [*line[:place], *line[place + 2 :]]
    line[line.index("--out") + 1] = str(tmp_path / "lifted")
    assert perfcap(line).code in (0, 3)
    place = line.index("--detector")
    line[place : place + 2] = ["--detections", str(tmp_path / "alone" / "detections.npz")]
    for name, more in (("file", []), ("file_alone", own)):
        line[line.index("--out") + 1] = str(tmp_path / name)
        assert perfcap([*line, *more]).code in (0, 3)
    names = ("alone", "lifted", "file", "file_alone")
    alone, lifted, file, file_alone = (
        np.load(tmp_path / n / "motion.npz")["joints3d"] for n in names
    )
    assert np.abs(lifted - file).max() < 2e-3  # the file holds single precision
    assert np.abs(alone - file_alone).max() < 2e-3
    assert np.abs(alone - lifted).max() > 0.02


@pytest.mark.long
def test_a_lifter_gives_3d_poses_to_one_view(
    dots: TakeFiles, network: Path, tmp_path: Path, perfcap: Command
) -> None:
    torch.manual_seed(0)
    lifter = Lifter(LifterConfig(channels=8, dilations=(1,)))
    with torch.no_grad():  # poses of about a person's size, or they are refused
        for weights in lifter.parameters():
            weights.mul_(0.7)
    export_lifter(lifter, tmp_path / "lifter", 30.0, "untrained", "none")
    outcome = perfcap(call(dots, network, tmp_path / "out", "--lifter", str(tmp_path / "lifter")))
    assert outcome.code == 3, outcome  # poses of a lifter that has learned nothing
    found, _ = read_detections(tmp_path / "out" / "detections.npz")
    expected = OnnxLifter(tmp_path / "lifter")(found, dots.take.cameras, 30.0)
    assert found.joints3d is not None and expected.joints3d is not None
    torch.testing.assert_close(found.joints3d, expected.joints3d, atol=1e-3, rtol=0)
    wrong = perfcap(call(dots, network, tmp_path / "none", "--lifter", str(network))).refused()
    assert "expected 'lifter'" in wrong


def test_saved_3d_is_millimetres_and_untrusted_frames_are_unknown(tmp_path: Path) -> None:
    found = make_take(5, views=2).detections
    trusted = found.trusted3d.clone()
    trusted[2, 1] = False
    assert found.joints3d is not None
    partial = Detections(found.joints2d, found.confidence2d, found.joints3d, trusted)
    save_detections(tmp_path / "d.npz", partial, ["a", "b"], pixel_offset=-0.5)
    again, _ = read_detections(tmp_path / "d.npz", views=["b", "a"], pixel_offset=-0.5)
    assert again.joints3d is not None
    torch.testing.assert_close(again.joints2d, found.select([1, 0]).joints2d, atol=1e-3, rtol=0)
    assert torch.equal(again.trusted3d, trusted[:, [1, 0]])
    torch.testing.assert_close(
        again.joints3d[trusted[:, [1, 0]]],
        found.select([1, 0]).joints3d[trusted[:, [1, 0]]],  # type: ignore[index]
        atol=1e-5,
        rtol=0,
    )


@pytest.fixture(scope="session")
def finder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finders")
    return write_people(folder, ("COCO-17", "landmarks16"), joints=16, split=0.0)


def with_finder(line: list[str], *names: Path | str) -> list[str]:
    place = line.index("--detector") + 1
    return [*line[:place], *map(str, names), *line[place + 1 :]]


def test_a_finder_takes_the_place_of_windows(
    dots: TakeFiles,
    network: Path,
    finder: Path,
    tmp_path: Path,
    perfcap: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unwanted(*_: object) -> None:
        raise AssertionError("windows were searched")

    monkeypatch.setattr("perfcap.detect.search._windows", unwanted)
    line = with_finder(call(dots, network, tmp_path), finder, network)
    assert perfcap(line).code == 0
    found, _ = read_detections(tmp_path / "detections.npz")
    assert located(found, dots.take.detections) < 0.5
    run = json.loads((tmp_path / "run.json").read_text())
    assert run["request"]["detector"] == [str(finder), str(network)]


def test_a_finder_follows_nobody_and_comes_first(
    dots: TakeFiles, network: Path, finder: Path, tmp_path: Path, perfcap: Command
) -> None:
    line = call(dots, network, tmp_path)
    for names, words in (
        ((finder,), "does not follow them; name networks that look up close after it"),
        ((network, finder), "expected one such network at most, named first"),
        ((finder, network, finder), "expected one such network at most, named first"),
    ):
        assert words in perfcap(with_finder(line, *names)).refused()
    assert not list(tmp_path.glob("*"))
