"""Mutate every input that perfcap reads, and record what is neither accepted nor refused in a line.

    python tools/fuzz.py --seconds 60 --seed 0

A finding is a traceback (anything but ``InputError`` or exit code 2), more than 10 s, memory beyond
1 GiB and four times the file, or NaN that is accepted. Case ``number`` of a seed is always the
same; with ``--state`` a later call goes on behind the last one. ``--case 0:123`` runs one alone.
``--inputs`` ends after so many (whole batches of processes), however fast the machine is.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import io
import json
import os
import random
import resource
import select
import signal
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[1]
for _folder in ("tools", "tests", "tests/io", "tests/io/datasets"):
    sys.path.insert(0, str(_ROOT / _folder))

from fuzzing.corpus import targets  # noqa: E402
from fuzzing.targets import Target, not_a_number, prepare, require_read  # noqa: E402

LONGEST = 10  # s
PATIENCE = 180  # s, by the clock: what only waits hangs, what starves on a busy machine does not
MOST = 1 << 30  # bytes, and four times the file
BATCH = 500  # cases of one process


class Hang(BaseException):
    """Took too long."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--inputs", type=int, default=1 << 40, help="no more than so many")
    parser.add_argument("--state", type=Path, help="JSON to go on from, written as it goes")
    parser.add_argument("--case", help="SEED:NUMBER, one case with its traceback")
    options = parser.parse_args()
    written = None if options.state is None else options.state.resolve()  # targets change folders
    with tempfile.TemporaryDirectory() as folder, quiet():
        known = targets(Path(folder) / "corpus")
        for target in known:
            if target.mutates_files:
                require_read(target, Path(folder) / "work")
        if options.case:
            seed, number = (int(part) for part in options.case.split(":"))
            finding = one(known, Path(folder) / "work", seed, number)
            sys.__stdout__.write(f"{finding or 'nothing found'}\n")
            return 1 if finding else 0
        state = _read(written)
        start, end = state["next"], time.monotonic() + options.seconds
        while time.monotonic() < end and state["next"] - start < options.inputs:
            batch(known, Path(folder) / "work", options.seed, state, end)
            if written is not None:
                written.write_text(json.dumps(state, indent=1))
    sys.stdout.write(f"{state['next'] - start} inputs, {len(state['findings'])} findings\n")
    for finding in state["findings"]:
        sys.stdout.write(f"{json.dumps(finding)}\n")
    return 1 if state["findings"] else 0


def batch(known: list[Target], work: Path, seed: int, state: dict[str, Any], end: float) -> None:
    """Some cases in a process of their own, watched from here."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        _serve(known, work, seed, state["next"], writing)
    os.close(writing)
    with os.fdopen(reading, "rb", buffering=0) as pipe:
        buffer = b""
        while True:
            if not select.select([pipe], [], [], PATIENCE)[0]:
                os.kill(child, signal.SIGABRT)  # says where it is
                break
            data = pipe.read(1 << 16)
            if not data:
                break
            *lines, buffer = (buffer + data).split(b"\n")
            for line in lines:
                state["next"] += 1
                if line != b"-":
                    state["findings"].append(json.loads(line))
            if time.monotonic() > end:
                os.kill(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    if status and time.monotonic() < end:
        name = target_of(known, seed, state["next"]).name
        found = {"case": f"{seed}:{state['next']}", "target": name, "what": f"died: {status}"}
        state["findings"].append(found)
        state["next"] += 1


def _serve(known: list[Target], work: Path, seed: int, first: int, pipe: int) -> None:
    faulthandler.enable(sys.__stderr__)
    try:
        for number in range(first, first + BATCH):
            finding = one(known, work, seed, number)
            os.write(pipe, (json.dumps(finding) if finding else "-").encode() + b"\n")
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            if finding or peak > 1 << 21:  # KiB; a new process has a new peak
                break
    except BaseException:
        traceback.print_exc(file=sys.__stderr__)
        os._exit(1)
    os._exit(0)


def target_of(known: list[Target], seed: int, number: int) -> Target:
    return draw(known, random.Random(f"{seed} {number}"))


def draw(known: list[Target], rng: random.Random) -> Target:
    return rng.choices(known, [each.weight for each in known])[0]


def one(known: list[Target], work: Path, seed: int, number: int) -> dict[str, str] | None:
    """What is wrong with a case; None where nothing is."""
    rng = random.Random(f"{seed} {number}")
    target = draw(known, rng)
    size = prepare(target, work, rng)
    os.chdir(
        work
    )  # a case before may have left a folder that is gone, in which Numba cannot compile
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    what = _outcome(target, work, rng)
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    if what is None and grown > MOST + 4 * size:
        what = f"memory: {grown / 2**20:.0f} MB of a file of {size} bytes"
    return (
        None if what is None else {"case": f"{seed}:{number}", "target": target.name, "what": what}
    )


def _outcome(target: Target, work: Path, rng: random.Random) -> str | None:
    def expire(*_: object) -> None:
        raise Hang

    # of processor time: on a busy machine nothing else would be the same twice; the parent's own
    # patience ends what only waits
    signal.signal(signal.SIGPROF, expire)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        bad = not_a_number(target.run(work, rng))
        return None if bad is None else f"not a number: {bad}"
    except target.refuses:
        return None
    except Hang:
        return f"hang: more than {LONGEST} s"
    except BaseException as error:
        places = traceback.extract_tb(error.__traceback__)
        ours = [p for p in places if "perfcap" in p.filename]
        where = ours[-1] if ours else places[-1]
        said = f"{type(error).__name__}: {str(error)[:200]}"
        return f"{said} at {Path(where.filename).name}:{where.lineno}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


@contextlib.contextmanager
def quiet() -> Any:
    """Nothing of what commands print."""
    sink = io.StringIO()
    with contextlib.redirect_stdout(sink), contextlib.redirect_stderr(sink):
        warnings.simplefilter("ignore")
        yield


def _read(path: Path | None) -> dict[str, Any]:
    fresh: dict[str, Any] = {"next": 0, "findings": []}
    return json.loads(path.read_text()) if path is not None and path.exists() else fresh


if __name__ == "__main__":
    sys.exit(main())
