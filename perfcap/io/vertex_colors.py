"""Colours of vertices as a texture, without splitting a vertex, and linear light as bytes."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.gltf_document import Document, Object

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]

_SIDE = 256  # px of the texture
_SIXTEEN_BITS = 65535
_ROUNDING = 0.01  # of white, below black
_BRIGHTEST = 2.0  # of fractions, which may lie a little above white
_MARGIN = 0.02  # of it, left around the colours


def colors_to_texture(colors: NDArray[np.uint8]) -> tuple[Floats, bytes]:
    """Texture coordinates (V, 2), origin at the top left, and a PNG, for RGB colours (V, 3).

    The texture is the plane through the colours that lies nearest to them, in linear units of the
    texture, so that colours between vertices are interpolated as if they were the vertices' own.
    What lies off the plane is lost: little, as colours of one person mostly differ in brightness
    and along one more axis.
    """
    values = colors.astype(np.float64)
    middle = values.mean(0)
    spread = np.pad(values - middle, ((0, max(0, 2 - len(values))), (0, 0)))  # for two axes
    axes = np.linalg.svd(spread, full_matrices=False)[2][:2]
    places = (values - middle) @ axes.T
    low, extent = places.min(0), np.maximum(np.ptp(places, axis=0), 1.0)
    uv = _MARGIN + (1 - 2 * _MARGIN) * (places - low) / extent
    along = ((np.arange(_SIDE) + 0.5) / _SIDE - _MARGIN) / (1 - 2 * _MARGIN)
    u, v = (low[k] + extent[k] * along for k in range(2))
    plane = middle + u[None, :, None] * axes[0] + v[:, None, None] * axes[1]
    image = plane.round().clip(0, 255).astype(np.uint8)
    return uv, cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1].tobytes()


def as_bytes(colors: NDArray[Any], what: str) -> Bytes:
    """RGB bytes (V, 3) of colours (V, 3 or 4) in the range that they are in.

    Files do not say it: small floating-point numbers are fractions; others are bytes where they
    reach no more than 255, whatever their type, and else have 16 bits.

    Raises:
        InputError: NaN or infinity, or numbers beyond 16 bits; it begins with ``what``.
    """
    values = np.asarray(colors)[:, :3].astype(np.float64)
    if not np.isfinite(values).all():
        raise InputError(f"{what} hold NaN or infinity; export it again")
    least, largest = float(values.min(initial=0.0)), float(values.max(initial=0.0))
    fractions = np.asarray(colors).dtype.kind == "f" and largest <= _BRIGHTEST
    white = 1.0 if fractions else 255.0 if largest <= 255 else float(_SIXTEEN_BITS)
    if least < -_ROUNDING * white or largest > max(white, _BRIGHTEST):
        raise InputError(
            f"{what} are {least:g} to {largest:g}; expected 0 to 1, to 255 or to "
            f"{_SIXTEEN_BITS}, export it again"
        )
    return np.asarray(np.round(255 * (values / white).clip(0, 1)), np.uint8)


def to_srgb(light: Floats) -> Bytes:
    """Bytes of images that show linear light, which is cut off below 0 and above 1."""
    light = np.clip(light, 0, 1)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.asarray(np.round(255 * curve), np.uint8)


def to_linear(image: Bytes) -> Floats:
    """Linear light, 0 to 1, of bytes of images."""
    value = image / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def read_colors(document: Document, primitive: Object, factor: Floats) -> Bytes | None:
    """Colours of a primitive's vertices, sRGB, (v, 3); None of none, or of white alone.

    Args:
        document: the file.
        primitive: with a ``POSITION``.
        factor: linear RGB that they are multiplied by, (3,).

    Raises:
        InputError: they are damaged, or not one a vertex.
    """
    attributes = primitive["attributes"]
    if "COLOR_0" not in attributes:
        return None
    index = attributes["COLOR_0"]
    accessor = document.item("accessors", index)
    kind = accessor.get("type")
    if kind not in ("VEC3", "VEC4"):
        raise document.error(f"colours of vertices have type {kind!r:.20}; expected VEC3 or VEC4")
    values = document.accessor(index, kind)[:, :3]
    if values.dtype.kind != "f":
        raise document.error(
            f"colours of vertices are {values.dtype} that are not normalized, so that nobody knows "
            "what is white; export them as normalized bytes or as floats"
        )
    vertices = document.item("accessors", attributes.get("POSITION")).get("count")
    if len(values) != vertices:
        raise document.error(f"{len(values)} colours for {vertices} vertices; export it again")
    if not np.isfinite(values).all():
        raise document.error("colours of vertices hold NaN or infinity; export it again")
    if np.all(values >= 1.0):  # programs write white where nobody painted
        return None
    return to_srgb(values.astype(np.float64) * factor)
