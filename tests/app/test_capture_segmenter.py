"""``perfcap capture --segmenter``: which network is asked, and which calls are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from runs import Command
from takes import TakeFiles

from perfcap.app.capture_request import segmenter_of, used_files
from perfcap.commands.capture import Capture
from perfcap.errors import InputError
from perfcap.io import models_folder

SHIPPED = models_folder() / "detectors" / "blazepose" / "segmenter.toml"


def request(**options: Any) -> Capture:
    return Capture(videos=(Path("a.mp4"),), out=Path("out"), **options)


def test_the_shipped_one_is_asked_and_read() -> None:
    assert segmenter_of(request()) == SHIPPED
    assert SHIPPED in used_files(request(), [])


@pytest.mark.parametrize(
    "options",
    [
        {"segmenter": "none"},
        {"preset": "monoperfcap"},
        {"preset": "rhodin2016"},
        {"until": "track_motion"},
    ],
)
def test_nobody_asks_it(options: dict[str, str]) -> None:
    assert segmenter_of(request(**options)) is None


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("deeplab", "no such folder; expected one with manifest.toml, or blazepose"),
        ("mask.onnx", "is a network without its manifest"),
    ],
)
def test_networks_that_are_not_there(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        segmenter_of(request(segmenter=name))


def test_another_kind_of_network_is_refused(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    wrong = models_folder() / "detectors" / "thunder"
    options = ("--segmenter", wrong, "--until", "refine_pose", "--no-overlay")
    call = take.command(tmp_path / "out", *options)
    assert "give a folder of a segmenter" in perfcap(call).refused()
