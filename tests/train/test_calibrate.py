"""Confidences that mean what they say."""

import numpy as np
import pytest

from perfcap.detect.manifest import Calibration
from perfcap.train.export import expected_error, fit_calibration


def test_a_known_curve_is_found() -> None:
    rng = np.random.default_rng(0)
    peaks = rng.uniform(0.01, 0.16, 20000)
    found = rng.random(20000) < (peaks / 0.16) ** 2
    calibration = fit_calibration(peaks, found)
    middle = np.linspace(0.03, 0.14, 12)
    promised = np.interp(middle, calibration.raw, calibration.probability)
    np.testing.assert_allclose(promised, (middle / 0.16) ** 2, atol=0.06)
    assert expected_error(peaks, found, calibration) < 0.02
    assert expected_error(peaks, found, Calibration((0.0, 0.2), (0.9, 0.9))) > 0.4


@pytest.mark.parametrize("found", [np.ones(40, bool), np.zeros(40, bool), np.arange(40) % 2 == 0])
def test_knots_rise_and_probabilities_never_fall(found: np.ndarray) -> None:
    peaks = np.repeat(np.linspace(0.02, 0.1, 10), 4)
    calibration = fit_calibration(peaks, found)
    assert (np.diff(calibration.raw) > 0).all() and (np.diff(calibration.probability) >= 0).all()
    assert calibration.raw[0] == calibration.probability[0] == 0
    assert 0 <= min(calibration.probability) <= max(calibration.probability) <= 1
