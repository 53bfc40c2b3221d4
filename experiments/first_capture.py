"""How much longer the first capture takes, which compiles what later ones find compiled."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import report
from report import Report, Table

from perfcap.errors import InputError


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    repeats: int = 1
    """Times that the demo is captured after the first."""


def run(config: Experiment) -> Report:
    """CPU time of ``perfcap demo``, all threads, with no kernel kept and with all of them."""
    with tempfile.TemporaryDirectory() as folder:
        times = [_seconds(Path(folder), str(n)) for n in range(config.repeats + 1)]
    again = sorted(times[1:])[(len(times) - 1) // 2]
    rows = (("first", times[0]), ("again", again), ("of the first, compiling", times[0] - again))
    return Report((Table("perfcap demo, CPU seconds", ("capture", "s"), rows),))


def _seconds(folder: Path, name: str) -> float:
    """CPU seconds of a capture in a process of its own."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    call = [sys.executable, "-m", "perfcap", "demo", "--out", str(folder / name)]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "kernels")}
    done = subprocess.run(call, env=environment, check=False, capture_output=True, text=True)
    if done.returncode:
        raise InputError(f"perfcap demo: exit code {done.returncode}: {done.stderr[-500:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    report.main(run, Experiment, "first_capture")
