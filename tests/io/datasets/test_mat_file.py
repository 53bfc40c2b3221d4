"""MATLAB files: what scipy writes is read back, and what is damaged is refused, never worse."""

from __future__ import annotations

import io
import random
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from perfcap.io.datasets.matlab import HEADER, read_variables


def written(compressed: bool, **values: Any) -> bytes:
    out = io.BytesIO()
    savemat(out, values, do_compression=compressed)
    return out.getvalue()


def cell(*arrays: np.ndarray) -> np.ndarray:
    found = np.empty((len(arrays), 1), dtype=object)
    for at, array in enumerate(arrays):
        found[at, 0] = array
    return found


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kind", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"])
def test_numbers_come_back(kind: str, compressed: bool) -> None:
    values = np.arange(24).reshape(2, 3, 4).astype(kind)
    data = written(compressed, other=np.ones(3), wanted=values, short=np.array([[1, 2]], kind))
    found = read_variables(data, ("wanted", "short", "missing"))
    expected = loadmat(io.BytesIO(data))
    assert sorted(found) == ["short", "wanted"]
    for name, array in found.items():
        assert array.dtype == expected[name].dtype
        np.testing.assert_array_equal(array, expected[name])


@pytest.mark.parametrize("compressed", [False, True])
def test_cells_come_back(compressed: bool) -> None:
    inside = [np.random.default_rng(i).normal(size=(5, i + 1)) for i in range(3)]
    found = read_variables(written(compressed, a=cell(*inside)), ("a",))["a"]
    assert found.shape == (3, 1) and found.dtype == object
    for one, other in zip(found[:, 0], inside, strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_other_order_of_bytes() -> None:
    head = b"MATLAB 5.0".ljust(124) + struct.pack(">H", 0x0100) + b"MI"
    parts = struct.pack(">IIII", 6, 8, 6, 0) + struct.pack(">IIii", 5, 8, 1, 2)
    parts += struct.pack(">II", 1, 1) + b"a" + bytes(7) + struct.pack(">IIdd", 9, 16, 1.5, -2)
    found = read_variables(head + struct.pack(">II", 14, len(parts)) + parts, ("a",))
    assert found["a"].tolist() == [[1.5, -2.0]]


def test_damaged_files_are_refused_or_read() -> None:
    """Nothing but ValueError and struct.error: scipy's reader crashed on such bytes."""
    whole = [written(packed, a=cell(np.ones((4, 3)), np.eye(2)), b=np.eye(3)) for packed in (0, 1)]
    rng = random.Random(0)
    refused = 0
    for _ in range(1500):
        data = bytearray(rng.choice(whole))
        for _ in range(rng.choice((1, 2, 8))):
            at = rng.randrange(HEADER, len(data))
            data[at : at + 4] = rng.choice((rng.randbytes(4), struct.pack("<I", rng.randrange(99))))
        if rng.random() < 0.2:
            del data[rng.randrange(len(data)) :]
        try:
            read_variables(bytes(data), ("a", "b"))
        except (ValueError, struct.error):
            refused += 1
    assert refused > 500


def test_lies_about_sizes_cost_no_memory() -> None:
    data = written(False, a=np.zeros((2, 2)))
    at = data.index(struct.pack("<ii", 2, 2))
    for sizes in ((2**30, 2**30), (-1, 4), (2**31 - 1, 0)):
        lying = data[:at] + struct.pack("<ii", *sizes) + data[at + 8 :]
        with pytest.raises(ValueError, match="size"):
            read_variables(lying, ("a",))
    bomb = zlib.compress(b"\0" * 40 + b"a" + bytes(257 << 20), 1)
    whole = data[:HEADER] + struct.pack("<II", 15, len(bomb)) + bomb
    with pytest.raises(ValueError, match="larger than"):
        read_variables(whole, ("a",))
