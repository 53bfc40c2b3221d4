"""A folder of finished work goes on with the capture that it is of, and with no other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from takes import Take, make_take

from perfcap.errors import InputError
from perfcap.io.journal import Journal
from perfcap.pipeline import CaptureConfig, Performance, PoseConfig, Stage, capture
from perfcap.pipeline.checkpoint import Checkpoint

FRAMES = 8
CONFIG = CaptureConfig(pose=replace(PoseConfig(), window=8, overlap=3, batch=1))


@pytest.fixture(scope="module")
def take() -> Take:
    return make_take(FRAMES, views=2)


def captured(take: Take, folder: Path, checked: bool = False, **changed: Any) -> Performance:
    given = {
        **{"actor": take.actor, "cameras": take.cameras, "detections": take.detections},
        **{"rate": take.rate, "config": CONFIG, "until": Stage.INITIALIZE, **changed},
    }
    return capture(**given, checkpoint=Checkpoint(folder, checked=checked))


@pytest.fixture(scope="module")
def kept(take: Take, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Performance]:
    folder = tmp_path_factory.mktemp("kept")
    return folder, captured(take, folder)


def test_the_same_arguments_go_on_with_the_same_bits(
    take: Take, kept: tuple[Path, Performance]
) -> None:
    folder, first = kept
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {"inputs.log", "initialize.log"} <= set(before)
    again = captured(take, folder, workers=2)
    assert torch.equal(first.motion.angles, again.motion.angles)
    assert torch.equal(first.motion.translation, again.motion.translation)
    assert before == {path.name: path.read_bytes() for path in folder.iterdir()}


def test_another_capture_is_refused(take: Take, kept: tuple[Path, Performance]) -> None:
    joints = take.detections
    with torch.no_grad():
        larger = take.actor.with_vertices(1.01 * take.actor.vertices)
    moved = replace(take.cameras, translation=take.cameras.translation + 0.01)
    changes: list[tuple[str, dict[str, Any]]] = [
        ("joints", {"detections": replace(joints, joints2d=joints.joints2d + 1)}),
        ("joints", {"detections": replace(joints, confidence2d=joints.confidence2d / 2)}),
        ("joints", {"detections": joints.frames(slice(5))}),
        ("actor", {"actor": larger}),
        ("cameras", {"cameras": moved}),
        ("cameras, rate", {"cameras": moved, "rate": take.rate + 1}),
        ("config", {"config": replace(CONFIG, pose=replace(CONFIG.pose, window=6))}),
        ("solve_bones", {"solve_bones": True}),
        ("level", {"level": True}),
        ("up", {"up": torch.tensor([0.0, 1.0, 0.0])}),
        ("energies", {"energies": {"mine": print}}),
    ]
    for name, changed in changes:
        with pytest.raises(InputError, match=rf"another capture, which differs in {name}; give"):
            captured(take, kept[0], **changed)


def test_a_call_that_finished_nothing_leaves_the_folder_free(take: Take, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        captured(take, tmp_path, up=torch.zeros(3), until=Stage.TRACK_MOTION, detections=replace(
            take.detections, confidence2d=torch.zeros_like(take.detections.confidence2d)
        ))  # fmt: skip
    assert {path.name for path in tmp_path.iterdir()} == {"inputs.log"}
    captured(take, tmp_path)
    captured(take, tmp_path)
    with pytest.raises(InputError, match="another capture"):
        captured(take, tmp_path, rate=take.rate + 1)


def test_work_without_a_record_is_taken_as_it_is(
    take: Take, kept: tuple[Path, Performance], tmp_path: Path
) -> None:
    (tmp_path / "initialize.log").write_bytes((kept[0] / "initialize.log").read_bytes())
    found = captured(take, tmp_path, rate=take.rate + 1)
    assert torch.equal(found.motion.angles, kept[1].motion.angles)
    assert not (tmp_path / "inputs.log").exists()


def test_whoever_has_checked_a_folder_is_believed(take: Take, tmp_path: Path) -> None:
    captured(take, tmp_path, checked=True)
    assert not (tmp_path / "inputs.log").exists()
    assert list(Journal(tmp_path / "initialize.log").records())
