"""Read PLY meshes with an image or with colours of vertices."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.bare_mesh import BareMesh
from perfcap.errors import InputError
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.gltf_texture import Material, one_texture
from perfcap.io.mesh_images import MeshImages
from perfcap.io.vertex_colors import as_bytes, colors_to_texture

_LONGEST_HEAD = 1000  # lines
_LONGEST_LINE = 1000  # bytes


def read_ply(path: Path, notes: list[Finding]) -> BareMesh:
    """Triangles of a PLY file, in its order unless corners have texture coordinates of their own.

    The image is the one that a line ``comment TextureFile`` names, as MeshLab and others write.

    Args:
        path: the file.
        notes: where to say what is left out.

    Raises:
        InputError: it is damaged, has no faces, or names an image outside of its folder.
    """
    from trimesh.exchange.ply import load_ply
    from trimesh.geometry import triangulate_quads

    head = [*_head(path)]
    files = tuple(dict.fromkeys(name for line in head if (name := _image(line))))
    painted = len(files) == 1
    of_corners = any(line.startswith("property") and "texcoord" in line for line in head)
    try:
        with path.open("rb") as file:
            # without an image there is no reason to split vertices
            data = load_ply(file, skip_materials=True, fix_texture=painted and of_corners)
        # to numbers here, where lists in place of them are refused
        vertices, faces = np.asarray(data.get("vertices", ()), np.float64), data.get("faces", ())
        faces = triangulate_quads(faces) if len(faces) else np.zeros((0, 3), int)
        faces = np.asarray(faces, np.int64)
        count = len(vertices)
        uv = _numbers(getattr(data.get("visual"), "uv", None), count, (2,), "coordinates")
        shown = painted and uv is not None  # then colours are of vertices before they were split
        colors = None if shown else _numbers(data.get("vertex_colors"), count, (3, 4), "colours")
    except Exception as error:  # the parsers raise anything
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise InputError(f"{path}: cannot be read as PLY ({reason}); export it again") from error
    if not len(faces):
        raise InputError(f"{path}: has no faces; expected a mesh, not a cloud of points")
    if painted and uv is not None:
        uv = np.column_stack((uv[:, 0], 1 - uv[:, 1])).astype(np.float64)
        texture, (uv,) = one_texture(MeshImages(path, files), [Material(0)], [uv], notes, [faces])
        return BareMesh(vertices, faces, uv, texture, path.stem)
    if files:
        _warn(
            notes,
            f"names {len(files)} images, of which none is read"
            if uv is not None
            else "names an image, but has no texture coordinates",
        )
    if colors is not None:
        painting = colors_to_texture(as_bytes(colors, f"{path}: colours of vertices"))
        return BareMesh(vertices, faces, *painting, path.stem)
    if data.get("face_colors") is not None:
        _warn(notes, "has colours of faces, which are not read")
    return BareMesh(vertices, faces, name=path.stem)


def _numbers(values: object, count: int, widths: tuple[int, ...], what: str) -> NDArray[Any] | None:
    """A row of numbers a vertex, one of these widths; None where there are none."""
    if values is None:
        return None
    rows = np.asarray(values)
    if rows.dtype.kind not in "fiu" or rows.shape not in [(count, width) for width in widths]:
        raise ValueError(f"{what} are {rows.dtype} {rows.shape}")
    return rows


def _warn(notes: list[Finding], what: str) -> None:
    remedy = "export it as OBJ or GLB, or with colours of vertices"
    notes.append(Finding(Severity.WARNING, "materials", what, remedy))


def _head(path: Path) -> Iterator[str]:
    with path.open("rb") as file:
        for _ in range(_LONGEST_HEAD):
            line = file.readline(_LONGEST_LINE).decode("utf-8", "replace").strip()
            if line == "end_header":
                return
            yield line


def _image(line: str) -> str:
    kind, _, rest = line.partition(" ")
    word, _, name = rest.strip().partition(" ")
    return name.strip() if kind == "comment" and word.lower() == "texturefile" else ""
