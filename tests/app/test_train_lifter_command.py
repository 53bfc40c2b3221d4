"""``perfcap train lifter``, from motion to a model that opens, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest
import torch
from motion_files import write_library
from runs import Command
from takes import make_take

from perfcap.app.train import sole_training
from perfcap.detect.lifter import OnnxLifter
from perfcap.io.result_folder import locked
from perfcap.train.checkpoint import load_checkpoint

TINY = (
    *("--held-out", "03", "--validation", "02", "--data.frames", 16, "--lifter.channels", 8),
    *("--loop.steps", 2, "--loop.batch", 8, "--loop.evaluate-every", 2, "--loop.warmup", 1),
)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_library(tmp_path_factory.mktemp("motion"), frames=20)


def require_said(model: Path, sources: tuple[str, ...]) -> None:
    """Require that card and manifest say what went in, and nothing of the folders it lay in."""
    text, origin = (model / "card.md").read_text(), OnnxLifter(model).manifest.file.origin
    assert f"- Went in: {'; '.join(sources)}. - Licence" in " ".join(text.split())
    assert origin == "; ".join(("perfcap train lifter, 2 steps, seed 0", *sources))
    assert str(model.parents[1]) not in text + origin


@pytest.mark.long
def test_other_motion_does_not_resume(perfcap: Command, library: Path, tmp_path: Path) -> None:
    call = ["train", "lifter", *TINY, "--out", tmp_path / "a", "--motion"]
    assert perfcap([*call, library]).code == 0
    assert perfcap([*call, library, "--resume"]).code == 0
    other = write_library(tmp_path / "other", frames=21)
    assert "of other motion" in perfcap([*call, other, "--resume"]).refused()


@pytest.mark.long
def test_other_taps_are_learned_with(perfcap: Command, library: Path, tmp_path: Path) -> None:
    call = ["train", "lifter", "--motion", library, *TINY, "--lifter.dilations", 1, 2, 4, 8]
    assert perfcap([*call, "--out", tmp_path / "a"]).code == 0
    assert OnnxLifter(tmp_path / "a" / "model").manifest.reach == 15


@pytest.mark.long
def test_trains_exports_and_starts_from_what_it_wrote(
    perfcap: Command, library: Path, tmp_path: Path
) -> None:
    call = ["train", "lifter", "--motion", library, *TINY, "--out"]
    outcome = perfcap([*call, tmp_path / "a"])
    assert outcome.code == 0 and "MPJPE" in outcome.out
    assert any("has learned nothing" in note for note in outcome.notes)  # in two steps
    assert OnnxLifter(tmp_path / "a" / "model").manifest.reach == 40
    assert "Where it fails" in (tmp_path / "a" / "model" / "card.md").read_text()
    best = tmp_path / "a" / "best.safetensors"
    slow = ("--start", best, "--loop.learning-rate", 1e-9, "--together-with", best)
    assert perfcap([*call, tmp_path / "b", *slow]).code == 0
    require_said(
        tmp_path / "b" / "model",
        (
            f"recorded motion of {library.name}",
            "to start from, the weights of best.safetensors, with what went into them",
            "averaged with it, the weights of best.safetensors, with what went into them",
        ),
    )
    assert "averaged with 1 of other runs" in (tmp_path / "b" / "model" / "card.md").read_text()
    features = torch.randn(1, 5, 49)
    alone, together = (OnnxLifter(tmp_path / run / "model")._run(features) for run in "ab")
    for one, same in zip(alone, together, strict=True):
        torch.testing.assert_close(one, same, atol=1e-5, rtol=1e-4)
    first, second = (
        load_checkpoint(path).part("average") for path in (best, tmp_path / "b/best.safetensors")
    )
    assert all((first[name] - second[name]).abs().max() < 1e-6 for name in first)
    assert perfcap([*call, tmp_path / "b", *slow, "--resume"]).code == 0
    last = tmp_path / "a" / "last.safetensors"
    for other in (("--start", last, *slow[2:]), slow[2:]):
        refused = perfcap([*call, tmp_path / "b", *other, "--resume"]).refused()
        assert "another configuration or --start" in refused
    wider = perfcap([*call, tmp_path / "c", "--start", best, "--lifter.channels", 12])
    assert "is of another network" in wider.refused()
    taps = ("--lifter.dilations", 1, 2, 4, 8)  # their weights have the same shapes
    for option in ("--start", "--together-with"):
        refused = perfcap([*call, tmp_path / "d", option, best, *taps]).refused()
        assert "has learned with --lifter.dilations [1, 3, 9, 27], expected [1, 2, 4, 8]" in refused
    assert not (tmp_path / "d").exists()
    assert "holds an unfinished or finished training" in perfcap([*call, tmp_path / "a"]).refused()


@pytest.mark.long
def test_one_folder_is_of_one_training_at_a_time(
    perfcap: Command, library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = ["train", "lifter", "--motion", library, *TINY, "--out", tmp_path / "a"]
    assert perfcap(call).code == 0
    with locked(tmp_path / "a"):
        assert "another perfcap writes into this folder" in perfcap([*call, "--resume"]).refused()
        monkeypatch.setenv("RANK", "1")  # of torchrun's processes the first one has the folder
        with sole_training(tmp_path / "a"):
            pass
    monkeypatch.delenv("RANK")
    assert perfcap([*call, "--resume"]).code == 0


@pytest.mark.long
@pytest.mark.parametrize("option", ["--start", "--together-with"])
def test_people_held_out_were_never_learned_from(
    perfcap: Command,
    library: Path,
    tmp_path: Path,
    option: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    call = ["train", "lifter", *TINY, "--motion"]
    assert perfcap([*call, library, "--out", tmp_path / "a"]).code == 0
    best = tmp_path / "a" / "best.safetensors"
    again = [*call, library, "--out", tmp_path / "b", option, best, "--held-out", "01"]
    assert "learned from people who are held out here (01)" in perfcap(again).refused()
    assert not (tmp_path / "b").exists()
    other = write_library(tmp_path / "other", frames=21)
    again[again.index(library)] = other
    assert perfcap(again).code == 0
    assert "has learned from other motion, of which it held out 03, 02" in caplog.text


def write_tracks(path: Path, frames: int, seed: int = 0) -> Path:
    take = make_take(frames)
    seen = take.cameras.to_camera(take.actor.joints(take.truth))[:, 0].numpy().astype(float)
    truth = seen + np.random.default_rng(seed).normal(0, 0.2, (3, 1, 1, 3))
    lens = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
    pixels = truth @ lens.T
    np.savez(
        path,
        joints2d=pixels[..., :2] / pixels[..., 2:],
        confidence=np.ones(truth.shape[:3]),
        truth=truth,
        intrinsics=np.tile(lens, (3, 1, 1)),
    )
    return path


@pytest.mark.long
def test_tracks_of_videos_are_learned_from(perfcap: Command, library: Path, tmp_path: Path) -> None:
    tracks = write_tracks(tmp_path / "tracks.npz", 90)
    call = ["train", "lifter", "--motion", library, *TINY, "--data.seen", 1]
    assert perfcap([*call, "--out", tmp_path / "a", "--tracks", tracks]).code == 0
    assert perfcap([*call, "--out", tmp_path / "b"]).code == 0
    motion = f"recorded motion of {library.name}"
    require_said(tmp_path / "a" / "model", (motion, "3 tracks of tracks.npz"))
    require_said(tmp_path / "b" / "model", (motion,))
    first, second = (
        load_checkpoint(tmp_path / run / "last.safetensors").part("model") for run in "ab"
    )
    assert any(not torch.equal(first[name], second[name]) for name in first)
    unseen = [*call[:-1], 0, "--out", tmp_path / "d", "--tracks", tracks]
    assert perfcap(unseen).code == 0
    require_said(tmp_path / "d" / "model", (motion,))
    other = write_tracks(tmp_path / "other.npz", 90, seed=1)
    resumed = perfcap([*call, "--out", tmp_path / "a", "--tracks", other, "--resume"]).refused()
    assert "another configuration" in resumed
    short = write_tracks(tmp_path / "short.npz", 40)
    refused = perfcap([*call, "--out", tmp_path / "c", "--tracks", short]).refused()
    assert "have 40 frames each; expected 81 or more" in refused
