"""Folders of images as clips."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from video_files import number, picture

from perfcap.errors import InputError
from perfcap.io.clip import Clip


def make_folder(path: Path, names: list[str]) -> Path:
    path.mkdir()
    for name in names:
        value = int("".join(c for c in name if c.isdigit()) or 0)
        cv2.imwrite(str(path / name), picture(value)[..., ::-1])
    return path


def test_images_in_natural_order_and_rgb(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "frames", ["f10.png", "f9.png", "f8.png"])
    red = np.zeros((48, 64, 3), np.uint8)
    red[..., 2] = 255
    cv2.imwrite(str(folder / "f11.png"), red)
    (folder / ".hidden.png").write_bytes(b"x")
    (folder / "notes.txt").write_text("not a frame")
    clip = Clip.open(folder)
    assert [number(f) for f in clip.read(0, 3)[:, 0]] == [8, 9, 10]
    assert clip.read(3, 4)[0, 0, 0, 0].tolist() == [255, 0, 0]
    assert clip.fps == 30 and "no frame rate" in clip.warnings[0]
    assert Clip.open(folder, frames=slice(0, 2)).total == len(clip) == 4
    assert not Clip.open(folder, fps=50).warnings and Clip.open(folder, fps=50).fps == 50


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["f1.png", "f2.png", "f3.png", "f7.png"], "images are missing between 3 and 7; "),
        (["f0.png", "f5.png", "f10.png"], None),
        (["a1.png", "a2.png", "b1.png"], "holds 2 series of images, whose names begin with 'a', "),
        (["1.png", "2.png"], None),
    ],
)
def test_numbers_that_tell_of_other_frames(
    tmp_path: Path, names: list[str], words: str | None
) -> None:
    warnings = Clip.open(make_folder(tmp_path / "frames", names), fps=30).warnings
    assert [str(words) in line for line in warnings] == [True] * (words is not None)


FOUR = ["0000.png", "0001.png", "0002.png", "0003.png"]


@pytest.mark.parametrize(
    "copy", ["0001 (1).png", "0001 - Copy.png", "0001 copy 2.png", "0001(1).PNG", "0001_mask.png"]
)
def test_copies_are_named(tmp_path: Path, copy: str) -> None:
    clip = Clip.open(make_folder(tmp_path / "frames", [*FOUR, copy]), fps=30)
    (told,) = clip.warnings
    assert f"holds an image named as another with more behind, {copy!r} beside '0001.png'" in told
    assert len(clip) == 5


def test_several_copies_do_not_hide_what_is_missing(tmp_path: Path) -> None:
    names = [*FOUR[:2], FOUR[3], "0001 (1).png", "0003 (1).png"]
    copied, missing = Clip.open(make_folder(tmp_path / "frames", names), fps=30).warnings
    assert "holds 2 images named as another" in copied and "'0001 (1).png' beside" in copied
    assert "images are missing between 1 and 3; " in missing


@pytest.mark.parametrize(
    "names",
    [
        ["12.png", "12.05.png", "12.5.png", "13.png"],  # seconds
        ["a_120000.png", "a_120000_1.png", "a_120000_2.png"],  # several of a second
        ["frame (1).png", "frame (2).png", "frame (3).png"],
        ["cam1 001 left.png", "cam1 002 left.png"],
    ],
)
def test_names_that_are_no_copies(tmp_path: Path, names: list[str]) -> None:
    warnings = Clip.open(make_folder(tmp_path / "frames", names), fps=30).warnings
    assert not any("named as another" in line for line in warnings)


def test_images_are_turned_as_their_camera_was(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image", reason="needs pillow to write EXIF")
    (tmp_path / "frames").mkdir()
    exif = image.Exif()
    exif[0x0112] = 6  # stored as is, to be shown turned clockwise
    image.fromarray(picture(5)).save(tmp_path / "frames/1.jpg", exif=exif, quality=95)
    clip = Clip.open(tmp_path / "frames")
    assert clip.sizes == ((64, 48),)
    turned = np.rot90(clip.read(0, 1)[0, 0])
    assert number(turned) == 5


def test_bad_folders(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="holds no images"):
        Clip.open(tmp_path / "empty")
    folder = make_folder(tmp_path / "frames", ["1.png", "2.png"])
    (folder / "3.png").write_bytes(b"not an image")
    cv2.imwrite(str(folder / "4.png"), np.zeros((20, 20, 3), np.uint8))
    (folder / "5.jpg").write_bytes(b"")
    clip = Clip.open(folder)
    for i, words in ((2, r"3\.png: is not an image"), (3, "is 20x20"), (4, "is empty")):
        with pytest.raises(InputError, match=words):
            clip.read(i, i + 1)


@pytest.mark.parametrize(
    ("names", "pair"),
    [
        ([*FOUR, "0000.jpg", "0001.jpg", "0002.jpg", "0003.jpg"], "0000.jpg and 0000.png"),
        (["1.png", "01.png", "2.png", "02.png"], "01.png and 1.png"),
        (["f1.png", "F01.PNG", "f2.png"], "F01.PNG and f1.png"),
        (["1 left.png", "1 left.jpg"], "1 left.jpg and 1 left.png"),
    ],
)
def test_two_images_of_one_frame_are_refused(tmp_path: Path, names: list[str], pair: str) -> None:
    folder = make_folder(tmp_path / "frames", names)
    with pytest.raises(InputError, match="images of one frame twice") as refused:
        Clip.open(folder, fps=30)
    assert pair in str(refused.value) and str(folder) in str(refused.value)


@pytest.mark.parametrize("inside", [".", "videos", "Videos/Cam0/InputMedia/walk"])
def test_folders_of_videos_name_them(tmp_path: Path, inside: str) -> None:
    folder = tmp_path / "session"
    place = folder / inside
    place.mkdir(parents=True)
    for name in ("b.mov", "a.mp4", ".c.mp4", "d.txt"):
        (place / name).write_bytes(b"0")
    with pytest.raises(InputError) as refused:
        Clip.open(folder)
    expected = f"one for each view: {place / 'a.mp4'}, {place / 'b.mov'}"
    assert (
        str(refused.value)
        == f"{folder}: holds no images, but videos; give these by name, {expected}"
    )


def test_an_image_without_a_number_beside_a_series_is_named(tmp_path: Path) -> None:
    numbered = [f"frame_{n:04d}.png" for n in (0, 1, 2, 3, 5, 6)]
    clip = Clip.open(make_folder(tmp_path / "stray", ["background.png", *numbered]), fps=30)
    stray, gap = clip.warnings
    assert "'background.png' without a number beside 6 numbered images" in stray
    assert "images are missing between 3 and 5" in gap
    named = Clip.open(make_folder(tmp_path / "names", ["front.png", "side.png"]), fps=30)
    assert not named.warnings


@pytest.mark.parametrize(("factor", "told"), [(16, True), (257, False), (1, True), (0, True)])
@pytest.mark.parametrize("ending", ["png", "tif"])
def test_few_of_sixteen_bits_are_named(
    tmp_path: Path, ending: str, factor: int, told: bool
) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for frame in range(3):
        image = factor * picture(frame).astype(np.uint16)
        cv2.imwrite(str(folder / f"{frame}.{ending}"), image)
    warnings = Clip.open(folder, fps=30).warnings
    assert ["images have 16 bits and no value above" in line for line in warnings] == [True] * told


def test_dark_pictures_are_not_named(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for frame, level in enumerate((0, 60000, 0)):  # of 16, which fade in
        cv2.imwrite(str(folder / f"{frame}.png"), np.full((48, 64, 3), level, np.uint16))
    assert not Clip.open(folder, fps=30).warnings
    cv2.imwrite(str(folder / "0.png"), np.full((48, 64, 3), 3, np.uint8))
    assert not Clip.open(folder, fps=30).warnings


def test_names_that_are_seconds_are_in_their_order(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for frame in range(40):
        cv2.imwrite(str(folder / f"{round(frame / 30, 3)}.png"), picture(frame)[..., ::-1])
    clip = Clip.open(folder, fps=30)
    assert [number(f) for f in clip.read(0, 40)[:, 0]] == list(range(40)) and not clip.warnings


@pytest.mark.parametrize("form", ["1.{}", "1.{:02d}"])
def test_numbers_of_shots_and_frames_are_no_seconds(tmp_path: Path, form: str) -> None:
    names = [form.format(frame) for frame in range(1, 102)]
    folder = tmp_path / "frames"
    folder.mkdir()
    for name in names:
        cv2.imwrite(str(folder / f"{name}.png"), np.zeros((4, 4, 3), np.uint8))
    assert Clip.open(folder, fps=30).image_names == (tuple(names),)
