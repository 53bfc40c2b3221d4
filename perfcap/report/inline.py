"""A result inside a notebook."""

from __future__ import annotations

import html
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from perfcap.errors import InputError
from perfcap.pipeline.performance import Performance
from perfcap.report.make import Wanted, build_page
from perfcap.report.sources import Places


def show(
    result: Performance | str | Path,
    videos: Sequence[str | Path] = (),
    cameras: str | Path | None = None,
    *,
    height: int = 720,
) -> Any:
    """The page of ``perfcap report`` below a notebook's cell, to turn and to play.

    Args:
        result: of a capture, or the folder of one; nothing is written there.
        videos: one a view, to be seen behind the motion; those that a folder names otherwise.
        cameras: their calibration, likewise.
        height: of the picture, px.

    Raises:
        InputError: this is no notebook, or the result cannot be read.
    """
    try:
        display: Any = import_module("IPython.display")
    except ImportError as error:
        raise InputError("show is for notebooks; perfcap view opens a folder") from error
    places = Places(
        tuple(Path(each) for each in videos), None if cameras is None else Path(cameras)
    )
    with TemporaryDirectory() as scratch:
        folder = Path(scratch) / "capture" if isinstance(result, Performance) else Path(result)
        if isinstance(result, Performance):
            result.save(folder)
        page = build_page(folder, Wanted(places=places))
    style = f'allow="fullscreen" style="width: 100%; height: {int(height)}px; border: 0"'
    return display.HTML(f'<iframe title="perfcap" {style} srcdoc="{html.escape(page)}"></iframe>')
