"""Archives are judged by their headers: nothing is unpacked that is out of proportion."""

import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.archive import SMALL, map_archive, read_archive
from perfcap.io.detections import read_detections
from perfcap.io.files import MEBIBYTE


def refused(path: Path) -> tuple[str, int]:
    """The refusal, and the memory that it took, bytes."""
    tracemalloc.start()
    with pytest.raises(InputError) as caught:
        read_detections(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return str(caught.value), peak


def claimed(archive: zipfile.ZipFile, name: str, count: int) -> None:
    """An array that is said to be large; its numbers are not there."""
    with archive.open(f"{name}.npy", "w") as out:
        header = {"descr": "<f8", "fortran_order": False, "shape": (count,)}
        np.lib.format.write_array_header_1_0(out, header)


def test_zeros_that_pack_well_are_refused_before_they_are_unpacked(tmp_path: Path) -> None:
    path, frames = tmp_path / "detections.npz", 9 * SMALL // (8 * 16 * 10)
    pixels = np.zeros((frames, 16, 2), np.uint8)
    np.savez_compressed(path, joints2d=pixels, confidence2d=np.ones((frames, 16), np.uint8))
    assert path.stat().st_size < MEBIBYTE
    words, peak = refused(path)
    assert "joints2d is " in words or "confidence2d is " in words
    assert "unpacks to" in words and peak < 4 * MEBIBYTE


@pytest.mark.long
def test_names_count_as_well(tmp_path: Path) -> None:
    path = tmp_path / "detections.npz"
    names = np.zeros(60, f"U{MEBIBYTE}")
    np.savez_compressed(path, joints2d=np.zeros((3, 16, 2)), joint_names=names)
    words, peak = refused(path)
    assert "joint_names is" in words and peak < 16 * MEBIBYTE


def test_arrays_that_nobody_asks_for_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as archive:
        claimed(archive, "other", SMALL)
        with archive.open("wanted.npy", "w") as out:
            np.lib.format.write_array(out, np.arange(3))
    assert read_archive(path, ["wanted"], "numbers")["wanted"].tolist() == [0, 1, 2]


def test_what_is_in_proportion_is_read(tmp_path: Path) -> None:
    path, values = tmp_path / "a.npz", np.random.default_rng(0).normal(size=(40, 3, 5))
    turned = np.asfortranarray(values)
    np.savez_compressed(path, plain=values, turned=turned, word=np.array("x"), none=np.zeros(0))
    found = read_archive(path, ["plain", "turned", "word", "none", "missing"], "numbers")
    assert set(found) == {"plain", "turned", "word", "none"}
    assert np.array_equal(found["plain"], values) and np.array_equal(found["turned"], values)
    assert str(found["word"]) == "x" and found["none"].shape == (0,)
    found["plain"][0] = 1  # nobody else's


def test_a_header_that_says_more_or_less_than_there_is(tmp_path: Path) -> None:
    for shape in ((2,), (4,), (2**62, 4)):
        with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive, archive.open("a.npy", "w") as out:
            header = {"descr": "<f8", "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_1_0(out, header)
            out.write(np.zeros(3).tobytes())
        with pytest.raises(InputError, match=r"a\.npz"):
            read_archive(tmp_path / "a.npz", ["a"], "numbers")


def test_objects_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="objects"):
        read_archive(tmp_path / "a.npz", ["a"], "numbers")


def test_arrays_beside_a_mapped_one(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as archive:
        with archive.open("large.npy", "w") as out:
            np.lib.format.write_array(out, np.zeros((2, 3)))
        claimed(archive, "bomb", SMALL)
    with pytest.raises(InputError, match="bomb is float64"):
        map_archive(path, "large", ["bomb"], "numbers", 2**40)
    assert np.array_equal(map_archive(path, "large", [], "numbers", 2**40)["large"], [[0] * 3] * 2)
