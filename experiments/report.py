"""What every experiment prints and keeps: tables, and one JSON file under ``results/``."""

from __future__ import annotations

import json
import math
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import torch
import tyro
from rich.console import Console
from rich.table import Table as Printed

from perfcap.errors import InputError

RESULTS = Path(__file__).parent / "results"
DATA = Path(__file__).parents[2] / "shared" / "data"

_WIDTH = 130  # of tables where the output is no terminal

Config = TypeVar("Config")


@dataclass(frozen=True)
class Table:
    """Rows of numbers or words under named columns; the first column names the row."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    digits: int = 1

    def print(self, console: Console) -> None:
        """For a terminal."""
        printed = Printed(*self.columns)
        console.print(f"\n{self.title}", highlight=False, soft_wrap=True)
        for row in self.rows:
            printed.add_row(*(self._text(value) for value in row))
        console.print(printed)

    def markdown(self) -> str:
        """For a README."""
        head = f"| {' | '.join(self.columns)} |", f"|{' --- |' * len(self.columns)}"
        body = (f"| {' | '.join(self._text(v) for v in row)} |" for row in self.rows)
        return "\n".join((*head, *body))

    def _text(self, value: Any) -> str:
        return f"{value:.{self.digits}f}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Report:
    """The tables of an experiment, and remarks a reader needs to judge them."""

    tables: tuple[Table, ...]
    notes: tuple[str, ...] = ()


def main(run: Callable[[Config], Report], config: type[Config], name: str) -> None:
    """Read the configuration from the command line, run, print and keep the tables."""
    chosen = tyro.cli(config, description=sys.modules[run.__module__].__doc__)
    try:
        report = run(chosen)
    except InputError as error:
        sys.exit(f"{name}: {error}")
    console = Console()
    console.width = max(console.width, _WIDTH)
    for table in report.tables:
        table.print(console)
    for note in report.notes:
        console.print(note, soft_wrap=True, highlight=False)
    console.print(f"kept in {write(name, report, chosen)}", soft_wrap=True, highlight=False)


def write(name: str, report: Report, config: object) -> Path:
    """Keep tables, notes, configuration and versions as JSON; returns the file."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    values = {
        "config": plain(config),
        "versions": {"python": platform.python_version(), "torch": torch.__version__},
        "tables": [plain(t) | {"markdown": t.markdown()} for t in report.tables],
        "notes": list(report.notes),
    }
    path.write_text(json.dumps(values, indent=1) + "\n")
    return path


def data_folder(data: Path, *parts: str) -> Path:
    """A folder of recordings.

    Raises:
        InputError: it is not there.
    """
    folder = data.joinpath(*parts)
    if not folder.is_dir():
        raise InputError(
            f"--data {data}: has no {'/'.join(parts) or 'such folder'}; name its place"
        )
    return folder


def plain(value: Any) -> Any:
    """Dataclasses, paths and tensors as values that JSON knows; numbers that are not are null."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str | int | float | bool) or value is None else str(value)
