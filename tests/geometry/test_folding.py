"""Folds are found, and nothing else is taken for one."""

import math

import pytest
import torch
import trimesh

from perfcap.geometry.folding import find_folds
from perfcap.geometry.rotation import rotvec_to_matrix

F64 = torch.float64
BALL = trimesh.creation.icosphere(2)
VERTICES, FACES = torch.tensor(BALL.vertices), torch.tensor(BALL.faces)


def turned(angle):
    return VERTICES @ rotvec_to_matrix(torch.tensor([0.0, angle, 0.0], dtype=F64)).mT


def test_sound_deformations_have_no_folds():
    scaled = VERTICES * torch.tensor([1.0, 0.6, 1.4], dtype=F64)
    after = torch.stack((VERTICES, scaled, turned(1.2) + 3))
    folds = find_folds(VERTICES.expand(3, -1, -1), after, FACES)
    assert folds.flipped.shape == folds.collapsed.shape == (3, len(FACES))
    assert folds.count.tolist() == [0, 0, 0]
    assert folds.share.tolist() == [0, 0, 0]


def test_vertex_pushed_through_its_ring_flips_it():
    after = VERTICES.clone()
    after[40] = -0.8 * after[40]
    ring = (FACES == 40).any(1)
    folds = find_folds(VERTICES[None], after[None], FACES)
    assert torch.equal(folds.flipped[0], ring)
    assert folds.count == ring.sum()
    area = torch.tensor(BALL.area_faces)
    assert folds.share.item() == pytest.approx((area[ring].sum() / area.sum()).item())


def test_crushed_triangles_collapse():
    after = VERTICES.clone()
    face = FACES[17]
    after[face] = after[face].mean(0) + 0.1 * (after[face] - after[face].mean(0))
    folds = find_folds(VERTICES[None], after[None], FACES)
    assert folds.collapsed[0, 17]
    assert not folds.flipped[0, 17]


def test_batch_equals_loop_over_many_frames():
    after = VERTICES + 0.2 * torch.randn(
        2, 11, *VERTICES.shape, dtype=F64, generator=torch.Generator().manual_seed(1)
    )
    before = VERTICES.expand_as(after)
    folds = find_folds(before, after, FACES)
    assert folds.count.min() > 0
    for b in range(2):
        for f in range(11):
            alone = find_folds(before[b, f][None], after[b, f][None], FACES)
            assert torch.equal(alone.flipped[0], folds.flipped[b, f])
            assert torch.equal(alone.collapsed[0], folds.collapsed[b, f])
            assert alone.share[0] == pytest.approx(folds.share[b, f])


def test_what_had_no_area_is_sound_and_what_is_not_finite_is_spoilt():
    before = torch.zeros(1, 6, 3, dtype=F64)
    before[0, 3:] = torch.eye(3, dtype=F64)
    after = before.clone()
    after[0, 0, 0] = 1
    after[0, 4, 1] = math.nan
    faces = torch.tensor([[0, 1, 2], [3, 4, 5]])
    folds = find_folds(before, after, faces)
    assert folds.flipped.tolist() == folds.collapsed.tolist() == [[False, True]]
    assert folds.share.item() == 1


def test_turn_is_the_angle_allowed():
    for angle in (0.5, 0.7):
        cap = VERTICES[FACES].mean(1)[:, 1].abs() < 0.1  # normals across the axis turn fully
        folds = find_folds(VERTICES[None], turned(angle)[None], FACES[cap], turn=0.6)
        assert folds.flipped.any().item() == (angle > 0.6)
