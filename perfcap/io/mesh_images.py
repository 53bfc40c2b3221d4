"""Image files that a mesh file names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, require_file

_LIMIT = 256 * MEBIBYTE


@dataclass(frozen=True)
class MeshImages:
    """Image files beside a mesh file, by their number."""

    path: Path
    files: tuple[str, ...]

    def error(self, message: str) -> InputError:
        """An `InputError` that names the mesh file."""
        return InputError(f"{self.path}: {message}")

    def image(self, index: object) -> bytes:
        """Encoded bytes of an image.

        Raises:
            InputError: it is missing, too large, or outside of the mesh's folder.
        """
        name = self.files[int(str(index))]
        target = beside(self.path, name, "texture")
        require_file(target, _LIMIT, f"the texture of {self.path.name}")
        return target.read_bytes()


def beside(path: Path, name: str, what: str) -> Path:
    """A file in the folder of another one, or below.

    Raises:
        InputError: it is anywhere else.
    """
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
