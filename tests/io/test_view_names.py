"""Files and views by name."""

import pytest

from perfcap.io.view_names import find_view, match_views

VIEWS = ("int_cam01_img", "int_cam02_img", "int_cam10_img")


@pytest.mark.parametrize(
    ("name", "view"),
    [
        ("cam01", 0),
        ("Cam_2", 1),
        ("cam10", 2),
        ("int_cam10_img", 2),
        ("trial_int_cam10_img_a", 2),
        ("cam", None),
        ("a", None),
        ("", None),
    ],
)
def test_find_view(name: str, view: int | None) -> None:
    assert find_view(name, VIEWS) == view


@pytest.mark.parametrize(
    ("names", "order"),
    [
        (["cam10", "cam01"], [2, 0]),
        (["cam02_json", "cam01_json", "cam10_json"], [1, 0, 2]),
        (["left", "right"], None),
        (["cam01", "right"], None),
        (["cam01", "cam1"], None),
        (["video"], None),
    ],
)
def test_match_views(names: list[str], order: list[int] | None) -> None:
    assert match_views(names, VIEWS) == order
