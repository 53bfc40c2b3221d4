"""Settings that are not made for the views are named in Python, as the command names them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from takes import make_take

from perfcap.pipeline.jobs import capture
from perfcap.pipeline.preset_doubts import held_cameras, preset_doubts
from perfcap.pipeline.presets import LIU, MONOPERFCAP, MUVS, PRESETS, RHODIN, CaptureConfig
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surface_config import RefineCamerasConfig


def test_a_capture_in_python_names_weights_of_one_view() -> None:
    take = make_take(6, views=3)
    given = take.actor, take.cameras, take.detections, take.rate
    told = capture(*given, MONOPERFCAP, until=Stage.INITIALIZE).warnings
    (line,) = [each for each in told if "weights of one view, and there are 3" in each]
    assert line.startswith("preset monoperfcap: ") and "--preset" not in line
    assert not capture(*given, until=Stage.INITIALIZE).warnings


def test_presets_are_named_for_views_that_they_are_not_made_for() -> None:
    for config in (LIU, MUVS):
        assert any("several views" in line for line in preset_doubts(config, 1))
        assert not any("several views" in line for line in preset_doubts(config, 2))
    assert not any("one view" in line for line in preset_doubts(MONOPERFCAP, 1))
    for config, views in ((CaptureConfig(), 1), (CaptureConfig(), 3), (RHODIN, 1), (RHODIN, 3)):
        assert not [*preset_doubts(config, views)]
    for config, views in ((LIU, 2), (MUVS, 2), (MONOPERFCAP, 1)):
        assert len([*preset_doubts(config, views)]) == 1  # whose errors are expected


@pytest.mark.parametrize("config", [LIU, MONOPERFCAP, MUVS])
@pytest.mark.parametrize("views", [1, 4])
def test_other_weights_say_whose_errors_are_expected(config: CaptureConfig, views: int) -> None:
    assert sum("errors that run.json expects" in line for line in preset_doubts(config, views)) == 1


def test_settings_of_ones_own_are_known_by_their_way() -> None:
    contact = replace(MONOPERFCAP.pose.contact, weight=2.0)
    own = replace(MONOPERFCAP, pose=replace(MONOPERFCAP.pose, contact=contact, window=40))
    assert any("weights of one view" in line for line in preset_doubts(own, 2))


@pytest.mark.parametrize("name", ["liu2013", "rhodin2016"])
def test_what_is_done_with_images_is_named_without_any(name: str) -> None:
    (line,) = preset_doubts(PRESETS[name], 2, looked_at=False)
    assert line.startswith(f"preset {name}: is what is done with images")


@pytest.mark.parametrize(
    ("views", "moving", "people", "looked_at", "why"),
    [
        (1, False, 1, True, "one view"),
        (3, True, 1, True, "they move"),
        (3, False, 2, True, "2 people"),
        (3, False, 1, False, "no stage looks at images"),
        (3, False, 1, True, None),
    ],
)
def test_cameras_that_stay_although_they_may_move_are_named(
    views: int, moving: bool, people: int, looked_at: bool, why: str | None
) -> None:
    cameras = make_take(4, views=views, moving=moving).cameras
    refining = replace(CaptureConfig(), refine_cameras=RefineCamerasConfig(enabled=True))
    said = [*held_cameras(refining, cameras, people, looked_at)]
    assert len(said) == (why is not None) and all(why in line for line in said)
    assert not [*held_cameras(CaptureConfig(), cameras, people, looked_at)]


def test_settings_without_silhouettes_leave_cameras_where_they_are() -> None:
    cameras = make_take(4, views=3).cameras
    for preset in (LIU, RHODIN):
        refining = replace(preset, refine_cameras=RefineCamerasConfig(enabled=True))
        assert any("no silhouettes" in line for line in held_cameras(refining, cameras, 1, True))


def test_a_capture_in_python_says_that_one_view_stays_where_it_is() -> None:
    take = make_take(6)
    given = take.actor, take.cameras, take.detections, take.rate
    refining = replace(CaptureConfig(), refine_cameras=RefineCamerasConfig(enabled=True))
    told = capture(*given, refining, until=Stage.INITIALIZE).warnings
    assert [line for line in told if line.startswith("refine_cameras: ")]
