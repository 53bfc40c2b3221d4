"""What is in a video file: its frames, their times, and its faults."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import av
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.video_halts import PictureSteps

PIXEL_LIMIT = 2**27  # pixels a frame
FRAME_LIMIT = 1_000_000  # a file that promises more is not believed
UNKNOWN_FPS = 30.0
_SHORTEST, _LONGEST = 8.0, 600.0  # mm that a lens may have on 35 mm film
FILM_FOCAL = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
# A file could be a playlist that makes the demuxer open other files or addresses.
OPEN_OPTIONS = {"protocol_whitelist": "file"}
PLAYLISTS = frozenset({"hls", "concat", "dash", "image2", "tty"})


@dataclass(frozen=True)
class Orientation:
    """How a stored frame becomes the one that is shown.

    Attributes:
        turns: quarter turns counter-clockwise.
        mirrored: whether left and right are exchanged before that.
    """

    turns: int = 0
    mirrored: bool = False

    @classmethod
    def of(cls, frame: Any) -> Self:
        """That of a decoded frame: the nearest of the eight that the file's matrix may mean."""
        matrix = frame.side_data.get("DISPLAYMATRIX")
        if matrix is None:
            return cls()
        # shown x = a x + c y, shown y = b x + d y, y downwards, in 16.16 numbers
        a, b, _, c, d, *_ = np.frombuffer(bytes(matrix), np.int32)[:5].astype(np.float64)
        mirrored = a * d - b * c < 0
        angle = np.arctan2(b, -a) if mirrored else np.arctan2(-b, a)
        return cls(round(angle / (0.5 * np.pi)) % 4, bool(mirrored))

    def shown(self, stored: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """A frame (H, W, 3) as it is shown."""
        return np.rot90(stored[:, ::-1] if self.mirrored else stored, self.turns)


@dataclass(frozen=True)
class VideoIndex:
    """What one pass over a video found.

    Attributes:
        pts: presentation time stamp of each frame in ticks, None where the file has none.
        tick: seconds a tick.
        rate: frames a second according to the file, or None.
        size: (height, width) as shown, after rotation.
        orientation: from stored to shown.
        lost: frames the file promises beyond those it has; at least 1 where decoding broke off.
        total: frames of the whole file: those it promises, or has where these are more; None where
            it promises none and was not read to its end.
        warnings: what a user should know about the file.
        film_focal: the lens's focal length in millimetres on 35 mm film, where the file says so.
        keys: which frames are key frames, increasing: those that a seek may land at.
        steps: how much each frame but the first differs from the one before; see ``PictureSteps``.
    """

    pts: tuple[int | None, ...]
    tick: float
    rate: float | None
    size: tuple[int, int]
    orientation: Orientation
    lost: int
    total: int | None
    warnings: tuple[str, ...]
    film_focal: float | None = None
    keys: tuple[int, ...] = ()
    steps: tuple[float, ...] = ()

    @property
    def addressable(self) -> bool:
        """Whether time stamps tell frames apart, so that one may seek by them."""
        return None not in self.pts and len(set(self.pts)) == len(self.pts)


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
        steps = PictureSteps()
        pts, keys, shape, damage = _decode_all(path, container, stream, stop, steps)
        if shape is None:
            raise InputError(
                f"{path}: yields no frame ({damage or 'no pictures inside'}); expected a video, "
                "copy or record it again"
            )
        stored, orientation = shape
        lost = _lost(stream.frames, len(pts), damage, stop)
        warnings = _notes(stream, len(pts), lost, damage, orientation)
        return VideoIndex(
            tuple(pts),
            float(stream.time_base or 1),
            float(stream.average_rate) if stream.average_rate else None,
            stored if orientation.turns % 2 == 0 else stored[::-1],
            orientation,
            lost,
            _total(promised_frames(stream), len(pts), stop),
            warnings,
            _film_focal(container),
            tuple(keys),
            tuple(steps.sizes),
        )


def _film_focal(container: Any) -> float | None:
    """Millimetres, where a phone wrote them; None where it did not, or wrote nonsense."""
    try:
        focal = float(container.metadata.get(FILM_FOCAL, "nan"))
    except ValueError:
        return None
    return focal if _SHORTEST <= focal <= _LONGEST else None


def _decode_all(
    path: Path, container: Any, stream: Any, stop: int | None, steps: PictureSteps
) -> tuple[list[int | None], list[int], tuple[tuple[int, int], Orientation] | None, str]:
    """Time stamps, key frames, (stored size, orientation) and, if decoding broke off, why.

    ``steps`` looks at every frame.
    """
    pts: list[int | None] = []
    keys: list[int] = []
    shape: tuple[tuple[int, int], Orientation] | None = None
    try:
        for frame in container.decode(stream):
            size = (frame.height, frame.width)
            if shape is None:
                _check_pixels(path, size)
                shape = size, Orientation.of(frame)
            elif size != shape[0]:
                raise InputError(
                    f"{path}: frame {len(pts)} is {size[1]}x{size[0]}, the first is "
                    f"{shape[0][1]}x{shape[0][0]}; expected one size, convert the video"
                )
            if frame.key_frame:
                keys.append(len(pts))
            pts.append(frame.pts)
            steps.add(frame)
            if stop is not None and len(pts) >= stop:
                break
    except av.error.FFmpegError as error:
        return pts, keys, shape, _reason(error)
    return pts, keys, shape, ""


def _check_pixels(path: Path, size: tuple[int, int]) -> None:
    if size[0] * size[1] > PIXEL_LIMIT:
        raise InputError(
            f"{path}: frames of {size[1]}x{size[0]}, expected at most {PIXEL_LIMIT // 2**20} "
            "megapixels; scale the video down"
        )


def promised_frames(stream: Any) -> int | None:
    """Frames according to the file, where its duration says about the same.

    A file that was trimmed without being encoded again counts frames that are never shown.
    """
    if not 0 < stream.frames <= FRAME_LIMIT:
        return None
    if stream.duration and stream.average_rate:
        lasting = float(stream.duration * stream.time_base * stream.average_rate)
        if abs(lasting / stream.frames - 1) > 0.01 and abs(lasting - stream.frames) > 1:
            return None
    return int(stream.frames)


def _total(promised: int | None, found: int, stop: int | None) -> int | None:
    if promised is None:
        return None if found == stop else found
    return max(promised, found)


def _lost(promised: int, found: int, damage: str, stop: int | None) -> int:
    wanted = promised if stop is None else min(promised, stop)
    return max(wanted - found, 1 if damage else 0)


def _notes(
    stream: Any, found: int, lost: int, damage: str, orientation: Orientation
) -> tuple[str, ...]:
    notes = []
    if orientation.mirrored:
        notes.append(
            "is marked to be shown as a mirror image, and is used so; the person's left and right "
            "are as shown"
        )
    if damage:
        notes.append(f"decoding broke off ({damage}); the {found} frames before that are used")
    elif lost > 0:
        promised = found + lost
        notes.append(f"is cut short: it promises {promised} frames, the {found} there are are used")
    ratio = stream.sample_aspect_ratio
    if ratio and ratio != 1:
        notes.append(
            f"pixels are not square ({ratio}); frames are used as stored, not stretched: calibrate "
            "them so, or stretch the video first (ffmpeg -vf scale=iw*sar:ih,setsar=1)"
        )
    return tuple(notes)


def seconds(index: VideoIndex) -> NDArray[np.float64]:
    """Times of the frames from the first, (F,), seconds."""
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
    steps = np.diff(times)
    middle = float(np.median(steps))  # none where most frames have one time
    kind, rate = ("median", 1 / middle) if middle > 0 else ("average", average)
    note = (
        f"has a variable frame rate (steps of {steps.min() * 1e3:.1f} to {steps.max() * 1e3:.1f} "
        f"ms); frames are used as stored, at the {kind} rate of {rate:.2f} a second"
    )
    return rate, [note]


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
