"""Alignments and joints that are missing one by one."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.metrics import (
    Alignment,
    action_table,
    align,
    aligned_distances,
    counted_joints,
    joint_errors,
    joint_table,
)

F64 = torch.float64


def joints(*batch: int, frames: int = 12, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*batch, frames, 16, 3, dtype=F64, generator=generator)


def turning(frames: int = 12) -> Tensor:
    """Rotations about the vertical, once around."""
    angle = torch.linspace(0, 2 * math.pi, frames, dtype=F64)
    return rotvec_to_matrix(angle[:, None] * torch.tensor([0, 1, 0], dtype=F64))


def test_a_constant_offset_in_the_body_is_gone() -> None:
    body = joints(frames=1)
    offset = 0.05 * joints(frames=1, seed=1)
    offset[:, [8, 12, 1]] = 0  # what tells the axes of the body
    turns = turning()
    place = joints(frames=12, seed=2)[:, :1]
    truth, estimate = body @ turns.mT + place, (body + offset) @ turns.mT + place
    errors = joint_errors(estimate, truth, 30.0)
    assert errors.mpjpe > 40
    assert errors.mpjpe_first_frame < 1e-9


def test_a_joint_is_compensated_from_its_own_first_frame() -> None:
    truth = joints()
    estimate = truth + 0.02
    estimate[:3, 4] = torch.nan  # appears late
    valid = counted_joints(estimate, truth, partial=True)
    apart = aligned_distances(estimate, truth, valid, Alignment.FIRST_FRAME)
    assert apart[:3, 4].isnan().all()
    assert apart[3, 4] < 1e-9
    assert apart[0, :4].max() < 1e-9


@pytest.mark.parametrize("alignment", list(Alignment))
def test_joints_that_do_not_count_change_nothing(alignment: Alignment) -> None:
    truth = joints(2)
    estimate = truth + 0.1 * joints(2, seed=1)
    valid = torch.ones(2, 12, 16, dtype=torch.bool)
    valid[:, :, [3, 9]] = False
    expected = aligned_distances(estimate, truth, valid, alignment)
    spoiled = estimate.clone()
    spoiled[:, :, 3] = torch.nan
    spoiled[:, :, 9] = 1e9
    found = aligned_distances(spoiled, truth, valid, alignment)
    torch.testing.assert_close(found, expected, equal_nan=True)
    assert found[..., [3, 9]].isnan().all()


@pytest.mark.parametrize("alignment", list(Alignment))
def test_alignment_moves_the_truth_nowhere(alignment: Alignment) -> None:
    truth = joints(3)
    valid = torch.ones(3, 12, 16, dtype=torch.bool)
    torch.testing.assert_close(align(truth, truth, valid, alignment), truth)


def test_partial_frames_count_with_what_they_have() -> None:
    truth = joints()
    estimate = truth + torch.tensor([0.03, 0, 0.04], dtype=F64)
    estimate[4, 2] = torch.nan
    estimate[7] = torch.nan
    errors = joint_errors(estimate, truth, 30.0, partial=True)
    assert (errors.frames, errors.missing, errors.missing_joints) == (11, 1, 1)
    torch.testing.assert_close(errors.mpjpe, errors.mpjpe.new_tensor(50.0))
    whole = joint_errors(estimate, truth, 30.0)
    assert (whole.frames, whole.missing, whole.missing_joints) == (10, 2, 0)


def test_a_joint_that_the_truth_never_has() -> None:
    """Other data sets have no crown: every frame still counts."""
    truth = joints()
    truth[:, 0] = torch.nan
    errors = joint_errors(truth.nan_to_num() + 0.01, truth, 30.0, partial=True)
    assert errors.frames == 12
    assert errors.missing_joints == 12
    assert errors.mpjpe_similarity < 1e-6
    assert errors.acceleration_error < 1e-9
    assert joint_errors(truth, truth, 30.0).frames == 0


def test_zero_confidence_is_missing() -> None:
    truth = joints()
    confidence = torch.ones(12, 16, dtype=F64)
    confidence[0, 0], confidence[1, 1] = 0, torch.nan
    errors = joint_errors(truth, truth, 30.0, confidence=confidence)
    assert errors.missing == 2
    with pytest.raises(InputError, match="confidence has shape"):
        joint_errors(truth, truth, 30.0, confidence=confidence[0])


def test_without_hips_there_is_no_root() -> None:
    truth = joints()
    truth[3, 8] = torch.nan
    errors = joint_errors(truth, truth, 30.0, partial=True)
    assert errors.frames == 12
    assert errors.mpjpe_root == 0 and errors.pck == 100
    assert (errors.frames_root, errors.frames_first_frame) == (11, 11)  # the estimate's, too
    truth[5, 2:] = truth[6, 1:] = torch.nan
    errors = joint_errors(truth.nan_to_num(0.5), truth, 30.0, partial=True)
    assert (errors.frames, errors.frames_translation, errors.frames_similarity) == (12, 11, 10)


def test_axes_of_a_body_are_those_of_its_estimate() -> None:
    """A hip that the truth lacks leaves the offsets of all others where they were."""
    truth, estimate = joints(), joints(seed=1)
    whole = joint_errors(estimate, truth, 30.0, partial=True)
    all_joints = torch.ones(12, 16, dtype=torch.bool)
    apart = aligned_distances(estimate, truth, all_joints, Alignment.FIRST_FRAME)
    torch.testing.assert_close(whole.mpjpe_first_frame, apart.mean())
    truth[4:, 8] = torch.nan
    apart[4:, 8] = torch.nan
    part = joint_errors(estimate, truth, 30.0, partial=True)
    torch.testing.assert_close(part.mpjpe_first_frame, apart.nanmean())
    confidence = torch.ones(12, 16, dtype=F64)
    confidence[4:, 8] = 0  # nor is the estimate known there
    unsure = joint_errors(estimate, truth, 30.0, confidence=confidence, partial=True)
    torch.testing.assert_close(unsure.mpjpe_first_frame, apart[:4].mean())
    assert (part.frames_first_frame, unsure.frames_first_frame) == (12, 4)
    with pytest.raises(InputError, match="expected bool"):
        aligned_distances(
            estimate, truth, all_joints, Alignment.FIRST_FRAME, known=all_joints.double()
        )


def test_partial_batch_equals_loop() -> None:
    truth = joints(2, 3)
    estimate = truth + 0.05 * joints(2, 3, seed=1)
    estimate[1, 2, 4, 5] = torch.nan
    batched = joint_errors(estimate, truth, 30.0, partial=True)
    one = joint_errors(estimate[1, 2], truth[1, 2], 30.0, partial=True)
    for name in vars(one):
        torch.testing.assert_close(getattr(batched, name)[1, 2], getattr(one, name))


def test_table_of_joints() -> None:
    errors = torch.tensor([[1.0, torch.nan], [3.0, torch.nan]], dtype=F64)
    table = joint_table(errors, ("a", "b"))
    assert table["a"] == 2 and table["b"].isnan()
    with pytest.raises(InputError, match="names"):
        joint_table(errors, ("a",))


def test_table_of_actions_weighs_actions_alike() -> None:
    walk, sit = torch.full((90, 2), 10.0), torch.full((10, 2), 30.0)
    table = action_table({"walk": [walk[:50], walk[50:]], "sit": [sit]})
    assert (table["walk"], table["sit"], table["mean"]) == (10, 30, 20)
    assert action_table({}) == {}
