"""Files that appear complete or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from perfcap.errors import InputError


def partial_path(path: Path) -> Path:
    """Where a file grows until it is complete: hidden, beside it, of this process."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def unwritable(path: Path, error: OSError) -> InputError:
    """What to tell when a disk or a folder refuses."""
    reason = error.strerror or str(error) or type(error).__name__
    return InputError(f"{path}: cannot be written ({reason}); free space or choose another folder")


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """Write under a temporary name that becomes ``path`` when the block ends without error.

    Raises:
        InputError: the place cannot be written.
    """
    partial = partial_path(path)
    try:
        with partial.open("wb") as file:
            yield file
        os.replace(partial, path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):  # not there any more when all went well
            partial.unlink()
