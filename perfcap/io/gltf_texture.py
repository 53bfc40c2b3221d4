"""One texture for all parts of a character.

Programs give each part of a character (skin, eyes, clothes) a material of its own; an actor has one
texture. A single image is kept as it is, byte for byte; several are placed side by side in a new
one, and coordinates follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.gltf_document import Document, Object
from perfcap.io.texture_file import ImageSource, encoded_image
from perfcap.io.texture_tiles import REPEATED, Wraps, in_one_tile, wraps
from perfcap.io.vertex_colors import colors_to_texture, read_colors, to_linear, to_srgb

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]

_SHEET = 4096  # px, side that the images of several materials are fitted into
_PATCH = 16  # px, side of a material of one colour
_BORDER = 4  # px around each image, so that filters see nothing of its neighbours
_JPEG_QUALITY = 95
_WHITE = (1.0, 1.0, 1.0)
_FEW = 0.01  # of the triangles of a part
_SEEN = 0.5  # of alpha, where the file says no other
_OF_VERTICES = -1  # number of the image that is made of their colours


@dataclass(frozen=True)
class Material:
    """What a part is painted with: an image of the file, colours of vertices, or a plain colour.

    Attributes:
        image: number of the image.
        color: linear light, 0 to 1; an image is multiplied by it.
        colors: of vertices where there is no image, sRGB, three bytes each.
    """

    image: int | None
    color: tuple[float, float, float] = _WHITE
    colors: bytes | None = None


@dataclass(frozen=True)
class Blend:
    """How a part that is not opaque is drawn.

    Attributes:
        factor: of the alpha of its image.
        cutoff: alpha below which it is hardly seen, or not at all.
    """

    factor: float
    cutoff: float


def read_blend(document: Document, primitive: Object) -> Blend | None:
    """How a primitive is seen through, by the ``alphaMode`` of its material; None if it is not."""
    if "material" not in primitive:
        return None
    material = document.item("materials", primitive["material"])
    mode = material.get("alphaMode")
    if mode not in ("MASK", "BLEND"):
        return None
    given = material.get("alphaCutoff", _SEEN) if mode == "MASK" else _SEEN
    (cutoff,) = document.numbers([given], 1, "alphaCutoff")
    return Blend(float(_painted_by(document, material)[0][3]), float(cutoff))


def read_material(document: Document, primitive: Object) -> tuple[Material, int, Floats, Wraps]:
    """Material of a primitive; its texture coordinates: which, their transform (2, 3), wraps."""
    identity, plain = np.eye(2, 3), REPEATED
    if "material" not in primitive:
        return _without_image(document, primitive, np.ones(3)), 0, identity, plain
    material = document.item("materials", primitive["material"])
    factor, reference = _painted_by(document, material)
    light = np.clip(factor[:3], 0, 1)
    if reference is None:
        return _without_image(document, primitive, light), 0, identity, plain
    texture = document.item("textures", reference.get("index"))
    coordinate, transform = _coordinates(document, reference)
    source = texture.get("source")
    for other in _extensions(texture).values() if source is None else ():
        source = other.get("source")  # WebP and the like, which are named when they are decoded
    if source is None:
        return _without_image(document, primitive, light), coordinate, identity, plain
    number = document.integer(source, "texture.source", 0, len(document.items("images")) - 1)
    return Material(number, _triple(light)), coordinate, transform, wraps(document, texture)


def _painted_by(document: Document, material: Object) -> tuple[Floats, Object | None]:
    """Colour of a material, (4,), and its reference to a texture.

    Colour of light that is reflected; by the extension that came before metallic roughness; or,
    where a material reflects nothing, of light that it emits.
    """
    surface: Any = material.get("pbrMetallicRoughness")
    surface = surface if isinstance(surface, dict) else {}
    glossy = _extensions(material).get("KHR_materials_pbrSpecularGlossiness", {})
    reference = surface.get("baseColorTexture")
    color, name = surface.get("baseColorFactor", [1, 1, 1, 1]), "baseColorFactor"
    if not isinstance(reference, dict) and glossy:
        reference, name = glossy.get("diffuseTexture"), "diffuseFactor"
        color = glossy.get("diffuseFactor", [1, 1, 1, 1])
    factor = document.numbers(color, 4, name)
    emitted = material.get("emissiveTexture")
    if isinstance(emitted, dict) and not factor[:3].any():
        light = document.numbers(material.get("emissiveFactor", [0, 0, 0]), 3, "emissiveFactor")
        reference, factor = emitted, np.append(light, 1.0)
    return factor, reference if isinstance(reference, dict) else None


def _extensions(entry: Object) -> dict[str, Object]:
    """Extensions of an object of the file, by name."""
    given = entry.get("extensions")
    found = given.items() if isinstance(given, dict) else ()
    return {name: value for name, value in found if isinstance(value, dict)}


def _without_image(document: Document, primitive: Object, light: Floats) -> Material:
    colors = read_colors(document, primitive, light)
    return Material(None, _triple(light), None if colors is None else colors.tobytes())


def _triple(light: Floats) -> tuple[float, float, float]:
    return float(light[0]), float(light[1]), float(light[2])


def _coordinates(document: Document, reference: Object) -> tuple[int, Floats]:
    """Set of texture coordinates, and their transform by KHR_texture_transform, (2, 3)."""
    given = _extensions(reference).get("KHR_texture_transform", {})
    number = given.get("texCoord", reference.get("texCoord", 0))
    offset = document.numbers(given.get("offset", [0, 0]), 2, "texture offset")
    scale = document.numbers(given.get("scale", [1, 1]), 2, "texture scale")
    (turn,) = document.numbers([given.get("rotation", 0)], 1, "texture rotation")
    linear = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) * scale
    return document.integer(number, "texCoord", 0, 15), np.column_stack((linear, offset))


def one_texture(
    source: ImageSource,
    materials: Sequence[Material],
    coordinates: Sequence[Floats | None],
    notes: list[Finding],
    faces: Sequence[NDArray[np.int64]] | None = None,
) -> tuple[bytes | None, list[Floats | None]]:
    """An encoded image for all parts, and the parts' coordinates in it.

    Args:
        source: the file.
        materials: of the parts.
        coordinates: of the parts, (v, 2) with the origin at the top left, or None.
        notes: where to say what had to be done.
        faces: of the parts, (t, 3); all vertices count where they are not given.

    Raises:
        InputError: an image is too large to be decoded.
    """
    painted = [
        m if uv is not None else replace(m, image=None)
        for m, uv in zip(materials, coordinates, strict=True)
    ]
    found = {number: encoded_image(source, number, notes) for number in _numbers(painted)}
    encoded = {number: data for number, data in found.items() if data is not None}
    painted = [m if m.image in encoded else replace(m, image=None) for m in painted]
    painted, coordinates = _with_colors(painted, coordinates, encoded)
    kinds = list(dict.fromkeys(painted))
    if len(kinds) == 1 and kinds[0].image is None and len(set(kinds[0].color)) == 1:
        return None, list(coordinates)  # a grey, as of what was never painted
    if any(kind.image is not None and kind.color != _WHITE for kind in kinds):
        what = "images are multiplied by the base colours of their materials"
        notes.append(Finding(Severity.INFO, "materials", what))
    if len(kinds) == 1 and kinds[0].image is not None:
        return _alone(source, kinds[0], encoded), list(coordinates)
    if len(kinds) > 1:
        what = f"the images and colours of {len(kinds)} materials are put into one texture"
        notes.append(Finding(Severity.INFO, "materials", what))
    return _sheet(source, kinds, encoded, painted, coordinates, faces, notes)


def _with_colors(
    painted: Sequence[Material], coordinates: Sequence[Floats | None], encoded: dict[int, bytes]
) -> tuple[list[Material], list[Floats | None]]:
    """Materials and coordinates with one more image, of the colours of all vertices that count."""
    kept = [replace(m, colors=None) for m in painted]
    moved = list(coordinates)
    colored = [k for k, m in enumerate(painted) if m.image is None and m.colors is not None]
    if not colored:
        return kept, moved
    colors = [np.frombuffer(painted[k].colors or b"", np.uint8).reshape(-1, 3) for k in colored]
    uv, encoded[_OF_VERTICES] = colors_to_texture(np.concatenate(colors))
    starts = np.cumsum([len(each) for each in colors])[:-1]
    for k, part in zip(colored, np.split(uv, starts), strict=True):
        kept[k], moved[k] = Material(_OF_VERTICES), part
    return kept, moved


def _numbers(materials: Sequence[Material]) -> list[int]:
    return list(dict.fromkeys(m.image for m in materials if m.image is not None))


def _sheet(
    source: ImageSource,
    kinds: Sequence[Material],
    encoded: dict[int, bytes],
    painted: Sequence[Material],
    coordinates: Sequence[Floats | None],
    faces: Sequence[NDArray[np.int64]] | None,
    notes: list[Finding],
) -> tuple[bytes, list[Floats | None]]:
    """All materials in one image, and coordinates in it."""
    tiles = [_tile(source, kind, encoded) for kind in kinds]
    places, (height, width) = _arranged([tile.shape[:2] for tile in tiles])
    sheet = np.zeros((height, width, 3), np.uint8)
    for tile, (top, left) in zip(tiles, places, strict=True):
        framed = np.pad(tile, ((_BORDER, _BORDER), (_BORDER, _BORDER), (0, 0)), mode="edge")
        sheet[top : top + framed.shape[0], left : left + framed.shape[1]] = framed
    moved: list[Floats | None] = []
    beyond = []
    for part, (material, uv) in enumerate(zip(painted, coordinates, strict=True)):
        number = kinds.index(material)
        rows, columns = tiles[number].shape[:2]
        top, left = places[number]
        inside = np.full((1, 2), 0.5)
        if uv is not None and material.image is not None:
            inside, share = in_one_tile(uv, None if faces is None else faces[part])
            beyond.append(share)
        local = inside * (columns, rows) + (left + _BORDER, top + _BORDER)
        moved.append(np.broadcast_to(local / (width, height), (1 if uv is None else len(uv), 2)))
    if max(beyond, default=0.0) > _FEW:
        notes.append(
            Finding(
                Severity.WARNING,
                "materials",
                f"{max(beyond):.0%} of the triangles of a part reach beyond one copy of its image, "
                "which repeats there, and show the image's edge",
                "bake the images into one that does not repeat",
            )
        )
    jpeg = bool(encoded) and all(_is_jpeg(data) for data in encoded.values())
    return _written(sheet, jpeg), moved


def _alone(source: ImageSource, kind: Material, encoded: dict[int, bytes]) -> bytes:
    """The only image, byte for byte where it is not multiplied by anything."""
    assert kind.image is not None
    data = encoded[kind.image]
    if kind.color == _WHITE:
        return data
    return _written(_decoded(source, kind, data), _is_jpeg(data))


def _is_jpeg(data: bytes) -> bool:
    return data.startswith(b"\xff\xd8")


def _written(image: Image, jpeg: bool) -> bytes:
    options = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY] if jpeg else []
    return cv2.imencode(".jpg" if jpeg else ".png", image, options)[1].tobytes()


def _tile(source: ImageSource, kind: Material, encoded: dict[int, bytes]) -> Image:
    if kind.image is None:
        return np.tile(to_srgb(_reversed(kind)), (_PATCH, _PATCH, 1))
    tile = _decoded(source, kind, encoded[kind.image])
    shrink = min(1.0, (_SHEET // 2) / max(tile.shape[:2]))
    if shrink < 1:
        tile = np.asarray(
            cv2.resize(tile, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), np.uint8
        )
    return tile


def _decoded(source: ImageSource, kind: Material, data: bytes) -> Image:
    """An image multiplied by its material's colour, in linear light."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise source.error(f"image {kind.image} cannot be decoded; export it again")
    if kind.color != _WHITE:
        shades = to_linear(np.arange(256, dtype=np.uint8))[:, None]
        image = cv2.LUT(image, to_srgb(shades * _reversed(kind))[:, None])
    return np.asarray(image, np.uint8)


def _reversed(kind: Material) -> Floats:
    """A material's colour in OpenCV's order, blue, green, red."""
    return np.array(kind.color[::-1])


def _arranged(sizes: Sequence[tuple[int, ...]]) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Top left corners of framed tiles on shelves, tallest first, and height and width of all."""
    framed = [(rows + 2 * _BORDER, columns + 2 * _BORDER) for rows, columns in sizes]
    width = max(max(c for _, c in framed), int(np.sqrt(1.3 * sum(r * c for r, c in framed))))
    places: dict[int, tuple[int, int]] = {}
    top = left = shelf = 0
    for number in sorted(range(len(framed)), key=lambda n: -framed[n][0]):
        rows, columns = framed[number]
        if left + columns > width:
            top, left, shelf = top + shelf, 0, 0
        places[number] = (top, left)
        left, shelf = left + columns, max(shelf, rows)
    return [places[number] for number in range(len(framed))], (top + shelf, width)
