"""CPU time of a capture of nothing but a video, by part, on one thread.

From the video to the solved motion, without what looks at silhouettes afterwards, and without
drawing and writing. The first capture of a process also loads kernels and does not count; it is
given apart, with imports. A part has what its functions take, without those of other parts that
they call. Decoders have threads of their own: their time goes to whoever runs meanwhile, and the
sum is that of the process. Other programs on the same cores lengthen all of it.
"""

from __future__ import annotations

import logging
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
import report
import torch
from report import Report, Table, data_folder

from perfcap.app import capture as app
from perfcap.app import capture_inputs, inputs, true_views
from perfcap.app.auto_actor import Cast
from perfcap.app.capture import run_capture
from perfcap.commands.capture import Capture
from perfcap.detect.lifter import OnnxLifter
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.people import OnnxFinder
from perfcap.detect.session import Session
from perfcap.io.actor import models_folder
from perfcap.io.video import VideoFile
from perfcap.pipeline import move

_AIM = 60  # ms a frame
_IMPORTS = "import time, perfcap.app.capture; print(time.process_time())"
_REST, _WRITING, _ALL = "rest", "drawing and writing, not counted", "together"
_PARTS: tuple[tuple[Any, str, str], ...] = (
    (VideoFile, "__init__", "video: indexed"),
    (VideoFile, "read", "video: frames read"),
    (OnnxDetector, "__init__", "networks opened"),
    (OnnxFinder, "__init__", "networks opened"),
    (OnnxLifter, "__init__", "networks opened"),
    (inputs, "detect_clip", "following, crops, decoding of maps"),
    (OnnxLifter, "__call__", "lifter, features and turns"),
    (true_views, "camera_moves", "checks: camera at rest"),
    (true_views, "find_motion", "a camera that moves"),
    (true_views, "find_up", "checks: gravity"),
    (capture_inputs, "examined", "checks: doctor"),
    (true_views, "solve_lens", "lens"),
    (app, "cast", "body"),
    (move, "prepare", "solve: each frame"),
    (move, "initialize", "solve: each frame"),
    (move, "track_twice", "solve: windows, twice"),
    (move, "result_doubts", "trust"),
    (move, "judge_motion", "trust"),
    (app, "write_result", _WRITING),
    (app, "_save_detections", _WRITING),
    (Cast, "save", _WRITING),
)


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight",)
    """Of the rendered set."""
    demo: bool = True
    """Whether the shipped clip is captured too."""
    frames: int = 100
    """First frames of these."""
    longer: tuple[str, ...] = ("sports2d_demo/demo.mp4",)
    """Videos in the folder of the recordings that are captured whole."""
    detector: tuple[str, ...] = ()
    """Networks as of ``perfcap capture --detector``; its own if none is named."""
    repeats: int = 3
    """Captures whose median counts."""


@dataclass
class Clocks:
    """CPU seconds of parts, each without the parts inside it."""

    spent: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    inside: list[str] = field(default_factory=lambda: [_REST])
    since: float = field(default_factory=time.process_time)

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Time goes to this part, except that of others inside."""
        self._turn()
        self.inside.append(name)
        try:
            yield
        finally:
            self._turn()
            self.inside.pop()

    def _turn(self) -> None:
        now = time.process_time()
        self.spent[self.inside[-1]] += now - self.since
        self.since = now

    def around(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        """The function with its time in a part; a session's is named after its network."""

        def timed(*args: Any, **options: Any) -> Any:
            own = name or f"network: {args[0].path.parent.name}"
            with self.part(own):
                return function(*args, **options)

        return timed


def run(config: Experiment) -> Report:
    """Time every clip."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    logging.disable(logging.WARNING)
    clips = list(_clips(config))
    captured = partial(_captured, detector=config.detector)
    first = captured(clips[0])
    runs = [_medians([captured(clip) for _ in range(config.repeats)], clip) for clip in clips]
    columns = ("part", *(f"{clip.name}, {clip.frames} frames" for clip in clips))
    table = Table("CPU ms a frame", columns, tuple(_rows(runs)))
    start = _start(first, runs[0], clips[0].frames)
    note = f"medians of {config.repeats} captures; the aim is {_AIM} ms a frame of 720p"
    return Report((table, start), (note,))


@dataclass(frozen=True)
class Clip:
    """The first frames of a video."""

    name: str
    path: Path
    frames: int


def _clips(config: Experiment) -> Iterator[Clip]:
    known = [data_folder(config.data, "rendered", name) for name in config.sequences]
    for folder in (*known, *([models_folder() / "demo"] if config.demo else [])):
        path = folder / "video.mp4"
        yield Clip(folder.name, path, min(config.frames, len(VideoFile(path))))
    for name in config.longer:
        path = data_folder(config.data, *Path(name).parts[:-1]) / Path(name).name
        yield Clip(path.parent.name, path, len(VideoFile(path)))


def _captured(clip: Clip, detector: tuple[str, ...] = ()) -> dict[str, float]:
    """CPU seconds of each part of a capture."""
    clocks = Clocks()
    with ExitStack() as stack:
        for owner, name, part in (*_PARTS, (Session, "run", "")):
            timed = clocks.around(getattr(owner, name), part)
            stack.enter_context(mock.patch.object(owner, name, timed))
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        request = Capture(
            videos=(clip.path,),
            out=Path(folder) / "out",
            detector=detector,
            frames=f"0:{clip.frames}",
            until="track_motion",
            overlay=False,
        )
        clocks.since = time.process_time()
        with clocks.part(_REST):
            run_capture(request)
    return dict(clocks.spent)


def _medians(runs: list[dict[str, float]], clip: Clip) -> dict[str, float]:
    """Milliseconds a frame of each part, and of all that counts."""
    parts = dict.fromkeys(name for each in runs for name in each)
    found = {name: 1e3 * _median(runs, [name]) / clip.frames for name in parts}
    counted = [name for name in parts if name != _WRITING]
    return {**found, _ALL: 1e3 * _median(runs, counted) / clip.frames}


def _median(runs: list[dict[str, float]], names: list[str]) -> float:
    return float(np.median([sum(each.get(name, 0.0) for name in names) for each in runs]))


def _rows(runs: list[dict[str, float]]) -> Iterator[tuple[object, ...]]:
    """A row for each part in the order of the table above, networks after the video's."""
    seen = {name for each in runs for name in each}
    order = dict.fromkeys(part for _, _, part in _PARTS if part != _WRITING)
    networks = sorted(name for name in seen if name.startswith("network: "))
    for name in (*order, *networks, _REST, _ALL, _WRITING):
        yield (name, *(each.get(name, 0.0) for each in runs))


def _start(first: dict[str, float], later: dict[str, float], frames: int) -> Table:
    """What a process takes once, in seconds."""
    told = subprocess.run(
        [sys.executable, "-c", _IMPORTS], capture_output=True, text=True, check=True
    )
    whole = sum(value for name, value in first.items() if name != _WRITING)
    rows = (
        ("imports", float(told.stdout)),
        ("the first capture, which also loads kernels", whole),
        ("later captures of it", later[_ALL] * frames / 1e3),
        ("of these, networks opened", later["networks opened"] * frames / 1e3),
    )
    return Table("what a process takes once, CPU s", ("part", "s"), rows, 2)


if __name__ == "__main__":
    report.main(run, Experiment, "video_speed")
