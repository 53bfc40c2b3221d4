"""Cells of a sweep on a Ray cluster, whose workers may die on the way."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sweep import Cell

from perfcap.errors import InputError

_TRIES = 4  # of a cell whose worker died


def run_on_ray(
    address: str,
    workers: int,
    config: Any,
    cells: Sequence[Cell],
    run: Callable[[Any, Cell], Mapping[str, float]],
) -> Iterator[tuple[Cell, Mapping[str, float]]]:
    """Cells and their scores as they are finished; a cell whose worker died runs again.

    Args:
        address: of the cluster, or ``local`` for one on this machine.
        workers: of a local cluster.
        config: of the sweep.
        cells: to run.
        run: of settings and a cell.

    Raises:
        InputError: Ray is not installed.
    """
    try:
        import ray
    except ModuleNotFoundError:
        raise InputError(
            "--cluster: Ray is not installed; pip install 'perfcap[cluster]', or leave it out"
        ) from None
    here = str(Path(__file__).parent)
    environment = {"env_vars": {"PYTHONPATH": ":".join([here, *filter(None, sys.path)])}}
    if address == "local":
        ray.init(
            num_cpus=workers, include_dashboard=False, runtime_env=environment, log_to_driver=False
        )
    else:
        ray.init(address, runtime_env=environment)
    try:
        task = ray.remote(num_cpus=1, max_retries=_TRIES)(run)
        running = {task.remote(config, cell): cell for cell in cells}
        while running:
            (done,), _ = ray.wait(list(running), num_returns=1)
            yield running.pop(done), ray.get(done)
    finally:
        ray.shutdown()
