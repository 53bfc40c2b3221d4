"""Clips of a batch on a Ray cluster, whose workers may die on the way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from perfcap.app.batch_clip import TRIES, Job, Outcome, run_clip
from perfcap.errors import InputError

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
