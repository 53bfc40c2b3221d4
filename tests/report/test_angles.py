"""Joint angles with their limits, and trust, as charts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reported import FRAMES

from perfcap.io.result import read_result
from perfcap.pipeline.performance import Performance
from perfcap.report.angles import angle_charts, read_angles, trust_chart

ALL = slice(0, FRAMES)


def rewrite(folder: Path, **changes: Any) -> None:
    """Change arrays of ``motion.npz``; None takes one out."""
    with np.load(folder / "motion.npz") as file:
        arrays = {**file, **changes}
    np.savez(folder / "motion.npz", **{k: v for k, v in arrays.items() if v is not None})


def test_every_angle_is_in_one_chart_with_its_limits(
    made: Path, take_performance: Performance
) -> None:
    charts = angle_charts(read_angles(read_result(made), ALL))
    skeleton, motion = take_performance.actor.skeleton, take_performance.motion
    lines = [(chart.title, line) for chart in charts for line in chart.lines]
    assert len(lines) == len(skeleton.angle_names)
    knee = next(chart for chart in charts if chart.title == "Knee flexion")
    assert [line.name for line in knee.lines] == ["left", "right"] and knee.unit == "°"
    index = skeleton.angle_names.index("r_knee_flexion")
    degrees = motion.angles[:, index].rad2deg()
    np.testing.assert_allclose(knee.lines[1].values, degrees, atol=1e-4)
    low, high = skeleton.lower[index].rad2deg(), skeleton.upper[index].rad2deg()
    assert knee.lines[1].limits == pytest.approx((float(low), float(high)), abs=1e-4)
    assert "0 to 160°" in knee.about and knee.worst == "limit"


def test_a_part_of_the_frames(made: Path) -> None:
    result = read_result(made)
    whole, part = read_angles(result, ALL), read_angles(result, slice(3, 7))
    np.testing.assert_array_equal(part.values, whole.values[3:7])


def test_names_of_other_actors(folder: Path) -> None:
    names = ["left_hip_pitch_joint", "waist", "knee_R", "l", "", "__"]
    angles = np.zeros((FRAMES, len(names)))
    rewrite(folder, angles=angles, angle_names=np.array(names), angle_lower=None)
    charts = angle_charts(read_angles(read_result(folder), ALL))
    found = [(chart.title, chart.lines[0].name, chart.lines[0].limits) for chart in charts]
    assert found[:3] == [
        ("Hip pitch joint", "left", None),
        ("Waist", "angle", None),
        ("Knee", "right", None),
    ]
    assert sum(len(chart.lines) for chart in charts) == len(names)
    assert all(chart.worst == "high" and "Without limits" in chart.about for chart in charts)


def test_trust_is_a_curve_of_percent(folder: Path) -> None:
    trust = np.linspace(0.2, 1.0, FRAMES)
    rewrite(folder, trust=trust)
    chart = trust_chart(read_angles(read_result(folder), slice(2, 5)))
    assert chart is not None and chart.worst == "low"
    np.testing.assert_allclose(chart.lines[0].values, 100 * trust[2:5])


@pytest.mark.parametrize(
    "change",
    [
        {"angles": None},
        {"angle_names": np.zeros(27)},
        {"angles": np.zeros((FRAMES - 1, 27))},
        {"angles": np.zeros((FRAMES, 3))},
    ],
)
def test_damaged_or_older_angles_are_left_out(folder: Path, change: dict[str, Any]) -> None:
    rewrite(folder, trust=np.zeros(FRAMES - 1), **change)
    angles = read_angles(read_result(folder), ALL)
    assert angle_charts(angles) == [] and trust_chart(angles) is None


def test_values_that_are_none_leave_gaps(folder: Path) -> None:
    with np.load(folder / "motion.npz") as file:
        angles = file["angles"].copy()
    angles[4, 0], angles[5, 0] = np.nan, 1e300
    rewrite(folder, angles=angles, angle_lower=np.full(angles.shape[1], np.nan))
    chart = angle_charts(read_angles(read_result(folder), ALL))[0]
    values = chart.plain()["lines"][0]["values"]
    assert [index for index, value in enumerate(values) if value is None] == [4, 5]
    assert "limits" not in chart.plain()["lines"][0]
