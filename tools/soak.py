"""Capture for long, and many at once: memory must stay flat, and results equal.

    python tools/soak.py stream --frames 20000   # one clip with images of 160 px, to the surface
    python tools/soak.py again --count 50        # so many captures in one process
    python tools/soak.py together                # four threads and four processes at once
    python tools/soak.py threads                 # with one thread and with two: equal bits?

Prints the memory of the process, and ends with 1 where it grows or results differ.
"""

from __future__ import annotations

import argparse
import gc
import hashlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
for _folder in ("tests", "tests/pipeline"):
    sys.path.insert(0, str(_ROOT / _folder))

import numpy as np  # noqa: E402
import torch  # noqa: E402
from takes import Take, detect, make_take, shrunk  # noqa: E402
from test_checkpoint import CONFIG, film, filmed_from  # noqa: E402

from perfcap.pipeline import Performance, Stage, capture  # noqa: E402
from perfcap.pipeline.images import Frames, Images  # noqa: E402

SIDE, PERIOD = 160, 20
GROWTH = 64  # MiB after the first quarter
FOUND = (
    4 / 1024
)  # MiB a frame of one stage: masks and their confidences, or vertices of the surface


@dataclass(frozen=True)
class Loop:
    """A short film again and again, there and back so that nothing jumps."""

    frames: Frames
    count: int

    def __len__(self) -> int:
        """How many frames there seem to be."""
        return self.count

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        """Frames of the one view."""
        return self.frames[there_and_back(np.arange(start, stop))]


def there_and_back(index: np.ndarray) -> np.ndarray:
    place = index % (2 * PERIOD - 2)
    return np.minimum(place, 2 * PERIOD - 2 - place)


def memory() -> float:
    """Resident memory of this process, MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def digest(found: Performance, frames: int) -> str:
    """Of the bits of a motion and of its surface."""
    motion = found.motion
    hashed = hashlib.sha256()
    for values in (motion.translation, motion.rotation, motion.angles):
        hashed.update(values.numpy(force=True).tobytes())
    for start in range(0, frames if found.surface is not None else 0, 64):
        assert found.surface is not None
        hashed.update(found.surface[start : start + 64].numpy(force=True).tobytes())
    return hashed.hexdigest()[:16]


def stream(frames: int, until: str) -> bool:
    """One long clip; memory at every percent of every stage."""
    take = make_take(PERIOD)
    cameras = shrunk(take.cameras, (SIDE, SIDE))
    take = replace(take, cameras=cameras, detections=detect(take.actor, cameras, take.truth))
    shown = Loop(_shown(take), frames)
    index = torch.from_numpy(there_and_back(np.arange(frames)))
    seen: dict[str, list[float]] = {}
    began = time.monotonic()

    def tell(stage: str, done: int, total: int) -> None:
        step = max(1, total // 100)
        if done % step == 0:
            seen.setdefault(stage, []).append(memory())
        if done % (10 * step) == 0:
            took = time.monotonic() - began
            _say(f"{stage}: {done} of {total}, {memory():.0f} MiB, {took:.0f} s")

    capture(
        *(take.actor, cameras, take.detections.frames(index), take.rate, CONFIG),
        images=Images(shown, cameras),
        until=Stage[until.upper()],
        progress=tell,
    )
    flat = True
    for stage, values in seen.items():
        later = values[len(values) // 4 :]
        grown = max(later) - later[0]
        flat &= grown < GROWTH + FOUND * frames
        _say(f"{stage}: {values[0]:.0f} MiB at first, {max(values):.0f} at most, +{grown:.0f} late")
    _say(f"{frames} frames of {SIDE} px in {time.monotonic() - began:.0f} s")
    return flat


def _shown(take: Take) -> Frames:
    """The person filmed at the size of the cameras."""
    import test_checkpoint

    test_checkpoint.SIDE = SIDE
    return film(take, take.cameras).frames[0]


def again(count: int) -> bool:
    """Captures with images, one after the other in this process."""
    filmed, values, results = filmed_from(1), [], set()
    for number in range(count):
        results.add(digest(filmed.run(), 20))
        gc.collect()
        values.append(memory())
        if number % max(1, count // 5) == 0:
            _say(f"after {number + 1} captures: {values[-1]:.0f} MiB")
    grown = values[-1] - values[len(values) // 4]
    _say(f"{count} captures: +{grown:.1f} MiB after the first quarter, {len(results)} results")
    return grown < GROWTH and len(results) == 1


def together() -> bool:
    """Four threads, then four processes, all with the same capture."""
    filmed = filmed_from(1)
    alone = digest(filmed.run(), 20)
    barrier = threading.Barrier(4)

    def once(_: int) -> str:
        barrier.wait()
        return digest(filmed.run(), 20)

    with ThreadPoolExecutor(4) as pool:
        threads = list(pool.map(once, range(4)))
    call = [sys.executable, __file__, "one"]
    running = [subprocess.Popen(call, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    processes = [each.communicate()[0].strip() for each in running]
    _say(f"alone {alone}, threads {sorted(set(threads))}, processes {sorted(set(processes))}")
    return {alone} == {*threads} == {*processes}


def threads() -> bool:
    """The same capture in new processes with one and with two threads of every kind."""
    names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    found = {}
    for count in ("1", "2"):
        environment = {**os.environ, **dict.fromkeys(names, count)}
        call = [sys.executable, __file__, "one", "--threads", count]
        done = subprocess.run(call, env=environment, capture_output=True, text=True, check=True)
        found[count] = done.stdout.strip()
    _say(", ".join(f"{count} threads: {bits}" for count, bits in found.items()))
    return len(set(found.values())) == 1


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("stream", "again", "together", "threads", "one"))
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--until", default="refine_surface")
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--threads", type=int, default=1, help="of torch, in 'one'")
    options = parser.parse_args(arguments)
    if options.what == "one":
        torch.set_num_threads(options.threads)
        _say(digest(filmed_from(1).run(), 20))
        return 0
    if options.what == "stream":
        return 0 if stream(options.frames, options.until) else 1
    if options.what == "again":
        return 0 if again(options.count) else 1
    return 0 if (together() if options.what == "together" else threads()) else 1


if __name__ == "__main__":
    sys.exit(main())
