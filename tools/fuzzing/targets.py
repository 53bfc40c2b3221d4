"""What is fed with mutated files, options and arrays."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from fuzzing import mutate
from fuzzing.mutate import Random
from torch import Tensor

from perfcap.cli import main
from perfcap.errors import InputError

_BY_SUFFIX: dict[str, Callable[[Random, bytes], bytes]] = {
    ".npz": mutate.archive,
    ".glb": mutate.glb,
    ".npy": mutate.plain_array,
    ".ply": mutate.headed,
    ".safetensors": mutate.tensors,
}
_MOST = 100  # frames of an array
_TREES = (".json", ".gltf")
_TEXTS = (".toml", ".yml", ".yaml", ".txt", ".obj", ".off", ".bvh", ".trc", ".calibration")
_TEXTS += (".calib", ".cal", ".xml", ".csv", ".urdf", ".mtl")


@dataclass(frozen=True)
class Target:
    """One reader.

    Attributes:
        name: of it.
        folder: files that it reads as they should be.
        run: reads the files of a folder; what it gives back must be free of NaN.
        refuses: errors that are an answer.
        mutates_files: whether files are mutated; otherwise ``run`` is given the random numbers.
        weight: how often it is drawn, relative to others; what solves is drawn less.
    """

    name: str
    folder: Path
    run: Callable[[Path, Random], Any]
    refuses: tuple[type[BaseException], ...] = (InputError,)
    mutates_files: bool = True
    weight: float = 1.0


def prepare(target: Target, place: Path, rng: Random) -> int:
    """A copy of the files with one of them mutated; returns its bytes."""
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(target.folder, place)
    if not target.mutates_files:
        return 0
    path = rng.choice(sorted(path for path in place.rglob("*") if path.is_file()))
    data = changed(rng, path.suffix.lower(), path.read_bytes())
    path.write_bytes(data)
    return len(data)


def require_read(target: Target, place: Path) -> None:
    """Read the files as they should be: mutants of what is refused would reach nothing."""
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(target.folder, place)
    try:
        target.run(place, Random(0))
    except target.refuses as error:
        raise ValueError(f"{target.name}: the files to mutate are refused: {error}") from error


def changed(rng: Random, suffix: str, data: bytes) -> bytes:
    """A file as its kind asks for."""
    if suffix in _BY_SUFFIX:
        return _BY_SUFFIX[suffix](rng, data)
    if rng.random() < 0.2:
        return mutate.raw(rng, data)
    if suffix in _TREES:
        return json.dumps(mutate.tree(rng, json.loads(data))).encode()
    if suffix in _TEXTS or (suffix == ".stl" and data.startswith(b"solid")):
        return mutate.text(rng, data.decode()).encode("utf-8", "surrogatepass")
    return mutate.raw(rng, data)


def not_a_number(found: Any, depth: int = 0) -> str | None:
    """Name of the first number in a result that is none; None where all are."""
    if isinstance(found, Tensor):
        found = found.detach().numpy(force=True)
    if isinstance(found, np.ndarray):
        good = found.dtype.kind not in "fc" or np.isfinite(found).all()
        return None if good else f"{found.dtype} {found.shape}"
    if depth > 4:
        return None
    parts: dict[str, Any] = {}
    if is_dataclass(found) and not isinstance(found, type):
        parts = {f.name: getattr(found, f.name, None) for f in fields(found)}
    elif isinstance(found, tuple | list):
        parts = {str(i): part for i, part in enumerate(found[:50])}
    elif isinstance(found, dict):
        parts = found
    for name, part in parts.items():
        bad = not_a_number(part, depth + 1)
        if bad is not None:
            return f"{name}: {bad}"
    return None


class Traceback(Exception):
    """A command that ended by something else than an exit code that is agreed upon."""


def command(arguments: list[str]) -> None:
    """A command line; what is not 0, 2, 3 or 130 is a finding."""
    try:
        main(arguments)
    except SystemExit as error:
        if error.code not in (0, 2, 3):
            raise Traceback(f"exit code {error.code}") from None


def spoiled(rng: Random, values: Tensor) -> Tensor:
    """A tensor for the Python API, as somebody might give it by mistake."""
    found = mutate.array(rng, values.numpy(force=True))
    if found.dtype.kind not in "fiub" or found.dtype.byteorder == ">":
        found = np.zeros(found.shape)
    found = found[:_MOST] if found.ndim else found  # longer clips are work, not mistakes
    return torch.from_numpy(np.ascontiguousarray(found).reshape(found.shape))
