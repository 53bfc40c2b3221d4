"""Work on several cores: order, laziness, errors."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from perfcap.workers import ordered_map, usable_cores


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_results_come_in_the_order_of_the_tasks(workers: int) -> None:
    def late_if_early(task: int) -> int:
        time.sleep(0.002 * (3 - task % 4))
        return task * task

    assert list(ordered_map(late_if_early, range(12), workers)) == [n * n for n in range(12)]


def test_tasks_are_drawn_no_further_ahead_than_there_are_workers() -> None:
    drawn: list[int] = []

    def tasks() -> Iterator[int]:
        for n in range(20):
            drawn.append(n)
            yield n

    results = ordered_map(lambda n: n, tasks(), 2)
    assert next(results) == 0
    assert len(drawn) == 3


def test_several_tasks_run_at_once() -> None:
    together = threading.Barrier(2, timeout=5)
    assert list(ordered_map(lambda n: together.wait() >= 0, range(2), 2)) == [True, True]


def test_an_error_ends_the_map_and_leaves_the_rest_undone() -> None:
    done: list[int] = []

    def fail_at_three(task: int) -> int:
        if task == 3:
            raise RuntimeError("task 3")
        done.append(task)
        return task

    with pytest.raises(RuntimeError, match="task 3"):
        list(ordered_map(fail_at_three, range(1000), 2))
    assert len(done) < 10


def test_cores_are_counted() -> None:
    assert usable_cores() >= 1
