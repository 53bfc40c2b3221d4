"""Kernels that other kernels alone call are no trap for Python."""

import pytest

from perfcap.kernels import inner, kernel


@inner()
def _twice(value: float) -> float:
    return 2 * value


@kernel()
def _four_times(value: float) -> float:
    return float(_twice(_twice(value)))


def test_inner_kernels_are_called_by_kernels() -> None:
    assert _four_times(1.5) == 6


@pytest.mark.parametrize("attempt", ["first", "second"])
def test_inner_kernels_refuse_python(attempt: str) -> None:
    with pytest.raises(TypeError, match="_twice is called by other kernels alone"):
        _twice(1.5)
