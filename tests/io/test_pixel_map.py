"""Videos in other pixels than their calibration."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import CameraRig, match_image, read_pixel_map

EYE = torch.eye(3, dtype=torch.float64)
RIG = CameraRig(
    ("int_cam01_img", "int_cam02_img"),
    Camera(
        EYE.expand(2, 3, 3),
        EYE.expand(2, 3, 3),
        torch.zeros(2, 3, dtype=torch.float64),
        size=((1920, 1088), (1920, 1088)),
    ),
)
SHRUNK = [[1.0074, 0, 0], [0, 1.0074, -7.1]]


def write(path: Path, entries: Any) -> Path:
    path.write_text(json.dumps({"video_px_to_native_px": entries}))
    return path


def test_equal_sizes_need_no_map() -> None:
    assert match_image(RIG, [(1920, 1088)] * 2).identity


def test_unequal_sizes_are_named_not_rescaled() -> None:
    with pytest.raises(InputError, match=r"int_cam02_img: the video is 1080x1920.*1088x1920"):
        match_image(RIG, [(1920, 1088), (1920, 1080)])


def test_map_goes_there_and_back(tmp_path: Path) -> None:
    maps = read_pixel_map(write(tmp_path / "map.json", {"cam02": SHRUNK}))
    pixel_map = match_image(RIG, [(1920, 1088), (1920, 1080)], maps)
    assert not pixel_map.identity
    pixels = torch.rand(4, 2, 5, 2, dtype=torch.float64) * 1000
    native = pixel_map.to_calibration(pixels)
    assert torch.equal(native[:, 0], pixels[:, 0])
    torch.testing.assert_close(native[0, 1, 0, 1], pixels[0, 1, 0, 1] * 1.0074 - 7.1)
    torch.testing.assert_close(pixel_map.to_video(native), pixels)


def test_a_map_for_another_view_does_not_help(tmp_path: Path) -> None:
    maps = read_pixel_map(write(tmp_path / "map.json", {"cam01": SHRUNK}))
    with pytest.raises(InputError, match="int_cam02_img"):
        match_image(RIG, [(1920, 1080)] * 2, maps)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ([[1, 0], [0, 1]], "has shape"),
        ([[1, 0, 0], [0, 0, 0]], "cannot be inverted"),
        ([[1, 0, 0], [0, float("nan"), 0]], "cannot be inverted"),
        ([[1, 0, 0], [0, 1, 0], [1, 0, 1]], "affine"),
        ([[0, 1, 0], [1, 0, 0]], "turns or mirrors the image"),
        ([[-1, 0, 480], [0, 1, 0]], "turns or mirrors the image"),
        ("x", "not a regular array"),
    ],
)
def test_bad_maps(tmp_path: Path, entry: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_pixel_map(write(tmp_path / "map.json", {"cam01": entry}))


@pytest.mark.parametrize("content", ["[]", "{}", '{"video_px_to_native_px": {}}'])
def test_file_without_maps(tmp_path: Path, content: str) -> None:
    (tmp_path / "map.json").write_text(content)
    with pytest.raises(InputError, match="video_px_to_native_px"):
        read_pixel_map(tmp_path / "map.json")


def test_map_that_misses_the_image() -> None:
    far = torch.diag(torch.tensor([100.0, 100, 1], dtype=torch.float64))
    with pytest.raises(InputError, match="sends the middle"):
        match_image(RIG, [(1920, 1080)] * 2, {"cam01": far, "cam02": far})


def test_an_inverted_map_is_told_from_a_good_one() -> None:
    """Twice or one and a half percent too small, it went through: its middle is in the image."""
    sizes = [(1920, 1080), (960, 544)]
    good = [torch.tensor([*SHRUNK, [0, 0, 1]], dtype=torch.float64)]
    good += [torch.diag(torch.tensor([2.0, 2, 1], dtype=torch.float64))]
    match_image(RIG, sizes, {"cam01": good[0], "cam02": good[1]})
    for turned in (0, 1):
        given = [torch.linalg.inv(m) if view == turned else m for view, m in enumerate(good)]
        with pytest.raises(InputError, match=f"int_cam0{turned + 1}_img: .* invert it"):
            match_image(RIG, sizes, {"cam01": given[0], "cam02": given[1]})


def test_maps_of_no_view_are_not_left_out(tmp_path: Path) -> None:
    path = write(tmp_path / "map.json", {"left": SHRUNK, "right": SHRUNK})
    assert set(read_pixel_map(path)) == set(read_pixel_map(path, ["left_1"])) == {"left", "right"}
    with pytest.raises(InputError, match="names left, right, none of the views int_cam01_img"):
        read_pixel_map(path, RIG.names)


def test_maps_that_are_called_as_no_view_are_refused_where_one_is_lacking(tmp_path: Path) -> None:
    path = write(tmp_path / "map.json", {"cam01": SHRUNK, "kitchen": SHRUNK})
    with pytest.raises(InputError, match="maps of kitchen, which are no views, and none of"):
        read_pixel_map(path, ["cam01", "cam02"])
    assert len(read_pixel_map(path, ["cam01", "cam03"], ["cam01", "kitchen", "cam03"])) == 2
    assert len(read_pixel_map(path, ["cam01"])) == 2


def test_as_many_videos_as_cameras() -> None:
    with pytest.raises(InputError, match="1 videos for 2 cameras"):
        match_image(RIG, [(1920, 1088)])


def test_cameras_of_the_videos_project_where_the_map_draws(tmp_path: Path) -> None:
    matrix = [[1.25, 0.02, -16], [-0.01, 1.3, 9.5]]
    maps = read_pixel_map(write(tmp_path / "map.json", {"cam01": matrix}))
    pixel_map = match_image(RIG, [(1500, 860), (1920, 1088)], maps)
    in_video = pixel_map.cameras(RIG.cameras, [(1500, 860), (1920, 1088)])
    points = torch.randn(7, 3, dtype=torch.float64) + torch.tensor([0, 0, 8.0])
    assert in_video.size == ((1500, 860), (1920, 1088))
    torch.testing.assert_close(
        in_video.project(points), pixel_map.to_video(RIG.cameras.project(points))
    )
