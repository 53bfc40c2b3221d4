"""Mutations that know the grammar: of trees, texts, arrays and bytes."""

from __future__ import annotations

import copy
import io
import json
import math
import random
import re
import struct
import zipfile
from typing import Any

import numpy as np

Random = random.Random

NUMBERS = (
    *(0, -1, 1, 2, 0.5, -0.0, 1e-300, 1e300, -1e300, 1e38, 1e-45, 2**31, 2**63, 2**70, -(2**63)),
    *(math.nan, math.inf, -math.inf, 255, 65536, 10**9, 4294967295),
)
OTHERS: tuple[Any, ...] = (None, True, "", "x", "\x1b[2J", "../../x", "\0", "é" * 40, [], {}, [[]])
_LONG = 1 << 20  # letters: what is longer is not repeated, or writing it takes longer than reading
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[^\s,;:=\[\](){}<>\"']+")
_DTYPES = ("f2", "f4", "f8", "i1", "u1", "i4", "i8", "u8", "?", "c16", "U3", "S2", "M8[s]", ">f8")
_LONGEST = 1 << 20  # elements that a mutation may make


def value(rng: Random) -> Any:
    """Something that is hardly ever expected."""
    kind = rng.randrange(8)
    if kind < 4:
        return rng.choice(NUMBERS)
    if kind < 6:
        return rng.choice(OTHERS)
    if kind == 6:
        return [rng.choice(NUMBERS)] * rng.choice((1, 2, 3, 4, 9, 16, 5000))
    nested: Any = rng.choice(NUMBERS)
    for _ in range(rng.choice((2, 50, 300))):
        nested = [nested] if rng.random() < 0.5 else {"a": nested}
    return nested


def tree(rng: Random, root: Any) -> Any:
    """A JSON value with one to three of its parts replaced, removed, repeated or exchanged."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        places = list(_places(root))
        if not places:
            return value(rng)
        holder, key = rng.choice(places)
        _change(rng, holder, key, places)
    return root


def _places(root: Any) -> Any:
    pending = [root]
    while pending:
        part = pending.pop()
        keys = part if isinstance(part, dict) else range(len(part))
        for key in list(keys):
            yield part, key
            if isinstance(part[key], dict | list):
                pending.append(part[key])


def _change(rng: Random, holder: Any, key: Any, places: list[Any]) -> None:
    kind = rng.randrange(7)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder, list):
        holder.extend([holder[key]] * rng.choice((1, 2, 1000)))
    elif kind == 2:
        other, place = rng.choice(places)
        if place in other if isinstance(other, dict) else place < len(other):
            holder[key] = json.loads(json.dumps(other[place]))
    elif kind == 3 and isinstance(holder[key], int | float) and holder[key] is not None:
        holder[key] = holder[key] * rng.choice((-1, 0.001, 1000, 1e12, 1 + 1e-9))
    elif kind == 4 and isinstance(holder[key], list):
        holder[key] = holder[key][: rng.randrange(len(holder[key]) + 1)]
    else:
        holder[key] = copy.deepcopy(value(rng))  # of its own: it may be changed further


def text(rng: Random, content: str) -> str:
    """A text with numbers, words, lines or letters changed."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        kind, lines = rng.randrange(10), content.splitlines(keepends=True) or [""]
        if kind < 3:
            found = list(_NUMBER.finditer(content))
            if found:
                at = rng.choice(found)
                content = content[: at.start()] + str(rng.choice(NUMBERS)) + content[at.end() :]
            continue
        if kind > 6:
            content = _of_itself(rng, content)
            continue
        line = rng.randrange(len(lines))
        if kind == 3:
            del lines[line]
        elif kind == 4:
            again = lines[rng.randrange(len(lines))]
            often = rng.choice((1, 2, 500))
            lines.insert(line, again * max(1, min(often, _LONG // max(len(again), 1))))
        elif kind == 5:
            lines[line] = lines[line][: rng.randrange(len(lines[line]) + 1)]
        else:
            extra = ("[" * 2000, "\x00", "\ufeff", "#", "=" * 9, '"', "\x1b[2J", "nan " * 9, "{}")
            lines[line] = lines[line].rstrip("\n") + rng.choice(extra) + "\n"
        content = "".join(lines)
    return content


def _of_itself(rng: Random, content: str) -> str:
    """A text with one of its words in the place of another, or of several, or two lines exchanged.

    Words keep a grammar where letters would break it: a kind or a name in another's place.
    """
    if rng.random() < 0.3:
        lines = content.splitlines(keepends=True) or [""]
        one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        lines[one], lines[other] = lines[other], lines[one]
        return "".join(lines)
    words = list(_WORD.finditer(content))
    if not words:
        return content
    place = rng.randrange(len(words))
    last = min(len(words) - 1, place + rng.choice((0, 0, 1, 2)))
    start = rng.randrange(len(words))
    stop = min(len(words) - 1, start + rng.choice((0, 0, 1, 2)))
    put = content[words[start].start() : words[stop].end()]
    return content[: words[place].start()] + put + content[words[last].end() :]


def headed(rng: Random, data: bytes) -> bytes:
    """A PLY with its head, or what follows, changed: numbers as text are, others as bytes."""
    head, mark, rest = data.partition(b"end_header\n")
    plain = b"format ascii" in head
    if rng.random() < 0.7:
        head = text(rng, head.decode()).encode("utf-8", "surrogatepass")
    if plain and rng.random() < 0.5:
        rest = text(rng, rest.decode()).encode("utf-8", "surrogatepass")
    return head + mark + (raw(rng, rest) if rng.random() < 0.2 else rest)


def raw(rng: Random, data: bytes) -> bytes:
    """Bytes turned over, cut, repeated or overwritten with extreme lengths."""
    content = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(content) + 1)
        kind = rng.randrange(6)
        if kind == 0 and at < len(content):
            content[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del content[at:]
        elif kind == 2:
            del content[at : at + rng.choice((1, 4, 64))]
        elif kind == 3:
            content[at:at] = content[at : at + rng.choice((1, 4, 1000))]
        elif kind == 4:
            number = rng.choice((0, 1, 255, 2**16, 2**31 - 1, 2**31, 2**32 - 1))
            content[at : at + 4] = struct.pack(rng.choice("<>") + "I", number)
        else:
            content[at : at + 8] = rng.randbytes(8)
    return bytes(content)


def array(rng: Random, values: np.ndarray) -> np.ndarray:
    """An array of another type, shape or content."""
    kind = rng.randrange(8)
    if kind < 3 and values.size and values.dtype.kind in "fiu":
        changed = values.copy()
        flat = changed.reshape(-1)
        for _ in range(rng.choice((1, 3, flat.size))):
            with np.errstate(all="ignore"):
                number = np.float64(rng.choice(NUMBERS))
                flat[rng.randrange(flat.size)] = number.astype(values.dtype)
        return changed
    if kind == 3:
        with np.errstate(all="ignore"):
            try:
                return values.astype(rng.choice(_DTYPES))
            except (ValueError, TypeError):
                return np.zeros(values.shape, rng.choice(_DTYPES))
    if kind == 4 and values.ndim:
        axis = rng.randrange(values.ndim)
        return np.take(values, range(rng.randrange(values.shape[axis] + 1)), axis)
    if kind == 5:
        return values[None] if rng.random() < 0.5 or not values.ndim else values[0:1].squeeze(0)
    if kind == 6 and 0 < values.size < _LONGEST // 1000:
        return np.concatenate([np.atleast_1d(values)] * 1000)
    shape = [rng.choice((0, 1, 2, 3, 16, 1000)) for _ in range(rng.randrange(5))]
    while math.prod(shape) > _LONGEST:
        shape.pop()
    return np.zeros(shape, rng.choice(_DTYPES))


def archive(rng: Random, data: bytes) -> bytes:
    """An npz with an array changed, dropped, lied about, or its bytes."""
    if rng.random() < 0.3:
        return raw(rng, data)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as found:
            arrays = {name: found[name] for name in found.files}
    except ValueError:  # objects, which only a careful reader looks into
        return raw(rng, data)
    name = rng.choice(list(arrays))
    kind = rng.randrange(10)
    if kind == 0:
        del arrays[name]
    elif kind > 1:
        arrays[name] = array(rng, arrays[name])
    out = io.BytesIO()
    rng.choice((np.savez, np.savez_compressed))(out, **arrays)
    return _lying(rng, out.getvalue(), name) if kind == 1 else out.getvalue()


def _lying(rng: Random, data: bytes, name: str) -> bytes:
    """One array whose header says something else."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w", 8) as new:
        for entry in old.infolist():
            content = old.read(entry)
            if entry.filename == f"{name}.npy":
                shape = tuple(rng.choice((0, 1, 3, 10**6, 2**40, -1)) for _ in range(2))
                head = io.BytesIO()
                kind = rng.choice(("<f8", "|O", "<U999999", "|V8"))
                header = {"descr": kind, "fortran_order": rng.random() < 0.5, "shape": shape}
                np.lib.format.write_array_header_1_0(head, header)
                content = head.getvalue() + content[128 : 128 + rng.choice((0, 8, 10**6))]
            new.writestr(entry.filename, content)
    return out.getvalue()


def plain_array(rng: Random, data: bytes) -> bytes:
    """An npy with its array or its bytes changed."""
    if rng.random() < 0.3:
        return raw(rng, data)
    out = io.BytesIO()
    np.save(out, array(rng, np.load(io.BytesIO(data), allow_pickle=False)), allow_pickle=False)
    return out.getvalue()


def tensors(rng: Random, data: bytes) -> bytes:
    """A safetensors with what its head says, or its bytes, changed."""
    if rng.random() < 0.3:
        return raw(rng, data)
    size = struct.unpack_from("<Q", data)[0]
    head = json.dumps(tree(rng, json.loads(data[8 : 8 + size]))).encode()
    return struct.pack("<Q", len(head)) + head + data[8 + size :]


def glb(rng: Random, data: bytes) -> bytes:
    """A binary glTF with its tree, its numbers or its bytes changed."""
    if rng.random() < 0.25 or len(data) < 20:
        return raw(rng, data)
    size = struct.unpack_from("<I", data, 12)[0]
    head, rest = json.loads(data[20 : 20 + size]), data[20 + size :]
    if rng.random() < 0.75:
        head = tree(rng, head)
    else:
        rest = rest[:8] + raw(rng, rest[8:])
    encoded = json.dumps(head).encode()
    encoded += b" " * (-len(encoded) % 4)
    total = 20 + len(encoded) + len(rest)
    return data[:8] + struct.pack("<II4s", total, len(encoded), b"JSON") + encoded + rest
