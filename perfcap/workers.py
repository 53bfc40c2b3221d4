"""Independent pieces of work on several cores, in order and with bounded memory."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


def ordered_map(
    function: Callable[[Task], Result], tasks: Iterable[Task], workers: int | None = None
) -> Iterator[Result]:
    """Results of a function in the order of its tasks, computed by threads.

    Tasks are drawn from the iterable by the calling thread, at most one more than there are
    workers ahead of the result that is waited for, so a stream of any length needs constant
    memory. Kernels and image operations release the interpreter's lock. Results do not depend on
    the number of workers, provided that tasks are independent.

    Args:
        function: of one task.
        tasks: may be lazy, such as blocks of a video.
        workers: threads; every core the process may use when not given.
    """
    count = workers if workers is not None else usable_cores()
    if count <= 1:
        yield from map(function, tasks)
        return
    with ThreadPoolExecutor(count, thread_name_prefix="perfcap") as pool:
        waiting: deque[Future[Result]] = deque()
        try:
            for task in tasks:
                waiting.append(pool.submit(function, task))
                if len(waiting) > count:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:  # after an error nothing that has not begun is worth doing
                future.cancel()


def usable_cores() -> int:
    """Cores this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
