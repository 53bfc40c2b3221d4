"""Views whose frames of one number were not taken at one time."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from video_files import picture, write_frames

from perfcap.errors import InputError
from perfcap.io.clip import Clip
from perfcap.io.view_times import parting

PLAIN = picture(0, 16, 16)
FILM = Fraction(30000, 1001)  # frames a second


def video(path: Path, rate: Fraction | int, frames: int, tick: Fraction | None = None) -> Path:
    """Frames at a constant rate, their times rounded to ticks."""
    tick = tick or 1 / Fraction(rate)
    times = [round(i / Fraction(rate) / tick) for i in range(frames)]
    write_frames(path, [(PLAIN, time) for time in times], tick)
    return path


def test_views_that_part_are_named(tmp_path: Path) -> None:
    paths = [
        video(tmp_path / "phone.mp4", 30, 600),
        video(tmp_path / "sport.mp4", Fraction(2975, 100), 600),
    ]
    (told,) = Clip.open(paths).warnings
    # frame 599 is at 19.967 s and at 20.134 s
    assert "phone 30, sport 29.75 frames a second" in told
    assert "in frame 599 they are 5.0 frames apart" in told and "-vf fps=30" in told
    (told,) = Clip.open(paths, frames=slice(200, 300)).warnings
    assert "in frame 299 they are 2.5 frames apart" in told


def test_a_short_clip_does_not_part(tmp_path: Path) -> None:
    paths = [video(tmp_path / "a.mp4", 30, 600), video(tmp_path / "b.mp4", FILM, 600)]
    assert "0.6 frames apart" in Clip.open(paths).warnings[0]
    assert not Clip.open(paths, frames=slice(0, 480)).warnings


def test_a_pause_in_one_view_is_named(tmp_path: Path) -> None:
    plain = video(tmp_path / "a.mp4", 30, 90)
    times = [i + 3 * (i > 40) for i in range(90)]
    write_frames(tmp_path / "b.mp4", [(PLAIN, time) for time in times], Fraction(1, 30))
    told = Clip.open([plain, tmp_path / "b.mp4"]).warnings
    assert "variable" in told[0] and "in frame 89 they are 3.0 frames apart" in told[1]


def test_pauses_at_different_times_are_named(tmp_path: Path) -> None:
    """The files end at one time; between the pauses their frames were taken at different ones."""
    paths = [tmp_path / "a.mp4", tmp_path / "b.mp4"]
    for path, after in zip(paths, (30, 60), strict=True):
        times = [i + 3 * (i > after) for i in range(90)]
        write_frames(path, [(PLAIN, time) for time in times], Fraction(1, 30))
    *rates, told = Clip.open(paths).warnings
    assert all("variable" in line for line in rates)
    assert "in frame 31 b and a are 3.0 frames apart" in told and "-vf fps=30" in told
    assert len(Clip.open(paths[:1] * 2).warnings) == 2  # of one camera


def test_one_odd_time_is_no_pause(tmp_path: Path) -> None:
    plain, path = video(tmp_path / "a.mp4", 30, 90), tmp_path / "b.mp4"
    write_frames(path, [(PLAIN, 4 * i + 3 * (i == 40)) for i in range(90)], Fraction(1, 120))
    assert not any("apart" in line for line in Clip.open([plain, path]).warnings)


def test_rounded_rates_are_one(tmp_path: Path) -> None:
    """Matroska has whole milliseconds, and some programs write the rate in two digits."""
    paths = [
        video(tmp_path / "a.mp4", FILM, 1200),
        video(tmp_path / "b.mkv", FILM, 1200, Fraction(1, 1000)),
        video(tmp_path / "c.mp4", Fraction(2997, 100), 1200),
    ]
    assert not Clip.open(paths).warnings


def test_long_views_that_part_are_to_be_converted_first(tmp_path: Path) -> None:
    paths = [
        video(tmp_path / "a.mp4", 30, 1000),
        video(tmp_path / "b.mp4", Fraction(2975, 100), 991),
    ]
    with pytest.raises(InputError, match="convert them to one rate, then cut them"):
        Clip.open(paths)


def test_views_most_of_whose_frames_have_one_time_are_not_compared() -> None:
    """A damaged file: its times say nothing of when frames were taken."""
    held = np.concatenate((np.zeros(20), [0.6]))
    assert parting([(held, "a"), (held, "b")]) == []
