"""Writing H.264 videos that every browser plays."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import av
import numpy as np
from numpy.typing import NDArray

from perfcap.io.atomic import claim, partial_path, unwritable


class VideoWriter:
    """H.264 (yuv420p, moov in front) under a temporary name until it is complete.

    Used as a context: leaving it normally gives the file its name, leaving it by an exception
    removes what was written.

    Example:
        >>> import numpy as np, tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "grey.mp4"
        >>> with VideoWriter(path, fps=30) as writer:
        ...     writer.write(np.full((48, 64, 3), 128, np.uint8))
        >>> path.exists()
        True
    """

    def __init__(
        self, path: str | Path, fps: float, *, crf: int = 20, preset: str = "medium"
    ) -> None:
        """Prepare a writer; nothing is written before the first frame.

        Args:
            path: final name, ``.mp4``.
            fps: frames a second.
            crf: quality, 0 (lossless) to 51; 17 is visually lossless.
            preset: x264's speed, ``ultrafast`` to ``veryslow``.
        """
        if not 0 < fps < 1e5:
            raise ValueError(f"fps is {fps}, expected a positive number")
        self.path = Path(path)
        self._partial = partial_path(self.path)
        self._rate = Fraction(fps).limit_denominator(1001)
        # with its tree of macroblocks x264 reads memory that nobody set: the same frames would
        # not always make the same file
        self._options = {"crf": str(crf), "preset": preset, "x264-params": "mbtree=0"}
        self._container: Any = None
        self._stream: Any = None
        self._claim: int | None = None  # descriptor of the temporary file, locked
        self._size: tuple[int, int] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    def write(self, frame: NDArray[np.uint8]) -> None:
        """Append an RGB frame (H, W, 3); all frames have the size of the first."""
        if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
            raise ValueError(
                f"frame is {frame.dtype} {frame.shape}, expected uint8 (height, width, 3)"
            )
        size = (frame.shape[0], frame.shape[1])
        if self._size is None:
            with self._reporting():
                self._begin(size)
        elif size != self._size:
            raise ValueError(f"frame has size {size}, the first had {self._size}")
        # yuv420p has half the chroma pixels: odd sides get one more row or column
        even = np.pad(frame, ((0, size[0] % 2), (0, size[1] % 2), (0, 0)), mode="edge")
        picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
        with self._reporting():
            self._container.mux(self._stream.encode(picture))

    def close(self) -> None:
        """Finish the file and give it its name.

        Raises:
            ValueError: no frame was written.
            InputError: the place cannot be written.
        """
        if self._container is None:
            raise ValueError(f"{self.path}: no frames were written")
        with self._reporting():
            self._container.mux(self._stream.encode())
            self._container.close()
            self._container = None
            assert self._claim is not None
            os.fsync(self._claim)
            os.replace(self._partial, self.path)
            self._release()

    @contextmanager
    def _reporting(self) -> Iterator[None]:
        """Remove what was written and say why when the disk or folder refuses."""
        try:
            yield
        except OSError as error:
            self.discard()
            raise unwritable(self.path, error) from error

    def discard(self) -> None:
        """Give up and remove what was written."""
        if self._container is not None:
            with suppress(OSError):  # closing writes the rest, which may be what failed
                self._container.close()
            self._container = None
        if self._claim is not None:
            with suppress(OSError):
                self._partial.unlink()
            self._release()

    def _release(self) -> None:
        if self._claim is not None:
            os.close(self._claim)
            self._claim = None

    def _begin(self, size: tuple[int, int]) -> None:
        self._size = size
        self._claim = claim(self.path)
        self._container = av.open(
            str(self._partial), "w", format="mp4", options={"movflags": "+faststart"}
        )
        self._stream = self._container.add_stream("libx264", self._rate, options=self._options)
        self._stream.height = size[0] + size[0] % 2
        self._stream.width = size[1] + size[1] % 2
        self._stream.pix_fmt = "yuv420p"
