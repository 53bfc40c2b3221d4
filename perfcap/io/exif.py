"""Which way up a JPEG is shown, as cameras note it beside the pixels."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress

_EXIF, _ORIENTATION = 0xE1, 0x0112  # a segment of a JPEG, and a tag in it
_UPRIGHT = 1


def jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Markers of a JPEG before its pixels, and where they begin."""
    position = 2
    while data[:2] == b"\xff\xd8" and position + 9 <= len(data):
        marker, length = data[position + 1], int.from_bytes(data[position + 2 : position + 4])
        if data[position] != 0xFF or length < 2:
            return
        yield marker, position
        position += 2 + length


def orientation(data: bytes) -> int:
    """EXIF orientation, 1 to 8; 1, as the pixels are, where a JPEG has none."""
    for position in _notes(data):
        start = position + 10  # of a TIFF, behind "Exif"
        order = ">" if data[start : start + 2] == b"MM" else "<"
        with suppress(struct.error):  # cut short
            entries = start + struct.unpack_from(order + "I", data, start + 4)[0]
            for number in range(struct.unpack_from(order + "H", data, entries)[0]):
                tag, _, _, value = struct.unpack_from(
                    order + "HHIH", data, entries + 2 + 12 * number
                )
                if tag == _ORIENTATION and 1 <= value <= 8:
                    return int(value)
    return _UPRIGHT


def is_turned(data: bytes) -> bool:
    """Whether a JPEG is shown turned by a quarter."""
    return orientation(data) >= 5


def as_stored(data: bytes) -> bytes:
    """An image that is shown as its pixels are stored: a JPEG loses EXIF that says otherwise."""
    if orientation(data) == _UPRIGHT:
        return data
    kept, end = bytearray(), 0
    for position in _notes(data):
        kept += data[end:position]
        end = position + 2 + int.from_bytes(data[position + 2 : position + 4])
    return bytes(kept + data[end:])


def _notes(data: bytes) -> Iterator[int]:
    """Where EXIF segments begin."""
    for marker, position in jpeg_segments(data):
        if marker == _EXIF and data[position + 4 : position + 10] == b"Exif\0\0":
            yield position
