"""An ONNX network without the work that nobody asks for, cut from its bytes.

A runtime computes every output of a graph, asked for or not: a network of joints that also draws
masks draws them each time. What is left computes the outputs that are wanted as before, to the last
bit. Only the protobuf wire format is needed, as in ``onnx_file``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from perfcap.detect.onnx_file import Field, fields

_GRAPH = 7  # of a model
_NODE, _OUTPUT = 1, 12  # of a graph
_VALUE_NAME = 1
_NODE_INPUT, _NODE_OUTPUT, _NODE_ATTRIBUTE = 1, 2, 5
_SUBGRAPHS = (6, 11)  # of an attribute
_SPAN = 2  # wire type of what has a length


@dataclass(frozen=True)
class _Node:
    inputs: tuple[bytes, ...]
    outputs: tuple[bytes, ...]
    has_graph: bool


def prune_outputs(data: bytes, wanted: Sequence[str]) -> bytes:
    """The model with these outputs alone, and the nodes that they need.

    It stays as it is where no output is named, or one that it does not have, where none is left
    out, where a node holds a graph of its own, which may use any name outside it, and where it is
    no model: the runtime says what is wrong.

    Args:
        data: bytes of a model.
        wanted: names of outputs.
    """
    try:
        return _cut(data, {name.encode() for name in wanted})
    except (ValueError, IndexError):
        return data


def _cut(data: bytes, wanted: set[bytes]) -> bytes:
    parts: list[bytes | memoryview] = []
    for field in fields(memoryview(data)):
        if field.number != _GRAPH or field.value is None:
            parts.append(field.raw)
            continue
        kept = _pruned(field.value, wanted)
        if kept is None:
            return data
        body = b"".join(kept)
        parts += [_varint(_GRAPH << 3 | _SPAN), _varint(len(body)), body]
    return b"".join(parts)


def _pruned(graph: memoryview, wanted: set[bytes]) -> list[memoryview] | None:
    """What is left of a graph's fields; None where it stays as it is."""
    parts = list(fields(graph))
    outputs = {_name(part) for part in parts if part.number == _OUTPUT}
    nodes = {id(part): _node(part) for part in parts if part.number == _NODE}
    if not wanted or not wanted < outputs or any(node.has_graph for node in nodes.values()):
        return None
    needed = _needed(list(nodes.values()), wanted)
    kept = []
    for part in parts:
        node = nodes.get(id(part))
        if node is not None and not needed.intersection(node.outputs):
            continue
        if part.number == _OUTPUT and _name(part) not in wanted:
            continue
        kept.append(part.raw)
    return kept


def _needed(nodes: Sequence[_Node], wanted: set[bytes]) -> set[bytes]:
    """Names of all tensors that some are made from, and these."""
    makers = {name: node for node in nodes for name in node.outputs if name}
    needed, ahead = set(wanted), list(wanted)
    while ahead:
        node = makers.get(ahead.pop())
        more = set() if node is None else set(node.inputs) - needed
        needed |= more
        ahead += more
    return needed


def _node(field: Field) -> _Node:
    parts = list(_inside(field))
    inputs, outputs = (
        tuple(bytes(part.value or b"") for part in parts if part.number == number)
        for number in (_NODE_INPUT, _NODE_OUTPUT)
    )
    inner = (each for p in parts if p.number == _NODE_ATTRIBUTE for each in _inside(p))
    return _Node(inputs, outputs, any(each.number in _SUBGRAPHS for each in inner))


def _name(field: Field) -> bytes:
    found = (part.value for part in _inside(field) if part.number == _VALUE_NAME)
    return bytes(next(found, None) or b"")


def _inside(field: Field) -> Iterator[Field]:
    return iter(()) if field.value is None else fields(field.value)


def _varint(value: int) -> bytes:
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes((*found, value))
