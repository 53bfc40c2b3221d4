"""XML of robots: small files without entities, read into plain elements and numbers."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, read_text

Element = ElementTree.Element
Floats = NDArray[np.float64]

_LARGEST = 4 * MEBIBYTE
_MOST = 20_000  # elements
_DEEPEST = 100
_DECLARED = re.compile(r"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)
_SMALLEST = 1e-9


def read_xml(path: Path, kind: str) -> Element:
    """The root of a file.

    Raises:
        InputError: it is missing, large, deep, declares entities or is no XML.
    """
    text = read_text(path, kind, _LARGEST)
    if _DECLARED.search(text):
        raise InputError(f"{path}: declares a document type or entities; remove them")
    try:
        root = ElementTree.fromstring(text)  # of text, whose declared encoding counts no more
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{path}: is no XML ({error!s:.80}); expected {kind}") from error
    _require_small(path, root)
    return root


def _require_small(path: Path, root: Element) -> None:
    level, depth, count = [root], 0, 0
    while level:
        depth, count = depth + 1, count + len(level)
        if depth > _DEEPEST or count > _MOST:
            raise InputError(
                f"{path}: is nested more than {_DEEPEST} deep or has more than {_MOST} elements; "
                "expected a robot"
            )
        level = [child for element in level for child in element]


def numbers(element: Element, name: str, count: int, default: str | None = None) -> Floats | None:
    """``count`` numbers of an attribute; None where it is not there.

    Raises:
        InputError: they are none, or of another number.
    """
    text = element.get(name, default)
    if text is None:
        return None
    try:
        found = np.array([float(word) for word in text.split()])
    except ValueError:
        found = np.array([math.nan])
    if len(found) != count or not np.isfinite(found).all() or np.abs(found).max() > 1e6:
        raise InputError(
            f"<{element.tag} name={element.get('name', '')!r:.40}>: {name} is {text!r:.40}, "
            f"expected {count} numbers"
        )
    return found


def unit(vector: Floats, what: str) -> Floats:
    """A vector of length one.

    Raises:
        InputError: it has no direction.
    """
    length = float(np.linalg.norm(vector))
    if not length > _SMALLEST:
        raise InputError(f"{what}: an axis has no direction; expected three numbers, not all 0")
    found: Floats = vector / length
    return found


def inside(folder: Path, name: str) -> Path:
    """A file that another one names, which must lie in a folder.

    Raises:
        InputError: it lies elsewhere.
    """
    path = None if "\0" in name else (folder / name).resolve()
    if path is None or not path.is_relative_to(folder.resolve()):
        raise InputError(f"{name!r:.80}: lies outside of {folder}; put it inside")
    return path
