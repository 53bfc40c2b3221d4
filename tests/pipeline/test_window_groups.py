"""Which windows of a refinement are solved as one batch."""

from types import SimpleNamespace
from typing import cast

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
