"""Kill captures, fill their disk and turn back their clock; what they leave must be whole.

    python tools/crash.py kills --count 100   # at random moments and at changes of files
    python tools/crash.py disk                # a tmpfs: full, without inodes, read-only; needs root
    python tools/crash.py clock               # time that runs backwards
    python tools/crash.py cost                # what keeping costs, and what a kill can cost at most

Takes of one view and of four are filmed small, captured with images to the surface, and resumed
after each kill. The result must have the bits of a capture that nobody disturbed. Each capture runs
in a process that is forked from this one, so that a kill costs no start of Python.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import mmap
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch
from crash_scenes import Scene, make_scene

from perfcap.cli import main as perfcap
from perfcap.io import models_folder
from perfcap.io.journal import Journal, Record

CHANGES = ("replace", "mkdir", "unlink", "rmdir", "fsync")
SAID = Path(tempfile.gettempdir()) / f"crash-{os.getpid()}.txt"  # by the last command
TIMED = ("wall_s", "stages", "peak_memory_mib")  # of run.json


def start(arguments: list[str], prepare: Callable[[], None] = lambda: None) -> int:
    """Run a command in a forked process; what it says goes to ``SAID``. Returns its number."""
    child = os.fork()
    if child:
        return child
    code = 70
    try:
        with (
            SAID.open("w", encoding="utf-8") as words,
            contextlib.redirect_stdout(words),
            contextlib.redirect_stderr(words),
        ):
            torch.set_num_threads(1)
            prepare()
            try:
                perfcap(arguments)
            except SystemExit as end:
                code = int(end.code or 0)
    finally:
        os._exit(code)


def finished(child: int) -> int:
    """Exit code of a process; minus its signal where it was killed."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def run(arguments: list[str], prepare: Callable[[], None] = lambda: None) -> int:
    return finished(start(arguments, prepare))


def bits(out: Path) -> dict[str, str]:
    """Every file of a result by its digest, but for what tells of time and memory."""
    found = {}
    for path in sorted(out.rglob("*")):
        if not path.is_file():
            continue
        data = path.read_bytes()
        if path.name == "run.json":
            report = json.loads(data)
            for name in TIMED:
                report.pop(name, None)
            report["request"].pop("out")
            data = json.dumps(report, sort_keys=True).encode()
        found[str(path.relative_to(out))] = hashlib.sha256(data).hexdigest()
    return found


def dying(last: int, note: Callable[[int], None] = lambda count: None) -> Callable[[], None]:
    """Make the process kill itself just before, or at half of, its ``last``-th change of files."""

    def prepare() -> None:
        count = [0]

        def counted(genuine: Callable[..., object], half: bool) -> Callable[..., object]:
            def call(*args: object, **kwargs: object) -> object:
                count[0] += 1
                note(count[0])
                if count[0] == last:
                    if half and last % 2:
                        genuine(*args, **kwargs)
                        path = args[0].path  # type: ignore[attr-defined]
                        os.truncate(path, path.stat().st_size - 5)
                    os.kill(os.getpid(), signal.SIGKILL)
                return genuine(*args, **kwargs)

            return call

        for name in CHANGES:
            setattr(os, name, counted(getattr(os, name), half=False))
        Journal.append = counted(Journal.append, half=True)  # type: ignore[method-assign, assignment]

    return prepare


def count_changes(scene: Scene, out: Path) -> int:
    """How often a capture changes files."""
    with mmap.mmap(-1, 8) as shared:  # the process that counts is another

        def note(count: int) -> None:
            shared[:8] = count.to_bytes(8, "little")

        code = run(scene.call(out), dying(-1, note))
        assert code == 0, (code, SAID.read_text()[-600:])
        return int.from_bytes(shared[:8], "little")


def kills(scenes: list[Scene], work: Path, count: int, seed: int) -> Iterator[str]:
    """Half of the kills at random moments, half at changes of files spread over all of them."""
    rng = random.Random(seed)
    for scene in scenes:
        began = time.monotonic()
        whole = work / f"whole{scene.views}"
        assert run(scene.call(whole)) == 0
        took, expected = time.monotonic() - began, bits(whole)
        changes = count_changes(scene, work / f"counted{scene.views}")
        share = count // len(scenes)
        places = np.linspace(1, changes, share - share // 2).round().astype(int).tolist()
        done = survived = restarts = 0
        while done < share:
            out = work / f"killed{scene.views}_{done}"
            code = -1
            while code < 0:
                resume = scene.call(out, "--resume")
                if done >= share:
                    code = run(resume)
                elif done % 2 and places:
                    code = run(resume, dying(places.pop(rng.randrange(len(places)))))
                else:
                    child = start(resume)
                    time.sleep(rng.uniform(0, took))
                    os.kill(child, signal.SIGKILL)
                    code = finished(child)
                done += code < 0
                restarts += 1
            equal = code == 0 and bits(out) == expected
            survived += equal
            if not equal:
                said = SAID.read_text()[-300:]
                yield f"FOUND: views {scene.views}, {out}: code {code}, other bits; {said}"
            else:
                shutil.rmtree(out)
            if code >= 0 and not equal:
                break
        yield (
            f"{scene.views} views: {done} kills in {restarts} runs, {changes} changes of files, "
            f"{survived} results, all with the bits of the undisturbed one; {took:.1f} s each"
        )


def disk(scene: Scene, work: Path, steps: int) -> Iterator[str]:
    """An older result lies on a disk that is too small for the next one."""
    older, place = work / "older", work / "disk"
    assert run(scene.call(older, "--until", "initialize", "--no-overlay")) == 0
    assert run(scene.call(work / "whole")) == 0
    expected, before = bits(work / "whole"), bits(older)
    size = sum(path.stat().st_size for path in older.rglob("*") if path.is_file())
    new = sum(path.stat().st_size for path in (work / "whole").rglob("*") if path.is_file())
    place.mkdir()
    cases = [f"size={size + 65536 + int(8 * new * at / steps)}" for at in range(steps)]
    cases += [f"size=1g,nr_inodes={len(before) + 4 + at * 8}" for at in range(steps)]
    lost = refused = 0
    for case in [*cases, "ro"]:
        options = "size=1g" if case == "ro" else case
        subprocess.run(["mount", "-t", "tmpfs", "-o", options, "none", str(place)], check=True)
        try:
            out = place / "out"
            shutil.copytree(older, out)
            if case == "ro":
                subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
            code = run(scene.call(out, "--overwrite"))
            found = {name: data for name, data in bits(out).items() if ".perfcap" not in name}
            refused += code == 2
            if code not in (0, 2) or found != (expected if code == 0 else before):
                lost += 1
                yield f"FOUND: {case}: code {code}, {sorted(set(found) ^ set(before))[:5]}"
            if code == 2:
                more = "remount,rw,size=1g,nr_inodes=100000"
                subprocess.run(["mount", "-o", more, str(place)], check=True)
                again = run(scene.call(out, "--resume", "--overwrite"))
                if again != 0 or bits(out) != expected:
                    lost += 1
                    yield f"FOUND: {case}: resumed with code {again}, other bits"
        finally:
            subprocess.run(["umount", str(place)], check=True)
    yield f"{len(cases) + 1} disks, {refused} of them too small: {lost} older results lost"


def clock(scene: Scene, work: Path) -> Iterator[str]:
    """Time that runs backwards, an hour with every question."""
    assert run(scene.call(work / "whole")) == 0
    now = [time.time()]

    def backwards() -> float:
        now[0] -= 3600
        return now[0]

    def prepare() -> None:
        time.time = backwards
        time.time_ns = lambda: int(1e9 * backwards())

    def dies() -> None:
        prepare()
        dying(20)()

    codes = [
        run(scene.call(work / "out"), dies),
        run(scene.call(work / "out", "--resume"), prepare),
    ]
    equal = bits(work / "out") == bits(work / "whole")
    yield f"clock backwards: codes {codes}, {'the same bits' if equal else 'FOUND: other bits'}"


def cost(frames: int, work: Path) -> Iterator[str]:
    """Processor time spent on keeping, and between two keeps, in a capture of the demo's video."""
    demo = models_folder() / "demo"
    call = ["capture", str(demo / "video.mp4"), "--actor", "sam", "--out", str(work / "cost")]
    call += ["--cameras", str(demo / "camera.json"), "--detections", str(demo / "detections.npz")]
    genuine, kept, spent = Journal.append, [time.process_time()], []

    def timed(journal: Journal, record: Record) -> None:
        began = time.process_time()
        genuine(journal, record)
        kept.append(time.process_time())
        spent.append(kept[-1] - began)

    Journal.append = timed  # type: ignore[method-assign]
    with contextlib.suppress(SystemExit), contextlib.redirect_stderr(io.StringIO()):
        perfcap([*call, "--frames", f"0:{frames}"])
    Journal.append = genuine  # type: ignore[method-assign]
    kept.append(time.process_time())  # drawing and writing the result comes after the last one
    total, longest = kept[-1] - kept[0], float(np.diff(kept).max())
    yield (
        f"{frames} frames: {len(spent)} keeps took {sum(spent):.2f} of {total:.1f} CPU s "
        f"({100 * sum(spent) / total:.2f} %); {longest:.1f} CPU s at most between two"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("kills", "disk", "clock", "cost"))
    parser.add_argument("--count", type=int, default=100, help="kills")
    parser.add_argument("--steps", type=int, default=12, help="sizes of disks, and of inodes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--views", type=int, nargs="+", default=[1, 4], help="0: a video and nothing else"
    )
    parser.add_argument("--frames", type=int, default=120, help="of 'cost'")
    options = parser.parse_args()
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        scenes = [make_scene(work / f"scene{views}", views) for views in options.views]
        torch.set_num_threads(1)
        with contextlib.suppress(SystemExit), contextlib.redirect_stderr(io.StringIO()):
            perfcap(scenes[0].call(work / "warm"))  # compiled once, for all that is forked
        if options.what == "kills":
            lines = kills(scenes, work, options.count, options.seed)
        elif options.what == "disk":
            lines = disk(scenes[0], work, options.steps)
        elif options.what == "cost":
            lines = cost(options.frames, work)
        else:
            lines = clock(scenes[0], work)
        for line in lines:
            bad += "FOUND" in line
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()
    SAID.unlink(missing_ok=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
