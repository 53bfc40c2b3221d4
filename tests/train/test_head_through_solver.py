"""A head that learns what views say together: directly, and through the solves of views alone."""

from dataclasses import replace

import pytest
import torch
from takes import Take, make_take
from torch import Tensor

from perfcap.app.train_head import refiner
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.train.config import HeadLoss
from perfcap.train.head import Head, best_decay, rooted, score_directly
from perfcap.train.head_crops import CropAnswers, Watched
from perfcap.train.head_task import HeadTask, Split

FRAMES, VIEWS, SIZE = 12, 2, 256
ARM = [LANDMARKS.index(name) for name in ("l_elbow", "l_wrist")]
SPLIT = Split(slice(0, 9), slice(9, FRAMES))


@pytest.fixture(scope="module")
def take() -> Take:
    return make_take(FRAMES, views=VIEWS)


def answers(take: Take, exchanged: bool = False) -> CropAnswers:
    """Exact 2D joints; 3D ones with an arm that is bent towards the camera, in every view."""
    joints = take.actor.joints(take.truth)
    known3d = rooted(take.cameras.to_camera(joints)).transpose(0, 1)[:, :, None].float()
    known2d = take.detections.joints2d.transpose(0, 1)[:, :, None].float()
    wrong = known3d.clone()
    wrong[..., ARM, 2] -= torch.tensor([0.1, 0.25])
    shape = (VIEWS, FRAMES, 1)
    random = torch.Generator().manual_seed(0)
    return CropAnswers(
        torch.randn(*shape, 6, generator=random),
        known2d,
        torch.ones(*shape, 16),
        wrong,
        known2d,
        known3d,
        torch.full(shape, exchanged),
        torch.tensor([False]),
        torch.eye(3)[:2].expand(*shape, 2, 3),
        torch.eye(3).expand(*shape, 3, 3),
    )


def watched(take: Take) -> Watched:
    def read(view: int, start: int, stop: int) -> Tensor:
        raise AssertionError("crops are known")

    seen = take.detections
    return Watched(
        read,  # type: ignore[arg-type]
        take.cameras,
        take.actor.joints(take.truth),
        torch.ones(FRAMES, dtype=torch.float64),
        seen.joints2d,
        seen.confidence2d,
        take.rate,
    )


def task(take: Take, crops: CropAnswers) -> HeadTask:
    head = Head.of(crops.features.flatten(0, 2), SIZE, LANDMARKS16)
    solver = refiner(take.actor, take.rate)
    return HeadTask(head, crops, watched(take), SPLIT, solver, 9, HeadLoss(stay=0.0), 0)


@pytest.mark.parametrize("exchanged", [False, True])
def test_a_planted_bias_is_learned_directly(take: Take, exchanged: bool) -> None:
    crops = answers(take, exchanged)
    trust = torch.ones(FRAMES)
    lesson = crops.lesson(SPLIT.learned, trust, SIZE)
    test = crops.lesson(SPLIT.chosen, trust, SIZE, plain=True)
    head = Head.of(lesson.features, SIZE, LANDMARKS16)
    before = score_directly(head, test)
    decay = best_decay(head, lesson, (1e-3, 1.0), test)
    assert decay in (1e-3, 1.0) and score_directly(head, test) < 0.2 * before
    # what the network calls left is moved, whatever it is
    moved = int(head.offset.detach().reshape(16, 5)[:, 4].argmax())
    assert LANDMARKS[moved] == ("r_wrist" if exchanged else "l_wrist")


@pytest.mark.long
def test_disagreement_of_views_moves_the_head_the_right_way(take: Take) -> None:
    study = task(take, answers(take))
    before = study.evaluate(study.model)
    loss = study.loss(0, VIEWS, 0.0)["loss"]
    loss.backward()
    gradient = study.model.offset.grad
    assert gradient is not None and bool(gradient.isfinite().all())
    assert float(gradient.reshape(16, 5)[ARM[1], 4]) < 0  # the wrist should be farther away
    for step in range(4):
        (slope,) = torch.autograd.grad(study.loss(step, VIEWS, 0.0)["loss"], study.model.offset)
        with torch.no_grad():
            slope.reshape(16, 5)[:, :2] = 0  # pixels are exact
            study.model.offset -= 0.05 * slope / slope.abs().max()
    after = study.evaluate(study.model)
    assert after["held_out"] < 0.8 * before["held_out"]
    assert after["solved_mm"] < 0.8 * before["solved_mm"]


def test_detections_that_nobody_believes_teach_nothing(take: Take) -> None:
    crops = answers(take)
    study = task(take, crops)
    study._watched = replace(watched(take), confidence=torch.zeros(FRAMES, VIEWS, 16))
    assert float(study.loss(0, VIEWS, 0.0)["loss"].detach()) == 0


def test_one_frame_of_three_is_read_from_its_place(take: Take) -> None:
    asked = []

    def read(view: int, start: int, stop: int) -> Tensor:
        asked.append((view, start, stop))
        return torch.arange(start, stop)

    third = replace(watched(take), read=read).every(3)  # type: ignore[arg-type]
    assert third.rate == take.rate / 3 and len(third.joints) == len(third.trust) == 4
    assert third.read(1, 1, 4).tolist() == [3, 6, 9] and asked == [(1, 3, 10)]
