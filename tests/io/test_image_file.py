"""Images are refused by their headers: a few bytes can declare gigabytes."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.image_file import decode_image, is_damaged_png, read_image, read_silhouette


def encoded(suffix: str = ".png") -> bytes:
    picture = np.arange(48, dtype=np.uint8).reshape(6, 8)
    data: bytes = cv2.imencode(suffix, picture)[1].tobytes()
    return data


def test_whole_images_are_read(tmp_path: Path) -> None:
    for suffix in (".png", ".jpg", ".bmp"):
        path = tmp_path / f"a{suffix}"
        path.write_bytes(encoded(suffix))
        assert decode_image(path, cv2.IMREAD_GRAYSCALE).shape == (6, 8)
    assert not is_damaged_png(encoded())


def test_sizes_that_nobody_has(tmp_path: Path) -> None:
    data = bytearray(encoded())
    struct.pack_into(">II", data, 16, 60_000, 60_000)
    struct.pack_into(">I", data, 29, zlib.crc32(data[12:29]))
    (tmp_path / "a.png").write_bytes(data)
    for read in (read_image, read_silhouette):
        with pytest.raises(InputError, match="60000x60000"):
            read(tmp_path / "a.png")


@pytest.mark.parametrize("at", [8, 33])
def test_chunks_that_say_more_than_there_is(tmp_path: Path, at: int) -> None:
    """Found by tools/fuzz.py: 179 bytes that took 2 GB, and 72 that took more than ten seconds."""
    data = bytearray(encoded())
    struct.pack_into(">I", data, at, 0x7FFFFFF0)
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(InputError, match="damaged PNG"):
        read_silhouette(tmp_path / "a.png")


def test_cut_anywhere(tmp_path: Path) -> None:
    data = encoded()
    for cut in range(1, len(data)):
        (tmp_path / "a.png").write_bytes(data[:cut])
        with pytest.raises(InputError):
            decode_image(tmp_path / "a.png", cv2.IMREAD_GRAYSCALE)
