"""Images that somebody else made: their size is known before they are decoded."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, require_file

IMAGE_LIMIT = 256 * MEBIBYTE
_PNG = b"\x89PNG\r\n\x1a\n"
MOST_PIXELS = 1 << 27  # more than any camera has; a few bytes can declare many times that


def decode_image(path: Path, flags: int, what: str = "an image") -> NDArray[np.uint8]:
    """An image as OpenCV decodes it.

    Args:
        path: the file.
        flags: ``cv2.IMREAD_...``.
        what: it should be, for messages.

    Raises:
        InputError: it is empty, too large, damaged, or no image.
    """
    require_file(path, IMAGE_LIMIT, what)
    data = path.read_bytes()
    if data[:4] == _PNG[:4] and not is_whole_png(data):
        raise InputError(f"{path}: is a damaged PNG; expected {what}, write it again")
    size = image_size(data)
    if size is not None and size[0] * size[1] > MOST_PIXELS:
        raise InputError(
            f"{path}: says it is {size[0]}x{size[1]}, expected at most {MOST_PIXELS >> 20} million "
            "pixels; write it smaller"
        )
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise InputError(f"{path}: cannot be decoded as an image ({error.err})") from error
    if image is None:
        raise InputError(f"{path}: is not an image or is damaged; expected {what}, write it again")
    decoded: NDArray[np.uint8] = image
    return decoded


def is_whole_png(data: bytes) -> bool:
    """Whether the chunks of a PNG lie within it: OpenCV makes room for what a chunk says it has."""
    if data[:8] != _PNG or data[12:16] != b"IHDR":
        return False
    position = 8
    while position + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, position)
        position += 12 + length
        if kind == b"IEND":
            return bool(position <= len(data))
    return False


def image_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that the header of a PNG or JPEG declares, None if it has none."""
    if data[:4] == b"\x89PNG" and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return int(width), int(height)
    position = 2
    while data[:2] == b"\xff\xd8" and position + 9 <= len(data):
        marker, length = data[position + 1], int.from_bytes(data[position + 2 : position + 4])
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # start of a frame
            height, width = struct.unpack_from(">HH", data, position + 5)
            return int(width), int(height)
        if data[position] != 0xFF or length < 2:
            return None
        position += 2 + length
    return None
