"""``perfcap train head``, from videos to a model that opens, and what it refuses."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from runs import Command
from takes import (
    camera_entry,
    detect,
    make_take,
    shrunk,
    write_detections,
    write_json,
    write_take,
    write_video,
)
from tiny_networks import write_tiny

from perfcap.app.head_checks import LEARNED, image_doubts, lags_of, late_doubts, misses_of
from perfcap.detect.onnx import OnnxDetector
from perfcap.io.video_writer import VideoWriter

FRAMES, VIEWS, SIZE = 10, 2, (120, 160)
TINY = (
    *("--crops.moved", 0, "--loop.steps", 1, "--loop.evaluate-every", 1, "--loop.warmup", 0),
    *("--loss.decays", 0.1, "--features", "t11"),  # peaks of the network's heat maps
)


@pytest.fixture(scope="module")
def call(tmp_path_factory: pytest.TempPathFactory) -> list[object]:
    """Two small views of a person, with joints that were detected in them."""
    return write_views(tmp_path_factory.mktemp("views"), FRAMES)


def write_views(folder: Path, frames: int) -> list[object]:
    """Write two small views of so many frames; the call that adapts a network to them."""
    one = write_take(folder, frames, size=SIZE)
    take = make_take(frames, views=VIEWS, actor=one.take.actor)
    cameras = shrunk(take.cameras, SIZE)
    found = detect(take.actor, cameras, take.truth)
    names = [f"cam{view}" for view in range(VIEWS)]
    for view, name in enumerate(names):
        seen = found.joints2d[:, view]
        write_video(folder / f"{name}.mp4", frames, SIZE, take.rate, seen=seen)
        write_detections(folder / f"{name}.npz", found.select([view]))
    entries = {name: camera_entry(cameras, view) for view, name in enumerate(names)}
    write_json(folder / "cameras.json", {"views": entries})
    network = write_tiny(folder, "mediapipe")
    return [
        *("train", "head", *(folder / f"{name}.mp4" for name in names)),
        *("--cameras", folder / "cameras.json", "--actor", one.actor, "--network", network),
        *("--detections", *(folder / f"{name}.npz" for name in names)),
    ]


@pytest.mark.long
def test_adapts_a_network_and_goes_on(perfcap: Command, call: list[object], tmp_path: Path) -> None:
    outcome = perfcap([*call, *TINY, "--out", tmp_path / "a"])
    assert outcome.code == 0 and "shipped, solved_mm" in outcome.out, outcome
    assert any("sees the joints far from where" in note for note in outcome.notes)  # it is random
    written = OnnxDetector(tmp_path / "a" / "model").manifest
    assert written.output.error3d is not None and "2 views, seed 0" in written.file.origin
    assert "without labels" in (tmp_path / "a" / "model" / "card.md").read_text()
    lines = (tmp_path / "a" / "chosen" / "metrics.jsonl").read_text().splitlines()
    assert "held_out" in json.loads(lines[-1])
    assert "holds an unfinished" in perfcap([*call, *TINY, "--out", tmp_path / "a"]).refused()
    assert perfcap([*call, *TINY, "--out", tmp_path / "a", "--resume"]).code == 0
    assert OnnxDetector(tmp_path / "a" / "model").manifest.file.sha256 == written.file.sha256


@pytest.mark.long
def test_frames_that_were_looked_at_are_counted(perfcap: Command, tmp_path: Path) -> None:
    call = write_views(tmp_path, 19)
    few = ("--crops.frames", 10, "--no-through-solver", "--out", tmp_path / "a")
    assert perfcap([*call, *TINY, *few]).code == 0
    model = tmp_path / "a" / "model"
    assert "10 of 19 frames of 2 views" in OnnxDetector(model).manifest.file.origin
    assert "10 of 19 frames of calibrated views" in (model / "card.md").read_text()


@pytest.mark.long
def test_what_cannot_be_adapted_is_refused(
    perfcap: Command, call: list[object], tmp_path: Path
) -> None:
    place = call.index("--cameras")
    views, rest = call[2:place], call[place:]
    tail = ("--out", tmp_path / "out")
    alone = [*call[:2], views[0], *tail]
    assert "one video shows no disagreement" in perfcap(alone).refused()
    assert "--cameras: is missing" in perfcap([*call[:2], *views, *tail]).refused()
    shipped = [*call[:2], *views, *rest[:2], "--network", "thunder", *tail]
    assert "without 3D joints" in perfcap(shipped).refused()
    assert "too few" in perfcap([*call, *TINY, "--frames", "0:6", *tail]).refused()
    assert "held_out: is 0.9" in perfcap([*call, "--held-out", 0.9, *tail]).refused()
    assert not (tmp_path / "out" / "model").exists()


@pytest.mark.long
def test_other_footage_is_not_gone_on_with(
    perfcap: Command, call: list[object], tmp_path: Path
) -> None:
    # the same files, whose cameras or joints were corrected meanwhile, teach something else
    cameras = Path(str(call[call.index("--cameras") + 1]))
    entries = json.loads(cameras.read_text())
    moved = tmp_path / "cameras.json"
    write_json(moved, entries)
    mine = [moved if each == cameras else each for each in call]
    assert perfcap([*mine, *TINY, "--out", tmp_path / "a"]).code == 0
    for entry in entries["views"].values():
        entry["t"][2] += 0.05
    write_json(moved, entries)
    again = perfcap([*mine, *TINY, "--out", tmp_path / "a", "--resume"])
    assert again.code == 2 and "another configuration" in again.err


@pytest.mark.long
@pytest.mark.parametrize("before", ["--no-through-solver", "--through-solver"])
def test_a_model_of_other_footage_is_not_replaced(
    perfcap: Command, call: list[object], tmp_path: Path, before: str
) -> None:
    """Without the solver there is no checkpoint that would say what was learned from."""
    out = tmp_path / "a"
    direct = [*call, *TINY, "--no-through-solver", "--out", out, "--resume"]
    assert perfcap([*call, *TINY, before, "--out", out]).code == 0
    written = (out / "model" / "model.onnx").read_bytes()
    cameras = Path(str(call[call.index("--cameras") + 1]))
    entries = json.loads(cameras.read_text())
    for entry in entries["views"].values():
        entry["t"][2] += 0.05
    write_json(tmp_path / "cameras.json", entries)
    other = [tmp_path / "cameras.json" if each == cameras else each for each in direct]
    assert "not the same: " in perfcap(other).refused()
    again = perfcap(direct)
    if before == "--no-through-solver":
        assert again.code == 0
        (out / LEARNED).unlink()
        assert f"but no {LEARNED}" in perfcap(direct).refused()
        (out / LEARNED).write_text("[")
        assert "is malformed" in perfcap(direct).refused()
    else:
        assert "(not the same: through_solver)" in again.refused()
    assert (out / "model" / "model.onnx").read_bytes() == written


@pytest.mark.long
def test_a_network_that_is_there_is_not_replaced(
    perfcap: Command, call: list[object], tmp_path: Path
) -> None:
    direct = [*call, *TINY, "--no-through-solver", "--out", tmp_path / "a"]
    assert perfcap(direct).code == 0
    written = (tmp_path / "a" / "model" / "card.md").read_bytes()
    assert "holds a trained network" in perfcap([*direct, "--frames", "0:10"]).refused()
    assert (tmp_path / "a" / "model" / "card.md").read_bytes() == written
    assert perfcap([*direct, "--resume"]).code == 0


@pytest.mark.long
def test_what_the_capture_warns_of_is_said(
    perfcap: Command, call: list[object], tmp_path: Path
) -> None:
    place = call.index("--actor")
    anybody = [*call[:place], *call[place + 2 :], *TINY, "--no-through-solver"]
    outcome = perfcap([*anybody, "--height", 1.4, "--out", tmp_path / "a"])
    assert outcome.code == 0 and any("--height says 1.40" in note for note in outcome.notes)


def test_videos_that_show_nothing_are_refused(
    perfcap: Command, call: list[object], tmp_path: Path
) -> None:
    black = [tmp_path / Path(str(each)).name for each in call[2:4]]
    for path in black:
        with VideoWriter(path, 30.0, preset="ultrafast") as writer:
            for _ in range(FRAMES):
                writer.write(np.zeros((*SIZE, 3), np.uint8))
    blind = [*call[:2], *black, *call[4:], *TINY, "--out", tmp_path / "a"]
    assert "of one color" in perfcap(blind).refused()


def test_images_in_which_the_network_sees_the_person_elsewhere_are_said() -> None:
    known = torch.rand(3, 5, 2, 16, 2, generator=torch.Generator().manual_seed(0)) * 100
    size = (known.amax(-2) - known.amin(-2)).amax(-1)[..., None, None]
    off = torch.tensor([0.03, 0.12, 0.05])[:, None, None, None, None]
    seen = known + off * size * torch.tensor([0.6, -0.8])
    seen[:, :, 1] += 1000  # moved crops are no evidence
    misses = misses_of(SimpleNamespace(joints2d=seen, known2d=known))
    assert misses == pytest.approx([0.03, 0.12, 0.05], rel=1e-3)
    names = ("left", "middle", "right")
    (line,) = image_doubts(misses, names)
    assert "middle 12 % of the person (medians, up to 5 % in the other views)" in line
    assert not [*image_doubts([0.03, 0.07, 0.05], names)]
    (line,) = image_doubts([0.1, 0.2, 0.3], names)
    assert "left 10 %, middle 20 %, right 30 % of the person (medians)" in line


def test_joints_that_are_late_against_the_images_are_said() -> None:
    """Crops were cut around the late joints, and the head learned to be late."""
    take = make_take(24, views=3)
    joints = take.actor.joints(take.truth)
    pixels = take.cameras.project(joints).transpose(0, 1)
    size = float(pixels[..., 1].amax(-1).sub(pixels[..., 1].amin(-1)).median())
    noise = torch.randn(pixels.shape, generator=torch.Generator().manual_seed(0))
    to_image = torch.eye(3)[:2].expand(3, 24, 1, 2, 3)

    def lags(late: tuple[int, ...], noisy: float) -> list[int]:
        shown = torch.stack([p.roll(-by, 0) for p, by in zip(pixels, late, strict=True)])
        seen = (shown + noisy * size * noise)[:, :, None]
        crops = SimpleNamespace(joints2d=seen.float(), to_image=to_image)
        return lags_of(crops, SimpleNamespace(cameras=take.cameras, joints=joints))

    assert lags((0, 0, 0), 0.0) == lags((0, 0, 0), 0.03) == [0, 0, 0]
    assert lags((0, 0, 0), 0.3) == [0, 0, 0]  # a network that sees nobody
    found = lags((5, 0, -4), 0.01)
    assert found == [5, 0, -4]
    (line,) = late_doubts(found, ("left", "middle", "right"), 2)
    assert "left 10 frames late, right 8 frames early; check" in line
    assert not [*late_doubts([0, 0, 0], ("left", "middle", "right"))]


def test_a_head_that_gains_nothing_is_said() -> None:
    from perfcap.app.train_head import doubts_of

    gained = {"shipped, mm": 80.0, "fitted, mm": 90.0, "through the solver, mm": 70.0}
    assert not [*doubts_of(gained)]
    (line,) = doubts_of(gained | {"through the solver, mm": 85.0})
    assert "no better" in line and "85 and 80 mm" in line


def test_the_default_is_the_one_with_coordinates_in_3d() -> None:
    from perfcap.app.train_head import default_network

    assert default_network() in ("blazepose", "blazepose_heavy")
