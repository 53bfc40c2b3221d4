"""Writing H.264 videos that every browser plays."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import av
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.atomic import claim, partial_path, unwritable
from perfcap.io.video_segment import Encoder, Encoding, Packet, Segment

_AHEAD = 2  # frames that x264 decodes before the one that is shown


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

        Raises:
            InputError: another name, or no such rate, quality or speed.
        """
        if Path(path).suffix.lower() != ".mp4":
            raise InputError(f"{path}: the video is written as MP4; give a name that ends in .mp4")
        self.path = Path(path)
        self.encoding = Encoding.at(fps, crf, preset)
        self._partial = partial_path(self.path)
        self._container: Any = None
        self._stream: Any = None
        self._claim: int | None = None  # descriptor of the temporary file, locked
        self._size: tuple[int, int] | None = None
        self._encoder = Encoder(self.encoding)
        self._first, self._decoded = 0, 0  # frame where the current part begins, packets so far

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
        """Append an RGB frame (H, W, 3); all frames have the size of the first.

        Raises:
            ValueError: it is something else, or of another size.
            InputError: the place cannot be written.
        """
        packets = self._encoder.feed(frame)
        assert self._encoder.size is not None
        with self._reporting():
            self._begin(self._encoder.size)
            self._mux(packets)

    def append(self, segment: Segment) -> None:
        """Append frames that ``self.encoding`` has encoded already.

        Raises:
            ValueError: they have another size.
            InputError: the place cannot be written.
        """
        if self._size not in (None, segment.size):
            raise ValueError(f"a segment has frames of {segment.size}, those before {self._size}")
        with self._reporting():
            self._begin(segment.size)
            self._flush()
            self._mux(segment.packets)
            self._first = self._decoded

    def close(self) -> None:
        """Finish the file and give it its name.

        Raises:
            ValueError: no frame was written.
            InputError: the place cannot be written.
        """
        if self._container is None:
            raise ValueError(f"{self.path}: no frames were written")
        with self._reporting():
            self._flush()
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
        if self._container is not None:
            return
        self._size = size
        self._claim = claim(self.path)
        # what is relative and has a colon would be a protocol of FFmpeg
        path = str(self._partial.absolute())
        self._container = av.open(path, "w", format="mp4", options={"movflags": "+faststart"})
        options = dict(self.encoding.options)
        self._stream = self._container.add_stream("libx264", self.encoding.rate, options=options)
        self.encoding.shape(self._stream, size)
        self._container.start_encoding()

    def _flush(self) -> None:
        """End the part that is being encoded."""
        self._mux(self._encoder.finish())
        self._first, self._encoder = self._decoded, Encoder(self.encoding)

    def _mux(self, packets: Sequence[Packet]) -> None:
        for data, place, key in packets:
            packet = av.Packet(data)
            packet.stream, packet.is_keyframe = self._stream, key
            packet.time_base = 1 / self.encoding.rate
            packet.pts, packet.dts = self._first + place, self._decoded - _AHEAD
            packet.duration = 1
            self._decoded += 1
            self._container.mux(packet)
