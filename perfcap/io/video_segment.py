"""H.264 in parts that are encoded on their own and put one behind the other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import av
import numpy as np
from av.codec.context import Flags
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.rates import frame_rate
from perfcap.setting_checks import require_count

Image = NDArray[np.uint8]
_WORST = 51  # quality of H.264
_PRESETS = (
    "ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow",
)  # fmt: skip


class Packet(NamedTuple):
    """An encoded frame: its bytes, its place among the frames shown, and whether it is a key."""

    data: bytes
    place: int
    key: bool


@dataclass(frozen=True)
class Segment:
    """Frames that begin with a key frame and refer to no others.

    Attributes:
        packets: in the order of decoding; places count from the segment's first frame.
        size: of the frames as given, height and width.
    """

    packets: tuple[Packet, ...]
    size: tuple[int, int]


@dataclass(frozen=True)
class Encoding:
    """How frames become H.264 (yuv420p); the same frames make the same bytes.

    Attributes:
        rate: frames a second.
        crf: quality, 0 (lossless) to 51; 17 is visually lossless.
        preset: x264's speed, ``ultrafast`` to ``veryslow``.
    """

    rate: Fraction
    crf: int = 20
    preset: str = "medium"

    @classmethod
    def at(cls, fps: float, crf: int = 20, preset: str = "medium") -> Encoding:
        """For so many frames a second.

        Raises:
            InputError: that is no rate, no quality or no speed of x264.
        """
        fps = frame_rate(fps, "fps")
        require_count(crf, "crf", least=0)
        if crf > _WORST or preset not in _PRESETS:
            raise InputError(
                f"crf is {crf} and preset {preset!r:.80}; expected 0 to {_WORST}, and one of "
                f"{', '.join(_PRESETS)}"
            )
        return cls(Fraction(fps).limit_denominator(1001), crf, preset)

    @property
    def options(self) -> Mapping[str, str]:
        """Of x264."""
        # with its tree of macroblocks x264 reads memory that nobody set: the same frames would
        # not always make the same file
        return {"crf": str(self.crf), "preset": self.preset, "x264-params": "mbtree=0"}

    def shape(self, target: Any, size: tuple[int, int]) -> None:
        """Give a stream or encoder the size of frames; yuv420p needs even sides."""
        target.height, target.width = (side + side % 2 for side in size)
        target.pix_fmt = "yuv420p"

    def segment(self, frames: Iterable[Image]) -> Segment:
        """Frames (H, W, 3), RGB, of one size; at least one.

        Raises:
            ValueError: there are none, or one is of another type or size.
        """
        encoder = Encoder(self)
        packets = [packet for frame in frames for packet in encoder.feed(frame)]
        if encoder.size is None:
            raise ValueError("no frames to encode")
        return Segment((*packets, *encoder.finish()), encoder.size)


class Encoder:
    """Frame after frame to packets; the first frame says the size of all."""

    def __init__(self, encoding: Encoding) -> None:
        self.encoding = encoding
        self.size: tuple[int, int] | None = None
        self._context: Any = None
        self._fed = 0

    def feed(self, frame: Image) -> list[Packet]:
        """The packets that are complete after a frame (H, W, 3).

        Raises:
            ValueError: it is no RGB image of bytes, or of another size than the first.
        """
        if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
            raise ValueError(
                f"frame is {frame.dtype} {frame.shape}, expected uint8 (height, width, 3)"
            )
        size = (frame.shape[0], frame.shape[1])
        if self.size is None:
            self._open(size)
        elif size != self.size:
            raise ValueError(f"frame has size {size}, the first had {self.size}")
        odd = ((0, size[0] % 2), (0, size[1] % 2), (0, 0))
        even = np.ascontiguousarray(np.pad(frame, odd, mode="edge"))
        picture = av.VideoFrame.from_ndarray(even, format="rgb24")
        picture.pts, picture.time_base = self._fed, self._context.time_base
        self._fed += 1
        return self._packets(picture)

    def finish(self) -> list[Packet]:
        """The remaining packets."""
        return [] if self._context is None else self._packets(None)

    def _packets(self, picture: Any) -> list[Packet]:
        encoded = self._context.encode(picture)
        return [Packet(bytes(each), each.pts, each.is_keyframe) for each in encoded]

    def _open(self, size: tuple[int, int]) -> None:
        self.size = size
        context: Any = av.CodecContext.create("libx264", "w")
        self.encoding.shape(context, size)
        context.options = dict(self.encoding.options)
        context.framerate, context.time_base = self.encoding.rate, 1 / self.encoding.rate
        context.flags |= Flags.global_header  # mp4 keeps the parameters once, at its head
        self._context = context
