"""surface.npz: written in blocks, mapped when read, refused when it is something else."""

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.surface_file import open_surface, save_surface

FACES = np.array([[0, 1, 2], [2, 1, 3]])


def vertices(frames: int = 7, count: int = 4) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(frames, count, 3)).astype(np.float32)


def blocks(values: np.ndarray, size: int = 3) -> Iterator[np.ndarray]:
    for start in range(0, len(values), size):
        yield values[start : start + size]


def written(folder: Path, **changes: Any) -> Path:
    """A file as anybody might write it."""
    arrays = {
        "vertices": vertices(),
        "faces": FACES,
        "frames": np.arange(7),
        "fps": np.array(30.0),
    } | changes
    path = folder / "surface.npz"
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    path, values = tmp_path / "a surface.npz", vertices()
    save_surface(path, blocks(values), FACES, np.arange(5, 12), 24.0)
    surface = open_surface(path)
    np.testing.assert_array_equal(surface.vertices, values)
    assert isinstance(surface.vertices, np.memmap)
    np.testing.assert_array_equal(surface.faces, FACES)
    assert surface.frames.tolist() == list(range(5, 12)) and surface.rate == 24
    np.testing.assert_array_equal(np.concatenate(list(surface.blocks(2))), values)
    np.testing.assert_array_equal(surface.read(slice(2, 4)), values[2:4])
    assert surface.read(slice(2, 4)).flags.writeable  # a copy, not the file


def test_numpy_reads_the_contract(tmp_path: Path) -> None:
    path, values = tmp_path / "surface.npz", vertices()
    save_surface(path, blocks(values.astype(np.float64)), FACES, np.arange(7), 30)
    with np.load(path, allow_pickle=False) as data:
        assert sorted(data.files) == ["faces", "fps", "frames", "vertices"]
        assert data["vertices"].dtype == np.float32
        np.testing.assert_array_equal(data["vertices"], values)
        np.testing.assert_array_equal(data["faces"], FACES)
    assert zipfile.ZipFile(path).testzip() is None


def test_equal_surfaces_make_equal_files(tmp_path: Path) -> None:
    for name, size in (("a", 1), ("b", 7)):
        save_surface(tmp_path / name, blocks(vertices(), size), FACES, np.arange(7), 30)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_writing_holds_one_block_at_a_time(tmp_path: Path) -> None:
    alive = 0

    def stream() -> Iterator[np.ndarray]:
        nonlocal alive
        for _ in range(5):
            assert alive == 0
            alive += 1
            yield np.zeros((2, 4, 3))
            alive -= 1

    save_surface(tmp_path / "s.npz", stream(), FACES, np.arange(10), 30)
    assert open_surface(tmp_path / "s.npz").vertices.shape == (10, 4, 3)


@pytest.mark.parametrize(
    "values",
    [
        [vertices(6)],
        [vertices(4), vertices(4)],
        [vertices(3), vertices(4, 5)],
        [vertices(7)[0]],
        [vertices(7)[..., :2]],
        [np.where(np.arange(7)[:, None, None] == 3, np.nan, vertices())],
        [np.full((7, 4, 3), 1e300)],
        [],
    ],
)
@pytest.mark.filterwarnings("ignore:overflow encountered in cast")
def test_a_bad_surface_is_refused_and_leaves_no_file(values: list[Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="surface") as caught:
        save_surface(tmp_path / "s.npz", values, FACES, np.arange(7), 30)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_crash_on_the_way_keeps_the_older_file(tmp_path: Path) -> None:
    path = written(tmp_path)
    before = path.read_bytes()

    def broken() -> Iterator[np.ndarray]:
        yield vertices()
        raise RuntimeError("boom")

    with pytest.raises(RuntimeError, match="boom"):
        save_surface(path, broken(), FACES, np.arange(7), 30)
    assert path.read_bytes() == before and len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("how", [np.savez, np.savez_compressed])
def test_files_of_numpy_are_read(how: Any, tmp_path: Path) -> None:
    path = tmp_path / "s.npz"
    how(path, vertices=vertices(), faces=FACES, fps=np.array(25))
    surface = open_surface(path)
    np.testing.assert_array_equal(surface.vertices, vertices())
    assert surface.frames.tolist() == list(range(7)) and surface.rate == 25
    np.testing.assert_array_equal(surface.read(slice(0, 2)), vertices()[:2])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("vertices", None),
        ("vertices", vertices().astype(np.float64)),
        ("vertices", vertices()[0]),
        ("vertices", vertices()[..., :2]),
        ("vertices", vertices()[:0]),
        ("faces", None),
        ("faces", FACES + 2),
        ("faces", FACES - 1),
        ("faces", FACES.astype(float)),
        ("faces", FACES[0]),
        ("frames", np.arange(6)),
        ("frames", np.arange(7.0)),
        ("fps", None),
        ("fps", np.array(0.0)),
        ("fps", np.array(np.nan)),
        ("fps", np.array([30.0, 30.0])),
        ("fps", np.array("thirty")),
    ],
)
def test_something_else_is_refused_by_name(name: str, value: Any, tmp_path: Path) -> None:
    path = written(tmp_path, **{name: value})
    with pytest.raises(InputError, match=r"surface\.npz: ") as caught:
        open_surface(path)
    assert name in str(caught.value) or not len(value)
    assert "\n" not in str(caught.value)


def test_frames_that_are_not_finite_are_refused_where_they_are_read(tmp_path: Path) -> None:
    values = vertices()
    values[4, 1, 2] = np.inf
    surface = open_surface(written(tmp_path, vertices=values))
    surface.read(slice(0, 4))
    with pytest.raises(InputError, match="NaN or infinity"):
        surface.read(slice(4, 5))


def test_objects_are_refused_and_never_loaded(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> Any:
            return (pytest.fail, ("unpickled",))

    for name in ("vertices", "faces"):
        path = written(tmp_path, **{name: np.array([Trap()], dtype=object)})
        with pytest.raises(InputError):
            open_surface(path)


def test_missing_empty_and_foreign_files(tmp_path: Path) -> None:
    path = tmp_path / "surface.npz"
    with pytest.raises(InputError, match="no such file"):
        open_surface(path)
    for content in (b"", b"\0", b"PK\x03\x04", b"hello" * 100):
        path.write_bytes(content)
        with pytest.raises(InputError):
            open_surface(path)


def test_truncation_and_damage_end_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "surface.npz"
    save_surface(path, blocks(vertices()), FACES, np.arange(7), 30)
    data, rng = path.read_bytes(), np.random.default_rng(0)
    for length in np.linspace(0, len(data) - 1, 50).astype(int):
        path.write_bytes(data[:length])
        with pytest.raises(InputError):
            open_surface(path)
    for _ in range(500):
        damaged = bytearray(data)
        for place in rng.integers(0, len(data), 4):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            surface = open_surface(path)
            for block in surface.blocks():
                assert np.isfinite(block).all()
        except InputError as error:
            assert "\n" not in str(error)


def test_a_header_that_promises_more_than_there_is(tmp_path: Path) -> None:
    path = written(tmp_path)
    data = path.read_bytes()
    assert data.count(b"(7, 4, 3), }") == 1
    path.write_bytes(data.replace(b"(7, 4, 3), }", b"(10**9,4,3)}"[:12]))
    with pytest.raises(InputError):
        open_surface(path)
    path.write_bytes(data.replace(b"(7, 4, 3), }", b"(9, 4, 3), }"))
    with pytest.raises(InputError, match="says"):
        open_surface(path)
