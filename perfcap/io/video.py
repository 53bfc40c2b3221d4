"""Frames of one video file, by index, as they are stored."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import require_file

logger = logging.getLogger(__name__)

Frames = NDArray[np.uint8]

SIZE_LIMIT = 2**40  # bytes; a guard against devices and sparse files, not against long videos
PIXEL_LIMIT = 2**27  # pixels a frame
UNKNOWN_FPS = 30.0
# A file could be a playlist that makes the demuxer open other files or addresses.
OPEN_OPTIONS = {"protocol_whitelist": "file"}
PLAYLISTS = frozenset({"hls", "concat", "dash", "image2", "tty"})
SKIP_AHEAD = 32  # decoding this many frames is cheaper than seeking to a key frame


@dataclass(frozen=True)
class VideoIndex:
    """What one pass over a video found.

    Attributes:
        pts: presentation time stamp of each frame in ticks, None where the file has none.
        tick: seconds a tick.
        rate: frames a second according to the file, or None.
        size: (height, width) as shown, after rotation.
        turns: quarter turns counter-clockwise from stored to shown.
        warnings: what a user should know about the file.
    """

    pts: tuple[int | None, ...]
    tick: float
    rate: float | None
    size: tuple[int, int]
    turns: int
    warnings: tuple[str, ...]

    @property
    def addressable(self) -> bool:
        """Whether time stamps tell frames apart, so that one may seek by them."""
        return None not in self.pts and len(set(self.pts)) == len(self.pts)


class VideoFile:
    """One video. Opening decodes it once: containers miscount their frames, decoding does not.

    That pass costs some milliseconds a full-HD frame and settles the number of frames, their
    times, and whether the file is damaged, before anything is computed.
    """

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
        self.timestamps = _seconds(self.index)
        self.fps, notes = frame_rate(self.timestamps, self.index)
        self.warnings = tuple(f"{path}: {note}" for note in (*self.index.warnings, *notes))
        for warning in self.warnings:
            logger.warning(warning)
        self._position = {pts: i for i, pts in enumerate(self.index.pts)}
        self._container: Any = None
        self._decoder: Iterator[tuple[int, Any]] | None = None
        self._next = 0

    def __len__(self) -> int:
        return len(self.index.pts)

    def read(self, start: int, stop: int) -> Frames:
        """Frames ``start`` to ``stop`` as RGB, (stop - start, H, W, 3); bounded memory."""
        if not 0 <= start <= stop <= len(self):
            raise IndexError(f"{self.path}: frames {start}:{stop} of {len(self)}")
        frames = np.empty((stop - start, *self.size, 3), np.uint8)
        for i in range(start, stop):
            frames[i - start] = np.rot90(
                self._frame(i).to_ndarray(format="rgb24"), self.index.turns
            )
        return frames

    def close(self) -> None:
        """Let go of the file; reading opens it again."""
        if self._container is not None:
            self._container.close()
        self._container, self._decoder = None, None

    def _frame(self, wanted: int) -> Any:
        """The decoded frame ``wanted``, going on from the last one, seeking, or starting over."""
        if self._decoder is None or not 0 <= wanted - self._next <= SKIP_AHEAD:
            self._seek(wanted)
        frame = self._advance(wanted)
        if frame is None:  # the seek landed too late, or frames before a key frame are missing
            self._restart()
            frame = self._advance(wanted)
        if frame is None:
            self.close()
            raise InputError(f"{self.path}: frame {wanted} can no longer be read; was it changed?")
        return frame

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
        self._decoder = self._numbered(self._container.decode(stream))

    def _restart(self) -> None:
        self.close()
        self._container = open_container(self.path)
        self._decoder = self._numbered(self._container.decode(self._container.streams.video[0]))
        self._next = 0

    def _numbered(self, decoded: Iterator[Any]) -> Iterator[tuple[int, Any]]:
        """Frames with their index: by time stamp, or by counting where there are none."""
        try:
            for count, frame in enumerate(decoded):
                position = self._position.get(frame.pts) if self.index.addressable else count
                if position is not None:
                    yield position, frame
        except av.error.FFmpegError:
            return


def open_container(path: Path) -> Any:
    """Open a video with a decoder that uses several threads.

    Raises:
        InputError: not a video, or a playlist of other files.
    """
    try:
        container = av.open(str(path.resolve()), options=OPEN_OPTIONS)
    except (av.error.FFmpegError, ValueError) as error:
        raise InputError(
            f"{path}: is not a video that can be opened ({_reason(error)}); expected MP4, MOV, "
            "MKV, WebM or AVI; a recording that was cut off may need repair or copying again"
        ) from error
    if PLAYLISTS & set(container.format.name.split(",")) or not container.streams.video:
        kind = container.format.name
        container.close()
        raise InputError(f"{path}: holds no video ({kind}); expected MP4, MOV, MKV, WebM or AVI")
    container.streams.video[0].thread_type = "AUTO"
    return container


def index_video(path: Path, stop: int | None = None) -> VideoIndex:
    """Decode a video once and note what is in it."""
    with open_container(path) as container:
        stream = container.streams.video[0]
        pts, shape, damage = _decode_all(path, container, stream, stop)
        if shape is None:
            raise InputError(
                f"{path}: yields no frame ({damage or 'no pictures inside'}); expected a video, "
                "copy or record it again"
            )
        stored, turns = shape
        warnings = _notes(stream, len(pts), damage, stop)
        return VideoIndex(
            tuple(pts),
            float(stream.time_base or 1),
            float(stream.average_rate) if stream.average_rate else None,
            stored if turns % 2 == 0 else stored[::-1],
            turns,
            warnings,
        )


def _decode_all(
    path: Path, container: Any, stream: Any, stop: int | None
) -> tuple[list[int | None], tuple[tuple[int, int], int] | None, str]:
    """Time stamps, (stored size, quarter turns) and, if decoding broke off, why."""
    pts: list[int | None] = []
    shape: tuple[tuple[int, int], int] | None = None
    try:
        for frame in container.decode(stream):
            size = (frame.height, frame.width)
            if shape is None:
                _check_pixels(path, size)
                shape = size, round(frame.rotation / 90) % 4
            elif size != shape[0]:
                raise InputError(
                    f"{path}: frame {len(pts)} is {size[1]}x{size[0]}, the first is "
                    f"{shape[0][1]}x{shape[0][0]}; expected one size, convert the video"
                )
            pts.append(frame.pts)
            if stop is not None and len(pts) >= stop:
                break
    except av.error.FFmpegError as error:
        return pts, shape, _reason(error)
    return pts, shape, ""


def _check_pixels(path: Path, size: tuple[int, int]) -> None:
    if size[0] * size[1] > PIXEL_LIMIT:
        raise InputError(
            f"{path}: frames of {size[1]}x{size[0]}, expected at most {PIXEL_LIMIT // 2**20} "
            "megapixels; scale the video down"
        )


def _notes(stream: Any, found: int, damage: str, stop: int | None) -> tuple[str, ...]:
    notes = []
    promised = stream.frames
    if damage:
        notes.append(f"decoding broke off ({damage}); the {found} frames before that are used")
    elif stop is None and promised > found:
        notes.append(f"is cut short: it promises {promised} frames, the {found} there are are used")
    ratio = stream.sample_aspect_ratio
    if ratio and ratio != 1:
        notes.append(f"pixels are not square ({ratio}); frames are used as stored, not stretched")
    return tuple(notes)


def _seconds(index: VideoIndex) -> NDArray[np.float64]:
    """Times of the frames from the first, (F,)."""
    if None in index.pts:
        return np.arange(len(index.pts)) / (index.rate or UNKNOWN_FPS)
    ticks = np.asarray(index.pts, np.float64)
    times: NDArray[np.float64] = (ticks - ticks[:1]) * index.tick
    return times


def frame_rate(times: NDArray[np.float64], index: VideoIndex) -> tuple[float, list[str]]:
    """Frames a second, and a note when the rate varies.

    Time stamps are rounded to ticks (a millisecond in MKV), so a constant rate is the average
    one; a rate varies when a frame is half a frame away from its place.
    """
    if len(times) < 2 or times[-1] <= 0:
        return index.rate or UNKNOWN_FPS, []
    average = (len(times) - 1) / float(times[-1])
    if np.abs(times - np.arange(len(times)) / average).max() < 0.5 / average + index.tick:
        close = index.rate is not None and abs(average / index.rate - 1) < 5e-3
        return (index.rate or average) if close else average, []
    median = 1 / float(np.median(np.diff(times)))
    steps = np.diff(times)
    note = (
        f"has a variable frame rate (steps of {steps.min() * 1e3:.1f} to {steps.max() * 1e3:.1f} "
        f"ms); frames are used as stored, at the median rate of {median:.2f} a second"
    )
    return median, [note]


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
