"""Threads that a budget of main memory has room for."""

from __future__ import annotations

from pathlib import Path

import pytest

from perfcap.app.capture_request import describe
from perfcap.app.memory_budget import threads_within
from perfcap.commands.capture import Capture
from perfcap.errors import InputError

FULL_HD = ((1920, 1080), (1080, 1920))


def test_more_memory_more_threads_and_no_more_than_cores() -> None:
    assert threads_within(None, FULL_HD) is None
    found = [threads_within(f"{size}G", FULL_HD, cores=16) for size in (4, 6, 8, 64)]
    assert found == sorted(found) and found[0] >= 2 and found[-1] == 16
    assert found[0] < found[1] < found[2]
    assert threads_within("64g", FULL_HD, cores=3) == 3
    assert threads_within("6144M", FULL_HD, cores=16) == found[1]
    assert threads_within("6G", FULL_HD, people=2, cores=16) < found[1]  # type: ignore[operator]


def test_larger_images_fewer_threads_until_there_is_no_room() -> None:
    small, large = (threads_within("6G", [(side, side)], cores=64) for side in (1000, 3000))
    assert small is not None and large is not None and large < small
    with pytest.raises(InputError, match=r"--memory 6G: has no room .* 64.0 million .*[0-9]+M"):
        threads_within("6G", [(8000, 8000)])


@pytest.mark.parametrize("text", ["", "much", "-2G", "0", "2GG", "nan", "1e9", "9" * 40])
def test_what_is_no_size_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="--memory"):
        threads_within(text, FULL_HD)


def test_a_result_is_the_same_call_with_another_budget() -> None:
    calls = [Capture(videos=(Path("a.mp4"),), memory=memory) for memory in (None, "2G")]
    assert describe(calls[0]) == describe(calls[1])
