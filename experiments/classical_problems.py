"""Least-squares problems with known answers, by which solvers are judged.

Formulas, data and minima: J. J. Moré, B. S. Garbow, K. E. Hillstrom, "Testing unconstrained
optimization software", ACM TOMS 7 (1981), numbered as there. Every function takes a tensor (n,)
and gives its residuals (m,).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

Function = Callable[[Tensor], Tensor]

_BARD = (0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.1, 4.39)
_GAUSS = (0.0009, 0.0044, 0.0175, 0.054, 0.1295, 0.242, 0.3521)
_MEYER: tuple[int, ...] = (34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744)
_MEYER += (8261, 7030, 6005, 5147, 4427, 3820, 3307, 2872)
_KOWALIK_Y = (0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246)
_KOWALIK_U = (4, 2, 1, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625)
_OSBORNE: tuple[float, ...] = (0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.85, 0.818)
_OSBORNE += (0.784, 0.751, 0.718, 0.685, 0.658, 0.628, 0.603, 0.58, 0.558, 0.538, 0.522, 0.506)
_OSBORNE += (0.49, 0.478, 0.467, 0.457, 0.448, 0.438, 0.431, 0.424, 0.42, 0.414, 0.411, 0.406)


@dataclass(frozen=True)
class Classic:
    """A problem, where to start, and the sums of squares at its known minima."""

    name: str
    residual: Function
    start: tuple[float, ...]
    minima: tuple[float, ...]
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = field(default=())

    def initial(self) -> Tensor:
        """The start, float64."""
        return torch.tensor(self.start, dtype=torch.float64)

    def bounds(self) -> tuple[Tensor, Tensor] | None:
        """Lower and upper bounds (n,), None where there are none."""
        if not self.lower and not self.upper:
            return None
        free = len(self.start) * (math.inf,)
        lower = self.lower or tuple(-each for each in free)
        pair = torch.tensor([lower, self.upper or free], dtype=torch.float64)
        return pair[0], pair[1]


def _count(m: int) -> Tensor:
    return torch.arange(1, m + 1, dtype=torch.float64)


def _data(values: tuple[float, ...]) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def rosenbrock(x: Tensor) -> Tensor:
    """1, and 21 for more unknowns."""
    odd, even = x[0::2], x[1::2]
    return torch.cat((10 * (even - odd**2), 1 - odd))


def freudenstein_roth(x: Tensor) -> Tensor:
    """2."""
    a, b = x.unbind()
    return torch.stack((-13 + a + ((5 - b) * b - 2) * b, -29 + a + ((b + 1) * b - 14) * b))


def powell_badly_scaled(x: Tensor) -> Tensor:
    """3."""
    return torch.stack((1e4 * x[0] * x[1] - 1, (-x).exp().sum() - 1.0001))


def brown_badly_scaled(x: Tensor) -> Tensor:
    """4."""
    return torch.stack((x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2))


def beale(x: Tensor) -> Tensor:
    """5."""
    return _data((1.5, 2.25, 2.625)) - x[0] * (1 - x[1] ** _count(3))


def jennrich_sampson(x: Tensor) -> Tensor:
    """6."""
    i = _count(10)
    return 2 + 2 * i - (i * x[0]).exp() - (i * x[1]).exp()


def helical_valley(x: Tensor) -> Tensor:
    """7."""
    turn = torch.atan2(x[1], x[0]) / (2 * math.pi)
    return torch.stack((10 * (x[2] - 10 * turn), 10 * (x[:2].norm() - 1), x[2]))


def bard(x: Tensor) -> Tensor:
    """8."""
    u = _count(15)
    v = 16 - u
    return _data(_BARD) - (x[0] + u / (v * x[1] + torch.minimum(u, v) * x[2]))


def gaussian(x: Tensor) -> Tensor:
    """9."""
    t = (8 - _count(15)) / 2
    return x[0] * (-x[1] * (t - x[2]) ** 2 / 2).exp() - _data((*_GAUSS, 0.3989, *_GAUSS[::-1]))


def meyer(x: Tensor) -> Tensor:
    """10."""
    return x[0] * (x[1] / (45 + 5 * _count(16) + x[2])).exp() - _data(_MEYER)


def gulf(x: Tensor) -> Tensor:
    """11, with 99 points."""
    t = _count(99) / 100
    y = 25 + (-50 * t.log()) ** (2 / 3)
    return (-((y - x[1]).abs() ** x[2]) / x[0]).exp() - t


def box(x: Tensor) -> Tensor:
    """12."""
    t = 0.1 * _count(10)
    return (-t * x[0]).exp() - (-t * x[1]).exp() - x[2] * ((-t).exp() - (-10 * t).exp())


def powell_singular(x: Tensor) -> Tensor:
    """13."""
    a, b, c, d = x.unbind()
    root = (a + 10 * b, 5**0.5 * (c - d), (b - 2 * c) ** 2, 10**0.5 * (a - d) ** 2)
    return torch.stack(root)


def wood(x: Tensor) -> Tensor:
    """14."""
    a, b, c, d = x.unbind()
    first = (10 * (b - a**2), 1 - a, 90**0.5 * (d - c**2), 1 - c)
    return torch.stack((*first, 10**0.5 * (b + d - 2), (b - d) / 10**0.5))


def kowalik_osborne(x: Tensor) -> Tensor:
    """15."""
    u = _data(_KOWALIK_U)
    return _data(_KOWALIK_Y) - x[0] * (u**2 + u * x[1]) / (u**2 + u * x[2] + x[3])


def brown_dennis(x: Tensor) -> Tensor:
    """16."""
    t = _count(20) / 5
    return (x[0] + t * x[1] - t.exp()) ** 2 + (x[2] + x[3] * t.sin() - t.cos()) ** 2


def osborne(x: Tensor) -> Tensor:
    """17."""
    t = 10 * (_count(33) - 1)
    return _data(_OSBORNE) - (x[0] + x[1] * (-t * x[3]).exp() + x[2] * (-t * x[4]).exp())


def biggs(x: Tensor) -> Tensor:
    """18, with 13 points."""
    t = 0.1 * _count(13)
    y = (-t).exp() - 5 * (-10 * t).exp() + 3 * (-4 * t).exp()
    return x[2] * (-t * x[0]).exp() - x[3] * (-t * x[1]).exp() + x[5] * (-t * x[4]).exp() - y


def watson(x: Tensor) -> Tensor:
    """20."""
    t, j = (_count(29) / 29).unsqueeze(1), _count(len(x)) - 1
    slope = (j[1:] * x[1:] * t ** (j[1:] - 1)).sum(1)
    value = (x * t**j).sum(1)
    return torch.cat((slope - value**2 - 1, x[:1], x[1:2] - x[0] ** 2 - 1))


def penalty(x: Tensor) -> Tensor:
    """23."""
    return torch.cat((1e-5**0.5 * (x - 1), x.square().sum().reshape(1) - 0.25))


def variably_dimensioned(x: Tensor) -> Tensor:
    """25."""
    total = (_count(len(x)) * (x - 1)).sum().reshape(1)
    return torch.cat((x - 1, total, total**2))


def trigonometric(x: Tensor) -> Tensor:
    """26."""
    n, i = len(x), _count(len(x))
    return n - x.cos().sum() + i * (1 - x.cos()) - x.sin()


def brown_almost_linear(x: Tensor) -> Tensor:
    """27."""
    return torch.cat((x[:-1] + x.sum() - (len(x) + 1), x.prod().reshape(1) - 1))


def broyden_tridiagonal(x: Tensor) -> Tensor:
    """30."""
    before, behind = torch.cat((0 * x[:1], x[:-1])), torch.cat((x[1:], 0 * x[:1]))
    return (3 - 2 * x) * x - before - 2 * behind + 1


def linear_full_rank(x: Tensor) -> Tensor:
    """32, with twice as many residuals as unknowns."""
    mean = 2 * x.sum() / (2 * len(x))
    return torch.cat((x - mean - 1, (-mean - 1).expand(len(x))))


def linear_rank_one(x: Tensor) -> Tensor:
    """33, with twice as many residuals as unknowns."""
    return _count(2 * len(x)) * (_count(len(x)) * x).sum() - 1


def chebyquad(x: Tensor) -> Tensor:
    """35."""
    n, before, now = len(x), torch.ones_like(x), 2 * x - 1
    rows = []
    for i in range(1, n + 1):
        exact = 0.0 if i % 2 else -1 / (i**2 - 1)
        rows.append(now.mean() - exact)
        before, now = now, 2 * (2 * x - 1) * now - before
    return torch.stack(rows)


def _many(name: str, residual: Function, start: tuple[float, ...], *minima: float) -> list[Classic]:
    """The problem from its start, and from starts ten and a hundred times as far away."""
    scaled = (tuple(factor * each for each in start) for factor in (1, 10, 100))
    names = (name, f"{name} x10", f"{name} x100")
    return [Classic(*each, minima) for each in zip(names, 3 * [residual], scaled, strict=True)]


def unbounded() -> list[Classic]:
    """Thirty-five problems and starts, from easy to hard; sums of squares from the paper."""
    powers = (*(2 * [0.0]), *(4 * [0.0]))
    return [
        *_many("Rosenbrock", rosenbrock, (-1.2, 1), 0),
        *_many("Freudenstein and Roth", freudenstein_roth, (0.5, -2), 0, 48.98425367924),
        Classic("Powell badly scaled", powell_badly_scaled, (0, 1), (0,)),
        Classic("Brown badly scaled", brown_badly_scaled, (1, 1), (0,)),
        Classic("Beale", beale, (1, 1), (0,)),
        Classic("Jennrich and Sampson", jennrich_sampson, (0.3, 0.4), (124.36218235561,)),
        *_many("helical valley", helical_valley, (-1, 0.1, 0), 0),
        Classic("Bard", bard, (1, 1, 1), (8.2148773065790e-3,)),
        Classic("Gaussian", gaussian, (0.4, 1, 0), (1.12793276961871e-8,)),
        Classic("Meyer", meyer, (0.02, 4000, 250), (87.945855170702,)),
        Classic("Gulf", gulf, (5, 2.5, 0.15), (0,)),
        Classic("Box", box, (0, 10, 20), (0,)),
        *_many("Powell singular", powell_singular, (3, -1, 0, 1), 0),
        *_many("Wood", wood, (-3, -1, -3, -1), 0),
        Classic(
            "Kowalik and Osborne",
            kowalik_osborne,
            (0.25, 0.39, 0.415, 0.39),
            (3.0750560384924e-4,),
        ),
        *_many("Brown and Dennis", brown_dennis, (25, 5, -5, -1), 85822.201626356),
        Classic("Osborne", osborne, (0.5, 1.5, -1, 0.01, 0.02), (5.46489469748290e-5,)),
        Classic("Biggs", biggs, (1, 2, 1, 1, 1, 1), (0, 5.6556499255e-3)),
        Classic("Watson 6", watson, (*powers,), (2.28767005355236e-3,)),
        Classic("penalty", penalty, (1, 2, 3, 4), (2.24997750063115e-5,)),
        Classic(
            "variably dimensioned",
            variably_dimensioned,
            tuple(1 - j / 10 for j in range(1, 11)),
            (0,),
        ),
        Classic("trigonometric", trigonometric, 10 * (0.1,), (0, 2.79506122e-5)),
        Classic("Brown almost linear", brown_almost_linear, 10 * (0.5,), (0, 1)),
        Classic("Broyden tridiagonal", broyden_tridiagonal, 10 * (-1,), (0,)),
        Classic("linear, full rank", linear_full_rank, 5 * (1,), (5,)),
        Classic("linear, rank one", linear_rank_one, 5 * (1,), (90 / 42,)),
        Classic(
            "Chebyquad 8",
            chebyquad,
            tuple(j / 9 for j in range(1, 9)),
            (3.51687372568e-3,),
        ),
    ]


def bounded() -> list[Classic]:
    """Problems in boxes.

    The first four are those of Hock and Schittkowski (1981: 1, 2, 25 and 38), the others boxes
    around the problems above; their minima are those on which SciPy's ``trf`` and ``dogbox``
    agree, each from six starts.
    """
    inf = math.inf
    return [
        Classic("Rosenbrock, free side", rosenbrock, (-2, 1), (0,), (-inf, -1.5)),
        Classic("Rosenbrock, held", rosenbrock, (-2, 1), (0.05042618789, 4.941229318), (-inf, 1.5)),
        Classic("Gulf in a box", gulf, (5, 2.5, 0.15), (0,), (0.1, 0, 0), (100, 25.6, 5)),
        Classic("Wood in a box", wood, (-3, -1, -3, -1), (0,), 4 * (-10,), 4 * (10,)),
        Classic("Beale, held", beale, (1, 1), (0,), (0.6, 0.5), (10, 100)),
        Classic(
            "helical valley, held",
            helical_valley,
            (-1, 0, 0),
            (0.990422121,),
            (-100, -1, -1),
            (0.8, 1, 1),
        ),
        Classic("Box, held", box, (0, 5, 20), (1.143481803e-4,), (0, 5, 0), (2, 9.5, 20)),
        Classic(
            "Brown and Dennis, held",
            brown_dennis,
            (25, 5, -5, -1),
            (88860.47977,),
            (-10, 0, -100, -20),
            (100, 15, 0, 0.2),
        ),
        Classic(
            "Biggs, held",
            biggs,
            (1, 2, 1, 1, 1, 1),
            (5.320986591e-4,),
            (0, 0, 0, 1, 0, 0),
            (2, 8, 1, 7, 5, 5),
        ),
        Classic("Powell, held", powell_badly_scaled, (0, 1), (1.512593672e-10,), (0, 1), (1, 9)),
        Classic(
            "penalty, held",
            penalty,
            (1, 2, 3, 4),
            (2.385077248e-5,),
            (0.1, 0, -inf, 0),
            (10, 0.2, 0.1, 5),
        ),
        Classic(
            "Kowalik and Osborne, held",
            kowalik_osborne,
            (0.25, 0.39, 0.415, 0.39),
            (3.116659251e-4,),
            (0, -1, 0.13, 0.12),
            (0.19, 12, 13, 12),
        ),
    ]
