"""EasyMocap's pair of OpenCV-YAML files, ``intri.yml`` and ``extri.yml``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from perfcap.errors import InputError
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.spelling import lens_of, size_of
from perfcap.io.calibration.toml_file import rotation_matrix
from perfcap.io.calibration.view import Array, View, make_view, to_numbers
from perfcap.io.files import MEBIBYTE, read_text

INTRINSICS, EXTRINSICS = "intri.yml", "extri.yml"
_APART = 2e-3  # of a rotation's entries, which have few digits in some files
LIMIT = 4 * MEBIBYTE  # thousands of cameras


def read_easymocap(path: Path, default_sizes: Sequence[tuple[int, int]] | None = None) -> CameraRig:
    """Read both files, given either of them or their folder.

    ``K_<name>``, ``dist_<name>``, ``H_<name>``, ``W_<name>`` in the first; ``Rot_<name>`` (matrix)
    or ``R_<name>`` (rotation vector) and ``T_<name>`` in the second. OpenCV's conventions.
    """
    folder = path if path.is_dir() else path.parent
    intrinsics = _read_opencv_yaml(folder / INTRINSICS)
    extrinsics = _read_opencv_yaml(folder / EXTRINSICS)
    names = extrinsics.get("names", intrinsics.get("names"))
    if not isinstance(names, list) or not all(isinstance(n, str | int) for n in names):
        raise InputError(f"{folder / EXTRINSICS}: has no list 'names' of cameras")
    views = [_view(folder, str(name), intrinsics, extrinsics) for name in names]
    return make_rig(str(folder), views, default_sizes=default_sizes)


def _view(folder: Path, name: str, inner: Mapping[str, Any], outer: Mapping[str, Any]) -> View:
    where = f"{folder}: camera {name}"
    stated = _stated(name, inner, outer)
    turns = (rotation_matrix(where, outer.get(key)) for key in (f"Rot_{name}", f"R_{name}"))
    rotations = [each for each in turns if each is not None]
    _require_same(where, name, rotations)
    translation = outer.get(f"T_{name}")
    return make_view(
        where,
        name,
        intrinsics=inner.get(f"K_{name}"),
        rotation=rotations[0] if rotations else None,
        translation=None if translation is None else _vector(where, translation),
        distortion=lens_of(where, stated),
        size=size_of(stated),
    )


def _stated(name: str, inner: Mapping[str, Any], outer: Mapping[str, Any]) -> dict[str, Any]:
    """What both files say of a camera, without its name; they call the lens D where not dist."""
    ending, names = f"_{name}", {"H": "height", "W": "width", "D": "dist"}
    both = {str(key): value for key, value in (*outer.items(), *inner.items())}
    found = {key.removesuffix(ending): both[key] for key in both if key.endswith(ending)}
    return {names.get(key, key): found[key] for key in found if key != "D" or "dist" not in found}


def _require_same(where: str, name: str, rotations: Sequence[Array]) -> None:
    """Refuse a matrix and a vector that are not of one rotation: one of them is out of date."""
    for other in rotations[1:]:
        if rotations[0].shape == other.shape and not np.allclose(rotations[0], other, atol=_APART):
            off = float(np.abs(rotations[0] - other).max())
            raise InputError(
                f"{where}: Rot_{name} and R_{name} differ by up to {off:.2g}; expected the matrix "
                "of the rotation vector: leave out the one that is out of date"
            )


def _vector(where: str, value: Any) -> Array:
    return to_numbers(where, "translation T", value).reshape(-1)


class _OpenCVLoader(yaml.SafeLoader):  # type: ignore[misc]
    """Plain YAML values and ``!!opencv-matrix``, nothing that could build an object.

    Aliases, which OpenCV never writes, are refused: nested ones unfold to any size.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        """The next node of the document."""
        if self.check_event(yaml.events.AliasEvent):
            raise yaml.composer.ComposerError(None, None, "OpenCV YAML has no aliases")
        return super().compose_node(parent, index)


def _matrix(loader: _OpenCVLoader, node: yaml.Node) -> Array:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.constructor.ConstructorError(None, None, "opencv-matrix is no mapping")
    fields = loader.construct_mapping(node, deep=True)
    rows, columns, data = (fields.get(key) for key in ("rows", "cols", "data"))
    numbers = to_numbers("opencv-matrix", "data", data)
    if not isinstance(rows, int) or not isinstance(columns, int) or numbers.size != rows * columns:
        raise yaml.constructor.ConstructorError(
            None, None, f"opencv-matrix of {rows} x {columns} has {numbers.size} numbers"
        )
    return numbers.reshape(rows, columns)


_OpenCVLoader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def _read_opencv_yaml(path: Path) -> Mapping[str, Any]:
    # OpenCV's first line, %YAML:1.0, is not YAML
    what = f"EasyMocap's {INTRINSICS} and {EXTRINSICS} beside each other"
    text = read_text(path, what, LIMIT)
    body = "\n".join(line for line in text.splitlines() if not line.startswith("%YAML"))
    try:
        data = yaml.load(body, Loader=_OpenCVLoader)
    except (yaml.YAMLError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: is not OpenCV YAML ({reason})") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: holds no entries; expected K_<name>, R_<name>, T_<name>")
    return data
