"""Mixtures of Gaussians over colours."""

from __future__ import annotations

import numpy as np
from scipy.stats import multivariate_normal

from perfcap.segment import _color_numba
from perfcap.segment.color_model import ColorModel, ColorSettings, fit_color_model

RED, BLUE = np.array([200.0, 30.0, 40.0]), np.array([20.0, 60.0, 180.0])


def two_colors(rng, count=900):
    spread = rng.normal(scale=6.0, size=(count, 3))
    centers = np.where(rng.random(count)[:, None] < 0.7, RED, BLUE)
    return (centers + spread).astype(np.float32)


def test_density_equals_scipy():
    rng = np.random.default_rng(0)
    means = rng.uniform(0, 255, (3, 3))
    roots = rng.normal(size=(3, 3, 3)) * 10
    covariances = roots @ roots.transpose(0, 2, 1) + 25 * np.eye(3)
    model = ColorModel(np.array([0.2, 0.5, 0.3]), means, covariances)
    pixels = rng.uniform(0, 255, (50, 3)).astype(np.float32)
    expected = sum(
        w * multivariate_normal(m, c).pdf(pixels)
        for w, m, c in zip(model.weights, means, covariances, strict=True)
    )
    np.testing.assert_allclose(model.log_density(pixels), np.log(expected), rtol=1e-4, atol=1e-3)


def test_fit_finds_two_colors():
    pixels = two_colors(np.random.default_rng(1))
    model = fit_color_model(pixels, ColorSettings(components=2))
    order = np.argsort(-model.weights)
    np.testing.assert_allclose(model.weights[order], [0.7, 0.3], atol=0.05)
    np.testing.assert_allclose(model.means[order], [RED, BLUE], atol=2)
    np.testing.assert_allclose(model.covariances[order], 2 * [45 * np.eye(3)], atol=8)


def test_fit_is_repeatable_and_ignores_what_it_thins_out():
    pixels = two_colors(np.random.default_rng(2))
    one, other = (fit_color_model(pixels, ColorSettings()) for _ in range(2))
    np.testing.assert_array_equal(one.means, other.means)
    thinned = fit_color_model(pixels, ColorSettings(samples=300))
    np.testing.assert_array_equal(
        thinned.means, fit_color_model(pixels[::3], ColorSettings()).means
    )


def test_warm_start_follows_colors_that_drift():
    pixels = two_colors(np.random.default_rng(3))
    settings = ColorSettings(components=2)
    start = fit_color_model(pixels, settings)
    drifted = fit_color_model(pixels + np.float32(5), settings, start)
    np.testing.assert_allclose(drifted.means, start.means + 5, atol=0.5)


def test_degenerate_regions():
    assert fit_color_model(np.zeros((0, 3), np.float32), ColorSettings()) is None
    for pixels in (np.full((1, 3), 7, np.float32), np.full((40, 3), 255, np.float32)):
        model = fit_color_model(pixels, ColorSettings())
        assert len(model.weights) == 1
        assert np.isfinite(model.log_density(pixels)).all()
        assert np.isfinite(model.log_density(np.zeros((1, 3), np.float32))).all()


def test_sides_are_weighed_as_sums_of_probabilities():
    rng = np.random.default_rng(5)
    person, scene, backed = rng.uniform(-60, 0, (3, 400)).astype(np.float32)
    person[:3], scene[:3] = -16.0, (-16.0, -np.inf, -200.0)
    known = rng.random(400) < 0.5
    alone, clear, unseen = np.log(np.array([[0.98, 0.02], [0.5, 0.5], [0.9, 0.1]], np.float32))
    clutter, limit = np.log(np.array([1e-3], np.float32)), np.array([20], np.float32)
    odds = np.where(known[:, None], clear, alone)
    own = np.logaddexp(person + odds[:, 0], odds[:, 1])
    other = np.logaddexp(scene + unseen[0], unseen[1])
    other = np.where(known, np.logaddexp(backed, other + clutter), other)
    found = np.empty(400, np.float32)
    _color_numba.weigh(person, scene, known, backed, alone, clear, unseen, clutter, limit, found)
    np.testing.assert_allclose(found, np.clip(own - other, -20, 20), rtol=1e-5, atol=1e-5)
