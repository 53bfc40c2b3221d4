from dataclasses import fields

import pytest
import torch

from perfcap.errors import InputError
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.metrics import (
    bone_length_variation,
    correct_share,
    joint_errors,
    limit_violations,
    reprojection_error,
)

FPS = 30.0


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


def joints(*batch, frames=12):
    return torch.randn(*batch, frames, 16, 3, dtype=torch.float64)


def test_truth_has_no_error():
    truth = joints()
    errors = joint_errors(truth, truth, FPS)
    assert errors.frames == 12
    assert errors.missing == 0
    for name in ("mpjpe", "mpjpe_root", "mpjpe_translation", "acceleration_error"):
        assert getattr(errors, name) == 0
    assert errors.mpjpe_similarity < 1e-9
    assert errors.pck == errors.auc == 100
    assert errors.jerk == errors.jerk_truth


def test_each_alignment_removes_its_motion():
    truth = joints()
    shifted = truth + torch.tensor([0.3, 0.0, 0.4], dtype=torch.float64)
    errors = joint_errors(shifted, truth, FPS)
    torch.testing.assert_close(errors.mpjpe, errors.mpjpe.new_tensor(500.0))
    assert errors.mpjpe_root < 1e-9
    assert errors.mpjpe_translation < 1e-9
    turn = rotvec_to_matrix(torch.randn(12, 3, dtype=torch.float64))
    moved = joint_errors(1.7 * truth @ turn.mT + 4, truth, FPS)
    assert moved.mpjpe_similarity < 1e-9
    assert moved.mpjpe_translation > 100


def test_missing_frames_are_left_out_and_counted():
    truth = joints(3)
    estimate = truth + 0.01 * joints(3)
    kept = [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
    expected = joint_errors(estimate[:, kept], truth[:, kept], FPS)
    estimate[:, 5, 3, 1] = torch.nan
    found = joint_errors(estimate, truth, FPS)
    assert (found.missing == 1).all()
    assert (found.frames == 11).all()
    for name in ("mpjpe", "mpjpe_root", "mpjpe_translation", "mpjpe_similarity", "pck", "auc"):
        torch.testing.assert_close(getattr(found, name), getattr(expected, name))
    parts = [joint_errors(estimate[:, s], truth[:, s], FPS) for s in (slice(0, 5), slice(6, 12))]
    acceleration = (3 * parts[0].acceleration_error + 4 * parts[1].acceleration_error) / 7
    torch.testing.assert_close(found.acceleration_error, acceleration)
    torch.testing.assert_close(found.jerk, (2 * parts[0].jerk + 3 * parts[1].jerk) / 5)
    torch.testing.assert_close(
        found.jerk_truth, (2 * parts[0].jerk_truth + 3 * parts[1].jerk_truth) / 5
    )


def test_no_frames_at_all():
    truth = joints()
    errors = joint_errors(torch.full_like(truth, torch.nan), truth, FPS)
    assert errors.frames == 0
    assert errors.mpjpe.isnan()
    assert errors.pck.isnan()
    short = joint_errors(truth[:2], truth[:2], FPS)
    assert short.mpjpe == 0
    assert short.acceleration_error.isnan()
    assert short.jerk.isnan()


def test_batch_equals_loop():
    truth = joints(2, 3)
    estimate = truth + 0.05 * joints(2, 3)
    estimate[1, 2, 4] = torch.nan
    batched = joint_errors(estimate, truth, FPS)
    one = joint_errors(estimate[1, 2], truth[1, 2], FPS)
    for field in fields(batched):
        torch.testing.assert_close(getattr(batched, field.name)[1, 2], getattr(one, field.name))


def test_jerk_of_a_cubic():
    time = torch.arange(10, dtype=torch.float64)[:, None, None] / FPS
    path = (time**3).expand(10, 16, 3) / 6  # third derivative one along each axis
    errors = joint_errors(path, path, FPS)
    torch.testing.assert_close(errors.jerk, errors.jerk.new_tensor(3**0.5), rtol=1e-9, atol=0)


def test_correct_share_is_strict():
    errors = torch.tensor([[149.9, 150.0, 150.1, 0.0]], dtype=torch.float64)
    assert correct_share(errors, torch.tensor([True])) == 50


def test_reprojection_leaves_missing_frames_out():
    pixels = torch.zeros(4, 16, 2, dtype=torch.float64)
    moved = pixels + torch.tensor([3.0, 4.0], dtype=torch.float64)
    moved[2, 0] = torch.nan
    torch.testing.assert_close(reprojection_error(moved, pixels), moved.new_tensor(5.0))


def test_reprojection_of_all_joints_that_are_known():
    pixels, truth = 100 * joints(2)[..., :2], 100 * joints(2)[..., :2]
    whole = reprojection_error(pixels, truth)
    assert torch.equal(reprojection_error(pixels, truth, partial=True), whole)
    truth[:, 4:, 3] = truth[1, 0] = torch.nan
    apart = (pixels - truth).norm(dim=-1)
    mean = torch.stack([each.nanmean() for each in apart])
    torch.testing.assert_close(reprojection_error(pixels, truth, partial=True), mean)
    first = torch.stack([apart[0, :4].mean(), apart[1, 1:4].mean()])
    torch.testing.assert_close(reprojection_error(pixels, truth), first)


def test_bone_length_variation():
    points = torch.zeros(3, 4, 3, 3, dtype=torch.float64)
    points[:, :, 1, 0] = 0.5
    points[:, :, 2, 0] = torch.tensor([0.7, 0.9, 0.7, 0.9], dtype=torch.float64)
    found = bone_length_variation(points, [(0, 1), (1, 2)])
    torch.testing.assert_close(found, torch.full((3,), 50.0, dtype=torch.float64))
    points[0, 1] = torch.nan
    thirds = 1000 * points[0, [0, 2, 3], 2, 0].std(correction=0) / 2
    torch.testing.assert_close(bone_length_variation(points, [(0, 1), (1, 2)])[0], thirds)
    turned = points[1:] @ rotvec_to_matrix(torch.randn(2, 4, 3, dtype=torch.float64)).mT
    torch.testing.assert_close(bone_length_variation(turned, [(0, 1), (1, 2)]), found[1:])


def test_limit_violations():
    angles = torch.tensor([[0.0, 1.0], [0.5, -1.5], [torch.nan, 9.0]], dtype=torch.float64)
    lower, upper = torch.tensor([[-1.0, -1.0], [1.0, 1.0]], dtype=torch.float64)
    found = limit_violations(angles, lower, upper)
    assert found.share == 25
    assert found.worst == 0.5
    inside = limit_violations(angles[:1] + 1e-8, lower, upper)
    assert inside.share == 0
    assert inside.worst == 0


def test_refuses_shapes():
    with pytest.raises(InputError, match="shape"):
        joint_errors(joints(), joints(frames=11), FPS)
    with pytest.raises(InputError, match=r"\(0, 16, 3\).*one or more"):
        joint_errors(joints()[:0], joints()[:0], FPS)
    with pytest.raises(InputError, match="shape"):
        reprojection_error(torch.zeros(3, 2), torch.zeros(3, 2))


@pytest.mark.parametrize("kind", [torch.float16, torch.float32, torch.int64])
def test_an_estimate_of_another_precision_than_the_truth(kind):
    truth = torch.arange(2 * 8 * 16 * 3.0, dtype=torch.float64).reshape(2, 8, 16, 3).sin()
    estimate = (4 * truth.cos()).to(kind)
    found = joint_errors(estimate, truth, 30)
    exact = joint_errors(estimate.double(), truth, 30)
    for each in fields(found):
        assert torch.equal(getattr(found, each.name), getattr(exact, each.name)), each.name
    with pytest.raises(InputError, match="give both as float32 or both"):
        procrustes(estimate.to(torch.float16), truth)
