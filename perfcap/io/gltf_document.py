"""glTF 2.0 containers, accessors and images, read as untrusted data.

Every index, offset and count is checked against what is really there before it is used; a bad
file ends in one `InputError`. Nothing is fetched: buffers are the GLB's own, data URIs, or files
in the same folder.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError

Object = dict[str, Any]

MAX_BYTES = 1 << 30
_MAX_TREE_BYTES = 64 << 20
_MAX_ITEMS = 200_000  # nodes, accessors, ...

_MAGIC, _JSON_CHUNK, _BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
_COMPONENTS: dict[int, type[np.generic]] = {
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_BY_BLENDER = {".fbx": "FBX", ".dae": "Collada", ".blend": "a file of Blender"}
_UNDERSTOOD = ("KHR_mesh_quantization", "KHR_texture_transform", "KHR_lights_punctual")


def require_readable_kind(path: Path) -> None:
    """Refuse characters in formats that Blender turns into glTF, and say so.

    Raises:
        InputError: the name ends like one of them.
    """
    kind = _BY_BLENDER.get(path.suffix.lower())
    if kind:
        raise InputError(
            f"{path}: is {kind}, which perfcap does not read; open it in Blender and take File > "
            "Export > glTF 2.0 for a .glb"
        )


@dataclass(frozen=True, eq=False)
class Document:
    """The JSON tree of a glTF file and its loaded buffers."""

    path: Path
    tree: Object
    buffers: tuple[bytes, ...]

    def error(self, message: str) -> InputError:
        """An `InputError` that names this file."""
        return InputError(f"{self.path}: {message}")

    def items(self, kind: str) -> list[Object]:
        """All objects of a top-level array such as ``nodes``; empty when absent."""
        return objects(self.path, self.tree, kind)

    def item(self, kind: str, index: object) -> Object:
        """One object of a top-level array by an index found in the file."""
        items = self.items(kind)
        return items[self.integer(index, f"index into {kind}", high=len(items) - 1)]

    def integer(self, value: object, what: str, low: int = 0, high: int = MAX_BYTES) -> int:
        """An integer found in the file, within bounds."""
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            found = json.dumps(value)[:40]
            raise self.error(f"damaged file, {what} is {found}; expected {low} to {high}")
        return value

    def numbers(self, value: object, count: int, what: str) -> NDArray[np.float64]:
        """A list of finite numbers found in the file, (count,)."""
        is_list = isinstance(value, list) and len(value) == count
        if not is_list or not all(type(entry) in (int, float) for entry in value):  # type: ignore[attr-defined]
            raise self.error(f"damaged file, {what} is not a list of {count} numbers")
        try:
            array = np.array(value, dtype=np.float64)
        except OverflowError:  # an integer of hundreds of digits
            array = np.full(count, np.inf)
        if not np.isfinite(array).all():
            raise self.error(f"damaged file, {what} holds NaN or infinity")
        return array

    def view(self, index: object) -> tuple[memoryview, int]:
        """Bytes of a buffer view and its stride, 0 when tightly packed."""
        view = self.item("bufferViews", index)
        extensions = view.get("extensions")
        if isinstance(extensions, dict) and "EXT_meshopt_compression" in extensions:
            raise self.error("uses EXT_meshopt_compression; export it again without compression")
        number = self.integer(view.get("buffer"), "bufferView.buffer", 0, len(self.buffers) - 1)
        data = self.buffers[number]
        start = self.integer(view.get("byteOffset", 0), "bufferView.byteOffset", 0, len(data))
        size = self.integer(view.get("byteLength"), "bufferView.byteLength", 1, len(data) - start)
        stride = self.integer(view.get("byteStride", 0), "bufferView.byteStride", 0, 252)
        return memoryview(data)[start : start + size], stride

    def accessor(self, index: object, kind: str) -> NDArray[Any]:
        """Values of an accessor of a type such as ``VEC3``, (count, width).

        Normalised integers come back as float64 in [0, 1] or [-1, 1], others in their own type.
        """
        accessor = self.item("accessors", index)
        what = f"accessor {index}"
        if "sparse" in accessor:
            raise self.error(f"{what} is sparse, which is not read; export without sparse data")
        return self.values(accessor, kind, what)

    def values(self, accessor: Object, kind: str, what: str) -> NDArray[Any]:
        """Like ``accessor``, of one that has been looked up; sparse changes are not heeded."""
        if accessor.get("type") != kind:
            raise self.error(f"{what} has type {accessor.get('type')!r}; expected {kind}")
        if "bufferView" not in accessor:
            raise self.error(f"{what} has no data; export it again without mesh compression")
        code = self.integer(accessor.get("componentType"), f"{what} componentType", 5120, 5126)
        if code not in _COMPONENTS:
            raise self.error(f"damaged file, {what} has unknown componentType {code}")
        raw = self._strided(accessor, np.dtype(_COMPONENTS[code]).newbyteorder("<"), what)
        return _normalized(raw) if accessor.get("normalized") is True else raw

    def _strided(self, accessor: Object, dtype: np.dtype[Any], what: str) -> NDArray[Any]:
        width = _WIDTHS[accessor["type"]]
        count = self.integer(accessor.get("count"), f"{what} count", 1)
        data, stride = self.view(accessor["bufferView"])
        stride = stride or width * dtype.itemsize
        start = self.integer(accessor.get("byteOffset", 0), f"{what} byteOffset")
        end = start + (count - 1) * stride + width * dtype.itemsize
        if end > len(data):
            raise self.error(
                f"{what} needs {end} bytes of a buffer view of {len(data)}; the file is damaged"
            )
        array: NDArray[Any] = np.ndarray(
            (count, width), dtype, data, offset=start, strides=(stride, dtype.itemsize)
        )
        return array.astype(dtype.newbyteorder("="))  # an own copy: aligned, the buffer may go

    def image(self, index: object) -> bytes:
        """Encoded bytes of an image."""
        image = self.item("images", index)
        if "bufferView" in image:
            return bytes(self.view(image["bufferView"])[0])
        return _resolve(self.path, image.get("uri"), "image")


def open_document(path: Path) -> Document:
    """Read a ``.glb`` or ``.gltf`` with its buffers.

    Raises:
        InputError: missing, empty, truncated, oversized or foreign file, or one that requires an
            extension we do not read.
    """
    data = _read_bounded(path)
    text, binary = _split_binary(path, data) if data[:4] == b"glTF" else (data, None)
    tree = _parse(path, text)
    asset = tree.get("asset")
    version = asset.get("version") if isinstance(asset, dict) else None
    if not isinstance(version, str) or not version.startswith("2."):
        raise InputError(f"{path}: glTF version {version!r:.20}; only 2.x is read, export it again")
    _check_extensions(path, tree)
    buffers = tuple(
        _load_buffer(path, entry, binary if number == 0 else None)
        for number, entry in enumerate(objects(path, tree, "buffers"))
    )
    return Document(path, tree, buffers)


def objects(path: Path, tree: Object, kind: str) -> list[Object]:
    """A bounded list of JSON objects under a key."""
    items = tree.get(kind, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise InputError(f"{path}: damaged file, {kind} is not a list of objects")
    if len(items) > _MAX_ITEMS:
        raise InputError(f"{path}: {len(items)} {kind}; at most {_MAX_ITEMS} are read")
    return items


def _read_bounded(path: Path) -> bytes:
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise InputError(f"{path}: cannot be read (it is not a file)")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"{path}: {size} bytes; files up to {MAX_BYTES} bytes are read")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if not data:
        raise InputError(f"{path}: is empty; expected a glTF 2.0 file")
    return data


def _split_binary(path: Path, data: bytes) -> tuple[bytes, bytes | None]:
    """JSON and binary chunks of a GLB."""
    if len(data) < 20 or struct.unpack_from("<I", data, 8)[0] > len(data):
        raise InputError(f"{path}: GLB is truncated at {len(data)} bytes; copy it again")
    chunks: dict[int, bytes] = {}
    position = 12
    while position + 8 <= len(data):
        size, kind = struct.unpack_from("<II", data, position)
        position += 8
        if size > len(data) - position:
            raise InputError(f"{path}: GLB chunk is truncated; copy the file again")
        chunks.setdefault(kind, data[position : position + size])
        position += size
    if _JSON_CHUNK not in chunks:
        raise InputError(f"{path}: GLB without its JSON chunk; the file is damaged")
    return chunks[_JSON_CHUNK], chunks.get(_BINARY_CHUNK)


def _parse(path: Path, text: bytes) -> Object:
    if len(text) > _MAX_TREE_BYTES:
        raise InputError(f"{path}: JSON of {len(text)} bytes; up to {_MAX_TREE_BYTES} are read")
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path}: not a glTF file (its JSON cannot be parsed); export it again"
        ) from error
    if not isinstance(tree, dict):
        raise InputError(f"{path}: not a glTF file (its JSON is not an object)")
    return tree


def _check_extensions(path: Path, tree: Object) -> None:
    required = tree.get("extensionsRequired", [])
    for name in required if isinstance(required, list) else [required]:
        known = isinstance(name, str) and (name in _UNDERSTOOD or name.startswith("KHR_materials_"))
        if not known:
            raise InputError(
                f"{path}: requires {name!r:.60}, which is not read; "
                "export it again without compression and extensions"
            )


def _load_buffer(path: Path, entry: Object, binary: bytes | None) -> bytes:
    data = binary if "uri" not in entry else _resolve(path, entry["uri"], "buffer")
    size = entry.get("byteLength")
    if data is None or not isinstance(size, int) or not 0 < size <= len(data):
        have = 0 if data is None else len(data)
        raise InputError(f"{path}: buffer of {have} bytes declares {size!r:.20}; file is damaged")
    return data


def _resolve(path: Path, uri: object, what: str) -> bytes:
    """Bytes of a data URI or of a file in the folder of ``path``; nothing else is opened."""
    if not isinstance(uri, str):
        raise InputError(f"{path}: {what} without data; the file is damaged")
    if uri.startswith("data:"):
        header, _, payload = uri.partition(",")
        try:
            encoded = payload if header.endswith(";base64") else None
            return base64.b64decode(encoded or "", validate=True)
        except binascii.Error as error:
            raise InputError(f"{path}: {what} holds broken base64 data") from error
    folder = path.parent.resolve()
    try:
        target = (folder / unquote(uri)).resolve()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {what} has the unusable path {uri!r:.80}") from error
    if "://" in uri or not target.is_relative_to(folder):
        raise InputError(f"{path}: {what} {uri!r:.80} is outside its folder and is not opened")
    return _read_bounded(target)


def companions(path: Path) -> tuple[Path, ...]:
    """Files that a ``.gltf`` keeps its buffers and images in; none of what is no glTF file."""
    if path.suffix.lower() != ".gltf":
        return ()
    try:
        tree = _parse(path, _read_bounded(path))
    except InputError:  # reading will say so
        return ()
    parts = [tree.get("buffers"), tree.get("images")]
    entries = [each for part in parts if isinstance(part, list) for each in part]
    uris = [each.get("uri") for each in entries if isinstance(each, dict)]
    named = [unquote(u) for u in uris if isinstance(u, str) and not u.startswith("data:")]
    return tuple(path.parent / name for name in dict.fromkeys(named) if "\0" not in name)


def _normalized(raw: NDArray[Any]) -> NDArray[np.float64]:
    if raw.dtype.kind == "f":
        return raw.astype(np.float64)
    largest = math.ldexp(1, 8 * raw.dtype.itemsize - (raw.dtype.kind == "i")) - 1
    return np.maximum(raw / largest, -1.0)
