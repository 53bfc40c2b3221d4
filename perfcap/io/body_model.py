"""Body models from files: ``body.npz`` beside a texture, or safetensors."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.body_model import ARRAYS, BodyModel
from perfcap.errors import InputError
from perfcap.io.actor import models_folder
from perfcap.io.archive import read_archive
from perfcap.io.files import MEBIBYTE, require_file

DEFAULT_BODY = "ada"
_FILE, _TEXTURE = "body.npz", "texture.jpg"
_WHAT = "a body model (.npz or .safetensors)"
_LIMIT, _HEADER_LIMIT, _TEXTURE_LIMIT = 1024 * MEBIBYTE, 4 * MEBIBYTE, 64 * MEBIBYTE
_DTYPES = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "I64": "<i8", "I32": "<i4", "U16": "<u2"}
_SHORTEST, _LONGEST = 0.3, 3.0  # m, of people
_TEXTS = ("bone_names", "landmark_names")


def load_body_model(name: str | Path = DEFAULT_BODY) -> BodyModel:
    """A shipped body model by name, a file, or a folder that holds ``body.npz``; in float64.

    The arrays are those of ``perfcap.actor.body_model``. In safetensors, which hold numbers only,
    texts are entries of the metadata, lists of them as JSON.

    Raises:
        InputError: there is no such model, or it cannot be used.
    """
    path, *pictures = body_model_files(name)
    is_tensors = path.suffix == ".safetensors"
    arrays = _read_safetensors(path) if is_tensors else read_archive(path, ARRAYS, _WHAT)
    texture = None
    for picture in pictures:
        require_file(picture, _TEXTURE_LIMIT, "a texture")
        texture = picture.read_bytes()
    label = path.parent.name if path.name == _FILE else path.stem
    model = BodyModel.from_arrays(arrays, label, texture)
    places = model.surface.mean
    long = float((places.amax(0) - places.amin(0)).max())
    if not _SHORTEST <= long <= _LONGEST:
        raise InputError(
            f"{path}: its mean body is {long:.3g} long; expected a person in metres, scale "
            "vertices, bones and their bases alike"
        )
    return model


def body_model_files(name: str | Path) -> tuple[Path, ...]:
    """The files that make a body model: its arrays, and its texture if it has one.

    Raises:
        InputError: there is no such model.
    """
    path = _find(name)
    picture = path.parent / _TEXTURE
    return (path, picture) if path.name == _FILE and picture.exists() else (path,)


def _find(name: str | Path) -> Path:
    path = Path(name)
    if path.is_file():
        return path
    bodies = models_folder() / "bodies"
    folder = path if path.is_dir() else bodies / path.name
    if not (folder / _FILE).is_file():
        known = ", ".join(sorted(p.parent.name for p in bodies.glob(f"*/{_FILE}"))) or "none"
        raise InputError(
            f"{name}: no such file, folder with {_FILE}, or shipped body model ({known}); "
            f"expected {_WHAT}"
        )
    return folder / _FILE


def _read_safetensors(path: Path) -> dict[str, NDArray[Any]]:
    require_file(path, _LIMIT, _WHAT)
    data = path.read_bytes()
    try:
        (size,) = struct.unpack_from("<Q", data)
        if size > _HEADER_LIMIT:
            raise ValueError(f"its header has {size} bytes")
        header = json.loads(data[8 : 8 + size])
        texts = header.pop("__metadata__", {})
        body = memoryview(data)[8 + size :]
        arrays = {key: _tensor(body, header[key]) for key in ARRAYS if key in header}
        return {**arrays, **_texts(texts)}
    except (ValueError, KeyError, TypeError, AttributeError, struct.error, RecursionError) as error:
        raise InputError(
            f"{path}: cannot be read as safetensors ({error}); write it again"
        ) from error


def _tensor(body: memoryview, entry: Mapping[str, Any]) -> NDArray[Any]:
    start, stop = entry["data_offsets"]
    if not 0 <= start <= stop <= len(body):
        raise ValueError(f"a tensor lies at bytes {start} to {stop} of {len(body)}")
    return np.frombuffer(body[start:stop], _DTYPES[entry["dtype"]]).reshape(entry["shape"])


def _texts(metadata: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    """Texts of the metadata as arrays."""
    found: dict[str, NDArray[Any]] = {}
    for key in ("name", "licence", "source", *_TEXTS):
        if key in metadata:
            value = json.loads(metadata[key]) if key in _TEXTS else str(metadata[key])
            found[key] = np.array(value, dtype=np.str_)
    return found
