"""What an ONNX file refers to outside itself, read from its bytes without loading it.

A network may keep its weights in other files, named by relative path. Whoever wrote the file wrote
the path, so it is checked here before any runtime follows it, whatever that runtime's version
checks by itself. Only the protobuf wire format is needed: tags, lengths and a few field numbers of
onnx.proto.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from perfcap.errors import InputError

LIMIT = 2**30  # bytes of a model, and of all its external data together
_DEPTH = 40  # of graphs inside nodes inside graphs

# Fields of a message that hold messages we look into, by field number (onnx.proto).
_INSIDE = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "function": {7: "node", 11: "attribute"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {13: "entry"},
}
_KEY, _VALUE, _GRAPH = 1, 2, 7


@dataclass(frozen=True)
class Field:
    """Of a message: its number, its value (None for plain numbers), and all of its bytes."""

    number: int
    value: memoryview | None
    raw: memoryview


def read_model(path: Path) -> tuple[bytes, tuple[Path, ...]]:
    """The bytes of a model and the files beside it that hold weights.

    Raises:
        InputError: not a file, too large, not ONNX, or weights outside the model's folder.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected the ONNX model that the manifest names")
    size = path.stat().st_size
    if size > LIMIT:
        raise InputError(
            f"{path}: is {size / 2**20:.0f} MB, expected at most {LIMIT / 2**20:.0f} MB; use a "
            "smaller model"
        )
    data = path.read_bytes()
    try:
        names = sorted(set(external_names(data)))
    except (ValueError, IndexError, UnicodeDecodeError):
        raise InputError(f"{path}: is not an ONNX model; export the network again") from None
    outside = tuple(_beside(path, name) for name in names)
    total = sum(file.stat().st_size for file in outside)
    if total > LIMIT:
        raise InputError(
            f"{path}: has {total / 2**20:.0f} MB of external data, expected at most "
            f"{LIMIT / 2**20:.0f} MB; use a smaller model"
        )
    return data, outside


def external_names(data: bytes) -> Iterator[str]:
    """Locations of external data in a model.

    Raises:
        ValueError: not the wire format, or without a graph.
    """
    view = memoryview(data)
    if not any(field.number == _GRAPH and field.value is not None for field in fields(view)):
        raise ValueError("no graph")
    yield from _locations(view, "model", 0)


def _beside(path: Path, name: str) -> Path:
    """A file named by a model, if it is inside the model's folder."""
    folder = path.parent.resolve()
    target = (folder / name).resolve()
    if not target.is_relative_to(folder):
        raise InputError(
            f"{path}: has external data at {name!r}, outside its folder; expected weights inside; "
            "export with external_data=False"
        )
    if not target.is_file():
        raise InputError(
            f"{path}: has external data in {name!r}, which is missing; put it beside the model"
        )
    return target


def _locations(view: memoryview, kind: str, depth: int) -> Iterator[str]:
    if depth > _DEPTH:
        raise ValueError("nested too deep")
    inside = _INSIDE[kind]
    for field in fields(view):
        child = inside.get(field.number)
        if child is None or field.value is None:
            continue
        if child == "entry":
            yield from _location(field.value)
        else:
            yield from _locations(field.value, child, depth + 1)


def _location(entry: memoryview) -> Iterator[str]:
    parts = {f.number: bytes(f.value).decode() for f in fields(entry) if f.value is not None}
    if parts.get(_KEY) == "location":
        yield parts.get(_VALUE, "")


def fields(view: memoryview) -> Iterator[Field]:
    """Fields of a message in order; lengths are checked against what is there."""
    position = 0
    while position < len(view):
        start = position
        tag, position = _varint(view, position)
        number, wire = tag >> 3, tag & 7
        if wire == 0:
            _, position = _varint(view, position)
            length = 0
        elif wire == 2:
            length, position = _varint(view, position)
        else:
            length = {1: 8, 5: 4}.get(wire, -1)
        if number == 0 or not 0 <= length <= len(view) - position:
            raise ValueError("not protobuf")
        stop = position + length
        yield Field(number, view[position:stop] if wire == 2 else None, view[start:stop])
        position = stop


def _varint(view: memoryview, position: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = view[position]
        value |= (byte & 0x7F) << shift
        position, shift = position + 1, shift + 7
        if byte < 0x80:
            return value, position
        if shift > 63:
            raise ValueError("not a varint")
