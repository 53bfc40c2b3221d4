"""What a capture said of its own frames, for whoever makes something else of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from perfcap.io.doctor.finding import ranges


def distrust(report: Mapping[str, Any], start: int, stop: int) -> tuple[str, ...]:
    """What to say of frames ``start`` to ``stop`` that were made up or are not to be trusted.

    Args:
        report: of the capture, the content of its ``run.json``; what is no such list says nothing.
        start: number of the first frame that is used, as the video counts.
        stop: number behind the last one.
    """
    quality = report.get("quality")
    doubted = quality.get("not_trusted") if isinstance(quality, dict) else None
    spans = [each.get("frames") for each in _list(doubted) if isinstance(each, dict)]
    kinds = (
        (_list(report.get("not_captured")), "show nobody and are made up from those beside them"),
        (spans, "are not to be trusted"),
    )
    if doubted is None and isinstance(quality, dict) and quality.get("trusted") is False:
        return ("the capture itself is not to be trusted in many frames; see its run.json",)
    said = []
    for known, words in kinds:
        frames = sorted({f for span in known for f in _within(span, start, stop)})
        said += [f"frames {ranges(frames)} {words}"] if frames else []
    return (f"as the capture said, {', and '.join(said)}",) if said else ()


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _within(span: Any, start: int, stop: int) -> Iterator[int]:
    """Frames of a stretch, first and behind the last, that are used."""
    if isinstance(span, list) and len(span) == 2 and all(type(each) is int for each in span):
        yield from range(max(start, span[0]), min(stop, span[1]))
