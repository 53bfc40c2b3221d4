"""``perfcap capture --people 1`` with an actor: the person who has its bones is captured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crowd_files import SIZE, CrowdFiles, write_crowd
from crowds import make_crowd
from runs import Command

from perfcap.app.capture_people import _with_bones_of
from perfcap.detect.association import associate
from perfcap.io.result import read_result
from perfcap.report.sources import find_sources


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> CrowdFiles:
    crowd = make_crowd(2, frames=20, views=3, size=SIZE, noise=2.0, spoil=0.1)
    return write_crowd(tmp_path_factory.mktemp("pair"), crowd)


@pytest.mark.long
@pytest.mark.parametrize("number", [0, 1])
def test_it_is_the_one_with_the_bones_of_the_actor(
    pair: CrowdFiles, tmp_path: Path, perfcap: Command, number: int
) -> None:
    options = ("--people", "1", "--no-overlay", "--until", "track_motion")
    done = perfcap(pair.command(tmp_path, *options, actors=pair.actors[number : number + 1]))
    assert done.code == 0
    assert any("has other bones" in note for note in done.notes)
    error = read_result(tmp_path).joints - pair.crowd.joints[number].numpy()
    assert 1000 * np.linalg.norm(error, axis=-1).mean() < 25
    shown = find_sources(read_result(tmp_path), slice(0, 20)).detections  # on pages
    assert shown is not None
    apart = (shown.joints2d - pair.crowd.cameras.project(pair.crowd.joints[number])).norm(dim=-1)
    assert float(apart[shown.confidence2d > 0].median()) < 5  # px; of noise of 2


@pytest.mark.long
def test_of_people_alike_the_best_seen_is_taken() -> None:
    crowd = make_crowd(2, frames=20, views=3, size=SIZE)
    found = associate(crowd.cameras, crowd.candidates)
    twins = replace(found, points=found.points[[0, 0]])
    kept = _with_bones_of(crowd.actors[1], "b", twins)
    assert kept.people == found.people[:1] and len(kept.slots) == 1
    assert any("fit it almost as well" in note for note in kept.notes)
    assert kept.notes[-1] == "further people: 1, left out, since views see less of them"
