"""A capture as columns, as tensors, and its progress in a notebook."""

import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from takes import make_take

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.pipeline import Stage, capture
from perfcap.pipeline.clock import notebook_progress
from perfcap.pipeline.performance import Performance, frame_table


@pytest.fixture(scope="module")
def found() -> Performance:
    take = make_take(8)
    clip = SimpleNamespace(fps=take.rate)  # anything that has a rate
    return capture(take.actor, take.cameras, take.detections, clip, until=Stage.INITIALIZE)


def test_columns_are_the_motion(found: Performance) -> None:
    table = frame_table(found)
    assert all(values.shape == (8,) for values in table.values())
    assert table["time", "", "s"][-1] == pytest.approx(7 / found.rate)
    wrist = LANDMARKS.index("l_wrist")
    np.testing.assert_array_equal(table["joint", "l_wrist", "y"], found.joints()[:, wrist, 1])
    names = found.actor.skeleton.angle_names
    for at, name in enumerate(names):
        angle = np.radians(table["angle", name, "deg"])
        np.testing.assert_allclose(angle, found.motion.angles[:, at], atol=1e-12)
    assert found.trust is not None
    np.testing.assert_array_equal(table["trust", "", ""], found.trust.value)
    assert ("stands", "l", "") not in table
    standing = replace(found, contact=torch.rand(8, 2))
    assert standing.contact is not None
    right = frame_table(standing)["stands", "r", ""]
    np.testing.assert_allclose(right, standing.contact[:, 1])


@pytest.mark.long
def test_a_frame_of_pandas(found: Performance) -> None:
    pytest.importorskip("pandas", reason="needs pandas: install the extra dev")
    table = found.to_pandas(first_frame=100)
    assert table.index.tolist() == list(range(100, 108)) and table.index.name == "frame"
    assert table.columns.names == ["quantity", "name", "axis"]
    assert table["joint", "neck", "x"].iloc[3] == float(found.joints()[3, 1, 0])
    assert table["angle"].shape == (8, len(found.actor.skeleton.angle_names))


def test_without_pandas(found: Performance, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match="pip install pandas"):
        found.to_pandas()


def test_state_is_saved_and_read(found: Performance, tmp_path: Any) -> None:
    torch.save(dict(found.state()), tmp_path / "state.pt")
    again = torch.load(tmp_path / "state.pt", weights_only=True)
    assert torch.equal(again["motion.angles"], found.motion.angles)
    assert torch.equal(again["joints"], found.joints()) and float(again["rate"]) == found.rate


def test_what_is_done_to_the_state_stays_there(found: Performance) -> None:
    before = found.joints()
    for values in found.state().values():
        values.mul_(2)
    assert torch.equal(found.joints(), before)


def test_a_motion_in_degrees_is_refused(found: Performance) -> None:
    motion = replace(found.motion, angles=found.motion.angles + 90)
    with pytest.raises(InputError, match="angles has angles of"):
        replace(found, motion=motion)


class Shell:
    kernel = None


@pytest.mark.parametrize("shell", [None, object()])
def test_no_progress_outside_of_notebooks(shell: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    assert notebook_progress() is None
    monkeypatch.delitem(sys.modules, "IPython")
    assert notebook_progress() is None


def test_progress_in_a_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []

    def display(thing: object, display_id: bool) -> object:
        assert display_id and not shown
        shown.append(repr(thing))
        return SimpleNamespace(update=lambda thing: shown.append(repr(thing)))

    notebook = SimpleNamespace(
        get_ipython=lambda: Shell(), display=SimpleNamespace(display=display)
    )
    monkeypatch.setitem(sys.modules, "IPython", notebook)
    take = make_take(8)
    capture(take.actor, take.cameras, take.detections, take.rate)
    assert shown[0].startswith("perfcap: initialize 0 of ")
    assert shown[-1] == "perfcap: initialize, track_motion"
    assert len(shown) < 20
