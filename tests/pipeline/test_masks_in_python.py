"""Masks that are given in Python get the checks of ``perfcap capture --masks``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from takes import Take, TakeFiles, silhouettes, write_take

from perfcap.errors import InputError
from perfcap.pipeline.image_doubts import mask_sentences
from perfcap.pipeline.images import Images
from perfcap.pipeline.input_doubts import scene_doubts
from perfcap.pipeline.people import Person, Scene

FRAMES = 24
Masks = dict[int, np.ndarray]


@dataclass(frozen=True)
class Known:
    """Masks of frames of one view."""

    frames: Masks

    def knows(self, view: int, frame: int) -> bool:
        return frame in self.frames

    def mask(self, view: int, frame: int) -> np.ndarray | None:
        return self.frames.get(frame)


@dataclass(frozen=True)
class Painted:
    """Somebody bright before a dark wall, both with a texture."""

    shown: np.ndarray

    @classmethod
    def of(cls, masks: list[np.ndarray]) -> Painted:
        rough = np.random.default_rng(0).integers(0, 20, (*masks[0].shape, 1))
        images = [np.where(mask[..., None], 180, 40) + rough for mask in masks]
        return cls(np.repeat(np.stack(images), 3, -1).astype(np.uint8))

    def __len__(self) -> int:
        return len(self.shown)

    def read_view(self, view: int, start: int, stop: int) -> np.ndarray:
        return self.shown[start:stop]


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Take:
    files: TakeFiles = write_take(tmp_path_factory.mktemp("take"), FRAMES, size=(240, 320))
    return files.take


@pytest.fixture(scope="module")
def truth(take: Take) -> list[np.ndarray]:
    return silhouettes(take)


def said(take: Take, truth: list[np.ndarray], masks: Masks) -> str:
    person = Person(take.actor, take.detections)
    images = Images(Painted.of(truth), take.cameras, masks=Known(masks))
    scene = Scene(take.cameras, (person,), take.rate, images)
    return " ".join(mask_sentences(images, scene, take.detections))


def test_right_masks(take: Take, truth: list[np.ndarray]) -> None:
    assert said(take, truth, dict(enumerate(truth))) == ""


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda m: {f: m[max(f - 6, 0)] for f in range(FRAMES)}, "masks of view 0: look as if of"),
        (lambda m: {f: np.roll(m[f], 8, 0) for f in range(FRAMES)}, "edges of the images"),
        (lambda m: {f: ~m[f] for f in range(FRAMES)}, "% of the detected joints; expected those"),
        (lambda m: {f: m[0] for f in range(FRAMES)}, "the masks are the same in frames"),
        (lambda m: {f: m[f - 1] for f in range(1, FRAMES)}, "for 23 of 24 frames, 1 to 23"),
    ],
)
def test_wrong_masks_are_named(
    take: Take,
    truth: list[np.ndarray],
    spoil: Callable[[list[np.ndarray]], Masks],
    words: str,
) -> None:
    """They were silent in Python: surfaces follow them."""
    assert words in said(take, truth, spoil(truth))


def test_views_that_are_late_lack_images(take: Take, truth: list[np.ndarray]) -> None:
    """Nothing is missing where there is no image."""
    masks = {f: truth[f] for f in range(2, FRAMES)}
    lag = take.detections.joints2d.new_zeros(FRAMES, 1)
    lag[:2] = float("nan")
    images = Images(Painted.of(truth), take.cameras, masks=Known(masks), lag=lag)
    scene = Scene(take.cameras, (Person(take.actor, take.detections),), take.rate, images)
    assert list(mask_sentences(images, scene, take.detections)) == []


def test_images_of_other_sizes_that_no_stage_looks_at(take: Take, truth: list[np.ndarray]) -> None:
    """Nothing is refused for them, and they are said not to be those of the cameras."""
    half = Painted.of([mask[::2] for mask in truth])
    person = Person(take.actor, take.detections)
    scene = Scene(take.cameras, (person,), take.rate, Images(half, take.cameras))
    told = scene_doubts(scene, person, looked_at=False).sentences
    assert any("images of view 0 are uint8" in line for line in told)
    with pytest.raises(InputError, match="images of view 0 are uint8"):
        scene_doubts(scene, person, looked_at=True)


def test_masks_of_one_person_are_refused_for_several(take: Take, truth: list[np.ndarray]) -> None:
    """They were left aside without a word."""
    seen = take.detections
    other = replace(seen, joints2d=seen.joints2d + 40.0)
    images = Images(Painted.of(truth), take.cameras, masks=Known({}))
    people = Person(take.actor, seen), Person(take.actor, other)
    with pytest.raises(InputError, match="masks, which are of one person, and there are 2"):
        Scene(take.cameras, people, take.rate, images)
