"""Materials of Wavefront OBJ meshes: colours, image files, and how images lie on the surface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.files import MEBIBYTE, is_file, require_file
from perfcap.io.mesh_images import beside
from perfcap.io.texture_tiles import ended

Floats = NDArray[np.float64]

_LIMIT = 4 * MEBIBYTE
# options of a map and how many words follow; those of up to three numbers end where no number is
_WORDS = {
    "-blendu": 1,
    "-blendv": 1,
    "-boost": 1,
    "-bm": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-mm": 2,
    "-texres": 1,
    "-type": 1,
}
_NUMBERS = ("-o", "-s", "-t")


@dataclass(frozen=True)
class ObjMaterial:
    """A material.

    Attributes:
        color: ``Kd``.
        image: file of ``map_Kd``.
        scale: of texture coordinates, ``-s``.
        offset: added to them then, ``-o``.
        clamped: whether the image ends at its edges rather than to repeat, ``-clamp on``.
    """

    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    image: str | None = None
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    clamped: bool = False

    def placed(self, uv: Floats) -> Floats:
        """Coordinates (v, 2) with the origin at the top left, in the image as it is."""
        moved = np.column_stack((uv[:, 0], 1 - uv[:, 1])) * self.scale + self.offset
        if self.clamped:
            moved = ended(moved)
        plain = self.scale == (1.0, 1.0) and self.offset == (0.0, 0.0) and not self.clamped
        return uv if plain else np.column_stack((moved[:, 0], 1 - moved[:, 1]))


def read_materials(
    path: Path, libraries: Sequence[str], used: Sequence[str], notes: list[Finding]
) -> dict[str, ObjMaterial]:
    """Materials of the libraries of a mesh file, by name.

    Args:
        path: of the mesh.
        libraries: what its ``mtllib`` lines name.
        used: names of the materials that its faces have.
        notes: where to say what is missing.

    Raises:
        InputError: a library is outside of the mesh's folder, or too large.
    """
    found: dict[str, ObjMaterial] = {}
    for library in libraries:
        # names may hold spaces; else a line may name several files
        whole = beside(path, library, "material library")
        words = (beside(path, word, "material library") for word in library.split())
        for target in (whole,) if is_file(whole) else words:
            if not is_file(target):
                what = f"has no colours of it: {target.name!r:.80} is not beside the mesh"
                remedy = "copy it there with its images"
                notes.append(Finding(Severity.WARNING, "materials", what, remedy))
                continue
            require_file(target, _LIMIT, "a material library")
            found |= dict(_library(target))
    missing = sorted(name for name in used if name and name not in found)
    if found and missing:
        what = f"{', '.join(missing[:3])!r:.80} are in no material library and stay white"
        notes.append(Finding(Severity.WARNING, "materials", what, "export the mesh again"))
    return found


def _library(path: Path) -> Iterator[tuple[str, ObjMaterial]]:
    name, material = "", ObjMaterial()
    for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines():
        kind, *words = line.split() or [""]
        kind = kind.lower()
        rest = line.split(maxsplit=1)[1].strip() if words else ""
        if kind == "newmtl":
            if name:
                yield name, material
            name, material = " ".join(words), ObjMaterial()
        elif kind == "kd":
            material = replace(material, color=_color(words))
        elif kind == "map_kd" and words:
            material = _mapped(material, rest)
    if name:
        yield name, material


def _color(words: Sequence[str]) -> tuple[float, float, float]:
    values = _leading_numbers(words)
    # one number is a grey; a spectrum is none that is read
    red, green, blue = (values * 3)[:3] or ObjMaterial.color
    return red, green, blue


def _mapped(material: ObjMaterial, rest: str) -> ObjMaterial:
    """A material with what a ``map_Kd`` says: options, then a name that may hold spaces."""
    while rest.startswith("-"):
        option, *words = rest.split()
        if option not in _NUMBERS and option not in _WORDS:  # the name is the last word then
            return replace(material, image=words[-1] if words else None)
        values = _leading_numbers(words)
        count = len(values) if option in _NUMBERS else _WORDS[option]
        if option == "-s" and values:
            material = replace(material, scale=_pair(values, 1.0))
        elif option == "-o" and values:
            material = replace(material, offset=_pair(values, 0.0))
        elif option == "-clamp":
            material = replace(material, clamped=words[:1] == ["on"])
        rest = (*rest.split(maxsplit=count + 1), "")[count + 1] if len(words) > count else ""
    return replace(material, image=rest.strip() or None)


def _leading_numbers(words: Sequence[str]) -> list[float]:
    """Numbers, at most three, that a list of words begins with."""
    values: list[float] = []
    for word in words[:3]:
        try:
            values.append(float(word))
        except ValueError:
            break
    return values if np.isfinite(values).all() else []


def _pair(values: Sequence[float], default: float) -> tuple[float, float]:
    return values[0], values[1] if len(values) > 1 else default
