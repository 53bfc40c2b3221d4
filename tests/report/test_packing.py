"""Arrays as text: bit for bit, at places a browser can read from."""

import numpy as np
import pytest

from perfcap.report.content import pack, unpack


def test_arrays_come_back() -> None:
    arrays = {
        "odd": np.arange(7, dtype=np.uint8),
        "signed": np.array([[-3, 4]], np.int16),
        "empty": np.zeros((0, 2), np.uint16),
        "points": np.random.default_rng(0).normal(size=(4, 3)).astype(np.float32),
        "faces": np.arange(6, dtype=np.uint32).reshape(2, 3)[:, ::-1],
        "big-endian": np.array([1, 2], ">u4"),
    }
    packed = pack(arrays)
    assert all(entry["start"] % 4 == 0 for entry in packed.entries.values())
    for name, array in unpack(packed).items():
        np.testing.assert_array_equal(array, arrays[name])
        assert array.dtype.name == packed.entries[name]["type"]


def test_types_that_browsers_lack() -> None:
    with pytest.raises(ValueError, match="wide is float64"):
        pack({"wide": np.zeros(3)})
