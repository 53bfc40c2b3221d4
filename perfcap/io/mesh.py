"""Read meshes without bones: OBJ, PLY, STL, and glTF without a skin."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from perfcap.actor.bare_mesh import BareMesh
from perfcap.errors import InputError
from perfcap.geometry.surface_topology import surface_topology
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.files import MEBIBYTE, require_file
from perfcap.io.gltf_alpha import see_through
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_part import joined, joined_uv, read_unskinned
from perfcap.io.gltf_scene import read_tree
from perfcap.io.gltf_texture import one_texture
from perfcap.io.obj_mesh import read_obj
from perfcap.io.ply_mesh import read_ply

FORMATS = (".obj", ".ply", ".stl", ".glb", ".gltf")
LIMIT = 1024 * MEBIBYTE
_MAX_VERTICES = 4_000_000

_LOG = logging.getLogger(__name__)


def read_mesh(path: str | Path) -> BareMesh:
    """Read a mesh in its own units and axes; vertices keep the order of the file.

    Colours of vertices become a texture where there is no image. Vertices of an STL, which repeats
    them for every triangle, are merged where they are equal. What is missing or left out of
    materials is logged as a warning.

    Raises:
        InputError: missing, empty, damaged or oversized file, another format, no triangles, or a
            texture outside of the file's folder.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise InputError(f"{path}: is no mesh that is read; expected {', '.join(FORMATS)}")
    require_file(path, LIMIT, "a mesh")
    notes: list[Finding] = []
    if kind == ".obj":
        mesh = read_obj(path, notes)
    elif kind == ".ply":
        mesh = read_ply(path, notes)
    elif kind == ".stl":
        mesh = _read_stl(path)
    else:
        mesh = _read_gltf(path, notes)
    for finding in notes:
        if finding.severity is not Severity.INFO:
            _LOG.warning("%s: %s", path, finding)
    if len(mesh.vertices) > _MAX_VERTICES:
        raise InputError(
            f"{path}: has {len(mesh.vertices)} vertices, at most {_MAX_VERTICES} are read; "
            "decimate it"
        )
    return mesh


def _read_gltf(path: Path, notes: list[Finding]) -> BareMesh:
    document = open_document(path)
    parts = read_unskinned(document, read_tree(document), notes)
    if not parts:
        raise document.error("has no mesh")
    notes += see_through(document, parts, metres=False)
    texture, coordinates = one_texture(
        document,
        [part.material for part in parts],
        [part.uv for part in parts],
        notes,
        [part.faces for part in parts],
    )
    vertices, faces = joined(parts)
    names = tuple((part.name, len(part.vertices)) for part in parts)
    return BareMesh(vertices, faces, joined_uv(parts, coordinates), texture, path.stem, names)


def _read_stl(path: Path) -> BareMesh:
    import trimesh

    try:
        # processing would merge and reorder vertices
        mesh = trimesh.load_mesh(path, file_type="stl", process=False)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(getattr(mesh, "faces", ()))
    except Exception as error:  # the parsers raise anything
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise InputError(f"{path}: cannot be read as STL ({reason}); export it again") from error
    if not len(faces):
        raise InputError(f"{path}: has no faces; expected a mesh, not a cloud of points")
    topology = surface_topology(vertices, faces)
    vertices, faces = vertices[topology.representative], topology.place[faces]
    return BareMesh(vertices, faces, name=path.stem)
