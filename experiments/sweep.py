"""Many runs under varied settings: kept one by one, resumed, shared out over cores and machines.

A sweep is a grid of cells, variant x sequence x seed. Every finished cell is a small file, so a
sweep that was stopped goes on where it was, and several machines that see the same folder can each
take a part (``--shard 1/4``). A cell depends on nothing but itself: tables are the same however the
work was shared out. Files know the settings they were made with, not the code: after changing that,
run with ``--fresh``.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import report
import torch
from report import Table

from perfcap.errors import InputError
from perfcap.io.atomic import writing

Scores = Mapping[str, float]
_HOW = ("data", "sequences", "seeds", "shard", "processes", "cluster", "fresh")  # not what


@dataclass(frozen=True)
class Cell:
    """One run."""

    variant: str
    sequence: str
    seed: int

    @property
    def file(self) -> str:
        """Name of what is kept of it; unlike names never share one."""
        digest = hashlib.sha256(repr(self).encode()).hexdigest()[:8]
        words = re.sub(r"[^a-z0-9.]+", "_", f"{self.variant}-{self.sequence}".lower())
        return f"{words[:80]}-{self.seed}-{digest}.json"


@dataclass(frozen=True)
class Sweep:
    """How to run; sweeps add what."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Of ``rendered``, or ``demo``, which needs no recordings."""
    seeds: int = 3
    """Runs of each cell that differ in what is random."""
    shard: str = "0/1"
    """Which part of the cells to run here, i/n; tables need all of them."""
    processes: int = 1
    """Cells run at once."""
    cluster: str = ""
    """Run on Ray: ``local``, or the address of a cluster."""
    fresh: bool = False
    """Forget what is kept of earlier runs with these settings."""


def run_cells(
    name: str,
    config: Sweep,
    variants: Iterable[str],
    run: Callable[[Any, Cell], Scores],
) -> dict[Cell, Scores]:
    """Scores of all cells; those not yet kept are run.

    Args:
        name: of the sweep.
        config: its settings.
        variants: names.
        run: a function of the module, of the settings and a cell; other processes must find it.

    Raises:
        InputError: a shard that is not one, or cells of other shards that are still missing.
    """
    grid = itertools.product(variants, config.sequences, range(config.seeds))
    cells = [Cell(*parts) for parts in grid]
    folder = report.RESULTS / name / _digest(config)
    folder.mkdir(parents=True, exist_ok=True)
    mine = cells[_shard(config)]
    if config.fresh:
        for cell in mine:
            (folder / cell.file).unlink(missing_ok=True)
    missing = [cell for cell in mine if not (folder / cell.file).is_file()]
    for cell, scores in _share_out(config, missing, run):
        text = json.dumps(report.plain(asdict(cell) | {"scores": scores})) + "\n"
        with writing(folder / cell.file) as file:
            file.write(text.encode())
    absent = [cell for cell in cells if not (folder / cell.file).is_file()]
    if absent:
        raise InputError(
            f"{len(absent)} of {len(cells)} cells are not in {folder} yet, such as {absent[0]}; "
            "run the other shards, then this again"
        )
    return {cell: json.loads((folder / cell.file).read_text())["scores"] for cell in cells}


def tables(
    title: str, found: Mapping[Cell, Scores], names: Sequence[str] = (), digits: int = 1
) -> tuple[Table, ...]:
    """A table a sequence: means over seeds, and their deviation where there are several.

    Args:
        title: what they show.
        found: by cell.
        names: of the scores, in order; all of the first cell's when not given.
        digits: behind the point.
    """
    names = names or tuple(next(iter(found.values())))
    several = len({cell.seed for cell in found}) > 1
    columns = ("variant", *(c for n in names for c in ((n, f"± {n}") if several else (n,))))
    result = []
    for sequence in dict.fromkeys(cell.sequence for cell in found):
        rows = []
        for variant in dict.fromkeys(cell.variant for cell in found):
            here = [s for c, s in found.items() if (c.variant, c.sequence) == (variant, sequence)]
            numbers: list[float] = []
            for key in names:
                values = np.array([np.nan if s[key] is None else s[key] for s in here], float)
                numbers += [float(values.mean()), float(values.std())][: 1 + several]
            rows.append((variant, *numbers))
        result.append(Table(f"{sequence}: {title}", columns, tuple(rows), digits))
    return tuple(result)


def _share_out(
    config: Sweep, cells: Sequence[Cell], run: Callable[[Any, Cell], Scores]
) -> Iterator[tuple[Cell, Scores]]:
    """Cells and their scores as they are finished."""
    if config.cluster:
        from on_ray import run_on_ray

        yield from run_on_ray(config.cluster, config.processes, config, cells, run)
    elif config.processes > 1:
        with ProcessPoolExecutor(
            config.processes, get_context("spawn"), torch.set_num_threads, (1,)
        ) as pool:
            yield from zip(cells, pool.map(run, itertools.repeat(config), cells), strict=True)
    else:
        for cell in cells:
            yield cell, run(config, cell)


def _digest(config: Sweep) -> str:
    """Of the settings that scores depend on."""
    what = {key: value for key, value in asdict(config).items() if key not in _HOW}
    return hashlib.sha256(repr(sorted(what.items())).encode()).hexdigest()[:12]


def _shard(config: Sweep) -> slice:
    found = re.fullmatch(r"(\d+)/(\d+)", config.shard)
    if not found or not int(found[1]) < int(found[2]):
        raise InputError(f"--shard {config.shard}: expected i/n with i from 0 below n, such as 0/4")
    return slice(int(found[1]), None, int(found[2]))
