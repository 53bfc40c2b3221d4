"""What the images say about the surface: masks, their contours, and how far to trust them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.io.journal import Record
from perfcap.pipeline.checkpoint import Codec
from perfcap.segment import Contour, FrameReport, Silhouettes, extract_contour

Mask = NDArray[np.bool_]

_FULL = 255  # a confidence of 1, as it is kept
AGREES = 0.86  # overlap with a network that is enough
_UNUSUAL = 0.04  # what is below the usual overlap with a network
_LEAST = 0.01  # what an overlap or a confidence lacks at least
_UNLIKE, _UNSURE, _ODD = 0.26, 0.35, 0.19  # see ``Evidence.odd``
_ENOUGH = 8  # frames that tell what is usual


@dataclass(frozen=True)
class MaskRecord:
    """One frame and view.

    Attributes:
        png: the encoded mask.
        confidence: of the points of the mask's contour, uint8.
        report: what the segmentation relied on.
    """

    png: bytes
    confidence: NDArray[np.uint8]
    report: FrameReport


@dataclass(frozen=True)
class Evidence:
    """Silhouettes of a clip with what is known about them; a few kilobytes a frame and view.

    Attributes:
        silhouettes: F frames of C views; of several people they show one.
        confidence: of the points of each mask's contour, uint8, ``[frame][view]``.
        reports: what each segmentation relied on, ``[frame][view]``.
        pixel_unit: one percent of the person's height in each view, (C,), pixels of the masks.
    """

    silhouettes: Silhouettes
    confidence: tuple[tuple[NDArray[np.uint8], ...], ...]
    reports: tuple[tuple[FrameReport, ...], ...]
    pixel_unit: Tensor

    @classmethod
    def collect(
        cls, views: Sequence[Sequence[MaskRecord]], heights: Tensor, person: int | None = None
    ) -> Self:
        """From records ``[view][frame]`` and the person's height in each view, (C,) px.

        Of several people in the same pictures, ``person`` says whose they are: a label from 1 on.
        """
        rows = list(zip(*views, strict=True))
        return cls(
            Silhouettes(tuple(tuple(record.png for record in row) for row in rows), person),
            tuple(tuple(record.confidence for record in row) for row in rows),
            tuple(tuple(record.report for record in row) for row in rows),
            0.01 * heights,
        )

    @property
    def heights(self) -> list[float]:
        """Height of the upright person in each view, C numbers, px."""
        heights: list[float] = (100 * self.pixel_unit).tolist()
        return heights

    def record(self, frame: int, view: int) -> MaskRecord:
        """What is kept of a frame and view; of several people, with the PNG of everybody."""
        png = self.silhouettes.encoded[frame][view]
        return MaskRecord(png, self.confidence[frame][view], self.reports[frame][view])

    def masks(self, frame: int) -> list[Mask]:
        """The person in every view, (H, W) each."""
        return [self.silhouettes.mask(frame, view) for view in range(self.silhouettes.views)]

    def unknown(self, frame: int) -> list[Mask] | None:
        """Where somebody else is seen, who may hide the person; None if one person is known."""
        if self.silhouettes.person is None:
            return None
        return [self.silhouettes.others(frame, view) for view in range(self.silhouettes.views)]

    def contours(self, frame: int) -> list[Contour]:
        """The masks' contours in every view, with their confidence."""
        pairs = zip(self.masks(frame), self.confidence[frame], strict=True)
        return [contour_of(*pair) for pair in pairs]

    @property
    def agreement(self) -> NDArray[np.float64]:
        """Overlap of each frame's masks with those of a network, least of the views, (F,).

        NaN where none was asked.
        """
        found = np.array([[report.agreement for report in row] for row in self.reports])
        filled = np.where(np.isnan(found), np.inf, found).min(1, initial=np.inf)
        return np.where(np.isinf(filled), np.nan, filled)

    @property
    def doubtful(self) -> NDArray[np.int64]:
        """Frames whose mask may be wrong: a network contradicts it, and not as it always does.

        Thresholds were chosen on masks of ``dev_tight``, ``dev_skirt`` and ``dev_coat``.
        """
        agreement = self.agreement
        if np.isnan(agreement).all():
            return np.zeros(0, np.int64)
        return np.flatnonzero(agreement < min(AGREES, self.usual_agreement - _UNUSUAL))

    @property
    def beside(self) -> NDArray[np.int64]:
        """Frames with a known mask that lies beside the captured body."""
        return np.flatnonzero([any(report.beside for report in row) for row in self.reports])

    def odd(self, overlap: NDArray[np.float64]) -> NDArray[np.int64]:
        """Frames whose mask is less sure, and less like the posed body, than is usual in the clip.

        Args:
            overlap: of masks and the posed body, (F,).

        The weights of both logarithms are those that ``experiments/mask_doubt.py`` learns from
        clips of other people in other places, the limit names one good mask in twenty there.
        """
        known = np.array([any(r.person and not r.given for r in row) for row in self.reports], bool)
        if known.sum() < _ENOUGH:
            return np.zeros(0, np.int64)
        sure = np.array([[_mean(trust) for trust in row] for row in self.confidence])
        unsure = _above_usual(1 - sure, known).max(-1)
        score = _UNLIKE * _above_usual(1 - overlap, known) + _UNSURE * unsure
        return np.flatnonzero(known & (score > _ODD))

    @property
    def usual_agreement(self) -> float:
        """Median overlap of the frames' masks with those of a network; NaN where none was asked."""
        agreement = self.agreement
        return float("nan") if np.isnan(agreement).all() else float(np.nanmedian(agreement))

    def report(self, first_frame: int = 0) -> dict[str, Any]:
        """What there is to say about the masks, as plain values."""
        rows = list(enumerate(self.reports, first_frame))
        agreement = self.agreement
        known = {} if np.isnan(agreement).all() else {"mask_agreement": _rounded(agreement)}
        return {
            **known,
            "given_masks": [frame for frame, row in rows if any(r.given for r in row)],
            "doubtful_masks": (self.doubtful + first_frame).tolist(),
            "scene_cuts": [frame for frame, row in rows if any(r.cut for r in row)],
            "nobody_in_view": [
                frame for frame, row in rows if not any(r.person or r.given for r in row)
            ],
            "cropped": [frame for frame, row in rows if any(r.cropped for r in row)],
            "blank_images": [frame for frame, row in rows if any(r.blank for r in row)],
            "no_contour": [
                frame
                for (frame, row), trust in zip(rows, self.confidence, strict=True)
                if any(r.person or r.given for r in row) and not any(map(len, trust))
            ],
            "mask_confidence": [
                round(float(np.mean([_mean(trust) for trust in row])), 3) for row in self.confidence
            ],
        }


def _above_usual(lack: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Logarithm of what is lacking (F, ...) over its median in known frames."""
    found: NDArray[np.float64] = np.log(np.maximum(lack, _LEAST))
    return found - np.median(found[known], 0)


def _rounded(values: NDArray[np.float64]) -> list[float | None]:
    return [None if np.isnan(value) else round(float(value), 3) for value in values]


def contour_of(mask: Mask, confidence: NDArray[np.uint8]) -> Contour:
    """The contour of a mask (H, W), whose points have confidences as they are kept."""
    line = extract_contour(mask)
    return Contour(line.points, line.normals, confidence / _FULL)


def encode_confidence(confidence: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Confidence in [0, 1] in a byte each."""
    return np.rint(confidence * _FULL).astype(np.uint8)


def _mean(confidence: NDArray[np.uint8]) -> float:
    return float(confidence.mean()) / _FULL if len(confidence) else 0.0


def _pack(records: list[MaskRecord]) -> Record:
    """Masks and confidences end to end, with their lengths."""
    return {
        "reports": [asdict(record.report) for record in records],
        "sizes": [[len(record.png), len(record.confidence)] for record in records],
        "masks": np.frombuffer(b"".join(record.png for record in records), np.uint8),
        "confidence": np.concatenate([record.confidence for record in records]),
    }


def _unpack(record: dict[str, Any]) -> list[MaskRecord]:
    ends = np.cumsum(record["sizes"], axis=0)[:-1]
    masks = np.split(record["masks"], ends[:, 0])
    confidence = np.split(record["confidence"], ends[:, 1])
    rows = zip(masks, confidence, record["reports"], strict=True)
    return [
        MaskRecord(mask.tobytes(), trust, FrameReport(**report)) for mask, trust, report in rows
    ]


RECORDS = Codec(_pack, _unpack)
