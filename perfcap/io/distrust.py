"""What a capture said of its own frames, for whoever makes something else of them."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate
from typing import Any

from perfcap.io.doctor.finding import ranges

_SOURCE = "captured"  # in run.json of what was made of a capture


def distrust(report: Mapping[str, Any], frames: Iterable[int]) -> tuple[str, ...]:
    """What to say of frames that were made up or are not to be trusted.

    Args:
        report: of the capture, the content of its ``run.json``; what is no such list says nothing.
        frames: numbers of those that are used, as the video counts.
    """
    made_up, doubted, whole = _said(report)
    if doubted is None and not whole:
        return ("the capture itself is not to be trusted in many frames; see its run.json",)
    kinds = (
        (made_up, "show no person and are made up from those beside them"),
        (doubted or [], "are not to be trusted"),
    )
    used = sorted({int(frame) for frame in frames})
    said = [
        f"frames {ranges(found)} {words}"
        for known, words in kinds
        if (found := _within(known, used))
    ]
    return (f"as the capture said, {', and '.join(said)}",) if said else ()


def kept(report: Mapping[str, Any]) -> dict[str, Any]:
    """What `distrust` reads of a report, under the key by which another report passes it on."""
    made_up, doubted, whole = _said(report)
    spans = None if doubted is None else [{"frames": span} for span in doubted]
    return {_SOURCE: {"not_captured": made_up, "quality": {"not_trusted": spans, "trusted": whole}}}


def _said(report: Mapping[str, Any]) -> tuple[list[Any], list[Any] | None, bool]:
    """Stretches made up; those not to be trusted, None if not known; whether the whole is."""
    source = report.get(_SOURCE)
    report = source if isinstance(source, dict) else report
    quality = report.get("quality")
    quality = quality if isinstance(quality, dict) else {}
    doubted = quality.get("not_trusted")
    spans = [each.get("frames") for each in _list(doubted) if isinstance(each, dict)]
    known = None if doubted is None else spans
    return _list(report.get("not_captured")), known, quality.get("trusted") is not False


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _within(spans: Iterable[Any], used: Sequence[int]) -> list[int]:
    """Those of increasing numbers that lie in a stretch, from its first to before its last."""
    change = [0] * (len(used) + 1)
    for span in spans:
        if isinstance(span, list) and len(span) == 2 and all(type(each) is int for each in span):
            start, stop = (bisect_left(used, each) for each in span)
            if start < stop:
                change[start] += 1
                change[stop] -= 1
    return [frame for frame, depth in zip(used, accumulate(change), strict=False) if depth > 0]
