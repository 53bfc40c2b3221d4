"""One clip of a batch: a capture in a process of its own, and what came of it."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import Any

from perfcap.app.capture_folder import states_of, unchanged
from perfcap.errors import InputError, one_line
from perfcap.io.atomic import writing
from perfcap.io.files import MEBIBYTE, read_json
from perfcap.io.result_folder import own_file

TRIES = 4  # of a clip whose process died
DONE, INCOMPLETE = 0, 3
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG
_TOP, _BOTTOM = "╭╰"
_BOX = " │╭╮╰╯─"
_TAIL = 4096  # bytes of a log in which the last message is


@dataclass(frozen=True)
class Job:
    """What to run.

    Attributes:
        name: of the clip.
        arguments: of ``perfcap``.
        folder: of the result.
        log: what the capture writes to its streams.
        state: what is kept of the outcome.
        inputs: files and folders whose change asks for a new capture.
    """

    name: str
    arguments: tuple[str, ...]
    folder: Path
    log: Path
    state: Path
    inputs: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What came of a clip.

    Attributes:
        name: of the clip.
        arguments: that it was captured with.
        code: exit code of the capture, negative for the signal that ended it.
        seconds: it took.
        tries: how often it was begun.
        message: the last line of what it said, where it failed.
        inputs: the state of each when it was begun.
    """

    name: str
    arguments: tuple[str, ...]
    code: int
    seconds: float
    tries: int = 1
    message: str = ""
    inputs: Mapping[str, str | None] = field(default_factory=dict)

    @property
    def captured(self) -> bool:
        """Whether there is a result."""
        return self.code in (DONE, INCOMPLETE)


def run_clip(job: Job, cores: Collection[int] = ()) -> Outcome:
    """Capture a clip and keep the outcome; where its process is killed, go on from its checkpoint.

    Args:
        job: what to run.
        cores: that it may use; all if none are named.
    """
    started = time.perf_counter()
    code, tries, inputs = -1, 0, states_of(job.inputs)
    while code < 0 and tries < TRIES:
        tries += 1
        code = _run(job, cores, overwrite=tries > 1 or job.state.exists())
        if -code in (signal.SIGINT, signal.SIGTERM):
            break
    message = "" if code in (DONE, INCOMPLETE) else last_line(job.log)
    if code < 0:
        message = f"its process was ended by signal {-code}, {tries} times"
    seconds = time.perf_counter() - started
    found = Outcome(job.name, job.arguments, code, seconds, tries, message, inputs)
    with writing(job.state) as file:
        file.write(json.dumps(asdict(found)).encode())
    return found


def read_outcome(job: Job) -> Outcome | None:
    """What is kept of an earlier run of a clip; None where there is nothing."""
    if not job.state.is_file():
        return None
    try:
        values: Any = read_json(job.state, "the outcome of a clip", MEBIBYTE)
        found = Outcome(**{**values, "arguments": tuple(values["arguments"])})
        sound = isinstance(found.code, int) and isinstance(found.seconds, float | int)
        return found if sound and isinstance(found.message, str) else None
    except (InputError, TypeError, KeyError):
        return None


def is_done(job: Job, known: Outcome | None) -> bool:
    """Whether a result is that of this very job, from inputs as they are now."""
    if known is None or not known.captured or known.arguments != job.arguments:
        return False
    report = own_file(job.folder, "run.json")
    if report is None or not unchanged(known.inputs, states_of(job.inputs)):
        return False
    read = _read_inside(report, job.inputs)
    return unchanged(read, states_of(map(Path, read)))


def _read_inside(report: Path, inputs: Collection[Path]) -> dict[str, str]:
    """Files that a capture read in or beside its inputs, with their states: those of a project's
    folder, the buffers of a character. Shipped models are others on every machine of a cluster.
    """
    try:
        values: Any = read_json(report, "the report of a capture")
    except InputError:
        return {}
    found = values.get("input_files") if isinstance(values, dict) else None
    places = {*inputs, *(path.parent for path in inputs)}
    read = found.items() if isinstance(found, dict) else ()
    return {name: state for name, state in read if not places.isdisjoint(Path(name).parents)}


def _run(job: Job, cores: Collection[int], overwrite: bool) -> int:
    """The exit code of one capture; its streams go to the log."""
    command = [sys.executable, "-m", "perfcap", *job.arguments, "--resume"]
    if overwrite:  # of this batch, with other options or inputs
        command.append("--overwrite")
    environment = {**os.environ, "OMP_NUM_THREADS": str(len(cores) or _count())}
    job.log.parent.mkdir(parents=True, exist_ok=True)
    with job.log.open("wb") as log:
        child = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=environment,
            preexec_fn=_death_with_parent(),
        )
        if cores and hasattr(os, "sched_setaffinity"):
            with suppress(OSError):  # it has ended already
                os.sched_setaffinity(child.pid, cores)
        try:
            return child.wait()
        except BaseException:
            child.terminate()
            child.wait()
            raise


def _count() -> int:
    return os.cpu_count() or 1


def _death_with_parent() -> Callable[[], None] | None:
    """What a child does first, so that a killed batch, or worker of a cluster, leaves no capture
    that holds its folder; None where the system does not offer it.
    """
    if sys.platform != "linux":
        return None
    # looked up here: after a fork another thread's lock on the loader may be held for ever
    prctl = ctypes.CDLL(None).prctl
    return lambda: prctl(_DIE_WITH_PARENT, signal.SIGKILL)


def last_line(log: Path) -> str:
    """What a log ends with; of options that are refused, which come in a box, its first words.

    Below these the box repeats the help of the option.
    """
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - _TAIL))
        lines = file.read().decode(errors="replace").rstrip().splitlines()
    tops = [number for number, line in enumerate(lines) if line.startswith(_TOP)]
    if tops and lines[-1].startswith(_BOTTOM):
        boxed = (line.strip(_BOX) for line in lines[tops[-1] + 1 :])
        return one_line(" ".join(takewhile(bool, boxed)))
    told = [line for line in (line.strip(_BOX) for line in lines) if line]
    return one_line(told[-1]).removeprefix("perfcap: ") if told else "said nothing"
