"""The few functions by which numpy writes its values into pickles, recognised and never called."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

_MAX_DIMENSIONS = 8
_DTYPE = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248]|c8|c16|[SU]\d{1,4}|O8?|\?)")
_ORDERS = ("<", ">", "|", "=")
_EMPTY: dict[str, Callable[[], Any]] = {"OrderedDict": dict, "bytes": bytes}

# what a pickle may name, and what it is taken for
_NAMES = {
    **{
        (f"numpy.{core}.multiarray", name): name
        for core in ("core", "_core")
        for name in ("_reconstruct", "scalar")
    },
    **{(f"numpy.{core}.numeric", "_frombuffer"): "_frombuffer" for core in ("core", "_core")},
    ("numpy", "ndarray"): "ndarray",
    ("numpy", "dtype"): "dtype",
    ("_codecs", "encode"): "encode",
    ("collections", "OrderedDict"): "OrderedDict",
    **{(module, "bytes"): "bytes" for module in ("builtins", "__builtin__")},
}


class Refused(ValueError):
    """Something that a pickle of plain values does not hold."""


@dataclass(frozen=True)
class Name:
    """A function or class that a pickle names; it is never imported."""

    role: str


@dataclass
class PickledType:
    """The type of an array: its code, and the byte order that comes after it."""

    code: str
    order: str = ""

    def build(self, state: Any) -> None:
        """Take the byte order from the state; types with fields are refused."""
        if not isinstance(state, tuple) or len(state) < 8 or any(p is not None for p in state[2:5]):
            raise Refused("arrays of a type with parts")
        self.order = state[1] if state[1] in _ORDERS else ""

    def made(self) -> np.dtype[Any]:
        """The type."""
        return np.dtype(self.order + self.code.lstrip("".join(_ORDERS)))


@dataclass
class PickledArray:
    """An array that is named first and described later."""

    value: Any = None
    made: bool = False

    def build(self, state: Any) -> None:
        """Make the array from the state that ``numpy.ndarray`` writes."""
        if self.made:
            raise Refused("an array that is described twice")
        self.value, self.made = _array_of(state), True


def find_name(module: Any, name: Any) -> Name:
    """What a pickle names.

    Raises:
        Refused: it is none of the few.
    """
    role = _NAMES.get((module, name)) if isinstance(module, str) and isinstance(name, str) else None
    if role is None:
        raise Refused(f"{module!s:.60}.{name!s:.60}")
    return Name(role)


def call(role: str, arguments: tuple[Any, ...]) -> Any:
    """What the functions by which numpy writes its values would make of their arguments."""
    if role == "_reconstruct":
        return PickledArray()
    if role == "dtype" and arguments and isinstance(arguments[0], str):
        return _checked_dtype(arguments[0])
    if role == "scalar" and len(arguments) == 2:
        return _from_bytes(arguments[1], _dtype(arguments[0]), ())[()]
    if role == "_frombuffer" and len(arguments) == 4:
        data, dtype, shape, order = arguments
        return _from_bytes(data, _dtype(dtype), shape, order)
    if role == "encode" and len(arguments) == 2 and arguments[1] in ("latin1", "latin-1"):
        return _bytes(arguments[0])
    if role in _EMPTY and not arguments:
        return _EMPTY[role]()
    raise Refused(f"a call of {role} with {len(arguments)} arguments")


def _array_of(state: Any) -> Any:
    """An array from the state that ``numpy.ndarray.__reduce__`` writes."""
    if not isinstance(state, tuple) or len(state) != 5:
        raise Refused("an array without a state")
    _, shape, dtype, column_major, data = state
    made = _dtype(dtype)
    if made.hasobject:
        return _objects(shape, data)
    return _from_bytes(data, made, shape, "F" if column_major else "C")


def _from_bytes(data: Any, dtype: np.dtype[Any], shape: Any, order: Any = "C") -> Any:
    raw = _bytes(data)
    if dtype.hasobject or order not in ("C", "F"):
        raise Refused("an array of objects as bytes")
    if math.prod(_sides(shape)) * dtype.itemsize != len(raw):
        raise Refused(f"an array {shape!s:.60} of {dtype} in {len(raw)} bytes")
    # native byte order, so that torch takes it; a copy, so that it can be written
    return np.frombuffer(raw, dtype).reshape(shape, order=order).astype(dtype.newbyteorder("="))


def _objects(shape: Any, items: Any) -> Any:
    if not isinstance(items, list) or math.prod(_sides(shape)) != len(items):
        raise Refused(f"an array {shape!s:.60} of objects that are not there")
    array = np.empty(len(items), dtype=object)
    for index, item in enumerate(items):
        array[index] = item
    return array.reshape(shape)


def _sides(shape: Any) -> tuple[int, ...]:
    if not isinstance(shape, tuple) or len(shape) > _MAX_DIMENSIONS:
        raise Refused("an array without a shape")
    if not all(type(side) is int and 0 <= side < 2**40 for side in shape):
        raise Refused(f"an array {shape!s:.60}")
    return shape


def _dtype(value: Any) -> np.dtype[Any]:
    if not isinstance(value, PickledType):
        raise Refused("an array without a type")
    return value.made()


def _checked_dtype(code: str) -> PickledType:
    if not _DTYPE.fullmatch(code):
        raise Refused(f"arrays of {code!s:.40}")
    return PickledType(code)


def _bytes(value: Any) -> bytes:
    """Bytes; text stands for them in pickles of Python 2, one character a byte."""
    if isinstance(value, str):
        return value.encode("latin-1")
    if isinstance(value, bytes | bytearray):
        return bytes(value)
    raise Refused("an array without its bytes")
