"""The lifter: what it sees, how it learns, that training resumes to the same numbers."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from motion_files import write_library
from torch import nn

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.errors import InputError
from perfcap.train import loop as loop_module
from perfcap.train.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from perfcap.train.config import LifterConfig, LiftingData, LiftingLoss, LoopConfig
from perfcap.train.lifter import Lifter, LifterCommittee
from perfcap.train.lifter_task import LiftingTask, lifting_loss
from perfcap.train.loop import BEST, LAST, LOG, learning_rate, mixed_seed, train
from perfcap.train.motion_library import MotionLibrary

SMALL = LifterConfig(channels=16, dilations=(1, 3), dropout=0.1)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> MotionLibrary:
    return MotionLibrary.read(write_library(tmp_path_factory.mktemp("motion")))


def task(library: MotionLibrary, dense: float = 0.5) -> LiftingTask:
    data = LiftingData(frames=16)
    people = library.without(["03"]), library.of(["03"])
    return LiftingTask(*people, SMALL, data, LiftingLoss(), 0, dense)


def lifter(config: LifterConfig = SMALL) -> Lifter:
    torch.manual_seed(0)
    return Lifter(config).eval().double()


# --- the network ----------------------------------------------------------------------------------


def test_poses_are_about_the_hips_and_spreads_positive() -> None:
    joints, spread = lifter()(torch.randn(2, 11, 49).double())
    assert joints.shape == (2, 11, 16, 3) and spread.shape == (2, 11, 16)
    assert mid_hip(joints).abs().max() < 1e-12 and (spread > 0).all()


def test_an_answer_depends_on_its_reach_only() -> None:
    model = lifter()
    features = torch.randn(1, 30, 49).double()
    changed = features.clone()
    changed[:, 20] += 1
    apart = (model(changed)[0] - model(features)[0]).abs().amax((0, 2, 3)) > 0
    assert apart.nonzero().flatten().tolist() == list(range(16, 25)) and SMALL.reach == 4


def test_the_middle_of_three_poses_is_the_whole_networks() -> None:
    model = lifter()
    features = torch.randn(5, 9, 49).double()
    for whole, three in zip(model(features), model.sparse(features), strict=True):
        assert three.shape[1] == 3
        torch.testing.assert_close(whole[:, 4], three[:, 1])
    with pytest.raises(ValueError, match="expected 9 frames"):
        model.sparse(features[:, :8])
    with pytest.raises(ValueError, match=re.escape("(1, 3)")):
        lifter(LifterConfig(16, (1, 2))).sparse(features)


@pytest.mark.long
def test_taps_that_are_not_apart_by_powers_of_three_learn_from_whole_tracks(
    library: MotionLibrary,
) -> None:
    config, data = replace(SMALL, dilations=(1, 2), dropout=0.0), LiftingData(frames=16)
    people = library.without(["03"]), library.of(["03"])
    learner = LiftingTask(*people, config, data, LiftingLoss(), 0, dense=0.15)
    first, last = (learner.loss(0, 8, progress) for progress in (0.0, 1.0))
    assert first["velocity"] > 0 and all(torch.equal(first[name], last[name]) for name in last)


def test_a_committee_that_disagrees_expects_more_than_its_members() -> None:
    one, other, features = lifter(), lifter(), torch.randn(2, 11, 49).double()
    alone = one(features)
    torch.testing.assert_close(LifterCommittee([one, other])(features), alone)
    with torch.no_grad():  # 60 mm farther along x at the right wrist, 80 along y at the left
        bias = other.across.bias
        wrists = (LANDMARKS.index("r_wrist"), 0, 0.06), (LANDMARKS.index("l_wrist"), 1, 0.08)
        for joint, axis, shift in wrists:
            bias[3 * joint + axis] += shift
    joints, spread = LifterCommittee([one, other])(features)
    grown = (spread.square() - alone[1].square()).clamp(min=0).sqrt()
    for joint, axis, shift in wrists:
        torch.testing.assert_close(joints[..., joint, axis], alone[0][..., joint, axis] + shift / 2)
        torch.testing.assert_close(grown[..., joint], torch.full_like(grown[..., 0], shift / 2))
    torch.testing.assert_close(spread[..., :2], alone[1][..., :2])


def test_loss_of_the_truth_is_least_and_spread_learns_the_error() -> None:
    truth = torch.randn(3, 8, 16, 3)
    exact = lifting_loss(truth, torch.full((3, 8, 16), 1e-3), truth, LiftingLoss())
    assert exact["place"] == 0 and exact["velocity"] == 0
    off = truth + 0.1 * torch.nn.functional.normalize(torch.randn_like(truth), dim=-1)
    spreads = torch.linspace(0.02, 0.5, 49)
    values = [
        float(
            lifting_loss(off, torch.full((3, 8, 16), float(s)), truth, LiftingLoss())["likelihood"]
        )
        for s in spreads
    ]
    assert spreads[int(torch.tensor(values).argmin())] == pytest.approx(0.1, abs=0.011)


# --- the loop -------------------------------------------------------------------------------------


@pytest.mark.long
def test_training_lowers_the_error(library: MotionLibrary, tmp_path: Path) -> None:
    config = LoopConfig(steps=60, batch=32, learning_rate=5e-3, warmup=5, evaluate_every=10)
    learner = task(library, dense=0.15)
    before = next(iter(learner.evaluate(learner.model).values()))
    model = train(learner, config, tmp_path, {"a": 1})
    after = next(iter(learner.evaluate(model).values()))
    assert after < 0.6 * before
    lines = [json.loads(line) for line in (tmp_path / LOG).read_text().splitlines()]
    assert [line["step"] for line in lines] == [10, 20, 30, 40, 50, 60]
    assert lines[-1]["loss"] < lines[0]["loss"]


class Stop(Exception):
    pass


@pytest.mark.long
def test_a_run_that_was_killed_ends_with_the_same_weights(
    library: MotionLibrary, tmp_path: Path
) -> None:
    config = LoopConfig(steps=8, batch=8, warmup=2, evaluate_every=4, save_every=3)
    whole = train(task(library), config, tmp_path / "a", {"a": 1})

    def kill(stage: str, done: int, total: int) -> None:
        if done == 5:
            raise Stop

    with pytest.raises(Stop):
        train(task(library), config, tmp_path / "b", {"a": 1}, progress=kill)
    assert load_checkpoint(tmp_path / "b" / LAST).values["step"] == "3"
    torch.manual_seed(123)  # what the world's generator holds must not matter
    again = train(task(library), config, tmp_path / "b", {"a": 1}, resume=True)
    for a, b in zip(whole.state_dict().values(), again.state_dict().values(), strict=True):
        assert torch.equal(a, b)
    logs = [(tmp_path / name / LOG).read_text().splitlines() for name in "ab"]
    steps = [[json.loads(line)["step"] for line in log] for log in logs]
    assert steps[0] == steps[1] == [4, 8]


def test_training_leaves_the_worlds_generator_alone(library: MotionLibrary, tmp_path: Path) -> None:
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    train(task(library), LoopConfig(steps=2, batch=8), tmp_path, {})
    assert torch.equal(torch.rand(3), expected)


def test_another_configuration_does_not_resume(library: MotionLibrary, tmp_path: Path) -> None:
    config = LoopConfig(steps=2, batch=8)
    train(task(library), config, tmp_path, {"a": 1})
    with pytest.raises(InputError, match="another configuration"):
        train(task(library), config, tmp_path, {"a": 2}, resume=True)


@pytest.mark.parametrize(
    "change",
    [
        *({"steps": 0}, {"batch": 0}, {"save_every": 0}, {"evaluate_every": -1}),
        *({"learning_rate": -1.0}, {"learning_rate": math.nan}, {"clip": 0.0}),
        *({"average": 1.5}, {"average": math.nan}, {"weight_decay": -5.0}, {"warmup": -1}),
    ],
)
def test_settings_that_learn_nothing_are_refused(change: dict[str, float]) -> None:
    LoopConfig().require_sound()
    with pytest.raises(InputError, match=r"loop.*expected"):
        LoopConfig(**change).require_sound()  # type: ignore[arg-type]


def test_a_loss_that_is_not_finite_stops(
    library: MotionLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    learner = task(library)
    monkeypatch.setattr(learner, "loss", lambda *_: {"loss": torch.tensor(torch.nan)})
    with pytest.raises(InputError, match="not finite at step 0"):
        train(learner, LoopConfig(steps=2), tmp_path, {})


def test_learning_rate_rises_and_falls() -> None:
    config = LoopConfig(steps=100, warmup=10, learning_rate=1.0)
    rates = [learning_rate(config, step) for step in range(100)]
    assert rates[0] == pytest.approx(0.1) and max(rates) == 1.0 and rates[-1] < 0.01
    assert rates[9:] == sorted(rates[9:], reverse=True)


def test_several_processes_share_gradients(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every process takes its own batches, and the mean of all gradients."""
    calls: list[torch.Tensor] = []
    monkeypatch.setattr(loop_module, "_place", lambda: (1, 2))
    monkeypatch.setattr(loop_module.distributed, "all_reduce", lambda g: calls.append(g.mul_(2)))
    model = nn.Linear(3, 1)
    model(torch.ones(1, 3)).sum().backward()
    expected = model.weight.grad.clone()
    loop_module._share_gradients(model)
    assert len(calls) == 2 and torch.equal(model.weight.grad, expected)


# --- checkpoints ----------------------------------------------------------------------------------


def test_checkpoints_come_back(tmp_path: Path) -> None:
    tensors = {"model.a": torch.randn(3, 4).T, "average.b": torch.ones(2)}
    values = {"step": "3", "best": "0.5", "config": "{}"}
    save_checkpoint(tmp_path / BEST, Checkpoint(tensors, values))
    again = load_checkpoint(tmp_path / BEST)
    assert torch.equal(again.part("model")["a"], tensors["model.a"]) and again.values == values
    assert sorted(p.name for p in tmp_path.iterdir()) == [BEST]


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", bytes(100), b"\xff" * 64])
def test_files_that_are_no_checkpoints(tmp_path: Path, data: bytes) -> None:
    (tmp_path / LAST).write_bytes(data)
    with pytest.raises(InputError, match="is not a checkpoint"):
        load_checkpoint(tmp_path / LAST)
    with pytest.raises(InputError, match="no such file"):
        load_checkpoint(tmp_path / "none")


def test_seeds_of_neighbours_differ_and_fit_every_generator() -> None:
    seeds = [mixed_seed(seed, number) for seed in range(20) for number in range(20)]
    assert len(set(seeds)) == len(seeds) and all(0 <= seed < 2**63 for seed in seeds)
