"""Pickles of plain values are read as they were written; nothing that they name is ever called."""

from __future__ import annotations

import collections
import io
import os
import pickle
import pickletools
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.datasets.safe_pickle import loads, read_object_archive, read_pickle

SHARED = [np.ones(3, ">f4"), "text é", b"\xff\x00", b""]
VALUE = {
    "matrix": np.arange(6.0).reshape(2, 3),
    "columns": np.asfortranarray(np.arange(6).reshape(2, 3)),
    "scalar": np.float32(2.5),
    "list": SHARED,
    "again": SHARED,
    "tuple": (1, -2, 3.5, 10**30, None, True, False),
    "one": (1,),
    "objects": np.array([{"k": 1}, None], object),
    "words": np.array(["ab", "c"]),
    "empty": np.zeros((0, 3)),
    "flags": np.array([True, False]),
    3: collections.OrderedDict(x=[]),
}


def same(found: Any, value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return (
            found.shape == value.shape
            and found.dtype == value.dtype.newbyteorder("=")
            and all(same(a, b) for a, b in zip(found.flat, value.flat, strict=True))
        )
    if isinstance(value, dict):
        return list(found) == list(value) and all(same(found[k], value[k]) for k in value)
    if isinstance(value, list | tuple):
        pairs = zip(found, value, strict=True)
        return isinstance(found, type(value)) and all(same(a, b) for a, b in pairs)
    return bool(type(found) is type(value) and found == value)


@pytest.mark.parametrize("protocol", range(6))
def test_every_protocol(protocol: int) -> None:
    found = loads(pickle.dumps(VALUE, protocol))
    assert same(found, VALUE)
    assert found["again"] is found["list"]
    found["matrix"][0, 0] = 7  # can be written


def test_python_2(tmp_path: Path) -> None:
    """As cPickle of Python 2 writes an array: names of old modules, its bytes as text."""
    data = np.array([1.5, -2.0])
    text = data.tobytes()
    written = (
        b"\x80\x02}q\x01U\x01acnumpy.core.multiarray\n_reconstruct\nq\x02cnumpy\nndarray\n"
        b"q\x03K\x00\x85U\x01b\x87Rq\x04(K\x01K\x02\x85cnumpy\ndtype\nq\x05U\x02f8K\x00K\x01\x87R"
        b"q\x06(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89U\x10" + text + b"tbs."
    )
    (tmp_path / "a.pkl").write_bytes(written)
    np.testing.assert_array_equal(read_pickle(tmp_path / "a.pkl", "numbers")["a"], data)


def test_python_2_as_text() -> None:
    """Protocol 0, which was the default: bytes of arrays as escapes in quotes."""
    text = repr(np.array([1.5, -2.0, 3.7]).tobytes())[1:].encode()
    written = (
        b"(dp1\nS'a'\np2\ncnumpy.core.multiarray\n_reconstruct\np3\n(cnumpy\nndarray\np4\n(I0\n"
        b"tp5\nS'b'\np6\ntp7\nRp8\n(I1\n(I3\ntp9\ncnumpy\ndtype\np10\n(S'f8'\np11\nI0\nI1\n"
        b"tp12\nRp13\n(I3\nS'<'\np14\nNNNI-1\nI-1\nI0\ntp15\nbI00\nS" + text + b"\np16\ntp17\n"
        b"bs."
    )
    np.testing.assert_array_equal(loads(written)["a"], [1.5, -2.0, 3.7])


class Attack:
    """What runs a program when it is unpickled."""

    def __reduce__(self) -> Any:
        return os.system, ("exit 7",)


class Record:
    """An object of a class of one's own."""

    def __init__(self) -> None:
        self.value = 1


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("value", [Attack(), [Record()], {1, 2}, print, slice(3), np.random.rand])
def test_refuses_everything_else(value: Any, protocol: int) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        loads(pickle.dumps(value, protocol))


@pytest.mark.parametrize(
    "data",
    [
        b"cposix\nsystem\n(S'true'\ntR.",
        b"cbuiltins\neval\n(S'1'\ntR.",
        b"(ios\nsystem\n.",
        b"\x80\x02cnumpy\nndarray\n)\x81.",  # NEWOBJ
        b"Pother\n.",  # persistent
        b"\x82\x01.",  # extension registry
        b"cnumpy.core.multiarray\n_reconstruct\n(tR(I1\n(I9999999\ntcnumpy\ndtype\n(S'f8'\ntRI00\n"
        b"S'short'\ntb.",  # an array larger than its bytes
        b"cnumpy\ndtype\n(S'O'\ntR.",
        b"h\x05.",
        b"N",
        b"0.",
        b"S'\\q'\n.",
        b"\x80\x02\x8c\x05posix\x8c\x06system\x93.",
        b"",
        b"garbage",
    ],
)
def test_refuses_by_hand(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.pkl").write_bytes(data)
    try:
        value = read_pickle(tmp_path / "x.pkl", "numbers")
    except InputError as error:
        assert "x.pkl" in str(error) and "\n" not in str(error)
    else:
        assert "PickledType" in type(value).__name__  # a type alone does nothing


def test_damaged_pickles_end_in_one_line(tmp_path: Path) -> None:
    """Random damage: always a value or one line about the file, never anything else."""
    path, refused = tmp_path / "x.pkl", 0
    whole = pickle.dumps(VALUE, 2)
    dice = random.Random(0)
    for _ in range(400):
        data = bytearray(whole[: dice.randrange(1, len(whole))] if dice.random() < 0.3 else whole)
        for _ in range(dice.randrange(1, 4)):
            data[dice.randrange(len(data))] = dice.randrange(256)
        path.write_bytes(data)
        try:
            read_pickle(path, "numbers")
        except InputError as error:
            refused += 1
            assert str(error).startswith(f"{path}: ") and len(str(error).splitlines()) == 1
    assert 100 < refused < 400  # some damage is only other numbers


def test_shared_lists_stay_shared() -> None:
    """A pickle of lists of lists that would have 2^60 leaves takes no room."""
    value: list[Any] = []
    for _ in range(60):
        value = [value, value]
    assert len(loads(pickle.dumps(value, 2))) == 2
    assert sum(1 for _ in pickletools.genops(pickle.dumps(value, 2))) < 500


def test_archives_of_objects(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, positions_3d=np.array({"S1": {"Walk": np.ones((2, 3))}}, object), plain=[1])
    found = read_object_archive(path, "positions_3d", "positions")
    assert found["S1"]["Walk"].shape == (2, 3)
    with pytest.raises(InputError, match="no positions_2d"):
        read_object_archive(path, "positions_2d", "positions")
    with pytest.raises(InputError, match="where a dictionary should be"):
        read_object_archive(path, "plain", "positions")
    buffer = io.BytesIO()
    np.save(buffer, np.ones(3))
    path.write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match="damaged"):
        read_object_archive(path, "positions_3d", "positions")
