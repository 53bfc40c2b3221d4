"""Exponentials of whole rows on the CPU: ``math.exp`` is called for one number at a time."""

import math

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import kernel

Floats = NDArray[np.float64]

_MOST = 700.0  # beyond it the exponential is next to the smallest normal number
_PER = 1 / math.log(2)
_ROUND = 1.5 * 2.0**52  # added to a number, what is behind its point is lost
# log 2 as a sum: the first part times a whole number is exact
_HIGH, _LOW = float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33")
_C2, _C3, _C4, _C5, _C6, _C7 = (1 / math.factorial(k) for k in range(2, 8))
_C8, _C9, _C10, _C11, _C12 = (1 / math.factorial(k) for k in range(8, 13))


# not fast, whoever calls it: that would take what rounds a number for nothing
@kernel(fastmath=False)
def fading(depth: Floats, left: Floats) -> None:
    """``exp(-depth)`` of numbers that are not negative, to the last digit or two.

    ``exp(-depth) = 2^n exp(r)`` with a whole number n and ``|r| <= log(2) / 2``: exponent bits, and
    a Taylor polynomial.
    """
    for i in range(len(depth)):
        left[i] = _ROUND - min(depth[i], _MOST) * _PER  # n in its last bits
    bits = left.view(np.int64)
    for i in range(len(depth)):
        bits[i] = (bits[i] + 1023) << 52
    for i in range(len(depth)):
        x = -min(depth[i], _MOST)
        n = (_ROUND + x * _PER) - _ROUND
        r = (x - n * _HIGH) - n * _LOW
        high = _C8 + r * (_C9 + r * (_C10 + r * (_C11 + r * _C12)))
        low = _C2 + r * (_C3 + r * (_C4 + r * (_C5 + r * (_C6 + r * (_C7 + r * high)))))
        left[i] *= 1.0 + r * (1.0 + r * low)
