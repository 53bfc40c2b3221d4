"""COLMAP's models without poses of some images: not placed by it, or lost by a layout."""

from pathlib import Path

import numpy as np
import pytest
from calibration_files import write_colmap

from perfcap.errors import InputError
from perfcap.io.calibration import read_cameras
from perfcap.io.clip import Clip
from perfcap.io.doctor.together import camera_frames


class Frames:
    """A video of so many frames."""

    name, size, lost, warnings, fps, timestamps = "walk", (480, 640), 0, (), 30.0, None

    def __init__(self, total: int | None) -> None:
        self.total = total

    def __len__(self) -> int:
        return self.total or 9

    def read(self, start: int, stop: int) -> np.ndarray:
        return np.zeros((stop - start, *self.size, 3), np.uint8)

    def close(self) -> None:
        pass


def write_moving(folder: Path, numbers: tuple[int, ...], name: str = "frame_{:04d}") -> Path:
    """A camera that moves, its images numbered so."""
    names = tuple(name.format(number) for number in numbers)
    write_colmap(folder, names=names)
    text = (folder / "images.txt").read_text()
    for i, each in enumerate(names, 1):
        text = text.replace(f" {i} {each}.png", f" 1 {each}.png")
    (folder / "images.txt").write_text(text)
    return folder


@pytest.mark.parametrize("numbers", [(1, 2, 3, 5, 6), (1, 6, 11, 16, 21), (3, 4, 5, 6, 7)])
@pytest.mark.parametrize("total", [9, None])
def test_images_without_a_pose_shift_those_behind(
    tmp_path: Path, numbers: tuple[int, ...], total: int | None
) -> None:
    rig = read_cameras(write_moving(tmp_path, numbers))
    with pytest.raises(InputError, match=r"none of images before frame_000[3-6]\.png"):
        camera_frames(rig, Clip([Frames(total)], 30.0, stop=4), 4)


def test_a_folder_of_the_images_that_have_poses(tmp_path: Path) -> None:
    rig = read_cameras(write_moving(tmp_path, (1, 2, 3, 5, 6)))
    assert camera_frames(rig, Clip([Frames(5)], 30.0), 5).cameras.translation.shape == (5, 1, 3)


@pytest.mark.parametrize(
    ("numbers", "name"),
    [
        ((0, 1, 2, 3), "frame_{:04d}"),
        ((1, 2, 3, 4), "clip/{}"),
        ((1, 2, 3, 4), "take7_{}_left"),
        ((97, 98, 99, 100), "{:c}"),
    ],
)
def test_poses_of_the_first_part_alone(tmp_path: Path, numbers: tuple[int, ...], name: str) -> None:
    rig = read_cameras(write_moving(tmp_path, numbers, name))
    part = camera_frames(rig, Clip([Frames(9)], 30.0, stop=4), 4)
    assert part.cameras.translation.shape == (4, 1, 3)


def test_images_without_a_line_for_their_points(tmp_path: Path) -> None:
    write_colmap(tmp_path)
    path = tmp_path / "images.txt"
    kept = [line for line in path.read_text().splitlines() if line.endswith(".png")]
    path.write_text("\n".join(kept) + "\n")
    with pytest.raises(InputError, match=r"line 2: ends in .*png, expected the points"):
        read_cameras(tmp_path)
