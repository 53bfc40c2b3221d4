"""Trust falls where the person is hidden or detections contradict each other, and says so."""

from dataclasses import replace

import pytest
import torch
from takes import make_take, without

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.trust import THRESHOLD, Trust, judge_frames
from perfcap.pipeline.trust_weights import FEATURES

F64 = torch.float64


def captured(views: int = 1, hidden: slice | None = None, noise: float = 0.0) -> Performance:
    take = make_take(60, views=views)
    detections = take.detections
    if hidden is not None:
        detections = without(detections, hidden)
    return capture(take.actor, take.cameras, shaken(detections, noise), take.rate)


def shaken(detections: Detections, noise: float) -> Detections:
    """With errors of so many pixels."""
    random = torch.Generator().manual_seed(0)
    shift = noise * torch.randn(detections.joints2d.shape, generator=random, dtype=F64)
    return replace(detections, joints2d=detections.joints2d + shift)


@pytest.mark.long
def test_exact_detections_are_trusted() -> None:
    for views in (1, 2):
        trust = captured(views).trust
        assert trust is not None
        assert (trust.value > THRESHOLD).all() and not trust.doubtful
        assert float(trust.error.min()) > 0 and float(trust.error.max()) < 80


@pytest.mark.long
def test_frames_in_which_nobody_is_seen_are_named() -> None:
    found = captured(hidden=slice(20, 45))
    trust = found.trust
    assert trust is not None
    assert trust.value[25:40].max() < THRESHOLD < trust.value[:12].min()
    assert float(trust.error[30]) > 2 * float(trust.error[5])
    ((start, stop, reason),) = trust.doubtful
    assert 15 <= start <= 25 and 40 <= stop <= 50 and "not detected" in reason
    assert trust.considerable and not found.trusted
    (sentence,) = trust.sentences(first_frame=100)
    assert f"frames {100 + start} to {99 + stop}" in sentence and "mm" in sentence
    report = found.report(first_frame=100)["quality"]
    assert report["trusted"] is False and len(report["expected_error_mm"]) == 60
    assert report["not_trusted"][0]["frames"] == [100 + start, 100 + stop]


def test_frames_that_are_close_in_time_are_judged_together() -> None:
    take = make_take(20)
    trust = capture(take.actor, take.cameras, take.detections, 9e4).trust  # reaches over all
    assert trust is not None and trust.value.isfinite().all()
    assert float(trust.value.max() - trust.value.min()) < 0.1


def doubted(deviation: float, views: int = 1, noise: float = 0.0) -> Trust:
    """Of frames 20 to 29, whose 3D poses are said to be so far off; others are good to 3 cm."""
    take = make_take(60, views=views)
    said = torch.full(take.detections.trusted3d.shape, 0.03, dtype=F64)
    said[20:30] = deviation
    detections = replace(shaken(take.detections, noise), deviation3d=said)
    trust = capture(take.actor, take.cameras, detections, take.rate).trust
    assert trust is not None
    return trust


@pytest.mark.long
def test_poses_that_are_said_to_be_far_off() -> None:
    # errors of 8 px: exact joints leave little to doubt
    sure, unsure = doubted(0.03, noise=8.0), doubted(0.4, noise=8.0)
    assert not sure.doubtful
    assert unsure.value[22:28].max() < sure.value[22:28].min() - 0.1
    assert unsure.error[22:28].min() > 2 * sure.error[22:28].max()
    torch.testing.assert_close(unsure.value[:12], sure.value[:12])
    ((start, stop, reason),) = doubted(1e3).doubtful
    assert 15 <= start <= 22 and 28 <= stop <= 34 and "not sure of them" in reason


@pytest.mark.long
@pytest.mark.parametrize("views", [2, 4])
def test_a_joint_that_no_view_bears_out_is_named_in_several(views: int) -> None:
    """Other joints of many views that agree do not make up for it."""
    take = make_take(40, views=views)
    joints = take.detections.joints2d.clone()
    wrist, span = LANDMARKS.index("r_wrist"), take.detections.person_height()
    for view in range(views):  # each has it somewhere else
        aside = torch.tensor([[0.0, 0.4], [0.4, 0.0], [0.0, -0.4], [-0.4, 0.0]], dtype=F64)[view]
        joints[10:25, view, wrist] += span[view] * aside
    detections = replace(take.detections, joints2d=joints).without_poses()
    trust = capture(take.actor, take.cameras, detections, take.rate).trust
    assert trust is not None
    assert (trust.value[13:22] < THRESHOLD).all() and (trust.value[:6] > THRESHOLD).all()
    assert (trust.value[31:] > THRESHOLD).all()


@pytest.mark.long
def test_a_neck_that_is_defined_otherwise_says_nothing_of_frames() -> None:
    """Some detectors call the middle of the shoulders so, and actors a joint far above it."""
    take = make_take(40, views=3)
    neck, span = LANDMARKS.index("neck"), take.detections.person_height()

    def trusted(frames: slice) -> torch.Tensor:
        joints = take.detections.joints2d.clone()
        for view, side in enumerate((0.1, -0.1, 0.05)):  # no place agrees with all of them
            joints[frames, view, neck] += span[view] * torch.tensor([side, 0.1], dtype=F64)
        detections = replace(take.detections, joints2d=joints).without_poses()
        trust = capture(take.actor, take.cameras, detections, take.rate).trust
        assert trust is not None
        return trust.value

    assert (trusted(slice(None)) > THRESHOLD).all()
    assert (trusted(slice(10, 25))[13:22] < THRESHOLD).all()  # elsewhere it is seen where it is


@pytest.mark.long
def test_several_views_need_nobody_to_say_so() -> None:
    torch.testing.assert_close(doubted(0.03, views=2).value, doubted(0.4, views=2).value)


@pytest.mark.long
def test_joints_that_a_set_lacks_say_nothing() -> None:
    """COCO's 17 have no crown, neck and toes; hidden legs are another matter."""
    take = make_take(60, views=2)

    def blind(*names: str) -> Trust:
        confidence = take.detections.confidence2d.clone()
        confidence[..., [LANDMARKS.index(name) for name in names]] = 0
        detections = replace(take.detections, confidence2d=confidence).without_poses()
        trust = capture(take.actor, take.cameras, detections, take.rate).trust
        assert trust is not None
        return trust

    whole = blind()
    assert not blind("head_top", "neck", "l_toe", "r_toe").doubtful
    legs = blind("l_knee", "r_knee", "l_ankle", "r_ankle", "l_toe", "r_toe")
    assert legs.value.max() < whole.value.min() and legs.error.min() > 1.2 * whole.error.max()


@pytest.mark.long
def test_noise_lowers_trust() -> None:
    clean, noisy = captured().trust, captured(noise=40.0).trust
    assert clean is not None and noisy is not None
    assert float(noisy.value.mean()) < float(clean.value.mean()) - 0.1
    assert float(noisy.error.mean()) > 1.5 * float(clean.error.mean())


def test_a_short_doubt_is_not_considerable() -> None:
    value = torch.ones(100, dtype=F64)
    few = Trust(value, 30 * value, ((10, 30, "x"),))
    many = Trust(value, 30 * value, ((10, 30, "x"), (60, 70, "y")))
    assert not few.considerable and many.considerable


def test_evidence_is_in_the_stated_order() -> None:
    assert len(FEATURES) == 10
    evidence = torch.zeros(4, len(FEATURES), dtype=F64)
    worse = evidence.clone()
    worse[:, FEATURES.index("worst_pixels")] = 3.0
    assert (judge_frames(worse).value < judge_frames(evidence).value).all()
