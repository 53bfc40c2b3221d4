"""Materials of many parts in one texture."""

import struct
import zlib
from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.doctor.finding import Finding
from perfcap.io.gltf_texture import Material, one_texture
from perfcap.io.image_file import image_size

WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Source:
    """Images in memory."""

    images: tuple[bytes, ...]

    def image(self, index: object) -> bytes:
        return self.images[int(str(index))]

    def error(self, message: str) -> InputError:
        return InputError(f"a.glb: {message}")


def encoded(picture: np.ndarray, kind: str = ".png") -> bytes:
    return cv2.imencode(kind, picture[..., ::-1])[1].tobytes()


def gradient(height: int, width: int, blue: int) -> np.ndarray:
    rows, columns = np.mgrid[:height, :width]
    return np.stack((4 * rows, 4 * columns, np.full_like(rows, blue)), -1).astype(np.uint8)


def seen(data: bytes, uv: np.ndarray) -> np.ndarray:
    """Colours of a texture at coordinates of texel middles."""
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    height, width = picture.shape[:2]
    return picture[np.floor(uv[:, 1] * height).astype(int), np.floor(uv[:, 0] * width).astype(int)]


def middles(height: int, width: int) -> np.ndarray:
    rows, columns = np.mgrid[:height, :width]
    return np.stack(((columns + 0.5) / width, (rows + 0.5) / height), -1).reshape(-1, 2)


def test_one_image_is_kept_as_it_is() -> None:
    data, uv = encoded(gradient(8, 8, 0)), middles(8, 8)
    texture, moved = one_texture(Source((data,)), [Material(0, WHITE)] * 2, [uv, uv[:3]], [])
    assert texture is data
    assert moved[0] is uv


def test_several_images_and_colours_show_what_they_showed() -> None:
    pictures = [gradient(40, 24, 10), gradient(16, 60, 200)]
    source = Source(tuple(encoded(picture) for picture in pictures))
    materials = [Material(0, WHITE), Material(1, WHITE), Material(None, (1.0, 0.0, 0.0))]
    coordinates = [middles(40, 24), middles(16, 60), None]
    notes: list[Finding] = []
    texture, moved = one_texture(source, materials, coordinates, notes)
    assert texture is not None
    for picture, uv in zip(pictures, moved, strict=False):
        assert uv is not None
        np.testing.assert_array_equal(seen(texture, uv), picture.reshape(-1, 3))
    assert moved[2] is not None
    np.testing.assert_array_equal(seen(texture, moved[2]), [[255, 0, 0]])
    assert "3 materials" in notes[0].what


@pytest.mark.parametrize("kind", [".png", ".jpg"])
def test_an_image_is_multiplied_by_its_colour_in_linear_light(kind: str) -> None:
    """Half the light of sRGB 255 is 188, and of 100 is 71."""
    picture = np.full((16, 16, 3), (255, 100, 100), np.uint8)
    source, uv = Source((encoded(picture, kind),)), middles(16, 16)
    notes: list[Finding] = []
    texture, moved = one_texture(source, [Material(0, (0.5, 0.5, 1.0))], [uv], notes)
    assert texture is not None and moved[0] is uv
    assert texture[:2] == source.images[0][:2]  # of the same format
    shown = seen(texture, uv).astype(int)
    assert np.abs(shown - (188, 71, 100)).max() <= (0 if kind == ".png" else 3)
    assert "multiplied by the base colours" in notes[0].what


def test_one_image_in_two_colours_shows_both() -> None:
    picture, uv = gradient(16, 24, 90), middles(16, 24)
    materials = [Material(0, WHITE), Material(0, (0.0, 1.0, 1.0))]
    texture, moved = one_texture(Source((encoded(picture),)), materials, [uv, uv], [])
    assert texture is not None
    for factor, there in zip((1, 0), moved, strict=True):
        assert there is not None
        expected = picture.reshape(-1, 3) * (factor, 1, 1)
        np.testing.assert_array_equal(seen(texture, there), expected)


def test_colours_of_vertices_of_all_parts_stand_beside_images() -> None:
    picture = gradient(20, 20, 10)
    ramp = np.linspace((250, 40, 30), (20, 20, 120), 7).astype(np.uint8)
    parts = [Material(None, WHITE, ramp[:4].tobytes()), Material(None, WHITE, ramp[4:].tobytes())]
    alone, moved = one_texture(Source(()), parts, [None, middles(1, 3)], [])
    assert alone is not None
    shown = np.concatenate([seen(alone, uv) for uv in moved if uv is not None])
    assert np.abs(shown.astype(int) - ramp).max() <= 3
    source, uv = Source((encoded(picture),)), middles(20, 20)
    texture, moved = one_texture(source, [*parts, Material(0)], [None, None, uv], [])
    assert texture is not None and moved[2] is not None
    np.testing.assert_array_equal(seen(texture, moved[2]), picture.reshape(-1, 3))
    shown = np.concatenate([seen(texture, uv) for uv in moved[:2] if uv is not None])
    assert np.abs(shown.astype(int) - ramp).max() <= 3


def test_tiles_further_along_are_the_same_tile() -> None:
    pictures = [gradient(8, 8, 10), gradient(8, 8, 200)]
    source = Source(tuple(encoded(picture) for picture in pictures))
    shifted = middles(8, 8) + np.array([3, -2])
    texture, moved = one_texture(
        source, [Material(0, WHITE), Material(1, WHITE)], [middles(8, 8), shifted], []
    )
    assert texture is not None and moved[1] is not None
    np.testing.assert_array_equal(seen(texture, moved[1]), pictures[1].reshape(-1, 3))


def grid(count: int) -> np.ndarray:
    """Triangles of a strip of so many vertices."""
    first = np.arange(count - 2)
    return np.stack((first, first + 1, first + 2), 1)


def test_pieces_find_their_own_tiles_by_the_vertices_of_their_triangles() -> None:
    pictures = [gradient(8, 8, 10), gradient(8, 8, 200)]
    source = Source(tuple(encoded(picture) for picture in pictures))
    uv = middles(8, 8)
    further = [uv + np.array(tiles) for tiles in ((0, 0), (1, 0), (0, -3))]
    shared = np.concatenate((*further, [[5.0, 9.0]]))  # one is used by none
    faces = [grid(64), np.concatenate((grid(64) + 64, grid(64) + 128))]
    notes: list[Finding] = []
    texture, moved = one_texture(
        source, [Material(0, WHITE), Material(1, WHITE)], [shared, shared], notes, faces
    )
    assert texture is not None and moved[0] is not None and moved[1] is not None
    np.testing.assert_array_equal(seen(texture, moved[0][:64]), pictures[0].reshape(-1, 3))
    for piece in (slice(64, 128), slice(128, 192)):
        np.testing.assert_array_equal(seen(texture, moved[1][piece]), pictures[1].reshape(-1, 3))
    assert not any("beyond one copy" in note.what for note in notes)


@pytest.mark.parametrize(("repeats", "said"), [(1, False), (3, True)])
def test_images_that_repeat_within_a_piece_are_told(repeats: int, said: bool) -> None:
    pictures = [gradient(8, 8, 10), gradient(8, 8, 200)]
    source = Source(tuple(encoded(picture) for picture in pictures))
    uv = middles(8, 8)
    notes: list[Finding] = []
    kinds = [Material(0, WHITE), Material(1, WHITE)]
    one_texture(source, kinds, [uv, repeats * uv], notes, [grid(64), grid(64)])
    assert any("beyond one copy of its image" in note.what for note in notes) is said


def test_no_image_is_no_texture() -> None:
    assert one_texture(Source(()), [Material(None, WHITE)], [None], [])[0] is None
    notes: list[Finding] = []
    webp = Source((b"RIFF....WEBP",))
    assert one_texture(webp, [Material(0, WHITE)], [middles(2, 2)], notes)[0] is None
    assert "neither JPEG nor PNG" in notes[0].what


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def bomb(width: int, height: int) -> bytes:
    """A small PNG that claims to be large."""
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = zlib.compress(bytes(1 << 16))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("size", [(1 << 20, 4), (16_000, 16_000), (1 << 31, 1 << 31)])
def test_bombs_are_refused_before_they_are_decoded(size: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=rf"a\.glb: image 0 is {size[0]} x {size[1]} pixels"):
        one_texture(Source((bomb(*size),)), [Material(0, WHITE)], [middles(2, 2)], [])


@pytest.mark.parametrize("kind", [".png", ".jpg"])
def test_sizes_are_read_from_headers(kind: str) -> None:
    data = encoded(gradient(12, 30, 0), kind)
    assert image_size(data) == (30, 12)
    for length in range(0, 24, 3):
        assert image_size(data[:length]) is None


def test_a_damaged_image_is_refused() -> None:
    with pytest.raises(InputError, match="damaged"):
        one_texture(Source((b"\xff\xd8\xff\xe0\0\0",)), [Material(0, WHITE)], [middles(2, 2)], [])
