"""Read Wavefront OBJ meshes with their materials."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.bare_mesh import BareMesh
from perfcap.errors import InputError
from perfcap.io.doctor.finding import Finding
from perfcap.io.gltf_texture import Floats, Material, one_texture
from perfcap.io.mesh_images import MeshImages
from perfcap.io.obj_material import ObjMaterial, read_materials
from perfcap.io.vertex_colors import as_bytes, colors_to_texture

_MAX_CORNERS = 64  # of a polygon

Corner = tuple[int, int, str]  # a place, a texture coordinate (-1: none), a material


@dataclass(eq=False)
class _Obj:
    """A file while it is read."""

    places: list[list[float]] = field(default_factory=list)
    colors: list[list[float]] = field(default_factory=list)
    coordinates: list[list[float]] = field(default_factory=list)
    faces: list[list[Corner]] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)

    def add_vertex(self, numbers: list[float]) -> None:
        """A place, and a colour where it is followed by one; a fourth number is a weight."""
        self.places.append(numbers[:3])
        if len(numbers) >= 6:
            self.colors.append(numbers[3:6])


def read_obj(path: Path, notes: list[Finding]) -> BareMesh:
    """Triangles of an OBJ file in the order of the file; a vertex for each texture coordinate.

    Colours of vertices, which some scanners write after their places, become a texture where no
    material has an image.

    Args:
        path: the file.
        notes: where to say what had to be done, or is missing.

    Raises:
        InputError: it is damaged, has no faces, or names files outside of its folder.
    """
    data = _parse(path)
    if not data.faces:
        raise InputError(f"{path}: has no faces; expected a mesh, not a cloud of points")
    names = list(dict.fromkeys(corner[2] for face in data.faces for corner in face))
    materials = read_materials(path, data.libraries, names, notes)
    # in the order of the file's vertices; copies at seams follow each other
    used = sorted(dict.fromkeys(corner for face in data.faces for corner in face), key=_place)
    number = {corner: index for index, corner in enumerate(used)}
    faces = np.array(
        [
            (number[face[0]], number[second], number[third])
            for face in data.faces
            for second, third in pairwise(face[1:])
        ]
    )
    places = np.array([place for place, _, _ in used])
    colors = _colors(path, data, places)
    images = any(materials[name].image for name in names if name in materials)
    uv, texture = None, None
    if images or colors is None:
        uv, texture = _painted(path, data, used, faces, materials, notes)
    if texture is None and colors is not None:
        uv, texture = colors_to_texture(colors)
    return BareMesh(np.array(data.places)[places], faces, uv, texture, path.stem)


def _colors(path: Path, data: _Obj, places: NDArray[np.int64]) -> NDArray[np.uint8] | None:
    """Colours (V, 3) of the vertices at these places; None of none, or of white alone."""
    if len(data.colors) != len(data.places):
        return None
    colors = as_bytes(np.array(data.colors)[places], f"{path}: colours of vertices")
    return None if np.all(colors == 255) else colors


def _place(corner: Corner) -> int:
    return corner[0]


def _parse(path: Path) -> _Obj:
    data, material = _Obj(), ""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, 1):
            kind, *words = line.split("#")[0].split() or [""]
            try:
                if kind == "v":
                    data.add_vertex([float(word) for word in words[:6]])
                elif kind == "vt":
                    data.coordinates.append([float(words[0]), 1 - float((*words, "0")[1])])
                elif kind == "f":
                    data.faces.append([_corner(data, word, material) for word in words])
                    if not 3 <= len(words) <= _MAX_CORNERS:
                        raise ValueError
                elif kind == "usemtl":
                    material = " ".join(words)
                elif kind == "mtllib":
                    data.libraries.append(line.split(maxsplit=1)[1].strip())
            except (ValueError, IndexError):
                raise InputError(
                    f"{path}: line {number} is {line.strip()!r:.60}, which is no part of an OBJ "
                    "mesh; export it again"
                ) from None
    if any(len(place) != 3 for place in data.places):
        raise InputError(f"{path}: has vertices of fewer than three numbers; export it again")
    return data


def _corner(data: _Obj, word: str, material: str) -> Corner:
    place, coordinate = (*word.split("/"), "")[:2]
    found = _index(place, len(data.places))
    return found, _index(coordinate, len(data.coordinates)) if coordinate else -1, material


def _index(word: str, count: int) -> int:
    """Index from a number that counts from one, or backwards from the end."""
    number = int(word)
    index = number - 1 if number > 0 else count + number
    if not 0 <= index < count:
        raise IndexError(word)
    return index


def _painted(
    path: Path,
    data: _Obj,
    corners: list[Corner],
    faces: NDArray[np.int64],
    materials: dict[str, ObjMaterial],
    notes: list[Finding],
) -> tuple[Floats | None, bytes | None]:
    """Texture coordinates of the corners and the image they are in."""
    # a part has one material, and coordinates of all its corners, or of none
    kinds = [(material, coordinate >= 0) for _, coordinate, material in corners]
    parts = list(dict.fromkeys(kinds))
    number_of = {kind: number for number, kind in enumerate(parts)}
    part_of = np.array([number_of[kind] for kind in kinds])
    known = [materials.get(name, ObjMaterial()) for name, _ in parts]
    files = tuple(dict.fromkeys(each.image for each in known if each.image))
    table = np.array([*data.coordinates, [0.0, 0.0]])
    coordinate = np.array([coordinate for _, coordinate, _ in corners])
    members = _grouped(part_of, len(parts))
    local = np.zeros(len(corners), np.int64)
    for inside in members:
        local[inside] = np.arange(len(inside))
    painted = [
        # programs write any Kd beside an image, and few multiply by it
        Material(files.index(each.image)) if each.image and has_uv else Material(None, each.color)
        for each, (_, has_uv) in zip(known, parts, strict=True)
    ]
    placed = [
        each.placed(table[coordinate[inside]]) if has_uv else None
        for each, inside, (_, has_uv) in zip(known, members, parts, strict=True)
    ]
    of_faces = part_of[faces]
    whole = faces[(of_faces == of_faces[:, :1]).all(1)]
    triangles = [local[whole[rows]] for rows in _grouped(part_of[whole[:, 0]], len(parts))]
    texture, moved = one_texture(MeshImages(path, files), painted, placed, notes, triangles)
    if all(uv is None for uv in moved):
        return None, None
    result = np.zeros((len(corners), 2))
    for inside, uv in zip(members, moved, strict=True):
        result[inside] = 0.0 if uv is None else uv
    return result, texture


def _grouped(numbers: NDArray[np.int64], count: int) -> list[NDArray[np.int64]]:
    """Rows that have each of so many numbers, in order."""
    ends = np.cumsum(np.bincount(numbers, minlength=count))
    return np.split(np.argsort(numbers, kind="stable"), ends[:-1])
