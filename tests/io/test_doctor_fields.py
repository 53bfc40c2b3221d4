"""Interlaced videos are named, and others are not."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from video_files import picture, write_frames

from perfcap.io import models_folder
from perfcap.io.clip import Clip
from perfcap.io.doctor.fields import examine_fields
from perfcap.io.doctor.inputs import examine_inputs

DEMO = models_folder() / "demo"
FRAMES = 40


def interlaced(pictures: np.ndarray) -> np.ndarray:
    """Odd lines are those of the next picture."""
    woven = pictures[:-1].copy()
    woven[:, 1::2] = pictures[1:, 1::2]
    return woven


@pytest.fixture(scope="module")
def pictures() -> np.ndarray:
    return Clip.open(DEMO / "video.mp4", frames=slice(0, FRAMES)).read_view(0, 0, FRAMES)


def written(path: Path, pictures: np.ndarray, crf: str = "18") -> Clip:
    frames = [(each, k) for k, each in enumerate(pictures)]
    write_frames(path, frames, Fraction(1, 30), {"crf": crf, "preset": "ultrafast"})
    return Clip.open(path)


@pytest.mark.long
@pytest.mark.parametrize("crf", ["5", "23"])
def test_two_moments_in_a_frame(tmp_path: Path, pictures: np.ndarray, crf: str) -> None:
    clip = written(tmp_path / "a.mp4", interlaced(pictures), crf)
    (told,) = examine_fields(clip, clip.names)
    assert told.subject == "a" and "is interlaced" in told.what and "bwdif" in told.remedy


def test_doctor_says_so(tmp_path: Path, pictures: np.ndarray) -> None:
    written(tmp_path / "video.mp4", interlaced(pictures))
    told = examine_inputs(DEMO / "camera.json", videos=[tmp_path / "video.mp4"])
    assert sum("is interlaced" in each.what for each in told) == 1


@pytest.mark.long
def test_noise_of_whole_frames(tmp_path: Path, pictures: np.ndarray) -> None:
    """As of a sensor in the dark: single lines stand out, and single columns as often."""
    random = np.random.default_rng(0)
    noise = random.normal(0, 14, pictures.shape[:3])[..., None]
    grainy = (pictures + noise).clip(0, 255).astype(np.uint8)
    assert examine_fields(written(tmp_path / "n.mp4", grainy, "5"), ["n"]) == []


@pytest.mark.long
def test_whole_frames(tmp_path: Path, pictures: np.ndarray) -> None:
    """As filmed; blended of two moments; with lines that stand still; too short to say."""
    whole = Clip.open(DEMO / "video.mp4")
    assert examine_fields(whole, whole.names) == []
    blended = ((pictures[1:].astype(int) + pictures[:-1]) // 2).astype(np.uint8)
    assert examine_fields(written(tmp_path / "b.mp4", blended), ["b"]) == []
    striped = pictures.copy()
    striped[:, 1::2, :200] = 255
    assert examine_fields(written(tmp_path / "c.mp4", striped), ["c"]) == []
    assert examine_fields(written(tmp_path / "d.mp4", picture(0)[None]), ["d"]) == []
