"""Short clips captured as a batch: one process against two, and one capture killed on the way.

Expect two processes to be at least 1.8 times as fast on two idle cores, and no clip lost.
"""

from __future__ import annotations

import csv
import os
import signal
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

from report import Report, Table, main

from perfcap.app.batch import run_batch
from perfcap.app.batch_page import SUMMARY
from perfcap.commands.capture import Batch
from perfcap.io import models_folder

LENGTH = 24  # frames


@dataclass(frozen=True)
class Experiment:
    """How much."""

    clips: int = 24
    """Parts of the shipped clip."""
    processes: tuple[int, ...] = (1, 2)
    """How many at once, in turn; in the last run one capture is killed."""


def run(config: Experiment) -> Report:
    """Capture the same list again and again, into new folders."""
    rows = []
    first = 0.0
    with tempfile.TemporaryDirectory() as scratch:
        clips = _write_list(Path(scratch) / "clips.csv", config.clips)
        for number, processes in enumerate(config.processes):
            out = Path(scratch) / str(number)
            killed: list[int] = []
            if number == len(config.processes) - 1:
                Thread(target=_kill_one, args=(out, killed), daemon=True).start()
            started = time.perf_counter()
            run_batch(Batch(clips, out, processes, report=False))
            wall = time.perf_counter() - started
            first = first or wall
            states = _column(out, "state")
            captured = sum(state in ("done", "gaps") for state in states)
            tries = max(int(number) for number in _column(out, "tries"))
            rows.append((processes, wall, first / wall, captured, len(killed), tries))
    columns = ("processes", "wall s", "times as fast", "captured", "killed", "most tries")
    note = f"{os.cpu_count()} cores; load of others before the start is not subtracted"
    return Report(
        (Table(f"{config.clips} clips of {LENGTH} frames", columns, tuple(rows)),), (note,)
    )


def _write_list(path: Path, count: int) -> Path:
    demo = models_folder() / "demo"
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        names = ("name", "videos", "cameras", "detections", "actor", "until", "overlay", "frames")
        table.writerow(names)
        for number in range(count):
            start = number % (120 - LENGTH)
            files = [demo / name for name in ("video.mp4", "camera.json", "detections.npz")]
            how = ("sam", "track_motion", "no", f"{start}:{start + LENGTH}")
            table.writerow((f"clip {number}", *files, *how))
    return path


def _column(out: Path, name: str) -> list[str]:
    with (out / SUMMARY).open(newline="") as file:
        return [row[name] for row in csv.DictReader(file)]


def _kill_one(out: Path, killed: list[int]) -> None:
    """Kill the first capture into a folder that has run for a while; where /proc tells of it."""
    for _ in range(10_000):
        for place in Path("/proc").glob("[0-9]*"):
            with suppress(OSError, ValueError):
                words = (place / "cmdline").read_bytes().decode().split("\0")
                if "capture" in words and any(word.startswith(str(out)) for word in words):
                    time.sleep(2)
                    os.kill(int(place.name), signal.SIGKILL)
                    killed.append(int(place.name))
                    return
        time.sleep(0.05)


if __name__ == "__main__":
    main(run, Experiment, "batch")
