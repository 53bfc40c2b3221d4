"""The surface as a mesh a frame: sequences of OBJ or PLY files, with the texture beside them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from perfcap.actor.template import Template
from perfcap.io.atomic import writing
from perfcap.io.export.options import Options
from perfcap.io.export.recording import Recording

# --- Shading normals of a surface in motion -------------------------------------------------------

Floats = NDArray[np.float64]


class SeamlessNormals:
    """Unit normals weighted by area, the same on both sides of a texture seam."""

    def __init__(self, template: Template) -> None:
        self._faces = template.faces
        self._weld, representative = template.weld()
        corners = self._weld[template.faces].ravel()
        triangles = np.repeat(np.arange(len(template.faces)), 3)
        shape = (len(representative), len(template.faces))
        self._around = csr_array((np.ones(len(corners)), (corners, triangles)), shape=shape)

    def __call__(self, vertices: NDArray[Any]) -> Floats:
        """Normals (V, 3) of vertices (V, 3); +y where a vertex has no area around it."""
        corners = vertices.astype(np.float64)[self._faces]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        total = self._around @ area
        length = np.linalg.norm(total, axis=1, keepdims=True)
        normals: Floats = np.where(length > 0, total / np.where(length > 0, length, 1), (0, 1, 0))
        return normals[self._weld]


# --------------------------------------------------------------------------------------------------
# The surface as a mesh a frame: sequences of OBJ or PLY files, with the texture beside them.

_MATERIAL = "actor.mtl"  # no blanks: readers of OBJ split names there
_DECIMALS = 6  # of a metre in OBJ, fewer in smaller units


def write_obj(folder: Path, recording: Recording, options: Options) -> None:
    """``NAME_obj/NAME_%06d.obj``, numbered as in the video, with a material and a texture."""
    inside = _make(folder / f"{recording.name}_obj")
    template = recording.template
    texture = write_texture(inside, template)
    with writing(inside / _MATERIAL) as file:
        file.write(_material(texture).encode())
    digits = max(0, _DECIMALS - round(np.log10(options.per_metre)))
    place = f"v %.{digits}f %.{digits}f %.{digits}f\n" * len(template.vertices)
    normal = "vn %.4f %.4f %.4f\n" * len(template.vertices)
    head, tail = f"mtllib {_MATERIAL}\n", _coordinates(template) + _triangles(template)
    for path, vertices, normals in _frames(inside, ".obj", recording, options):
        text = place % tuple(vertices.ravel().tolist()) + normal % tuple(normals.ravel().tolist())
        with writing(path) as file:
            file.write((head + text + tail).encode())


def write_ply(folder: Path, recording: Recording, options: Options) -> None:
    """``NAME_ply/NAME_%06d.ply``, binary, with normals and texture coordinates."""
    inside = _make(folder / f"{recording.name}_ply")
    template = recording.template
    texture = write_texture(inside, template)
    columns = ["x", "y", "z", "nx", "ny", "nz"] + (["s", "t"] if template.uv is not None else [])
    head = ["ply", "format binary_little_endian 1.0"]
    head += [f"comment TextureFile {texture}"] if texture else []
    head += [f"element vertex {len(template.vertices)}", *(f"property float {c}" for c in columns)]
    head += [f"element face {len(template.faces)}", "property list uchar int vertex_indices"]
    start = ("\n".join([*head, "end_header"]) + "\n").encode()
    faces = np.empty(len(template.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, template.faces
    flat = [] if template.uv is None else [_from_below(template.uv)]
    for path, vertices, normals in _frames(inside, ".ply", recording, options):
        rows = np.concatenate([vertices, normals, *flat], axis=1).astype("<f4")
        with writing(path) as file:
            file.write(start + rows.tobytes() + faces.tobytes())


def write_texture(folder: Path, template: Template, name: str = "texture") -> str | None:
    """Write the texture as it is; returns its name, None where there is none."""
    if template.texture is None or template.uv is None:
        return None
    name += ".jpg" if template.texture_mime == "image/jpeg" else ".png"
    with writing(folder / name) as file:
        file.write(template.texture)
    return name


def _make(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _frames(
    folder: Path, suffix: str, recording: Recording, options: Options
) -> Iterator[tuple[Path, Floats, Floats]]:
    """File, vertices and normals of each frame."""
    normals = SeamlessNormals(recording.template)
    numbers = iter(recording.numbers.tolist())
    for block in recording.blocks():
        for vertices in block.astype(np.float64) * options.per_metre:
            path = folder / f"{recording.name}_{next(numbers):06d}{suffix}"
            yield path, vertices, normals(vertices)


def _from_below(uv: Floats) -> Floats:
    """Texture coordinates with the origin at the bottom left."""
    return uv * (1.0, -1.0) + (0.0, 1.0)


def _coordinates(template: Template) -> str:
    if template.uv is None:
        return ""
    return "vt %.6f %.6f\n" * len(template.uv) % tuple(_from_below(template.uv).ravel().tolist())


def _triangles(template: Template) -> str:
    corner = "%d//%d" if template.uv is None else "%d/%d/%d"
    line = f"f {corner} {corner} {corner}\n"
    repeat = 2 if template.uv is None else 3
    indices = np.repeat(template.faces.ravel() + 1, repeat)
    return "usemtl actor\ns 1\n" + line * len(template.faces) % tuple(indices.tolist())


def _material(texture: str | None) -> str:
    lines = ["newmtl actor", "Ka 0 0 0", "Kd 0.7 0.7 0.7", "Ks 0 0 0", "d 1", "illum 1"]
    if texture:
        lines[2] = "Kd 1 1 1"
        lines.append(f"map_Kd {texture}")
    return "\n".join(lines) + "\n"
