"""Measurements of a person: printed, and kept beside the actor."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from rich.table import Table

from perfcap.actor.measurements import Measurements
from perfcap.app.console import PlainConsole
from perfcap.io.atomic import writing
from perfcap.io.result_folder import MEASURES


def print_measures(
    found: Measurements, deviations: Measurements | None = None, weight: float | None = None
) -> None:
    """A table in centimetres, with one standard deviation where it is known."""
    table = Table("measurement", "cm", *(["±"] if deviations is not None else []))
    known = None if deviations is None else asdict(deviations)
    for name, value in asdict(found).items():
        spread = [] if known is None else [f"{100 * known[name]:.1f}"]
        table.add_row(name, f"{100 * value:.1f}", *spread)
    console = PlainConsole()
    console.print(table)
    if weight is not None:
        console.print(f"weight {weight:.1f} kg")


def save_measures(
    folder: Path, found: Measurements, deviations: Measurements | None, source: str
) -> None:
    """Write ``measurements.json``: metres, and standard deviations where they are known.

    Args:
        folder: of the actor.
        found: the measurements.
        deviations: of them.
        source: what they come from.
    """
    known: Mapping[str, float] = {} if deviations is None else asdict(deviations)
    values = {
        name: {"metres": round(value, 4)}
        | ({"deviation": round(known[name], 4)} if name in known else {})
        for name, value in asdict(found).items()
    }
    with writing(folder / MEASURES) as file:
        file.write(json.dumps({"source": source, **values}, indent=1).encode())
