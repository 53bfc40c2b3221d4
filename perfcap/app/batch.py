"""``perfcap batch``: a list of clips, captured on all cores or on a cluster."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from perfcap.app.batch_clip import (
    DONE,
    INCOMPLETE,
    TRIES,
    Job,
    Outcome,
    is_done,
    read_outcome,
    run_clip,
)
from perfcap.app.batch_page import (
    INDEX,
    PICTURES,
    SUMMARY,
    draw_picture,
    summarize,
    write_pages,
)
from perfcap.app.console import PlainConsole
from perfcap.commands.capture import Batch, Capture
from perfcap.errors import InputError
from perfcap.io.clip_list import ListedClip, read_clip_list
from perfcap.io.made_folder import made_folder
from perfcap.workers import usable_cores

# --- Clips of a batch on a Ray cluster, whose workers may die on the way --------------------------

LOCAL = "local"


def run_on_cluster(
    address: str, workers: int, jobs: Sequence[Job]
) -> Iterator[tuple[Job, Outcome]]:
    """Outcomes as clips are finished; a clip whose worker died goes on from its checkpoint.

    Every machine must see the same folders.

    Args:
        address: of the cluster, or ``local`` for one on this machine.
        workers: of a local cluster.
        jobs: to run.

    Raises:
        InputError: Ray is not installed, or there is no such cluster.
    """
    ray = _ray()
    try:
        if address == LOCAL:
            ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False)
        else:
            ray.init(address, log_to_driver=False)
    except ConnectionError as error:
        raise InputError(f"--cluster {address}: cannot be reached ({error})") from None
    try:
        task = ray.remote(num_cpus=1, max_retries=TRIES)(run_clip)
        running = {task.remote(job): job for job in jobs}
        while running:
            (done,), _ = ray.wait(list(running), num_returns=1)
            job = running.pop(done)
            yield job, _outcome(ray, done, job)
    finally:
        ray.shutdown()


def _outcome(ray: Any, done: Any, job: Job) -> Outcome:
    try:
        found: Outcome = ray.get(done)
    except ray.exceptions.RayError as error:
        return Outcome(job.name, job.arguments, -1, 0.0, TRIES + 1, str(error).splitlines()[0])
    return found


def _ray() -> Any:
    try:
        import ray
    except ModuleNotFoundError:
        raise InputError(
            "--cluster: Ray is not installed; pip install 'perfcap[cluster]', or leave it out"
        ) from None
    return ray


# --- ``perfcap batch``: a list of clips, captured on all cores or on a cluster --------------------

_KEPT = ".batch"  # outcomes and logs, in the folder of the batch
_OURS = ("out", "resume", "overwrite", "report")  # options that the batch gives
_PATHS = ("videos", "cameras", "detections", "masks", "video_map")
_EITHER = ("actor", "detector", "lifter", "segmenter", "edges")  # names of shipped ones, or paths
_SWITCHES = ("overlay", "refine_cameras")
_YES, _NO = ("yes", "true", "1"), ("no", "false", "0")


def run_batch(request: Batch) -> int:
    """Capture what is not captured yet; 0 where every clip has a whole result, else 3.

    Raises:
        InputError: a list or an option that cannot be used; nothing has been captured then.
    """
    if request.processes is not None and request.processes < 1:
        raise InputError(f"--processes {request.processes}: expected 1 or more")
    columns = [f.name for f in dataclasses.fields(Capture) if f.name not in _OURS]
    reserved = (INDEX, SUMMARY, PICTURES, _KEPT)
    clips = read_clip_list(request.clips.absolute(), columns, _PATHS, _EITHER, reserved)
    with made_folder(request.out) as folder:
        jobs = [_job(folder.absolute(), clip, request.report) for clip in clips]
        (folder / _KEPT).mkdir(exist_ok=True)
        outcomes = {job.name: read_outcome(job) for job in jobs}
        missing = [job for job in jobs if not is_done(job, outcomes[job.name])]
        for job in missing:
            outcomes[job.name] = None
        console = PlainConsole(soft_wrap=True)
        console.print(f"{len(jobs)} clips, {len(jobs) - len(missing)} of them captured already")
        _write(folder, jobs, outcomes)
        for job, found in _outcomes(request, missing):
            outcomes[job.name] = found
            draw_picture(folder, job.name)
            _write(folder, jobs, outcomes)
            warnings = summarize(folder, job.name, found).values.get("warnings", ())
            console.print(_line(found, len(warnings)))
    console.print(f"{folder / INDEX} shows them, {folder / SUMMARY} lists them")
    whole = all(found is not None and found.code == DONE for found in outcomes.values())
    return DONE if whole else INCOMPLETE


def _job(folder: Path, clip: ListedClip, report: bool) -> Job:
    arguments = ["capture", *clip.values["videos"]]
    for key, parts in clip.values.items():
        option = f"--{key.replace('_', '-')}"
        if key in _SWITCHES:
            arguments.append(_switch(clip.name, key, option, parts))
        elif key != "videos":
            arguments += [option, *parts]
    arguments += ["--out", str(folder / clip.name), *(["--report"] if report else [])]
    kept = folder / _KEPT
    log, state = kept / f"{clip.name}.log", kept / f"{clip.name}.json"
    return Job(clip.name, tuple(arguments), folder / clip.name, log, state, _inputs(clip))


def _switch(name: str, key: str, option: str, parts: Sequence[str]) -> str:
    said = ";".join(parts).lower()
    if said in _YES:
        return option
    if said in _NO:
        return f"--no-{option[2:]}"
    raise InputError(f"clip {name}: {key} is {said!r:.40}; expected yes or no")


def _inputs(clip: ListedClip) -> tuple[Path, ...]:
    """Files of a clip whose change asks for a new capture."""
    parts = (Path(part) for key in (*_PATHS, *_EITHER) for part in clip.values.get(key, ()))
    return tuple(path for path in parts if path.exists())


def _outcomes(request: Batch, jobs: Sequence[Job]) -> Iterator[tuple[Job, Outcome]]:
    """Jobs and their outcomes as they end."""
    cores = usable_cores()
    count = min(request.processes or cores, max(len(jobs), 1))
    if request.cluster is not None:
        if jobs:
            yield from run_on_cluster(request.cluster, request.processes or cores, jobs)
        return
    shares: SimpleQueue[tuple[int, ...]] = SimpleQueue()
    for share in _shares(count):
        shares.put(share)

    def run(job: Job) -> Outcome:
        share = shares.get()
        try:
            return run_clip(job, share)
        finally:
            shares.put(share)

    with ThreadPoolExecutor(count, thread_name_prefix="perfcap-batch") as pool:
        waiting: dict[Future[Outcome], Job] = {pool.submit(run, job): job for job in jobs}
        try:
            for done in as_completed(waiting):
                yield waiting[done], done.result()
        finally:
            for future in waiting:
                future.cancel()


def _shares(count: int) -> list[tuple[int, ...]]:
    """Cores of each of some processes, all of them where they are too few to share."""
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    if len(cores) < count:
        return [()] * count
    return [tuple(cores[number::count]) for number in range(count)]


def _write(folder: Path, jobs: Sequence[Job], outcomes: dict[str, Outcome | None]) -> None:
    write_pages(folder, [summarize(folder, job.name, outcomes[job.name]) for job in jobs])


def _line(found: Outcome, warnings: int) -> str:
    said = {DONE: "captured", INCOMPLETE: "captured with gaps or doubts"}.get(found.code)
    if said and warnings:
        said += f", {warnings} {'warning' if warnings == 1 else 'warnings'}"
    again = f", begun {found.tries} times" if found.tries > 1 else ""
    return f"{found.name}: {said or found.message} ({found.seconds:.0f} s{again})"
