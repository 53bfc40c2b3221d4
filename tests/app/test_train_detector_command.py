"""``perfcap train detector``, from motion to a model that opens, and what it refuses."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from motion_files import write_library
from runs import Command

from perfcap.app.train_detector import describe_drawn, detector_sources, dressed_actor
from perfcap.commands.train import TrainDetector
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.onnx import OnnxDetector
from perfcap.io.actor import models_folder
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.checkpoint import Checkpoint, save_checkpoint, start_from
from perfcap.train.config import DetectorConfig, SceneData, TrainDetectorConfig
from perfcap.train.detector import Detector
from perfcap.train.photographs import Photographs

LSPET = Path(__file__).parents[3] / "shared" / "data" / "lspet"
VALUES = {"step": "1", "best": "1.0", "config": "{}"}
PEOPLE = ("--held-out", "03", "--validation", "02")
TINY = (
    *("--crops", 32, "--validation-crops", 32, "--sizes", 0.0, 64, "--actors"),
    *("--loop.steps", 2, "--loop.batch", 2, "--loop.evaluate-every", 2, "--loop.warmup", 1),
    *("--detector.size", 64, "--detector.widths", 8, 8, 8, 8, "--detector.blocks", 1, 1, 1),
    *("--scene.size", 72, "--scene.group", 1, "--scene.texture", 32, "--scene.shadowed", 0.0),
)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_library(tmp_path_factory.mktemp("motion"), frames=20)


def write_pictures(folder: Path) -> Path:
    folder.mkdir()
    cv2.imwrite(str(folder / "grey.png"), np.full((40, 60, 3), 99, np.uint8))
    return folder


def write_photographs(folder: Path) -> Path:
    """Three people with annotated joints in two photographs."""
    (folder / "images").mkdir(parents=True)
    rng = np.random.default_rng(0)
    entries = []
    for name in ("one.png", "two.png", "two.png"):
        image = rng.integers(0, 255, (80, 60, 3), np.uint8)
        cv2.imwrite(str(folder / "images" / name), image)
        rows = np.concatenate([rng.uniform(20, 50, (16, 2)), np.ones((16, 1))], 1)
        entries.append({"file": name, "joints": rows.tolist()})
    table = {"joint_names": list(LANDMARKS), "images": entries}
    (folder / "annotations.json").write_text(json.dumps(table))
    return folder


def test_all_that_goes_in_is_named(tmp_path: Path) -> None:
    motion = tmp_path / "motion"
    plain = TrainDetector(motion, tmp_path / "run")
    first = ("recorded motion of motion", "the body model ada")
    assert detector_sources(plain, Backgrounds(), None) == (*first, "the actor sam")
    alone = SceneData(actors=0.0)
    without = TrainDetector(motion, tmp_path / "run", config=TrainDetectorConfig(scene=alone))
    assert detector_sources(without, Backgrounds(), None) == first
    pictures = write_pictures(tmp_path / "pictures")
    photographs = write_photographs(tmp_path / "people")
    full = TrainDetector(
        *(motion, tmp_path / "run"),
        body_model=str(tmp_path / "bodies" / "eve"),
        actors=("sam", str(tmp_path / "who.glb")),
        backgrounds=pictures,
        photographs=photographs,
        start=tmp_path / "before" / "weights.safetensors",
    )
    found = detector_sources(full, Backgrounds(pictures), Photographs(photographs, 72, 1.8))
    assert found == (
        first[0],
        "the body model eve",
        "the actors sam, who.glb",
        "1 background of pictures",
        "2 photographs with 3 people of people",
        "to start from, the weights of weights.safetensors, with what went into them",
    )


@pytest.mark.slow
def test_cards_and_manifests_say_what_went_in(
    perfcap: Command, library: Path, tmp_path: Path
) -> None:
    pictures = write_pictures(tmp_path / "pictures")
    photographs = write_photographs(tmp_path / "people")
    call = ["train", "detector", "--motion", library, *PEOPLE, *TINY, "--licence", "CC0"]
    call += ["--crops-folder", tmp_path / "crops", "--backgrounds", pictures, "--out"]
    assert perfcap([*call, tmp_path / "a"]).code == 0
    best = tmp_path / "a" / "best.safetensors"
    more = ("--photographs", photographs, "--start", best)
    assert perfcap([*call, tmp_path / "b", *more]).code == 0
    first = f"recorded motion of {library.name}; the body model ada; 1 background of pictures"
    then = (
        "; 2 photographs with 3 people of people; to start from, the weights of best.safetensors, "
        "with what went into them"
    )
    for run, said in (("a", first), ("b", first + then)):
        model = tmp_path / run / "model"
        origin, card = OnnxDetector(model).manifest.file.origin, (model / "card.md").read_text()
        assert origin == f"perfcap train detector, 2 steps, seed 0; {said}"
        expected = f"- Went in: {said}. - Licence of the weights: CC0; it follows"
        assert expected in " ".join(card.split())
        assert str(tmp_path) not in card + origin


@pytest.mark.slow
def test_trains_exports_and_describes(perfcap: Command, library: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    call = ["train", "detector", "--motion", library, "--out", out, *PEOPLE, *TINY, "--crops", 33]
    outcome = perfcap(call)
    assert outcome.code == 0 and "PCK" in outcome.out
    assert "learned from 64 rendered crops, scored on 32\n" in outcome.out  # in whole parts
    assert any("has learned nothing" in note for note in outcome.notes)  # in two steps
    assert {p.name for p in out.iterdir()} >= {
        "best.safetensors",
        "last.safetensors",
        "crops",
        "model",
    }
    detector = OnnxDetector(out / "model")
    assert not detector.joint_set.missing()
    card = (out / "model" / "card.md").read_text()
    assert "Where it fails" in card and "1 recorded people (01)" in card
    assert "Learned from: 64 rendered crops" in card and "Scores on 32 rendered crops" in card
    assert "--resume" in perfcap(call).refused()
    assert perfcap([*call, "--resume"]).code == 0
    pictures = write_pictures(tmp_path / "pictures")
    behind = perfcap([*call, "--resume", "--backgrounds", pictures])
    assert "crops of other settings, actors, body model or backgrounds" in behind.refused()
    more = ("--crops-folder", out / "crops", "--start", out / "model/weights.safetensors")
    wider = ("--detector.widths", 8, 8, 8, 16)
    other = perfcap([*call[:4], "--out", tmp_path / "b", *PEOPLE, *TINY, *more, *wider])
    assert "is of another network" in other.refused()


@pytest.mark.slow
def test_corrected_actors_are_others(perfcap: Command, library: Path, tmp_path: Path) -> None:
    who = tmp_path / "who"
    shutil.copytree(models_folder() / "actors" / "sam", who)
    call = ["train", "detector", "--motion", library, *PEOPLE, *TINY, "--actors", who]
    crops = ("--crops-folder", tmp_path / "crops")
    assert perfcap([*call, "--out", tmp_path / "a", *crops]).code == 0
    shutil.move(who, tmp_path / "same")  # other names, the same files
    call[-1] = tmp_path / "same"
    assert perfcap([*call, "--out", tmp_path / "a", *crops, "--resume"]).code == 0
    with (tmp_path / "same" / "manifest.toml").open("a") as file:
        file.write("# corrected\n")
    for out in ("a", "b"):
        refused = perfcap([*call, "--out", tmp_path / out, *crops, "--resume"]).refused()
        assert "crops of other settings, actors" in refused
    again = perfcap([*call, "--out", tmp_path / "a", "--crops-folder", tmp_path / "c", "--resume"])
    assert "joints, actors, backgrounds or photographs; expected the same" in again.refused()


def test_people_are_known_by_what_their_files_hold(tmp_path: Path) -> None:
    for name in ("actor.glb", "manifest.toml", "body.npz", "texture.jpg", "who.bin"):
        (tmp_path / name).write_bytes(b"# first")
    (tmp_path / "who.gltf").write_text('{"buffers": [{"uri": "who.bin"}]}')

    def described() -> list[dict[str, object]]:
        actors = [(str(tmp_path),), (str(tmp_path / "who.gltf"),)]
        asked = [TrainDetector(tmp_path, tmp_path, actors=each) for each in actors]
        asked.append(TrainDetector(tmp_path, tmp_path, actors=(), body_model=str(tmp_path)))
        return [describe_drawn(each, Backgrounds()) for each in asked]

    # files, and which of the three are others when they are
    changes = {"actor.glb": 0, "manifest.toml": 0, "who.bin": 1, "body.npz": 2, "texture.jpg": 2}
    for name, other in changes.items():
        before = described()
        (tmp_path / name).write_text("# corrected")
        assert [b != a for b, a in zip(before, described(), strict=True)] == [
            number == other for number in range(3)
        ]


def test_crops_that_are_smaller_than_what_is_shown_are_named(
    perfcap: Command, library: Path, tmp_path: Path
) -> None:
    call = ["train", "detector", "--motion", library, "--out", tmp_path, *PEOPLE, *TINY]
    (tmp_path / "crops" / "validation").mkdir(parents=True)
    (tmp_path / "crops" / "validation" / "crops_0000.npz").write_bytes(b"")  # ends it here
    for side, names in ((48, True), (72, False)):
        outcome = perfcap([*call, "--scene.size", side])
        assert outcome.code == 2
        assert any("expected 76 or more" in note for note in outcome.notes) == names


def test_actors_without_clothes_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    dressed_actor("sam")
    assert not caplog.records
    glb = (models_folder() / "actors" / "sam" / "actor.glb").read_bytes()
    bare = glb.replace(b'"baseColorTexture"', b'"XbaseColorTextur"')  # of the same length
    assert bare != glb
    (tmp_path / "bare.glb").write_bytes(bare)
    dressed_actor(str(tmp_path / "bare.glb"))
    assert any("has no texture" in record.getMessage() for record in caplog.records)


def test_a_network_grows(tmp_path: Path) -> None:
    torch.manual_seed(0)
    small, large = (
        Detector(DetectorConfig(64, (8, 8, 16, 16), (1, 1, count))).eval() for count in (1, 2)
    )
    crops = 255 * torch.rand(2, 3, 64, 64)
    weights = {f"average.{name}": value for name, value in small.state_dict().items()}
    save_checkpoint(tmp_path / "small", Checkpoint(weights, VALUES))
    start_from(large, tmp_path / "small")
    for one, same in zip(small(crops), large(crops), strict=True):
        torch.testing.assert_close(one, same)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("--sizes", 0.5, 64), "start at [0.5]; expected rising shares"),
        (("--sizes", 0.0, 64, 45, 64), "expected rising shares of the steps, from 0 to below 1"),
        (("--sizes", 0.0, 100), "expected multiples of 32"),
        (("--detector.size", 96), "the last one detector.size"),
        (("--held-out", "09"), "09 have no clips"),
        (("--held-out", "02"), "02 are named twice"),
    ],
)
def test_refuses_in_a_line(
    perfcap: Command,
    library: Path,
    tmp_path: Path,
    change: tuple[object, ...],
    message: str,
) -> None:
    call = ["train", "detector", "--motion", library, "--out", tmp_path, *PEOPLE, *TINY, *change]
    assert message in perfcap(call).refused()


@pytest.mark.skipif(not LSPET.is_dir(), reason="needs shared/data/lspet")
def test_photographs_with_exchanged_sides_are_refused(
    perfcap: Command, library: Path, tmp_path: Path
) -> None:
    table = json.loads((LSPET / "annotations.json").read_text())
    other = {"l_": "r_", "r_": "l_"}
    table["joint_names"] = [other.get(n[:2], n[:2]) + n[2:] for n in table["joint_names"]]
    table["images"] = table["images"][:24]
    (tmp_path / "images").symlink_to(LSPET / "images")
    (tmp_path / "annotations.json").write_text(json.dumps(table))
    call = ["train", "detector", "--motion", library, "--out", tmp_path / "run", *PEOPLE, *TINY]
    refused = perfcap([*call, "--photographs", tmp_path]).refused()
    assert "where those of the other side are marked" in refused
