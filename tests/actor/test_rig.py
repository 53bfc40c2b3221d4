"""Skeletons as plain data that contradict themselves."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from perfcap.errors import InputError
from perfcap.io.actor import load_actor


def test_names_are_those_of_one() -> None:
    """Of two hinges of one name, limits and results found the last."""
    rig = load_actor("sam").skeleton.rig
    hinges = (replace(rig.hinges[0], name=rig.hinges[1].name), *rig.hinges[1:])
    landmarks = (rig.landmarks[1], *rig.landmarks[1:])
    for change, name in (({"hinges": hinges}, hinges[0].name), ({"landmarks": landmarks}, "neck")):
        with pytest.raises(InputError, match=f"several {next(iter(change))} called {name}"):
            replace(rig, **change)


def test_landmarks_are_somewhere() -> None:
    rig = load_actor("sam").skeleton.rig
    with pytest.raises(InputError, match="joints or landmarks that are not finite"):
        replace(rig, landmark_positions=rig.landmark_positions * torch.nan)


def test_vertices_of_another_size_are_no_actor() -> None:
    """Only larger ones were refused, and NaN is not larger."""
    actor = load_actor("sam")
    for factor in (0.001, torch.nan):
        with pytest.raises(InputError, match="times as large as the actor"):
            actor.with_vertices(factor * actor.vertices)
