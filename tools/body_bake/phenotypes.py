"""Adult bodies of the MakeHuman shape targets (CC0): parameters in, morphed base mesh out.

The targets mark corners of a box of parameters (female or male, young or old, little or much
muscle, ...); in between they are blended by products of linear weights.
"""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

Floats = NDArray[np.float64]

ANCHORS = {
    "gender": ("male", "female"),
    "age": ("young", "old"),
    "muscle": ("minmuscle", "averagemuscle", "maxmuscle"),
    "weight": ("minweight", "averageweight", "maxweight"),
    "height": ("minheight", "maxheight"),
    "proportions": ("idealproportions", "uncommonproportions"),
    "african": ("african",),
    "asian": ("asian",),
    "caucasian": ("caucasian",),
}
_FOLDERS = ("macrodetails", "macrodetails/height", "macrodetails/proportions")
_CHILDREN = ("newborn", "baby", "child")
_METRES = 0.1  # the assets are in decimetres


@dataclass(frozen=True, eq=False)
class Targets:
    """Displacements of the base mesh, one row (3 V,) each, and the words of their names."""

    words: tuple[tuple[str, ...], ...]
    rows: csr_array

    def displacement(self, parameters: dict[str, float]) -> Floats:
        """Sum of the targets for parameters from 0 to 1, (V, 3), metres."""
        share = blend(parameters)
        weights = [float(np.prod([share[word] for word in words])) for words in self.words]
        return np.asarray(np.array(weights) @ self.rows).reshape(-1, 3)


def read_targets(root: Path, vertices: int) -> Targets:
    """All targets of grown-ups."""
    known = {word for words in ANCHORS.values() for word in words}
    names, columns, values, start = [], [], [], [0]
    for path in sorted(p for f in _FOLDERS for p in (root / "targets" / f).glob("*.target.gz")):
        words = tuple(w for w in path.name.split(".")[0].split("-") if w != "universal")
        if not known.issuperset(words) or not {"young", "old"}.intersection(words):
            assert set(words) & {*_CHILDREN, *known}, path
            continue
        index, offset = _read(path)
        names.append(words)
        columns.append((3 * index[:, None] + np.arange(3)).ravel())
        values.append(_METRES * offset.ravel())
        start.append(start[-1] + offset.size)
    shape = (len(names), 3 * vertices)
    rows = csr_array((np.concatenate(values), np.concatenate(columns), start), shape=shape)
    return Targets(tuple(names), rows)


def blend(parameters: dict[str, float]) -> dict[str, float]:
    """Share of each word: linear between the two nearest anchors; ancestries sum to one."""
    share: dict[str, float] = {}
    for name, words in ANCHORS.items():
        if len(words) == 1:
            continue
        at = min(max(parameters.get(name, 0.5), 0.0), 1.0) * (len(words) - 1)
        share |= {word: max(0.0, 1 - abs(at - k)) for k, word in enumerate(words)}
    ancestry = {n: parameters.get(n, 1.0) for n in ("african", "asian", "caucasian")}
    total = sum(ancestry.values())
    return share | {name: value / total for name, value in ancestry.items()}


def random_parameters(rng: np.random.Generator) -> dict[str, float]:
    """An adult; age 0 is about 25 years, 1 about 90."""
    ancestry = rng.dirichlet((1.0, 1.0, 1.0))
    return {
        "gender": float(np.clip(rng.integers(2) + rng.normal(0, 0.08), 0, 1)),
        "age": float(rng.uniform(0, 0.8)),
        "muscle": float(rng.beta(2, 2)),
        "weight": float(rng.beta(1.6, 1.9)),
        "height": float(np.clip(rng.normal(0.41, 0.10), 0, 1)),
        "proportions": float(rng.uniform(0, 1)),
        **dict(zip(("african", "asian", "caucasian"), ancestry.tolist(), strict=True)),
    }


def _read(path: Path) -> tuple[NDArray[np.int64], Floats]:
    with gzip.open(path, "rt") as file:
        rows = [line.split() for line in file if line.strip()[:1].isdigit()]
    table = np.array(rows, dtype=float).reshape(-1, 4)
    return table[:, 0].astype(np.int64), table[:, 1:]
