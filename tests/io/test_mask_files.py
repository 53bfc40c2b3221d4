"""Masks in folders: whole files, and none of an older run."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.mask_files import remove_masks, save_masks


def png(value: int) -> bytes:
    encoded: bytes = cv2.imencode(".png", np.full((4, 5), value, np.uint8))[1].tobytes()
    return encoded


def tree(folder: Path) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


def test_one_view_lies_in_the_folder_itself(tmp_path: Path) -> None:
    folder = tmp_path / "a folder/masks"
    assert save_masks(folder, {"front": [png(0), png(1), png(2)]}, 6) == 3
    assert tree(folder) == ["000006.png", "000007.png", "000008.png"]
    assert cv2.imread(str(folder / "000008.png"), cv2.IMREAD_UNCHANGED).tolist() == [[2] * 5] * 4


def test_several_views_lie_in_folders_of_their_names(tmp_path: Path) -> None:
    views = {"cam 1": [png(1)] * 2, "../out": [png(2)], "": [png(3)]}
    assert save_masks(tmp_path / "masks", views) == 4
    expected = ["cam 1/000000.png", "cam 1/000001.png", "view_1/000000.png", "view_2/000000.png"]
    assert tree(tmp_path / "masks") == expected


def test_masks_of_an_older_run_go_and_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "masks"
    save_masks(folder, {"a": [png(1)] * 9, "b": [png(1)] * 9})
    for keep in ("notes.txt", "12.png", "a/000001.png.bak", "a/x000001.png"):
        (folder / keep).write_bytes(b"mine")
    elsewhere = tmp_path / "elsewhere"
    save_masks(elsewhere, {"a": [png(1)]})
    (folder / "link").symlink_to(elsewhere)
    save_masks(folder, {"a": [png(1)] * 2})
    kept = ["12.png", "a/000001.png.bak", "a/x000001.png", "notes.txt"]
    assert sorted(tree(folder)) == sorted(["000000.png", "000001.png", *kept])
    assert not (folder / "b").exists()
    assert tree(elsewhere) == ["000000.png"]


def test_removing_leaves_nothing_of_a_plain_folder(tmp_path: Path) -> None:
    folder = tmp_path / "masks"
    save_masks(folder, {"a": [png(1)], "b": [png(1)]})
    remove_masks(folder)
    remove_masks(folder)  # nothing to do
    assert list(tmp_path.iterdir()) == []


def test_a_crash_leaves_whole_files_only(tmp_path: Path) -> None:
    def broken() -> Iterator[bytes]:
        yield png(1)
        raise RuntimeError("boom")

    with pytest.raises(RuntimeError, match="boom"):
        save_masks(tmp_path / "masks", {"a": broken()})
    assert tree(tmp_path) == ["masks/000000.png"]


def test_bad_images_and_places_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="frame 1 is not an encoded PNG"):
        save_masks(tmp_path / "masks", {"a": [png(1), b"jpeg"]})
    (tmp_path / "file").write_bytes(b"")
    for place in ("file", "file/masks"):
        with pytest.raises(InputError, match="cannot be written"):
            save_masks(tmp_path / place, {"a": [png(1)]})


def test_a_folder_of_masks_that_is_a_link_is_left_alone(tmp_path: Path) -> None:
    elsewhere, link = tmp_path / "elsewhere", tmp_path / "masks"
    save_masks(elsewhere, {"a": [png(1)], "b": [png(1)]}, 1)
    before = tree(elsewhere)
    link.symlink_to(elsewhere)
    remove_masks(link)
    with pytest.raises(InputError, match="is a link"):
        save_masks(link, {"a": [png(1)]})
    link.unlink()
    link.mkdir()
    (link / "a").symlink_to(elsewhere)
    with pytest.raises(InputError, match="is a link"):
        save_masks(link, {"a": [png(1)], "b": [png(1)]})
    assert tree(elsewhere) == before


def test_masks_that_are_kept(tmp_path: Path) -> None:
    save_masks(tmp_path, {"a": [png(1)] * 3, "b": [png(1)]})
    remove_masks(tmp_path, {"a/000001.png"})
    assert tree(tmp_path) == ["a/000001.png"]
