"""Typed reading of TOML that somebody else wrote: every fault is one line that names its field."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn, Self

from perfcap.errors import InputError

LIMIT = 2**20  # bytes; a manifest is a page


@dataclass(frozen=True)
class TomlTable:
    """A table of a TOML file that remembers which of its keys were asked for.

    Attributes:
        path: the file, for messages.
        name: of the table, dotted; empty for the whole file.
        values: what it holds.
    """

    path: Path
    name: str
    values: dict[str, Any]
    _asked: set[str] = field(default_factory=set)

    @classmethod
    def read(cls, path: Path) -> Self:
        """The whole of a file.

        Raises:
            InputError: it is missing, too large or no TOML.
        """
        if not path.is_file():
            raise InputError(f"{path}: no such file; expected a manifest beside the model")
        if path.stat().st_size > LIMIT:
            raise InputError(f"{path}: is larger than 1 MB; expected a manifest of one page")
        try:
            return cls(path, "", tomllib.loads(path.read_text(encoding="utf-8-sig")))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
            raise InputError(f"{path}: is not TOML ({error}); correct it") from None

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def fail(self, key: str, found: str, expected: str) -> NoReturn:
        """Refuse a field."""
        raise InputError(f"{self.path}: {self._where(key)} {found}; expected {expected}")

    def table(self, key: str, *, optional: bool = False) -> TomlTable:
        """A table inside; an empty one where it is absent and optional."""
        value = self._take(key, {} if optional else None, "a table")
        if not isinstance(value, dict):
            self.fail(key, f"is {value!r}", "a table")
        return TomlTable(self.path, self._where(key), value)

    def tables(self, key: str) -> list[TomlTable]:
        """An array of tables, ``[[key]]``."""
        value = self._take(key, None, "an array of tables")
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            self.fail(key, f"is {value!r:.80}", f"tables [[{key}]]")
        return [TomlTable(self.path, f"{key}[{i}]", item) for i, item in enumerate(value)]

    def text(self, key: str, default: str | None = None, choices: Sequence[str] = ()) -> str:
        """A string, one of ``choices`` where there are any."""
        expected = f"one of {', '.join(choices)}" if choices else "a string"
        value = self._take(key, default, expected)
        if not isinstance(value, str) or not value or (choices and value not in choices):
            self.fail(key, f"is {value!r:.80}", expected)
        return value

    def texts(self, key: str, default: Sequence[str] | None = None) -> tuple[str, ...]:
        """A list of strings."""
        value = self._take(key, default, "a list of strings")
        if not isinstance(value, list | tuple) or not all(isinstance(v, str) and v for v in value):
            self.fail(key, f"is {value!r:.80}", "a list of strings")
        return tuple(value)

    def number(self, key: str, default: float | None = None, *, low: float = -math.inf) -> float:
        """A finite number of at least ``low``."""
        expected = "a number" if low == -math.inf else f"a number of at least {low:g}"
        value = self._take(key, default, expected)
        if not _is_number(value) or value < low:
            self.fail(key, f"is {value!r:.80}", expected)
        return float(value)

    def integer(self, key: str, default: int | None = None, *, low: int = 0) -> int:
        """A whole number of at least ``low``."""
        expected = f"a whole number of at least {low}"
        value = self._take(key, default, expected)
        if not isinstance(value, int) or isinstance(value, bool) or value < low:
            self.fail(key, f"is {value!r:.80}", expected)
        return value

    def numbers(
        self, key: str, default: Sequence[float] | None = None, *, count: int | None = None
    ) -> tuple[float, ...]:
        """A list of finite numbers, ``count`` of them where it is given."""
        expected = "a list of numbers" if count is None else f"{count} numbers"
        value = self._take(key, default, expected)
        good = isinstance(value, list | tuple) and all(_is_number(v) for v in value)
        if not good or (count is not None and len(value) != count):
            self.fail(key, f"is {value!r:.80}", expected)
        return tuple(float(v) for v in value)

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self._take(key, default, "true or false")
        if not isinstance(value, bool):
            self.fail(key, f"is {value!r:.80}", "true or false")
        return value

    def done(self) -> None:
        """Refuse keys that nobody asked for: misspelt ones would silently change results."""
        for key in self.values:
            if key not in self._asked:
                known = ", ".join(sorted(self._asked))
                self.fail(key, "is unknown", f"one of {known}")

    def _take(self, key: str, default: Any, expected: str) -> Any:
        self._asked.add(key)
        value = self.values.get(key, default)
        if value is None:
            self.fail(key, "is missing", expected)
        return value

    def _where(self, key: str) -> str:
        return f"{self.name}.{key}" if self.name else key


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
