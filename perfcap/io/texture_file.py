"""Encoded images of the files of characters: of formats, sizes and a way up that are read."""

from __future__ import annotations

from typing import Protocol

from perfcap.actor.template import image_mime
from perfcap.errors import InputError
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.exif import as_stored
from perfcap.io.image_file import image_size, is_damaged_png

LARGEST_SIDE = 16_384  # px
LARGEST_AREA = 1 << 27  # px; a decoded image of this size takes 400 MB


class ImageSource(Protocol):
    """Where encoded images come from."""

    def image(self, index: object) -> bytes:
        """Encoded bytes of an image."""

    def error(self, message: str) -> InputError:
        """An error that names the file."""


def encoded_image(source: ImageSource, number: int, notes: list[Finding]) -> bytes | None:
    """An image of a file, None (with a note) if it is neither JPEG nor PNG.

    Texture coordinates are of the pixels as they are stored; a photograph that a camera wants
    shown turned loses that note, which programs follow or not.

    Args:
        source: the file.
        number: of the image.
        notes: where to say what had to be done.

    Raises:
        InputError: it is damaged, or too large to be decoded.
    """
    data = source.image(number)
    if image_mime(data) is None:
        what = "its texture is neither JPEG nor PNG and is left out"
        notes.append(Finding(Severity.WARNING, f"image {number}", what, "export it as PNG"))
        return None
    size = image_size(data)
    if size is None or is_damaged_png(data):
        raise source.error(f"image {number} is damaged; export it again as JPEG or PNG")
    if max(size) > LARGEST_SIDE or size[0] * size[1] > LARGEST_AREA:
        raise source.error(
            f"image {number} is {size[0]} x {size[1]} pixels; at most {LARGEST_SIDE} a side and "
            f"{LARGEST_AREA >> 20} million are read, make it smaller"
        )
    plain = as_stored(data)
    if plain != data:
        what = "its EXIF orientation is left out: the texture is read as its pixels are stored"
        remedy = "if it is turned on the person, save it upright"
        notes.append(Finding(Severity.WARNING, f"image {number}", what, remedy))
    return plain
