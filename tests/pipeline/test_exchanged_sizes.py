"""Width before height, turns in radians and numbers before the first frame."""

import math
import warnings
from dataclasses import replace

import pytest
from synthetic import cameras
from test_camera_path import JOINTS, SCENE

from perfcap.errors import InputError
from perfcap.pipeline import calibrated, orbit, resized

WIDE = replace(cameras(2, 96), size=((72, 128), (72, 128)))


def test_width_before_height_is_named() -> None:
    with pytest.warns(UserWarning, match="not \\(width, height\\)"):
        resized(WIDE, (128, 72))
    with pytest.warns(UserWarning, match="not \\(width, height\\)"):
        calibrated(WIDE.select([0]), [0], [0], (256, 144))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for right in ((36, 64), (144, 256), (72, 72), (100, 60)):
            resized(WIDE, right)
        calibrated(WIDE.select([0]), [0], [0], (144, 256))
        resized(cameras(1, 96), (48, 48))


def test_numbers_of_frames_count_from_zero() -> None:
    for numbers in ([-1], [0, 1]):
        with pytest.raises(InputError, match="numbers"):
            calibrated(WIDE.select([0]), [0], numbers)


def test_orbits_are_in_degrees_and_metres() -> None:
    with pytest.warns(UserWarning, match="radians"):
        orbit(JOINTS, SCENE, [0], (64, 64), 30.0, 2 * math.pi)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for degrees in (0.0, 3.0, 6.0, 90.0, -360.0):
            orbit(JOINTS, SCENE, [0], (64, 64), 30.0, degrees)
    with pytest.raises(InputError, match="metres"):
        orbit(1000 * JOINTS, SCENE, [0], (64, 64), 30.0)
    with pytest.raises(InputError, match="joints"):
        orbit(JOINTS[:, :14], SCENE, [0], (64, 64), 30.0)
