"""A capture that is killed after any of its blocks and goes on ends with the same bits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from takes import Take, detect, make_take, shrunk
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.journal import Journal
from perfcap.pipeline import CaptureConfig, Performance, PoseConfig, capture
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, Codec, motions, tensors
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.surface_config import RefineSurfaceConfig

FRAMES, SIDE = 20, 120
CONFIG = CaptureConfig(
    pose=replace(PoseConfig(), window=8, overlap=3, batch=1),
    refine_surface=RefineSurfaceConfig(nodes=40),
)


class Killed(BaseException):
    """Nothing in the program may catch it."""


@dataclass(frozen=True)
class Shown:
    """A reader of frames in memory, the same in every view."""

    frames: dict[int, Frames]

    def __len__(self) -> int:
        return FRAMES

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        return self.frames[view][start:stop]


def film(take: Take, cameras: Camera) -> Shown:
    """The person in front of a wall."""
    rng = np.random.default_rng(0)
    wall = cv2.resize(rng.integers(0, 130, (8, 8, 3), np.uint8), (SIDE, SIDE))
    cloth = cv2.resize(rng.integers(100, 256, (30, 30, 3), np.uint8), (SIDE, SIDE)) // (4, 1, 8)
    template = take.actor.template
    sight = Sight(cameras, torch.as_tensor(template.faces.copy()), template.weld()[0])
    drawn = sight.look(take.actor.surface(take.truth), slice(0, FRAMES))
    frames = {v: np.stack([wall] * FRAMES) for v in range(cameras.views)}
    for frame, views in enumerate(drawn):
        for view, seen in enumerate(views):
            frames[view][frame][seen.mask] = cloth[seen.mask]
    return Shown(frames)


@dataclass(frozen=True)
class Filmed:
    take: Take
    images: Images

    def run(self, checkpoint: Checkpoint = NO_CHECKPOINT, bones: bool = False) -> Performance:
        take = self.take
        return capture(
            *(take.actor, take.cameras, take.detections, take.rate, CONFIG),
            images=self.images,
            workers=1,
            checkpoint=checkpoint,
            solve_bones=bones,
        )


@pytest.fixture(scope="module")
def filmed() -> Filmed:
    return filmed_from(1)


def filmed_from(views: int) -> Filmed:
    take = make_take(FRAMES, views=views)
    cameras = shrunk(take.cameras, (SIDE, SIDE))
    take = replace(take, cameras=cameras, detections=detect(take.actor, cameras, take.truth))
    return Filmed(take, Images(film(take, cameras), cameras))


def bits(found: Performance) -> list[Tensor | object]:
    """Everything that is written."""
    assert found.surface is not None and found.refinement is not None
    pose, surface = found.refinement.pose, found.refinement.surface
    assert surface is not None
    return [
        *(found.motion.translation, found.motion.rotation, found.motion.angles),
        found.surface[0:FRAMES],
        *(torch.from_numpy(each) for each in (pose.before, pose.after, surface.folded)),
        found.refinement.evidence.silhouettes.png(0),
        repr(found.refinement.report()),
        repr(found.windows),
        found.warnings,
    ]


def equal(one: Performance, other: Performance) -> bool:
    pairs = zip(bits(one), bits(other), strict=True)
    return all(torch.equal(a, b) if isinstance(a, Tensor) else list(a) == list(b) for a, b in pairs)  # type: ignore[arg-type, call-overload]


def killed_at(monkeypatch: pytest.MonkeyPatch, block: int, half: bool) -> list[int]:
    """Let the process die at its ``block``-th record, before or in the middle of writing it."""
    count = [0]
    genuine = Journal.append

    def append(self: Journal, record: object) -> None:
        count[0] += 1
        if count[0] != block:
            genuine(self, record)  # type: ignore[arg-type]
            return
        if half:
            genuine(self, record)  # type: ignore[arg-type]
            data = self.path.read_bytes()
            self.path.write_bytes(data[: len(data) - 7])
        raise Killed

    monkeypatch.setattr(Journal, "append", append)
    return count


def check_killed_every(
    step: int, filmed: Filmed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One run that is killed again and again; in the end nothing was computed twice."""
    blocks = killed_at(monkeypatch, -1, half=False)
    whole = filmed.run(Checkpoint(tmp_path))
    monkeypatch.undo()
    stages = {path.name.rstrip("_0123456789.log") for path in tmp_path.iterdir()}
    assert {"initialize", "track_motion", "extract_silhouettes", "refine_pose"} <= stages
    again, deaths = tmp_path / "again", 0
    again.mkdir()
    while True:
        killed_at(monkeypatch, step, half=deaths % 2 == 1)
        try:
            found = filmed.run(Checkpoint(again))
            break
        except Killed:
            deaths += 1
        finally:
            monkeypatch.undo()
    assert equal(whole, found)
    # of every ``step`` blocks the last is lost, and nothing else
    assert blocks[0] > 20 and deaths == (blocks[0] - 1) // (step - 1)


def test_killed_now_and_then(
    filmed: Filmed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    check_killed_every(24, filmed, tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("views", [1, 2])
def test_killed_at_every_other_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, views: int
) -> None:
    check_killed_every(2, filmed_from(views), tmp_path, monkeypatch)


@pytest.mark.slow
def test_keeping_changes_nothing(filmed: Filmed, tmp_path: Path) -> None:
    assert equal(filmed.run(), filmed.run(Checkpoint(tmp_path)))


@pytest.mark.slow
def test_a_damaged_record_ends_what_is_kept(filmed: Filmed, tmp_path: Path) -> None:
    whole = filmed.run(Checkpoint(tmp_path))
    for number, path in enumerate(sorted(tmp_path.iterdir())):
        data = bytearray(path.read_bytes())
        data[(number * 37) % len(data)] ^= 255
        path.write_bytes(bytes(data) + b"rest" * (number % 2))
    assert equal(whole, filmed.run(Checkpoint(tmp_path)))


def test_records_of_something_else_are_one_line(filmed: Filmed, tmp_path: Path) -> None:
    Journal(tmp_path / "track_motion.log").append({"values": np.zeros(3)})
    with pytest.raises(InputError, match=r"track_motion\.log: holds something else"):
        filmed.run(Checkpoint(tmp_path))


@pytest.mark.long
def test_bone_lengths_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = make_take(8, views=2)
    parts = (take.actor, take.cameras, take.detections, take.rate)
    first = capture(*parts, solve_bones=True, checkpoint=Checkpoint(tmp_path))

    def again_solved(*_: object) -> None:
        raise AssertionError("solved again")

    monkeypatch.setattr("perfcap.pipeline.move.solve_bone_lengths", again_solved)
    again = capture(*parts, solve_bones=True, checkpoint=Checkpoint(tmp_path))
    assert first.bone_scales is not None and again.bone_scales is not None
    assert torch.equal(first.bone_scales, again.bone_scales)
    assert torch.equal(first.motion.angles, again.motion.angles)


def test_codecs_are_exact() -> None:
    values = tuple(torch.randn(3, 2, dtype=t) for t in (torch.float32, torch.float64))
    plain = tensors(values[0])
    for value, found in zip(values, plain.unpack(dict(plain.pack(values))), strict=True):
        assert value.dtype == found.dtype and torch.equal(value, found)
    motion = make_take(4).truth
    codec = motions(motion.angles)
    assert torch.equal(codec.unpack(dict(codec.pack(motion))).rotation, motion.rotation)


def test_more_is_kept_than_is_asked_for(tmp_path: Path) -> None:
    codec: Codec[int] = Codec(lambda value: {"value": value}, lambda record: record["value"])
    kept = Checkpoint(tmp_path).kept("numbers")
    assert list(kept.each(codec, lambda x: x * x, range(5))) == [0, 1, 4, 9, 16]
    assert list(kept.each(codec, lambda x: x / 0, range(3))) == [0, 1, 4]  # type: ignore[arg-type, return-value]
    assert list(kept.each(codec, lambda x: -x, range(7))) == [0, 1, 4, 9, 16, -5, -6]
