"""Files that appear complete or not at all."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from perfcap.errors import InputError

_TRIES = 10  # to open a file that others give its name at the same time


def partial_path(path: Path) -> Path:
    """Where a file grows until it is complete: hidden, beside it.

    The name is always the same, so that what a killed process leaves is written over, not kept.
    """
    return path.with_name(f".{path.name}.tmp")


def unwritable(path: Path, error: OSError) -> InputError:
    """What to tell when a disk or a folder refuses."""
    reason = error.strerror or str(error) or type(error).__name__
    return InputError(f"{path}: cannot be written ({reason}); free space or choose another folder")


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """Write under a temporary name that becomes ``path`` when the block ends without error.

    The content is on the disk before the name is given, so that no loss of power leaves a file of
    the right name and the wrong content.

    Raises:
        InputError: the place cannot be written, or another process is writing it.
    """
    partial = partial_path(path)
    try:
        with os.fdopen(claim(path), "wb") as file:
            try:
                yield file
                file.flush()
                os.fsync(file.fileno())
                os.replace(partial, path)
            except BaseException:
                with suppress(OSError):  # not there any more when it has its name
                    partial.unlink()
                raise
    except OSError as error:
        raise unwritable(path, error) from error


def claim(path: Path) -> int:
    """Open the temporary file of ``path``, empty, for this writer alone; returns its descriptor.

    What is left of a writer that was killed is taken over.

    Raises:
        InputError: another process, or thread, is writing it.
        OSError: the place cannot be written.
    """
    partial = partial_path(path)
    for _ in range(_TRIES):
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
        descriptor = os.open(partial, flags, 0o666)
        try:
            if _locked(descriptor) and _is_at(descriptor, partial):
                os.ftruncate(descriptor, 0)
                return descriptor
        except BlockingIOError:
            os.close(descriptor)
            raise InputError(
                f"{path}: another perfcap writes it at the moment; wait for it, or choose another "
                "place"
            ) from None
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # it was given its name between opening and locking
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))


def settle(folder: Path) -> None:
    """Have names that were given or taken in a folder on the disk."""
    with suppress(OSError):  # some file systems cannot, and need not
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _locked(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a file system without locks
        return True
    return True


def _is_at(descriptor: int, path: Path) -> bool:
    """Whether a file is still the one of its name.

    Raises:
        OSError: it is no regular file.
    """
    found = os.fstat(descriptor)
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EEXIST, f"{path.name} is no file", str(path))
    try:
        return os.path.samestat(found, path.lstat())
    except FileNotFoundError:
        return False
