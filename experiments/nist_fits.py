"""The nonlinear regressions of NIST's Statistical Reference Datasets as least-squares problems.

The 27 files, which give data, two starts and certified parameters to eleven digits, are in the
public domain and come from https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml; put them into
one folder. The models are written out here, as the files give them in words.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

Model = Callable[[Tensor, Tensor], Tensor]


def _peaks(b: Tensor, x: Tensor) -> Tensor:
    first = b[2] * (-((x - b[3]) ** 2) / b[4] ** 2).exp()
    return b[0] * (-b[1] * x).exp() + first + b[5] * (-((x - b[6]) ** 2) / b[7] ** 2).exp()


def _three_decays(b: Tensor, x: Tensor) -> Tensor:
    return b[0] * (-b[1] * x).exp() + b[2] * (-b[3] * x).exp() + b[4] * (-b[5] * x).exp()


def _cycles(b: Tensor, x: Tensor) -> Tensor:
    turn = 2 * math.pi * x
    year = b[0] + b[1] * (turn / 12).cos() + b[2] * (turn / 12).sin()
    first = b[4] * (turn / b[3]).cos() + b[5] * (turn / b[3]).sin()
    return year + first + b[7] * (turn / b[6]).cos() + b[8] * (turn / b[6]).sin()


def _cubics(b: Tensor, x: Tensor) -> Tensor:
    over = b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3
    return over / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def _quadratics(b: Tensor, x: Tensor) -> Tensor:
    return (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2)


def _rat43(b: Tensor, x: Tensor) -> Tensor:
    return b[0] / (1 + (b[1] - b[2] * x).exp()) ** (1 / b[3])


MODELS: dict[str, Model] = {
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": lambda b, x: b[0] * (1 - (-b[1] * x).exp()),
    "Chwirut1": lambda b, x: (-b[0] * x).exp() / (b[1] + b[2] * x),
    "Chwirut2": lambda b, x: (-b[0] * x).exp() / (b[1] + b[2] * x),
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": _cycles,
    "Eckerle4": lambda b, x: b[0] / b[1] * (-0.5 * ((x - b[2]) / b[1]) ** 2).exp(),
    "Gauss1": _peaks,
    "Gauss2": _peaks,
    "Gauss3": _peaks,
    "Hahn1": _cubics,
    "Kirby2": _quadratics,
    "Lanczos1": _three_decays,
    "Lanczos2": _three_decays,
    "Lanczos3": _three_decays,
    "MGH09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * (b[1] / (x + b[2])).exp(),
    "MGH17": lambda b, x: b[0] + b[1] * (-x * b[3]).exp() + b[2] * (-x * b[4]).exp(),
    "Misra1a": lambda b, x: b[0] * (1 - (-b[1] * x).exp()),
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Nelson": lambda b, x: b[0] - b[1] * x[:, 0] * (-b[2] * x[:, 1]).exp(),
    "Rat42": lambda b, x: b[0] / (1 + (b[1] - b[2] * x).exp()),
    "Rat43": _rat43,
    "Roszman1": lambda b, x: b[0] - b[1] * x - (b[2] / (x - b[3])).atan() / math.pi,
    "Thurber": _cubics,
}


@dataclass(frozen=True)
class Fit:
    """One regression: data, starts (2, n) and certified parameters (n,)."""

    name: str
    x: Tensor
    y: Tensor
    starts: Tensor
    certified: Tensor

    def residual(self, parameters: Tensor) -> Tensor:
        """Model minus observation, (m,)."""
        return MODELS[self.name](parameters, self.x) - self.y

    def digits(self, parameters: Tensor) -> float:
        """Correct significant digits of the worst parameter, at most 11."""
        error = ((parameters - self.certified) / self.certified).abs().max()
        return min(11.0, -math.log10(float(error.nan_to_num(math.inf).clamp(min=1e-11))))


def read_fits(folder: Path) -> list[Fit]:
    """All regressions whose files ``<name>.dat`` lie in a folder."""
    return [read_fit(folder / f"{name}.dat") for name in MODELS if _lies(folder, name)]


def _lies(folder: Path, name: str) -> bool:
    return (folder / f"{name}.dat").is_file()


def read_fit(path: Path) -> Fit:
    """One regression from its file."""
    lines = path.read_text(encoding="latin-1").splitlines()
    number = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
    row = re.compile(rf"\s*b\d+\s*=\s*({number})\s+({number})\s+({number})\s+{number}\s*$")
    found = [match.groups() for match in map(row.match, lines) if match]
    table = torch.tensor([[float(v) for v in each] for each in found], dtype=torch.float64)
    first = max(i for i, line in enumerate(lines) if line.startswith("Data:"))
    data = [[float(v) for v in line.split()] for line in lines[first + 1 :] if line.strip()]
    values = torch.tensor(data, dtype=torch.float64)
    y, x = values[:, 0], values[:, 1] if values.shape[1] == 2 else values[:, 1:]
    if path.stem == "Nelson":
        y = y.log()
    return Fit(path.stem, x, y, table[:, :2].T.contiguous(), table[:, 2].contiguous())
