"""Folders of masks: whose frames they are of, and which pixels they mean."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from square_masks import FRAMES, SIZE, black_clip, square

from perfcap.errors import InputError
from perfcap.io.clip import Clip
from perfcap.io.late_source import LateSource
from perfcap.io.mask_files import MaskFolders


@pytest.fixture
def clip(tmp_path: Path) -> Clip:
    return black_clip(tmp_path / "video")


def write(folder: Path, frames: dict[str, np.ndarray]) -> Path:
    folder.mkdir()
    for name, image in frames.items():
        assert cv2.imwrite(str(folder / name), image)
    return folder


def plain(frames: range | list[int], name: str = "{:06d}.png") -> dict[str, np.ndarray]:
    return {name.format(f): 255 * square(f).astype(np.uint8) for f in frames}


def test_numbers_say_of_which_frame_they_are(clip: Clip, tmp_path: Path) -> None:
    folder = write(tmp_path / "m", plain([3, 10, 7], "mask_{}.png"))
    masks = MaskFolders.open([folder], clip)
    assert masks.complete() == [3, 7, 10]
    for frame in range(FRAMES):
        assert masks.knows(0, frame) == (frame in (3, 7, 10))
        found = masks.mask(0, frame)
        assert (found is None) == (frame not in (3, 7, 10))
        if found is not None:
            np.testing.assert_array_equal(found, square(frame))


def test_as_many_as_frames_are_in_order(clip: Clip, tmp_path: Path) -> None:
    images = plain(range(FRAMES))
    named = {f"{i + 1:03d}.png": image for i, image in enumerate(images.values())}  # from 1
    masks = MaskFolders.open([write(tmp_path / "m", named)], clip)
    np.testing.assert_array_equal(masks.mask(0, 0), square(0))
    np.testing.assert_array_equal(masks.mask(0, FRAMES - 1), square(FRAMES - 1))


def test_a_part_of_the_clip_and_a_late_view_keep_their_masks(clip: Clip, tmp_path: Path) -> None:
    folder = write(tmp_path / "m", plain([4, 6]))
    part = Clip(clip.sources, 30.0, start=4)
    masks = MaskFolders.open([folder], part)
    assert masks.complete() == [0, 2]
    np.testing.assert_array_equal(masks.mask(0, 2), square(6))
    late = Clip([LateSource(clip.sources[0], 3)], 30.0)
    shifted = MaskFolders.open([folder], late)  # frame 1 of the clip is frame 4 of the file
    np.testing.assert_array_equal(shifted.mask(0, 1), square(4))


@pytest.mark.parametrize(
    "kind", ["labels", "grey", "colours", "alpha", "jpeg", "sixteen", "soft", "palette"]
)
def test_what_is_inside(clip: Clip, tmp_path: Path, kind: str) -> None:
    """0 is background; white on black is cut at a half; what is transparent is background."""
    inside = square(5)
    image = 255 * inside.astype(np.uint8)
    name = "5.jpg" if kind == "jpeg" else "5.png"
    drawn = {
        "labels": inside.astype(np.uint8),
        "grey": image,
        "colours": np.where(inside[..., None], np.array((0, 0, 200), np.uint8), 0),
        "alpha": np.dstack([np.full((*SIZE, 3), 90, np.uint8), image]),
        "jpeg": image,
        "sixteen": 257 * image.astype(np.uint16),
        "soft": np.where(inside, 255, 60).astype(np.uint8),
        "palette": np.where(inside[..., None], np.array((0, 0, 64), np.uint8), 0),
    }[kind]
    masks = MaskFolders.open([write(tmp_path / "m", {name: np.ascontiguousarray(drawn)})], clip)
    np.testing.assert_array_equal(masks.mask(0, 5), inside)


def test_nobody_is_an_answer(clip: Clip, tmp_path: Path) -> None:
    folder = write(tmp_path / "m", {"2.png": np.zeros(SIZE, np.uint8)})
    found = MaskFolders.open([folder], clip).mask(0, 2)
    assert found is not None and not found.any()


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ({"a.png": np.zeros(SIZE, np.uint8), "b.png": np.zeros(SIZE, np.uint8)}, "not numbered"),
        ({"x1.png": np.zeros(SIZE, np.uint8), "y1.png": np.zeros(SIZE, np.uint8)}, "not numbered"),
        ({"12.png": np.zeros(SIZE, np.uint8)}, "12.png of a video of 12 frames"),
        ({"3.png": np.zeros((40, 30), np.uint8)}, "is 30x40, its video is 40x30"),
        ({"3.bmp": np.zeros((40, 30), np.uint8)}, "is 30x40, its video is 40x30"),
    ],
)
def test_masks_of_other_frames_are_refused(
    clip: Clip, tmp_path: Path, frames: dict[str, np.ndarray], words: str
) -> None:
    folder = write(tmp_path / "m", frames)
    with pytest.raises(InputError, match=words):
        MaskFolders.open([folder], clip).mask(0, 3)


def test_folders_that_are_none(clip: Clip, tmp_path: Path) -> None:
    empty = write(tmp_path / "m", {})
    for folders, words in (
        ([empty], "holds no images"),
        ([tmp_path / "nowhere"], "no such folder"),
        ([empty, empty], "are 2 folders, expected one for each of 1 views"),
    ):
        with pytest.raises(InputError, match=words):
            MaskFolders.open(folders, clip)
    few = write(tmp_path / "few", plain([1, 2]))
    with pytest.raises(InputError, match="none of the frames 5 to 11 that are captured"):
        MaskFolders.open([few], Clip(clip.sources, 30.0, start=5))


def test_shares_of_a_network_that_is_nowhere_sure_are_no_labels(clip: Clip, tmp_path: Path) -> None:
    """Of the brightest pixel, 72 % sure, and of haze: not everything that is not black."""
    soft = cv2.GaussianBlur(square(5).astype(np.float32), (0, 0), 1.5)
    soft *= np.linspace(0.64, 0.74, SIZE[0], dtype=np.float32)[:, None]
    hazy = (255 * soft.clip(0.03)).astype(np.uint8)
    labels = np.where(square(5), np.arange(SIZE[1]) % 24 + 1, 0).astype(np.uint8)
    masks = MaskFolders.open([write(tmp_path / "m", {"5.png": hazy, "6.png": labels})], clip)
    assert (hazy > 0).all() and hazy.max() < 0.75 * 255
    assert np.array_equal(masks.mask(0, 5), hazy > 127)
    assert np.array_equal(masks.mask(0, 6), square(5))


@pytest.mark.parametrize("late", [0, 2])
def test_names_of_images_say_of_which_frame_they_are(tmp_path: Path, late: int) -> None:
    folder = tmp_path / "from_one"
    folder.mkdir()
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / f"img_{frame + 1:04d}.jpg"), np.zeros((*SIZE, 3), np.uint8))
    clip = Clip.open(folder, fps=30.0)
    clip = Clip([LateSource(source, late) for source in clip.sources], clip.fps)
    named = write(tmp_path / "named", plain([5, 6, 9], "img_{:04d}.png"))
    assert MaskFolders.open([named], clip).complete() == [4 - late, 5 - late, 8 - late]
    numbered = write(tmp_path / "numbered", plain([5, 6, 9], "mask_{:04d}.png"))
    assert MaskFolders.open([numbered], clip).complete() == [5 - late, 6 - late, 9 - late]


def test_masks_of_a_capture_count_from_zero_whatever_images_are_called(tmp_path: Path) -> None:
    folder = tmp_path / "from_one"
    folder.mkdir()
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / f"{frame + 1:06d}.jpg"), np.zeros((*SIZE, 3), np.uint8))
    masks = write(tmp_path / "m", plain([5, 6, 9]))
    assert MaskFolders.open([masks], Clip.open(folder, fps=30.0)).complete() == [5, 6, 9]


def test_masks_of_images_that_are_called_by_their_time(tmp_path: Path) -> None:
    folder = tmp_path / "timed"
    folder.mkdir()
    names = [f"{round((frame + 1) / 30, 3)}.png" for frame in range(FRAMES)]
    for name in names:
        cv2.imwrite(str(folder / name), np.zeros((*SIZE, 3), np.uint8))
    images = {name: 255 * square(frame).astype(np.uint8) for frame, name in enumerate(names)}
    masks = MaskFolders.open([write(tmp_path / "m", images)], Clip.open(folder, fps=30.0))
    assert [masks.files[0][frame].name for frame in range(FRAMES)] == names
