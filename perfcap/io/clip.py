"""Lazy frames of one or several synchronous views."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.image_file import ImageFolder
from perfcap.io.late_source import LateSource
from perfcap.io.video import KEPT, VideoFile
from perfcap.io.video_index import UNKNOWN_FPS
from perfcap.io.view_times import parting
from perfcap.rates import frame_rate
from perfcap.setting_checks import require_count

Frames = NDArray[np.uint8]

# Recordings of one take rarely stop at the same frame: this many may be missing at an end.
END_SLACK = 5
RATE_SLACK = 0.01  # share by which frame rates may differ and mean the same


class FrameSource(Protocol):
    """Frames of one view by index; ``VideoFile`` or ``ImageFolder``."""

    name: str
    size: tuple[int, int]
    lost: int
    total: int | None
    warnings: tuple[str, ...]

    @property
    def fps(self) -> float | None:
        """Frames a second, None when unknown."""

    @property
    def timestamps(self) -> NDArray[np.float64] | None:
        """Seconds from the first frame, (F,), None when unknown."""

    def __len__(self) -> int: ...

    def read(self, start: int, stop: int) -> Frames:
        """RGB frames, (stop - start, H, W, 3)."""

    def close(self) -> None:
        """Let go of files."""


class FrameReader(Protocol):
    """Frames of C synchronous views, read in blocks; ``Clip`` is one."""

    def __len__(self) -> int:
        """F."""

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        """RGB frames ``start`` to ``stop`` of a view, (stop - start, H, W, 3) uint8."""


class Clip:
    """Frames of C synchronous views: frame f of every view was taken at the same time.

    Attributes:
        sources: one a view.
        fps: frames a second.
        warnings: what a user should know about how the files were read.
        start: index in the files of the clip's first frame.

    Raises:
        InputError: no view, no such rate, or an empty part.
    """

    def __init__(
        self,
        sources: Sequence[FrameSource],
        fps: float,
        warnings: Sequence[str] = (),
        start: int = 0,
        stop: int | None = None,
    ) -> None:
        self.sources = tuple(sources)
        if not self.sources:
            raise InputError("sources are none, expected one a view")
        require_count(start, "start", least=0)
        if stop is not None:
            require_count(stop, "stop", least=start + 1)
        self.fps = frame_rate(fps, "fps")
        self.warnings = tuple(warnings)
        self.start = start
        shortest = min(len(source) for source in sources)
        self._stop = shortest if stop is None else min(stop, shortest)

    @classmethod
    def open(
        cls,
        paths: str | Path | Sequence[str | Path],
        *,
        fps: float | None = None,
        frames: slice | None = None,
    ) -> Self:
        """Open one video or folder of images a view.

        Args:
            paths: one or several files or folders.
            fps: frames a second where the files do not say (folders), e.g. from a camera file.
            frames: the part to use, ``slice(start, stop)``; frames after it are never decoded.

        Raises:
            InputError: a file that cannot be used, views of different rate or length, or an empty
                part.
        """
        several = [paths] if isinstance(paths, str | Path) else list(paths)
        if not several:
            raise InputError("VIDEO: is missing; expected a video or a folder of images a view")
        start, stop = _bounds(frames)
        sources = [open_source(Path(path), stop) for path in several]
        rate, rate_notes = _common_rate(sources, fps)
        parting = _parting(sources)
        rate_notes += parting
        length_notes = _check_lengths(sources, bool(parting))
        clip = cls(
            sources,
            rate,
            [*(w for s in sources for w in s.warnings), *rate_notes, *length_notes],
            start,
            stop,
        )
        if not len(clip):
            raise InputError(
                f"--frames {start}:{'' if stop is None else stop}: holds no frame of "
                f"{several[0]}, which has {len(sources[0])}; expected a part of these"
            )
        return clip

    def __len__(self) -> int:
        return max(0, self._stop - self.start)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files without suffix, C."""
        return tuple(source.name for source in self.sources)

    @property
    def image_names(self) -> tuple[tuple[str, ...], ...]:
        """Names of all images a view, C, without ending, frame by frame; none of a video."""
        own = (s.source if isinstance(s, LateSource) else s for s in self.sources)
        return tuple(each.names if isinstance(each, ImageFolder) else () for each in own)

    @property
    def lost(self) -> int:
        """Frames after the last that a damaged file promises and no longer has."""
        return max(source.lost for source in self.sources)

    @property
    def total(self) -> int | None:
        """Frames of the whole files, also behind the clip's part; None where none of them says."""
        known = [source.total for source in self.sources if source.total is not None]
        return min(known, default=None)

    @property
    def views(self) -> int:
        """C."""
        return len(self.sources)

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Image (height, width) a view."""
        return tuple(source.size for source in self.sources)

    @property
    def timestamps(self) -> NDArray[np.float64]:
        """Seconds from the clip's first frame, (F,): the first view's, or evenly spaced."""
        times = self.sources[0].timestamps
        if times is None:
            return np.arange(len(self)) / self.fps
        part: NDArray[np.float64] = times[self.start : self._stop] - times[self.start]
        return part

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        """RGB frames ``start`` to ``stop`` of a view, (stop - start, H, W, 3)."""
        if not 0 <= start <= stop <= len(self):
            raise IndexError(f"frames {start}:{stop} of a clip of {len(self)}")
        return self.sources[view].read(self.start + start, self.start + stop)

    def read_views(self, start: int, stop: int) -> list[Frames]:
        """RGB frames ``start`` to ``stop`` a view, each (stop - start, H, W, 3)."""
        return [self.read_view(view, start, stop) for view in range(self.views)]

    def read(self, start: int, stop: int) -> Frames:
        """RGB frames of views of one size, (stop - start, C, H, W, 3)."""
        self._require_one_size()
        return np.stack(self.read_views(start, stop), 1)

    def iter_views(self, batch: int = 16) -> Iterator[list[Frames]]:
        """All frames in order, ``batch`` at a time, a list with one array a view."""
        for start in range(0, len(self), batch):
            yield self.read_views(start, min(start + batch, len(self)))

    def iter(self, batch: int = 16) -> Iterator[Frames]:
        """All frames of views of one size in order, (f, C, H, W, 3) with f at most ``batch``."""
        self._require_one_size()
        return (np.stack(views, 1) for views in self.iter_views(batch))

    def halted(self, view: int) -> NDArray[np.bool_]:
        """Which frames show the picture of the frame before once more, (F,), as videos tell."""
        given = self.sources[view]
        source = given.source if isinstance(given, LateSource) else given
        found = np.zeros(len(self), np.bool_)
        if isinstance(source, VideoFile):
            rows = self.file_frames(view)
            there = (rows > 0) & (np.arange(len(self)) > 0)
            found[there] = source.halted[rows[there]]
        return found

    def late(self, view: int) -> int:
        """Frames by which a view is read later in its file than the others, see ``LateSource``."""
        source = self.sources[view]
        return source.late if isinstance(source, LateSource) else 0

    def file_frames(self, view: int) -> NDArray[np.int64]:
        """Number of each frame in the file of a view, (F,); -1 where that ends or begins before."""
        rows = np.arange(self.start, self._stop) + self.late(view)
        return np.where((rows >= 0) & (rows < len(self.sources[view])), rows, -1)

    def keep(self, frames: Iterable[int]) -> None:
        """Have videos hold some frames of the clip when they are read; see ``VideoFile.keep``."""
        chosen = [self.start + frame for frame in frames]
        for source in self.sources:
            if isinstance(source, VideoFile):
                source.keep(chosen, KEPT // self.views)

    def close(self) -> None:
        """Let go of the files; reading opens them again."""
        for source in self.sources:
            source.close()

    def _require_one_size(self) -> None:
        if len(set(self.sizes)) > 1:
            raise ValueError(f"views have sizes {self.sizes}; use read_views or iter_views")


def open_source(path: Path, stop: int | None = None) -> FrameSource:
    """The frames of a video file or a folder of images."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; expected a video or a folder of images")
    return ImageFolder(path, stop) if path.is_dir() else VideoFile(path, stop)


def _bounds(frames: slice | None) -> tuple[int, int | None]:
    if frames is None:
        return 0, None
    if not isinstance(frames, slice | range) or frames.step not in (None, 1):
        raise InputError(f"frames is {frames!r:.60}, expected slice(A, B), of every frame")
    start, stop = frames.start or 0, frames.stop
    if start < 0 or (stop is not None and stop <= start):
        raise InputError(f"--frames: is {start}:{stop}, expected A:B with 0 <= A < B")
    return start, stop


def assumed_rate(name: str) -> str:
    """That images of a view do not say how many there are a second."""
    return f"{name}: images have no frame rate; {UNKNOWN_FPS:g} a second assumed"


def _common_rate(sources: Sequence[FrameSource], fps: float | None) -> tuple[float, list[str]]:
    fps = None if fps is None else frame_rate(fps, "fps")
    known = [source for source in sources if source.fps is not None]
    rates = [source.fps for source in known if source.fps is not None]
    if not rates:
        return (UNKNOWN_FPS, [assumed_rate(sources[0].name)]) if fps is None else (fps, [])
    if max(rates) / min(rates) > 1 + RATE_SLACK:
        listing = ", ".join(f"{source.name} {source.fps:.3g}" for source in known)
        raise InputError(
            f"videos run at different rates ({listing} frames a second); expected synchronous "
            "views, convert them to one rate"
        )
    if fps is not None and abs(rates[0] / fps - 1) > RATE_SLACK:
        note = f"{sources[0].name}: runs at {rates[0]:.3g} frames a second, not {fps:.3g}"
        return rates[0], [note]
    return rates[0], []


def _parting(sources: Sequence[FrameSource]) -> list[str]:
    """That frames of one number were not taken at one time, by the times in the files."""
    count = min(len(source) for source in sources)
    known = [(source.timestamps, source.name) for source in sources]
    return parting([(times[:count], name) for times, name in known if times is not None])


def _check_lengths(sources: Sequence[FrameSource], parting: bool) -> list[str]:
    lengths = [len(source) for source in sources]
    shortest, longest = min(lengths), max(lengths)
    if shortest == longest:
        return []
    listing = ", ".join(f"{s.name} {n}" for s, n in zip(sources, lengths, strict=True))
    if longest - shortest > END_SLACK:
        first = "convert them to one rate, then " if parting else ""
        raise InputError(
            f"videos have different numbers of frames ({listing}); expected synchronous views, "
            f"{first}cut them to the same part"
        )
    return [f"videos have different numbers of frames ({listing}); the first {shortest} are used"]


def late_views(clip: Clip, late: Sequence[int], stop: int) -> Clip:
    """A clip whose views are read so many whole frames later.

    Args:
        clip: each view as its file has it.
        late: of each view; below 0 for earlier ones.
        stop: number of the frame after the last one.
    """
    sources = [
        LateSource(source, frames) if frames else source
        for source, frames in zip(clip.sources, late, strict=True)
    ]
    return Clip(sources, clip.fps, clip.warnings, clip.start, stop)
