"""Metrics name shares, metres and skins that are none; each was taken for what it is not."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh

from perfcap.errors import InputError
from perfcap.metrics import (
    align,
    aligned_distances,
    area_under_curve,
    correct_share,
    image_correct_share,
    reprojection_error,
    skin_gap,
    torso_size,
)

GENERATOR = torch.Generator().manual_seed(2)
TRUTH = torch.rand(6, 16, 3, generator=GENERATOR, dtype=torch.float64)
FOUND = TRUTH + 0.01 * torch.rand(6, 16, 3, generator=GENERATOR, dtype=torch.float64)
ALL = torch.ones(6, 16, dtype=torch.bool)


def test_joints_in_space_or_shares_of_an_image_are_not_projected() -> None:
    with pytest.raises(InputError, match="project joints first"):
        reprojection_error(FOUND, TRUTH)
    pixels = 640 * TRUTH[..., :2]
    for found, truth in ((pixels / 640, pixels), (pixels / 640, pixels / 640)):
        with pytest.raises(InputError, match=r"has joints within .* multiply shares of an image"):
            reprojection_error(found, truth)
    few = TRUTH[:1, :4, :2]
    assert reprojection_error(few, few) == 0


def test_sizes_of_people_in_metres() -> None:
    pixels = 300 * TRUTH[..., :2]
    assert image_correct_share(pixels, pixels + 1, torso_size(pixels), 0.2) == 100
    with pytest.raises(InputError, match="no joint would be near enough"):
        image_correct_share(pixels, pixels + 1, torso_size(pixels) / 300, 0.2)


def test_errors_in_metres_are_all_near() -> None:
    errors = (FOUND - TRUTH).norm(dim=-1)
    for share in (correct_share, area_under_curve):
        with pytest.warns(UserWarning, match="multiply metres by 1000"):
            share(errors, ALL)
        assert share(1000 * errors, ALL) > 0
    assert correct_share(errors, ALL, 0.15) == 100
    assert correct_share(0 * errors, ALL) == 100


def test_alignments_of_other_frames_or_units() -> None:
    """One frame of truth was spread over all, as it was not by ``joint_errors``."""
    for function in (align, aligned_distances):
        with pytest.raises(InputError, match="give joints of the same frames"):
            function(FOUND, TRUTH[:1], ALL, "root")
        with pytest.raises(InputError, match=r"^truth spans .* expected metres; convert them"):
            function(FOUND, TRUTH * 1000, ALL, "root")
    away = TRUTH.clone()
    away[0, 3] = 1e6  # does not count
    seen = ALL.clone()
    seen[0, 3] = False
    assert aligned_distances(FOUND, away, seen, "absolute")[0, 3].isnan()


def test_skins_that_are_none() -> None:
    """Of faces for normals, and of normals that point into bodies, gaps were up to 12 cm deep."""
    ball = trimesh.creation.icosphere(3, 0.3)
    normals = np.asarray(ball.vertex_normals)
    there = np.asarray(ball.vertices) + np.array([0.8, 0, 0])
    right = np.asarray(ball.vertices), normals
    assert skin_gap(right, (there, normals)) == pytest.approx(0.2, abs=0.01)
    for wrong, words in (
        ((there, np.asarray(ball.faces)), "expected a unit vector a vertex"),
        ((there, np.asarray(ball.faces)[: len(there)]), "expected a unit vector a vertex"),
        ((there, -normals), "other has normals that point into the body"),
        ((there, 1000 * normals), "expected 1; divide by the norm"),
        ((1000 * there, normals), "other spans 600 from end to end, expected metres"),
    ):
        with pytest.raises(InputError, match=words):
            skin_gap(right, wrong)
