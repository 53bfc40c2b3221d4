"""Pictures to show people before: of places, and of people or masks by mistake."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from perfcap.detect.people import OnnxFinder
from perfcap.io.actor import models_folder
from perfcap.io.video import VideoFile
from perfcap.train.background_looks import background_doubts
from perfcap.train.backgrounds import Backgrounds, procedural


@pytest.fixture(scope="module")
def finder() -> OnnxFinder:
    return OnnxFinder(models_folder() / "detectors" / "multipose")


def doubts(folder: Path, finder: OnnxFinder) -> list[str]:
    return [*background_doubts(folder, Backgrounds(folder).files, finder)]


def places(folder: Path, count: int) -> Path:
    folder.mkdir()
    for number in range(count):
        picture = procedural(200, np.random.default_rng(number))
        cv2.imwrite(str(folder / f"place{number}.jpg"), picture)
    return folder


@pytest.mark.long
def test_places_are_fine(tmp_path: Path, finder: OnnxFinder) -> None:
    assert not doubts(places(tmp_path / "places", 12), finder)


@pytest.mark.long
def test_people_are_named(tmp_path: Path, finder: OnnxFinder) -> None:
    folder = places(tmp_path / "places", 8)
    for number, frame in enumerate(VideoFile(models_folder() / "demo" / "video.mp4").read(0, 2)):
        cv2.imwrite(str(folder / f"a{number}.jpg"), np.asarray(frame)[..., ::-1])
    (said,) = doubts(folder, finder)
    assert "2 of 10 pictures that were looked at show people (a0.jpg, a1.jpg)" in said


def test_masks_and_black_pictures_are_named(tmp_path: Path, finder: OnnxFinder) -> None:
    folder = places(tmp_path / "places", 4)
    mask = np.zeros((120, 160), np.uint8)
    cv2.ellipse(mask, (70, 60), (20, 50), 0, 0, 360, 255, -1, cv2.LINE_AA)
    for name, image in (("black", 0 * mask), ("mask", mask)):
        cv2.imwrite(str(folder / f"{name}.png"), image)
    (said,) = doubts(folder, finder)
    assert "2 of 6" in said and "(black.png, mask.png); expected photographs of places" in said
