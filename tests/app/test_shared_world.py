"""People of one capture share a world: one direction is up for all of them."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from runs import Command
from synthetic import actor
from takes import sway

from perfcap.app.level import Level, level_of
from perfcap.app.together import on_their_floors
from perfcap.errors import InputError
from perfcap.io.moving_rig import read_moving_rig
from perfcap.io.result import Result, read_result
from perfcap.pipeline.floor import Floor
from perfcap.pipeline.retargeting import Retargeted
from perfcap.pipeline.surroundings import shared_up

LYING = [1, 0, 2], np.array([1.0, -1.0, 1.0])


def leaning(degrees: float) -> torch.Tensor:
    turn = math.radians(degrees)
    return torch.tensor([math.sin(turn), math.cos(turn), 0.0], dtype=torch.float64)


def lying(result: Result, aside: float) -> Result:
    order, sign = LYING
    joints = result.joints[..., order] * sign
    ground = result.joints[..., 1].min() - joints[..., 1].min()
    return replace(result, joints=joints + np.array([aside, ground, 0.0]))


def with_floor(result: Result, normal: torch.Tensor, support: float = 0.97) -> Result:
    floor = Floor(normal, torch.zeros(()), 0.05, support).report()
    return replace(result, report={**result.report, "floor": floor})


def test_of_two_who_stand_and_lie_one_is_followed(captured: Path) -> None:
    standing = read_result(captured)
    along = level_of([standing]).axis
    flat = lying(standing, 1.5)
    assert torch.equal(level_of([standing, flat]).axis, along)
    assert torch.equal(level_of([flat, standing]).axis, along)
    assert not torch.equal(level_of([flat]).axis, along)  # alone, nothing says otherwise


def test_one_person_needs_no_comparison() -> None:
    assert shared_up([torch.rand(3, 16, 3)], [leaning(0), leaning(90)]) == 0


def test_a_floor_that_leans_is_named(captured: Path) -> None:
    result = read_result(captured)
    up = level_of([result]).axis
    assert up.tolist() == [0, 1, 0]
    tilted = level_of([with_floor(result, leaning(25))])
    found, lines = tilted.chosen("--world-up", "auto")
    assert torch.equal(found, up) and "leans by 25 degrees" in lines[0]
    found, lines = tilted.chosen("--world-up", "floor")
    assert torch.allclose(found, leaning(25)) and not lines
    assert "the person lies" in tilted.chosen("--world-up", "x")[1][0]


@pytest.mark.parametrize(("degrees", "support"), [(0, 0.97), (6, 0.97), (25, 0.4)])
def test_level_and_unsure_floors_are_not_named(
    captured: Path, degrees: float, support: float
) -> None:
    level = level_of([with_floor(read_result(captured), leaning(degrees), support)])
    assert not level.chosen("--world-up", "auto")[1]


def test_no_floor_cannot_be_level() -> None:
    with pytest.raises(InputError, match="found none"):
        Level(leaning(0)).chosen("--up", "floor")


@pytest.mark.parametrize("damaged", [None, [], {"normal": [0, 1]}, {"normal": "up", "support": 1}])
def test_damaged_floors_are_none(captured: Path, damaged: object) -> None:
    result = read_result(captured)
    assert level_of([replace(result, report={**result.report, "floor": damaged})]).normal is None


def test_files_are_level_where_the_floor_is_asked_for(
    captured: Path, tmp_path: Path, perfcap: Command
) -> None:
    folder = Path(shutil.copytree(captured, tmp_path / "a"))
    report = json.loads((folder / "run.json").read_text())
    report["floor"] = Floor(leaning(25), torch.zeros(()), 0.05, 0.97).report()
    (folder / "run.json").write_text(json.dumps(report))
    call = ["export", folder, "--to", "npz", "--name", "b"]
    assert "--world-up floor makes it level" in perfcap(call).out
    assert "is level" in perfcap([*call, "--world-up", "floor"]).out
    with np.load(folder / "export" / "b.npz") as data:
        turned = data["joints3d"]
    assert np.allclose(turned[..., 1], read_result(folder).joints @ leaning(25).numpy(), atol=1e-6)
    drawn = ["render", folder, "--freeze", 0, "--seconds", 0.05, "--size", 64, 48]
    told = perfcap([*drawn, "--out", tmp_path / "a.mp4"])
    assert "--up floor makes it level" in told.out
    assert perfcap([*drawn, "--up", "floor", "--out", tmp_path / "b.mp4"]).code == 0


@pytest.mark.long
def test_people_stay_together_on_another_character(
    captured: Path, tmp_path: Path, perfcap: Command
) -> None:
    """The floor of each is found from their own feet; one of them is taken for all."""
    several = tmp_path / "several"
    for name, lean in (("person1", 12.0), ("person2", -12.0)):
        shutil.copytree(captured, several / name)
        report = json.loads((several / name / "run.json").read_text())
        report["floor"] = Floor(leaning(lean), torch.zeros(()), 0.05, 0.97).report()
        (several / name / "run.json").write_text(json.dumps(report | {"person": name}))
    people = [{"folder": "person1"}, {"folder": "person2"}]
    (several / "people.json").write_text(json.dumps({"K": 2, "people": people}))
    (several / "run.json").write_text("{}")
    out = tmp_path / "out"
    assert perfcap(["retarget", several, "--actor", "sam", "--out", out]).code == 0
    found = [read_result(out / name).joints for name in ("person1", "person2")]
    assert np.abs(found[0] - found[1]).max() < 1e-6


@pytest.mark.parametrize(
    ("lowered", "heights"),
    [
        ([0.0, 0.6], [0.0, 0.6]),  # the second stands on a stage
        ([-0.6, 0.0], [0.0, 0.6]),  # the floor of the stage was taken for that of all
        ([-0.6, None], [0.0, 0.6]),
        ([0.0, None], [0.0, 0.0]),
        ([0.03, 0.15], [0.0, 0.0]),  # as well as floors are found
        ([None, None], [0.0, 0.0]),
        ([0.8], [0.0]),
    ],
)
def test_whoever_stands_on_a_stage_stays_there(
    lowered: list[float | None], heights: list[float]
) -> None:
    person = actor()
    floor = Floor(leaning(0), torch.zeros((), dtype=torch.float64), 0.0, 1.0)
    people = [
        Retargeted(sway(person, 3), None if each is None else floor, None, 1.0, each)
        for each in lowered
    ]
    found = on_their_floors([(each, person) for each in people])
    for one, before, height in zip(found, people, heights, strict=True):
        moved = one.motion.translation - before.motion.translation
        assert torch.allclose(moved, torch.tensor([0.0, height, 0.0]).to(moved))
        assert one.floor is None or float(one.floor.height) == pytest.approx(height)


@pytest.mark.long
def test_whoever_lies_in_a_retargeted_motion_lies_in_the_next(
    captured: Path, tmp_path: Path, perfcap: Command
) -> None:
    once = tmp_path / "once"
    call = ["retarget", captured, "--actor", "sam", "--floor", "none", "--out", once]
    assert perfcap(call).code == 0
    assert read_moving_rig(once).level and not read_moving_rig(captured).level
