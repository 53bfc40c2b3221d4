"""Frames of one video file, by index, as they are stored."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.forks import abandon_after_fork
from perfcap.io.files import require_file
from perfcap.io.video_halts import halted
from perfcap.io.video_index import frame_rate, index_video, open_container, seconds

Frames = NDArray[np.uint8]

SIZE_LIMIT = 2**40  # bytes; a guard against devices and sparse files, not against long videos
SKIP_AHEAD = 32  # decoding this many frames is cheaper than seeking to a key frame
KEPT = 2**26  # bytes of decoded frames that are held for whoever looks again


class VideoFile:
    """One video. Opening decodes it once: containers miscount their frames, decoding does not.

    That pass costs some milliseconds a full-HD frame and settles the number of frames, their
    times, which of them show the picture of the one before (``halted``, (F,)), and whether the
    file is damaged, before anything is computed.
    """

    _container: Any = None

    def __init__(self, path: Path, stop: int | None = None) -> None:
        """Index the first ``stop`` frames, or all.

        Raises:
            InputError: a file that is missing, empty, no video, or yields no frame.
        """
        require_file(path, SIZE_LIMIT, "a video")
        self.path = path
        self.name = path.stem
        self.index = index_video(path, stop)
        self.size = self.index.size
        self.lost = self.index.lost
        self.total = self.index.total
        self.film_focal = self.index.film_focal
        self.timestamps = seconds(self.index)
        self.halted = halted(self.index.steps)
        self.fps, notes = frame_rate(self.timestamps, self.index)
        self.warnings = tuple(f"{path}: {note}" for note in (*self.index.warnings, *notes))
        self._position = {pts: i for i, pts in enumerate(self.index.pts)}
        self._decoder: Iterator[tuple[int, Any]] | None = None
        self._next = 0
        self._wanted: frozenset[int] = frozenset()
        self._kept: dict[int, Any] = {}
        self._room = KEPT
        abandon_after_fork(self)

    def __len__(self) -> int:
        return len(self.index.pts)

    def read(self, start: int, stop: int) -> Frames:
        """Frames ``start`` to ``stop`` as RGB, (stop - start, H, W, 3); bounded memory."""
        if not 0 <= start <= stop <= len(self):
            raise IndexError(f"{self.path}: frames {start}:{stop} of {len(self)}")
        frames = np.empty((stop - start, *self.size, 3), np.uint8)
        for i in range(start, stop):
            stored = self._frame(i).to_ndarray(format="rgb24")
            frames[i - start] = self.index.orientation.shown(stored)
        return frames

    def keep(self, frames: Iterable[int], most: int = KEPT) -> None:
        """Hold some frames from when they are read on: who looks at them again need not decode.

        Those of the last call are let go.

        Args:
            frames: their numbers.
            most: bytes of frames as the decoder made them; those that are read later are not held.
        """
        self._wanted, self._kept, self._room = frozenset(frames), {}, most

    def close(self) -> None:
        """Let go of the file and of frames that are held; reading opens it again."""
        self._kept = {}
        if self._container is not None:
            self._container.close()
        self._container, self._decoder = None, None

    def __del__(self) -> None:
        # an open file refers to itself, and its decoder has threads
        self.close()

    def abandon(self) -> object:
        """Give up the open file without closing it; see ``perfcap.forks``."""
        held = self._container, self._decoder, self._kept
        self._container, self._decoder, self._kept = None, None, {}
        return held

    def _frame(self, wanted: int) -> Any:
        """The decoded frame ``wanted``, held or read."""
        if wanted in self._kept:
            return self._kept[wanted]
        frame = self._decoded(wanted)
        if wanted in self._wanted:
            size = sum(plane.buffer_size for plane in frame.planes)
            if (len(self._kept) + 1) * size <= self._room:
                self._kept[wanted] = frame
        return frame

    def _decoded(self, wanted: int) -> Any:
        """The same, going on from the last one, seeking, or starting over."""
        if self._decoder is None or wanted < self._next or self._seek_helps(wanted):
            self._seek(wanted)
        frame = self._advance(wanted)
        if frame is None:  # the seek landed too late, or frames before a key frame are missing
            self._restart()
            frame = self._advance(wanted)
        if frame is None:
            self.close()
            raise InputError(f"{self.path}: frame {wanted} can no longer be read; was it changed?")
        return frame

    def _seek_helps(self, wanted: int) -> bool:
        """Whether a frame ahead is far, and a key frame lies on the way: a seek goes back else."""
        keys = self.index.keys
        before = bisect_right(keys, wanted) - 1  # the last key frame that is no later
        near = wanted - self._next <= SKIP_AHEAD
        return not near and before >= 0 and keys[before] > self._next

    def _advance(self, wanted: int) -> Any:
        assert self._decoder is not None
        for position, frame in self._decoder:
            if position > wanted:
                return None
            self._next = position + 1
            if position == wanted:
                return frame
        return None

    def _seek(self, wanted: int) -> None:
        if not self.index.addressable or wanted <= SKIP_AHEAD:
            self._restart()
            return
        if self._container is None:
            self._restart()
        stream = self._container.streams.video[0]
        try:
            self._container.seek(self.index.pts[wanted], stream=stream, backward=True)
        except av.error.FFmpegError:
            self._restart()
            return
        self._decoder = self._numbered(stream)

    def _restart(self) -> None:
        self.close()
        self._container = open_container(self.path)
        self._decoder = self._numbered(self._container.streams.video[0])
        self._next = 0

    def _numbered(self, stream: Any) -> Iterator[tuple[int, Any]]:
        known = self._position if self.index.addressable else None
        return _numbered(self._container.decode(stream), known)


def _numbered(
    decoded: Iterator[Any], known: Mapping[int | None, int] | None
) -> Iterator[tuple[int, Any]]:
    """Frames with their index: by time stamp, or by counting where there are none.

    Not a method: a video that its own iterator holds would keep its decoder's threads until the
    garbage is collected.
    """
    try:
        for count, frame in enumerate(decoded):
            position = count if known is None else known.get(frame.pts)
            if position is not None:
                yield position, frame
    except av.error.FFmpegError:
        return
