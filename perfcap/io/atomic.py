"""Files that appear complete or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from perfcap.errors import InputError


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """Write under a temporary name that becomes ``path`` when the block ends without error.

    Raises:
        InputError: the place cannot be written.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with partial.open("wb") as file:
            yield file
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); free space or choose another folder"
        ) from None
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
