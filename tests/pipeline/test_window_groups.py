"""Which windows of a refinement are solved as one batch."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from perfcap.errors import InputError
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.pose_refiner import _groups


def test_windows_with_and_without_a_fitted_prior_are_solved_apart() -> None:
    """In one batch, a clip that was solved once would take the prior of the others away."""
    once, twice = (
        cast(ClipProblem, SimpleNamespace(frames=20, first=first, config=PoseConfig()))
        for first in (None, object())
    )
    groups = list(_groups([twice, once, twice]))
    assert [[clip for clip, _ in group] for group in groups] == [[0, 2], [1]]


@pytest.mark.parametrize("wrong", [{"batch": 0}, {"initial_batch": -1}, {"window": 2.5}])
def test_sizes_that_are_none_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="expected a whole number of 1 or more"):
        PoseConfig(**wrong)
