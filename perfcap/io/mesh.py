"""Read meshes without bones: OBJ, PLY, STL, and glTF without a skin."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from perfcap.actor.bare_mesh import BareMesh
from perfcap.errors import InputError
from perfcap.geometry.surface_topology import surface_topology
from perfcap.io.doctor.finding import Finding
from perfcap.io.files import MEBIBYTE, require_file
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_part import joined, joined_uv, read_unskinned
from perfcap.io.gltf_scene import read_tree
from perfcap.io.gltf_texture import Floats, Material, one_texture
from perfcap.io.vertex_colors import colors_to_texture

# --- Read Wavefront OBJ meshes with their materials -----------------------------------------------

_IMAGE_LIMIT = 256 * MEBIBYTE
_MAX_CORNERS = 64  # of a polygon


@dataclass(eq=False)
class _Obj:
    """A file while it is read: a corner is a place, a texture coordinate (-1: none), a material."""

    places: list[list[float]] = field(default_factory=list)
    coordinates: list[list[float]] = field(default_factory=list)
    faces: list[list[tuple[int, int, str]]] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Images:
    """Image files beside an OBJ file."""

    path: Path
    files: tuple[str, ...]

    def error(self, message: str) -> InputError:
        """An `InputError` that names the OBJ file."""
        return InputError(f"{self.path}: {message}")

    def image(self, index: object) -> bytes:
        """Encoded bytes of an image."""
        name = self.files[int(str(index))]
        target = _beside(self.path, name, "texture")
        require_file(target, _IMAGE_LIMIT, f"the texture of {self.path.name}")
        return target.read_bytes()


def read_obj(path: Path) -> BareMesh:
    """Triangles of an OBJ file in the order of the file; a vertex for each texture coordinate.

    Raises:
        InputError: it is damaged, has no faces, or names files outside of its folder.
    """
    data = _parse(path)
    if not data.faces:
        raise InputError(f"{path}: has no faces; expected a mesh, not a cloud of points")
    materials = _materials(path, data.libraries)
    # in the order of the file's vertices; copies at seams follow each other
    used = sorted(dict.fromkeys(corner for face in data.faces for corner in face), key=_place)
    number = {corner: index for index, corner in enumerate(used)}
    faces = [
        (number[face[0]], number[second], number[third])
        for face in data.faces
        for second, third in pairwise(face[1:])
    ]
    uv, texture = _painted(path, data, used, materials)
    vertices = np.array([data.places[place] for place, _, _ in used])
    return BareMesh(vertices, np.array(faces), uv, texture, path.stem)


def _place(corner: tuple[int, int, str]) -> int:
    return corner[0]


def _parse(path: Path) -> _Obj:
    data, material = _Obj(), ""
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            kind, *words = line.split("#")[0].split() or [""]
            try:
                if kind == "v":
                    data.places.append([float(word) for word in words[:3]])
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


def _corner(data: _Obj, word: str, material: str) -> tuple[int, int, str]:
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


def _materials(path: Path, libraries: list[str]) -> dict[str, tuple[Floats, str | None]]:
    """Colour and image file by name of the material; libraries that are missing are left out."""
    found: dict[str, tuple[Floats, str | None]] = {}
    for library in libraries:
        target = _beside(path, library, "material library")
        if target.is_file():
            require_file(target, 4 * MEBIBYTE, "a material library")
            found |= dict(_read_library(target))
    return found


def _read_library(path: Path) -> Iterator[tuple[str, tuple[Floats, str | None]]]:
    name, color, image = "", np.ones(3), None
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        kind, *words = line.split() or [""]
        if kind == "newmtl":
            if name:
                yield name, (color, image)
            name, color, image = " ".join(words), np.ones(3), None
        elif kind == "Kd":
            try:
                color = np.array([float(word) for word in words[:3]])
            except ValueError:
                color = np.ones(3)
        elif kind == "map_Kd" and words:
            # options such as `-s 1 1 1` come before the name, which may hold spaces
            image = words[-1] if words[0].startswith("-") else line.split(maxsplit=1)[1].strip()
    if name:
        yield name, (color, image)


def _painted(
    path: Path,
    data: _Obj,
    corners: list[tuple[int, int, str]],
    materials: dict[str, tuple[Floats, str | None]],
) -> tuple[Floats | None, bytes | None]:
    """Texture coordinates of the corners and the image they are in."""
    names = list(dict.fromkeys(material for _, _, material in corners))
    files = tuple(dict.fromkeys(file for n in names if (file := materials.get(n, (0, None))[1])))
    kinds, coordinates, members = [], [], []
    of_corner = np.array([names.index(material) for _, _, material in corners])
    table = np.array([*data.coordinates, [0.0, 0.0]])
    used = np.array([coordinate for _, coordinate, _ in corners])
    for number, name in enumerate(names):
        color, file = materials.get(name, (np.ones(3), None))
        inside = np.flatnonzero(of_corner == number)
        has_uv = bool(np.all(used[inside] >= 0))
        members.append(inside)
        triple = (float(color[0]), float(color[-2]), float(color[-1]))
        # programs write any Kd beside an image, and few multiply by it
        kinds.append(Material(files.index(file)) if file and has_uv else Material(None, triple))
        coordinates.append(table[used[inside]] if has_uv else None)
    notes: list[Finding] = []
    texture, moved = one_texture(_Images(path, files), kinds, coordinates, notes)
    if all(uv is None for uv in moved):
        return None, None
    result = np.zeros((len(corners), 2))
    for inside, uv in zip(members, moved, strict=True):
        result[inside] = 0.0 if uv is None else uv
    return result, texture


def _beside(path: Path, name: str, what: str) -> Path:
    """A file in the folder of another one, or below."""
    folder = path.parent.resolve()
    try:
        target = (folder / name.replace("\\", "/")).resolve()
    except (OSError, ValueError):
        raise InputError(f"{path}: {what} has the unusable path {name!r:.80}") from None
    if not target.is_relative_to(folder):
        raise InputError(
            f"{path}: {what} {name!r:.80} is outside its folder and is not opened; "
            "copy it beside the mesh"
        )
    return target


# --- Read meshes without bones: OBJ, PLY, STL, and glTF without a skin ----------------------------

FORMATS = (".obj", ".ply", ".stl", ".glb", ".gltf")
LIMIT = 1024 * MEBIBYTE
_MAX_VERTICES = 4_000_000


def read_mesh(path: str | Path) -> BareMesh:
    """Read a mesh in its own units and axes; vertices keep the order of the file.

    Colours of vertices of a PLY, and of a glTF without an image, become a texture. Vertices of an
    STL, which repeats them for every triangle, are merged where they are equal.

    Raises:
        InputError: missing, empty, damaged or oversized file, another format, no triangles, or a
            texture outside of the file's folder.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise InputError(f"{path}: is no mesh that is read; expected {', '.join(FORMATS)}")
    require_file(path, LIMIT, "a mesh")
    if kind == ".obj":
        mesh = read_obj(path)
    elif kind in (".glb", ".gltf"):
        mesh = _read_gltf(path)
    else:
        mesh = _read_with_trimesh(path, kind)
    if len(mesh.vertices) > _MAX_VERTICES:
        raise InputError(
            f"{path}: has {len(mesh.vertices)} vertices, at most {_MAX_VERTICES} are read; "
            "decimate it"
        )
    return mesh


def _read_gltf(path: Path) -> BareMesh:
    document = open_document(path)
    notes: list[Finding] = []
    parts = read_unskinned(document, read_tree(document))
    if not parts:
        raise document.error("has no mesh")
    texture, coordinates = one_texture(
        document,
        [part.material for part in parts],
        [part.uv for part in parts],
        notes,
        [part.faces for part in parts],
    )
    vertices, faces = joined(parts)
    return BareMesh(vertices, faces, joined_uv(parts, coordinates), texture, path.stem)


def _read_with_trimesh(path: Path, kind: str) -> BareMesh:
    import trimesh

    try:
        # processing would merge and reorder vertices
        mesh = trimesh.load_mesh(path, file_type=kind[1:], process=False)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(getattr(mesh, "faces", ()))
    except Exception as error:  # the parsers raise anything
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise InputError(
            f"{path}: cannot be read as {kind[1:].upper()} ({reason}); export it again"
        ) from error
    if not len(faces):
        raise InputError(f"{path}: has no faces; expected a mesh, not a cloud of points")
    if kind == ".stl":
        topology = surface_topology(vertices, faces)
        vertices, faces = vertices[topology.representative], topology.place[faces]
        return BareMesh(vertices, faces, name=path.stem)
    if getattr(mesh.visual, "kind", None) == "vertex":
        colors = np.asarray(mesh.visual.vertex_colors)[:, :3]
        return BareMesh(vertices, faces, *colors_to_texture(colors), path.stem)
    return BareMesh(vertices, faces, name=path.stem)
