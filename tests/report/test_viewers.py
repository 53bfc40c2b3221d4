"""Captured motion in Rerun and viser: real ones where they are installed."""

import sys
import types
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from perfcap.errors import InputError
from perfcap.pipeline.performance import Performance
from perfcap.report import show
from perfcap.report.viewers import add_to_viser, log_to_rerun


@pytest.mark.parametrize(("package", "hook"), [("rerun", log_to_rerun), ("viser", add_to_viser)])
def test_a_viewer_that_is_not_there_is_named(
    package: str, hook: Any, take_performance: Performance, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    given = (take_performance,) if package == "rerun" else (None, take_performance)
    with pytest.raises(InputError, match=rf"{package} is not installed.*perfcap\[{package}\]"):
        hook(*given)


def test_several_people_at_once_are_refused(take_performance: Performance) -> None:
    people: Any = (take_performance, take_performance)
    for call in (log_to_rerun, lambda given: add_to_viser(None, given)):
        with pytest.raises(InputError, match="got a tuple, expected a Performance; of several"):
            call(people)
    pytest.importorskip("IPython", exc_type=ImportError)
    with pytest.raises(InputError, match="show: got a tuple, expected a Performance"):
        show(people)


def test_rerun_gets_every_frame(
    take_performance: Performance, monkeypatch: pytest.MonkeyPatch
) -> None:
    rr = pytest.importorskip("rerun", exc_type=ImportError)
    logged: dict[str, list[Any]] = {}
    times: list[float] = []
    monkeypatch.setattr(rr, "set_time", lambda _, duration: times.append(duration))
    monkeypatch.setattr(rr, "log", lambda path, what, **_: logged.setdefault(path, []).append(what))
    log_to_rerun(take_performance, "sam")
    assert np.allclose(times, np.arange(take_performance.frames) / take_performance.rate)
    last = logged["sam/surface"][-1].vertex_positions.as_arrow_array().to_pylist()
    np.testing.assert_allclose(last, take_performance.shown[-1:][0], atol=1e-6)
    assert len(logged["sam/surface"]) == len(logged["sam/joints"]) == take_performance.frames


@pytest.mark.parametrize(
    ("up", "name"), [((0.0, 0.1, -0.99), "RIGHT_HAND_Z_DOWN"), (None, "RIGHT_HAND_Y_UP")]
)
def test_viewers_heed_what_is_known_of_up(
    take_performance: Performance,
    monkeypatch: pytest.MonkeyPatch,
    up: tuple[float, ...] | None,
    name: str,
) -> None:
    logged: dict[str, Any] = {}
    fake = types.SimpleNamespace(
        ViewCoordinates=types.SimpleNamespace(**{name: name}),
        **dict.fromkeys(("Mesh3D", "Points3D"), lambda *_, **__: None),
        log=lambda path, what, **_: logged.setdefault(path, what),
        set_time=lambda *_, **__: None,
    )
    monkeypatch.setitem(sys.modules, "rerun", fake)
    lying = replace(take_performance, up=None if up is None else torch.tensor(up))
    log_to_rerun(lying)
    assert logged["/"] == name


def test_viser_shows_the_frame_of_its_slider(take_performance: Performance) -> None:
    viser = pytest.importorskip("viser", exc_type=ImportError)
    server = viser.ViserServer(port=0, verbose=False)
    try:
        show_frame = add_to_viser(server, take_performance, "sam")
        for frame in (0, take_performance.frames - 1):
            show_frame(frame)
            found = server.scene._handle_from_node_name["/sam"].vertices
            np.testing.assert_allclose(
                found, take_performance.shown[frame : frame + 1][0], atol=1e-6
            )
    finally:
        server.stop()
