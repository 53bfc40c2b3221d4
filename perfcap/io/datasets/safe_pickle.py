"""Plain values and arrays of a pickle, without unpickling.

Python's ``pickle`` runs what a file tells it to, so it is not used: several data sets are published
as pickles all the same. Here the opcodes are walked by an interpreter that knows only those that
build numbers, text, bytes, tuples, lists and dictionaries, and that never calls anything a file
names. Of all functions a pickle can name, the few by which numpy writes arrays are *recognised*,
and the arrays are made here, from their bytes. Anything else is refused.
"""

from __future__ import annotations

import io
import pickletools
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from perfcap.errors import InputError
from perfcap.io.datasets.pickled_array import (
    Name,
    PickledArray,
    PickledType,
    Refused,
    call,
    find_name,
)
from perfcap.io.files import MEBIBYTE, require_file

LIMIT = 1024 * MEBIBYTE
_MAX_OPCODES = 20_000_000
_HEADER_LIMIT = 4096  # bytes of an array's header
_ESCAPE = re.compile(r"\\(x[0-9a-fA-F]{2}|.?)", re.DOTALL)
_ESCAPES = {"n": "\n", "r": "\r", "t": "\t", "\\": "\\", "'": "'", '"': '"'}
_KEYS = (str, bytes, int, float, bool, type(None))


class _Mark:
    """Where the items of a container start on the stack."""


def read_pickle(path: Path, what: str) -> Any:
    """The value of a pickle file: numbers, text, bytes, tuples, lists, dictionaries, arrays.

    Texts of Python 2 are read as Latin-1.

    Raises:
        InputError: it is missing, too large, damaged, or holds anything else.
    """
    require_file(path, LIMIT, what)
    with _reporting(path, what):
        return loads(path.read_bytes())


def read_object_archive(path: Path, name: str, what: str) -> Any:
    """The Python value that ``numpy.savez`` put into an archive as an array of objects.

    Raises:
        InputError: as ``read_pickle``, or there is no such array.
    """
    require_file(path, LIMIT, what)
    with _reporting(path, what), zipfile.ZipFile(path) as archive:
        member = f"{name}.npy"
        if member not in archive.namelist():
            raise InputError(
                f"{path}: holds {', '.join(archive.namelist()[:5]) or 'nothing'}, no {name}; "
                f"expected {what}"
            )
        if archive.getinfo(member).file_size > LIMIT:
            raise Refused(f"{name} unpacks to more than {LIMIT // MEBIBYTE} MB")
        stream = io.BytesIO(archive.read(member))
        shape = _object_header(stream)
        value = loads(stream.read())
    return value.item() if isinstance(value, np.ndarray) and shape == () else value


def loads(data: bytes) -> Any:
    """The value of a pickle (see ``read_pickle``).

    Raises:
        ValueError: it is damaged or holds anything that is not plain.
    """
    machine = _Machine()
    stream = io.BytesIO(data)
    for _ in range(_MAX_OPCODES):
        name, argument = _next_opcode(stream)
        if name == "STOP":
            return machine.result()
        machine.step(name, argument)
    raise Refused(f"more than {_MAX_OPCODES} opcodes")


def _next_opcode(stream: io.BytesIO) -> tuple[str, Any]:
    code = stream.read(1)
    opcode = _OPCODES.get(code.decode("latin-1"))
    if opcode is None:
        raise Refused(f"the opcode {code!r}" if code else "no end")
    if opcode.name == "STRING":  # where the standard library knows ASCII only
        return opcode.name, _quoted(stream.readline())
    if opcode.name == "GLOBAL":
        return opcode.name, [stream.readline().decode("latin-1").rstrip("\n") for _ in range(2)]
    return opcode.name, opcode.arg.reader(stream) if opcode.arg is not None else None


def _quoted(line: bytes) -> str:
    """A text of Python 2 in quotes, its escapes undone."""
    text = line.decode("latin-1").rstrip("\n")
    if len(text) < 2 or text[0] not in "'\"" or text[0] != text[-1]:
        raise Refused("a text without quotes")
    return _ESCAPE.sub(_unescaped, text[1:-1])


def _unescaped(match: re.Match[str]) -> str:
    code = match[1]
    if code not in _ESCAPES and len(code) != 3:
        raise Refused(f"the escape {match[0]!s:.4}")
    return _ESCAPES[code] if code in _ESCAPES else chr(int(code[1:], 16))


class _Machine:
    """The stack and memo of the walk; one method a group of opcodes."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.memo: dict[int, Any] = {}

    def step(self, name: str, argument: Any) -> None:
        if name in _LITERALS:
            self.stack.append(_LITERALS[name](argument))
        elif name in _ACTIONS:
            _ACTIONS[name](self, argument)

    def result(self) -> Any:
        if len(self.stack) != 1:
            raise Refused(f"{len(self.stack)} values instead of one")
        return _finished(self.stack[0])

    def pop(self) -> Any:
        if not self.stack or isinstance(self.stack[-1], _Mark):
            raise Refused("an empty stack")
        return self.stack.pop()

    def top(self, kind: type) -> Any:
        if not self.stack or not isinstance(self.stack[-1], kind):
            raise Refused(f"items for something that is no {kind.__name__}")
        return self.stack[-1]

    def items(self) -> list[Any]:
        """Everything above the last mark, which goes too."""
        for index in range(len(self.stack) - 1, -1, -1):
            if isinstance(self.stack[index], _Mark):
                found = [_finished(value) for value in self.stack[index + 1 :]]
                del self.stack[index:]
                return found
        raise Refused("items without a mark")

    def store(self, index: int) -> None:
        if not self.stack:
            raise Refused("an empty stack")
        self.memo[index] = self.stack[-1]

    def recall(self, index: int) -> None:
        if index not in self.memo:
            raise Refused(f"a reference to {index}, which is not there")
        self.stack.append(self.memo[index])

    def tuple(self, size: int) -> None:
        items = [_finished(self.pop()) for _ in range(size)]
        self.stack.append(tuple(reversed(items)))

    def extend(self, items: list[Any]) -> None:
        self.top(list).extend(items)

    def update(self, items: list[Any]) -> None:
        self.top(dict).update(_pairs(items))

    def name(self, module: Any, name: Any) -> None:
        self.stack.append(find_name(module, name))

    def reduce(self) -> None:
        arguments, function = self.pop(), self.pop()
        if not isinstance(function, Name) or not isinstance(arguments, tuple):
            raise Refused("a call of something without a name")
        self.stack.append(call(function.role, arguments))

    def build(self) -> None:
        state = self.pop()
        target = self.stack[-1] if self.stack else None
        if not isinstance(target, PickledArray | PickledType):
            raise Refused("a state for something that has none")
        target.build(state)


def _finished(value: Any) -> Any:
    """What the caller sees of a value: arrays instead of their descriptions."""
    return value.value if isinstance(value, PickledArray) and value.made else value


def _pairs(items: list[Any]) -> dict[Any, Any]:
    if len(items) % 2 or not all(isinstance(key, _KEYS) for key in items[::2]):
        raise Refused("a dictionary with keys that are no text or number")
    return dict(zip(items[::2], items[1::2], strict=True))


def _object_header(stream: io.BytesIO) -> tuple[int, ...]:
    if np.lib.format.read_magic(stream) != (1, 0):
        raise Refused("an array in a format of its own")
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream, _HEADER_LIMIT)
    if not dtype.hasobject:
        raise Refused(f"numbers {dtype} {shape} where a dictionary should be")
    return shape


def _same(argument: Any) -> Any:
    return argument


_NUMBERS = ("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT")
_TEXTS = (
    *("STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE"),
    *("BINUNICODE8", "BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8"),
)
_LITERALS: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys((*_NUMBERS, *_TEXTS), _same),
    "NONE": lambda _: None,
    "NEWTRUE": lambda _: True,
    "NEWFALSE": lambda _: False,
    "EMPTY_TUPLE": lambda _: (),
    "EMPTY_LIST": lambda _: [],
    "EMPTY_DICT": lambda _: {},
    "MARK": lambda _: _Mark(),
}
_ACTIONS: dict[str, Callable[[_Machine, Any], Any]] = {
    "TUPLE": lambda m, _: m.stack.append(tuple(m.items())),
    "TUPLE1": lambda m, _: m.tuple(1),
    "TUPLE2": lambda m, _: m.tuple(2),
    "TUPLE3": lambda m, _: m.tuple(3),
    "LIST": lambda m, _: m.stack.append(m.items()),
    "DICT": lambda m, _: m.stack.append(_pairs(m.items())),
    "APPEND": lambda m, _: m.extend([_finished(m.pop())]),
    "APPENDS": lambda m, _: m.extend(m.items()),
    "SETITEM": lambda m, _: m.update([_finished(m.pop()), _finished(m.pop())][::-1]),
    "SETITEMS": lambda m, _: m.update(m.items()),
    "GET": lambda m, index: m.recall(int(index)),
    "BINGET": lambda m, index: m.recall(index),
    "LONG_BINGET": lambda m, index: m.recall(index),
    "PUT": lambda m, index: m.store(int(index)),
    "BINPUT": lambda m, index: m.store(index),
    "LONG_BINPUT": lambda m, index: m.store(index),
    "MEMOIZE": lambda m, _: m.store(len(m.memo)),
    "GLOBAL": lambda m, names: m.name(*names),
    "STACK_GLOBAL": lambda m, _: m.name(*[m.pop(), m.pop()][::-1]),
    "REDUCE": lambda m, _: m.reduce(),
    "BUILD": lambda m, _: m.build(),
    "POP": lambda m, _: m.stack.pop(),
    "POP_MARK": lambda m, _: m.items(),
    "DUP": lambda m, _: m.stack.append(m.top(object)),
}
_KNOWN = {"PROTO", "FRAME", "STOP", *_LITERALS, *_ACTIONS}
_OPCODES = {opcode.code: opcode for opcode in pickletools.opcodes if opcode.name in _KNOWN}


@contextmanager
def _reporting(path: Path, what: str) -> Iterator[None]:
    """Turn whatever is wrong with a file into one line about it."""
    try:
        yield
    except InputError:
        raise
    except (OSError, ValueError, LookupError, TypeError, MemoryError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{path}: holds {reason}; expected {what}: a pickle of plain numbers, texts, lists, "
            "dictionaries and arrays is all that is read, since pickles can run programs"
        ) from error
    except (zipfile.BadZipFile, zlib.error, EOFError, SyntaxError) as error:
        raise InputError(f"{path}: is damaged ({error!s:.80}); expected {what}") from error
