"""Confidence in points of a boundary."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from disc_scene import RADIUS, SIZE, disc_clip

from perfcap.segment.grabcut import segment
from perfcap.segment.scene import survey
from perfcap.segment.trimap import TrimapSettings, build_trimap
from perfcap.segment.trust import TrustSettings, boundary_trust

CENTER = np.array([SIZE / 2, SIZE / 2 + 2])


def circle(radius=RADIUS, center=CENTER):
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    normals = np.stack([np.cos(angle), np.sin(angle)], 1)
    return center + radius * normals, normals


def find(clip, widths=None, plate=None):
    middle = len(clip.images) // 2
    trimap = build_trimap(clip.models[middle], clip.bones[middle], widths)
    return segment(clip.images[middle], trimap, plate=None if plate is None else plate[trimap.box])


@pytest.fixture(scope="module")
def strong():
    clip = disc_clip(frames=9, error=(1.0, 0.0))
    return find(clip)


def test_strong_edges_are_trusted_and_weak_ones_less(strong):
    weak = find(disc_clip(frames=9, error=(1.0, 0.0), person=((45, 92, 62), (122, 178, 149))))
    high, low = (boundary_trust(found, *circle()) for found in (strong, weak))
    assert ((high >= 0) & (high <= 1)).all()
    assert high.mean() > 0.85
    assert low.mean() < high.mean() - 0.25


def test_wrong_places_are_not_trusted(strong):
    right = boundary_trust(strong, *circle())
    for radius in (RADIUS - 5, RADIUS + 5):
        wrong = boundary_trust(strong, *circle(radius))
        assert np.median(wrong) < np.median(right) - 0.4


def test_a_boundary_that_no_clue_speaks_for_is_rather_wrong(strong):
    silent = replace(TrustSettings(), inside=0.0, outside=0.0, contrast=0.0, departure=0.0)
    trust = boundary_trust(strong, *circle(), silent)
    assert 0.3 < trust.max() < 0.5


def test_limits_of_the_band_measure_nothing():
    clip = disc_clip(frames=9, error=(0.0, 0.0))
    found = find(clip, TrimapSettings(outer=0.1, inner=0.1))
    limits = RADIUS + found.trimap.outer, RADIUS - found.trimap.inner
    for radius in limits:
        assert boundary_trust(found, *circle(radius)).max() < 0.3


def test_no_points_and_no_person(strong):
    nothing = np.zeros((0, 2))
    assert boundary_trust(strong, nothing, nothing).shape == (0,)
    clip = disc_clip(frames=1)
    empty = segment(clip.images[0], build_trimap(np.zeros((SIZE, SIZE), bool), clip.bones[0]))
    assert (boundary_trust(empty, *circle()) == 0).all()


def test_points_outside_the_box_and_many_of_them(strong):
    points, normals = circle(300.0)
    assert (boundary_trust(strong, points, normals) < 0.1).all()
    points, normals = (np.tile(part, (600, 1)) for part in circle())
    many = boundary_trust(strong, points, normals)
    np.testing.assert_allclose(many[:60], many[-60:])
    np.testing.assert_allclose(many[:60], boundary_trust(strong, *circle()))


def test_plate_raises_trust():
    clip = disc_clip(frames=25, person=((60, 90, 80), (130, 160, 140)), error=(2.0, 0.0))
    scene = survey(clip.images, clip.models)
    alone, backed = (boundary_trust(find(clip, plate=p), *circle()) for p in (None, scene.plate))
    assert backed.mean() > alone.mean()
