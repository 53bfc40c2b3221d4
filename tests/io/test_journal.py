"""Journals end at their last whole record, whatever was cut off or turned over."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from perfcap.io.journal import Journal, decode, encode


def record(number: int) -> dict[str, object]:
    values = np.random.default_rng(number).normal(size=(number, 3))
    return {"values": values, "bytes": np.arange(number, dtype=np.uint8), "about": {"nan": [1.5]}}


def numbers(path: Path) -> list[int]:
    found = list(Journal(path).records())
    for each in found:
        expected = record(len(each["values"]))
        assert np.array_equal(each["values"], expected["values"])  # type: ignore[arg-type]
        assert each["about"] == expected["about"] and each["bytes"].dtype == np.uint8
    return [len(each["values"]) for each in found]


def test_cut_anywhere(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    ends = [0]
    for number in range(4):
        Journal(path).append(record(number))
        ends.append(path.stat().st_size)
    data = path.read_bytes()
    for cut in range(0, len(data) + 1, 5):
        path.write_bytes(data[:cut])
        whole = sum(end <= cut for end in ends) - 1
        assert numbers(path) == list(range(whole))
        assert path.stat().st_size == ends[whole]
        Journal(path).append(record(7))
        assert numbers(path) == [*range(whole), 7]


def test_every_byte_turned_over(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    for number in (1, 2):
        Journal(path).append(record(number))
    data = path.read_bytes()
    for at in range(len(data)):
        spoiled = bytearray(data)
        spoiled[at] ^= 1 << at % 8
        path.write_bytes(bytes(spoiled))
        assert numbers(path) in ([], [1])


def test_a_checksum_that_is_right_is_not_enough(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    for head in (b"", b"{}", b"[]", b"null", b'{"plain": 3, "arrays": []}', b"[" * 5000):
        data = struct.pack("<I", len(head)) + head
        path.write_bytes(struct.pack("<4sQI", b"pcj1", len(data), zlib.crc32(data)) + data)
        with pytest.raises(ValueError, match=r"."):
            list(Journal(path).records())


@pytest.mark.parametrize("kind", ["|O", "<U9", "<M8[s]", "<f8"])
def test_only_plain_numbers_that_are_there(kind: str) -> None:
    head = f'{{"plain": {{}}, "arrays": [["a", "{kind}", [9, 9]]]}}'.encode()
    with pytest.raises(ValueError, match="an array of"):
        decode(struct.pack("<I", len(head)) + head + b"x" * 99)
    assert decode(encode({"a": None}))["a"] is None


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert list(Journal(tmp_path / "none").records()) == []
