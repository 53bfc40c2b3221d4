"""What people film: lamps, passers-by, mirrors. Masks get worse, and stay better than the model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from disc_scene import SIZE, DiscClip, disc_clip, overlap
from numpy.typing import NDArray

from perfcap.segment.scene import survey
from perfcap.segment.sequence import Footage, segment_block

Images = NDArray[np.uint8]
FRAMES = 15


def lamp(clip: DiscClip) -> Images:
    """Switched on half way, on the left."""
    light = np.ones((FRAMES, 1, SIZE, 1))
    light[FRAMES // 2 :] = np.linspace(1.6, 1.0, SIZE)[:, None]
    return np.clip(clip.images * light, 0, 255).astype(np.uint8)


def mirror(clip: DiscClip) -> Images:
    """The person's image comes towards them, and is behind them in the middle of the clip."""
    images = clip.images.copy()
    for image, whole, person in zip(images, clip.images, clip.truth, strict=True):
        shown = person[:, ::-1] & ~person
        image[shown] = whole[:, ::-1][shown]
    return images


def passer(clip: DiscClip) -> Images:
    """Somebody in other clothes passes behind, and they cover each other in part."""
    other = disc_clip(FRAMES, seed=4, speed=-6.0, person=((20, 60, 160), (90, 140, 250)))
    images = clip.images.copy()
    for frame, person in enumerate(clip.truth):
        shown = np.roll(other.truth[frame], -20, 0) & ~person
        images[frame][shown] = np.roll(other.images[frame], -20, 0)[shown]
    return images


@pytest.mark.long
@pytest.mark.parametrize(
    ("spoil", "least", "typical"),
    [(lamp, 0.90, 0.93), (mirror, 0.87, 0.92), (passer, 0.91, 0.95)],
    ids=["lamp", "mirror", "passer"],
)
def test_masks_stay_better_than_the_model(
    spoil: Callable[[DiscClip], Images], least: float, typical: float
) -> None:
    clip = disc_clip(FRAMES)
    images, wanted = spoil(clip), range(1, FRAMES - 1)
    footage = Footage(images, clip.models, clip.bones)
    found = segment_block(footage, wanted, survey(images, clip.models))
    shares = [overlap(each.mask, clip.truth[i]) for i, each in zip(wanted, found, strict=True)]
    assert overlap(clip.models[1], clip.truth[1]) < 0.84
    assert min(shares) > least and np.median(shares) > typical


def test_five_frames_are_a_clip() -> None:
    clip = disc_clip(5)
    scene = survey(clip.images, clip.models)
    assert scene.plate is not None
    found = segment_block(Footage(clip.images, clip.models, clip.bones), range(5), scene)
    assert min(overlap(each.mask, clip.truth[i]) for i, each in enumerate(found)) > 0.94
