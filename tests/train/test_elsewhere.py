"""People before other backgrounds: they stay, what is behind them goes."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from perfcap.train.backgrounds import Backgrounds
from perfcap.train.body_parts import PARTS, UNKNOWN
from perfcap.train.config import Augmentation
from perfcap.train.crop_batches import elsewhere
from perfcap.train.scenes import Shot

ALWAYS = Augmentation(moved=1.0, camouflaged=0.0)


@pytest.fixture
def backgrounds(tmp_path: Path) -> Backgrounds:
    noise = np.random.default_rng(0).integers(0, 40, (96, 96, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "dark.png"), noise)
    return Backgrounds(tmp_path)


def somebody() -> Shot:
    """A bright square before a grey wall."""
    image = np.full((96, 96, 3), 128, np.uint8)
    image[24:72, 32:64] = (250, 210, 200)
    parts = np.zeros((24, 24), np.uint8)
    parts[6:18, 8:16] = PARTS.index("trunk_front")
    return Shot(
        image, np.zeros((16, 2), np.float32), np.zeros((16, 3), np.float32), 80.0, True, parts
    )


def test_people_stay_and_what_is_behind_goes(backgrounds: Backgrounds) -> None:
    for seed in range(6):
        shot = somebody()
        moved = elsewhere(shot, backgrounds, ALWAYS, np.random.default_rng(seed))
        assert (moved.image[32:64, 40:56] == shot.image[32:64, 40:56]).all()
        around = np.concatenate([moved.image[:14].ravel(), moved.image[82:].ravel()])
        assert around.mean() < 60 and around.std() > 3
        assert moved.parts is shot.parts and (shot.image[0] == 128).all()
        again = elsewhere(shot, backgrounds, ALWAYS, np.random.default_rng(seed))
        assert np.array_equal(moved.image, again.image)


def test_a_background_may_have_the_colours_of_the_person(backgrounds: Backgrounds) -> None:
    hidden = replace(ALWAYS, camouflaged=1.0)
    moved = elsewhere(somebody(), backgrounds, hidden, np.random.default_rng(1))
    np.testing.assert_allclose(moved.image[:14].mean((0, 1)), (250, 210, 200), atol=12)


def test_nothing_moves_without_leave_or_without_a_map(backgrounds: Backgrounds) -> None:
    shot, rng = somebody(), np.random.default_rng(2)
    assert elsewhere(shot, backgrounds, replace(ALWAYS, moved=0.0), rng) is shot
    photograph = replace(shot, parts=np.full_like(shot.parts, UNKNOWN))
    assert elsewhere(photograph, backgrounds, ALWAYS, rng) is photograph
