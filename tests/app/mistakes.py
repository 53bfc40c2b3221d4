"""Bad input by name: what to change in a good call, and words of the line that is expected."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from runs import Command
from takes import TakeFiles

Mistake = Callable[[TakeFiles, Path], dict[str, Any]]
Case = tuple[Mistake, str]


def register(cases: dict[str, Case]) -> Callable[[str], Callable[[Mistake], Mistake]]:
    """A decorator that adds mistakes to ``cases``, given words of the line expected."""

    def case(message: str) -> Callable[[Mistake], Mistake]:
        def add(mistake: Mistake) -> Mistake:
            cases[mistake.__name__] = (mistake, message)
            return mistake

        return add

    return case


def require_one_line(case: Case, take: TakeFiles, folder: Path, perfcap: Command) -> None:
    """The capture ends with one line that says what is wrong and what to do, and leaves nothing."""
    mistake, message = case
    changes = mistake(take, folder)
    out = changes.pop("out", folder / "out")
    more = changes.pop("more", [])
    call = take.command(out, "--no-overlay", **changes)
    line = perfcap([*call[:2], *more, *call[2:]]).refused()
    assert message in line
    assert ";" in line or "expected" in line  # says what to do
    if out == folder / "out" and out.exists():
        assert os.listdir(out) == []
