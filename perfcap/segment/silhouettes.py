"""The silhouettes of a clip, held compressed."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.segment.recent_labels import RecentLabels
from perfcap.segment.trimap import Mask

Labels = NDArray[np.uint8]

_WHITE = 255  # of masks in bytes
_LARGEST = 1 << 14  # px, longest side that is unpacked here

_SETTINGS = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
if hasattr(cv2, "IMWRITE_PNG_FILTER"):  # not in OpenCV 4.10; labels are runs without a filter
    _SETTINGS += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]


@dataclass(frozen=True)
class Silhouettes:
    """Labels of every pixel of F frames in C views: 0 background, k the k-th person.

    A few kilobytes a frame and view are kept, as PNG; labels are decoded when asked for, and those
    of some frames are remembered.

    Attributes:
        encoded: PNG of each frame and view, ``[frame][view]``.
        person: the only person shown, as 1; everybody if None.
    """

    encoded: tuple[tuple[bytes, ...], ...]
    person: int | None = None
    _recent: RecentLabels = field(default_factory=RecentLabels, repr=False, compare=False)

    @classmethod
    def collect(cls, frames: Iterable[Sequence[Labels | Mask]]) -> Silhouettes:
        """Compress labels or masks (H, W), one a view, frame by frame as they come.

        Raises:
            InputError: pictures of another kind, frames of different numbers of views, views whose
                pictures change their size, or masks of bytes, in which 255 is no 255th person.
        """
        seen = _Seen()
        encoded = tuple(
            tuple(encode_labels(seen.checked(labels, view)) for view, labels in enumerate(views))
            for views in frames
        )
        if len({len(views) for views in encoded}) > 1:
            raise InputError("silhouettes: frames have different numbers of views, expected one")
        return cls(encoded)

    def __len__(self) -> int:
        return len(self.encoded)

    @property
    def views(self) -> int:
        """C."""
        return len(self.encoded[0]) if self.encoded else 0

    @property
    def size_bytes(self) -> int:
        """Memory held."""
        return sum(len(png) for views in self.encoded for png in views)

    def of(self, person: int) -> Silhouettes:
        """One person alone, labelled 1.

        Raises:
            InputError: not a label of a person.
        """
        if not 1 <= person <= 255 or (self.person is not None and person != 1):
            raise InputError(f"person: is {person}, expected a label from 1 on")
        return self if self.person is not None else replace(self, person=person)

    def labels(self, frame: int, view: int = 0) -> Labels:
        """(H, W) uint8."""
        labels = self._all(frame, view)
        return labels if self.person is None else (labels == self.person).astype(np.uint8)

    def mask(self, frame: int, view: int = 0, person: int = 1) -> Mask:
        """Where one person is, (H, W)."""
        mask: Mask = self.labels(frame, view) == person
        return mask

    def others(self, frame: int, view: int = 0) -> Mask:
        """Where anybody but the person shown is, (H, W); nowhere if everybody is shown."""
        labels = self._all(frame, view)
        elsewhere: Mask = (labels > 0) & (labels != self.person) & (self.person is not None)
        return elsewhere

    def _all(self, frame: int, view: int) -> Labels:
        return self._recent.labels(self.encoded[frame][view], decode_labels)

    def png(self, view: int = 0) -> Iterator[bytes]:
        """Files of a view's frames in order, as they are to be written."""
        for frame in range(len(self)):
            if self.person is None:
                yield self.encoded[frame][view]
            else:
                yield encode_labels(self.labels(frame, view))


class _Seen:
    """What the pictures of a clip are like, from the first on."""

    def __init__(self) -> None:
        self.sizes: dict[int, tuple[int, ...]] = {}

    def checked(self, labels: Labels | Mask, view: int) -> Labels | Mask:
        """The same, refused where it has another size than the view's first, or is a mask of
        bytes.
        """
        size = self.sizes.setdefault(view, labels.shape)
        if labels.shape != size:
            raise InputError(
                f"silhouettes of view {view}: have {labels.shape} rows and columns after {size}; "
                "expected one size in all frames, as [frame][view]"
            )
        if labels.dtype == np.uint8 and labels.max(initial=0) == _WHITE:
            raise InputError(
                f"silhouettes of view {view}: hold {_WHITE}, expected 0 for the background and k "
                "for the k-th person: compare masks of bytes, as mask > 127"
            )
        return labels


def encode_labels(labels: Labels | Mask) -> bytes:
    """Labels or a mask (H, W) as PNG."""
    if labels.ndim != 2 or labels.dtype not in (np.uint8, np.bool_) or not labels.size:
        raise InputError(
            f"labels: are {labels.dtype} {labels.shape}, expected uint8 or bool (H, W)"
        )
    done, data = cv2.imencode(".png", labels.astype(np.uint8), _SETTINGS)
    assert done
    return data.tobytes()


def decode_labels(png: bytes) -> Labels:
    """Labels (H, W) of a PNG."""
    found = _unfiltered(png)
    if found is not None:
        return found
    labels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE)
    return np.asarray(labels, np.uint8)


def _unfiltered(png: bytes) -> Labels | None:
    """Labels of a grey PNG whose rows are as they are, as ours are, in less than half the time."""
    width, height = (int.from_bytes(png[at : at + 4], "big") for at in (16, 20))
    if png[12:16] != b"IHDR" or png[24:29] != b"\x08\0\0\0\0" or max(width, height) > _LARGEST:
        return None
    unpack, rows, at = zlib.decompressobj(), b"", 33
    try:
        while at < len(png) and len(rows) <= height * (width + 1):
            size = int.from_bytes(png[at : at + 4], "big")
            if png[at + 4 : at + 8] == b"IDAT":
                rows += unpack.decompress(png[at + 8 : at + 8 + size], height * (width + 1) + 1)
            at += size + 12
    except zlib.error:
        return None
    if len(rows) != height * (width + 1):
        return None
    table = np.frombuffer(rows, np.uint8).reshape(height, width + 1)
    return None if table[:, 0].any() else np.ascontiguousarray(table[:, 1:])
