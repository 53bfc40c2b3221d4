"""``perfcap actor frames``: a video to stills and masks."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from runs import Command

from perfcap.app.actor_frames import mask_doubts
from perfcap.segment.central_person import cut_off


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wall passes behind somebody in plain clothes."""
    folder = tmp_path_factory.mktemp("film")
    wall = np.random.default_rng(2).uniform(0, 255, (20, 90, 3)).astype(np.float32)
    wall = cv2.resize(wall, (540, 120), interpolation=cv2.INTER_CUBIC).clip(0, 255)
    for frame in range(30):
        picture = wall[:, 4 * frame : 4 * frame + 90].copy()
        picture[12:108, 34:56] = wall[:96, 400:422]
        cv2.imwrite(str(folder / f"{frame:04d}.png"), picture)
    return folder


@pytest.mark.parametrize(
    ("option", "suffix"), [("colmap", ".jpg.png"), ("plain", ".png"), ("none", None)]
)
def test_images_and_masks_are_named_as_tools_want_them(
    film: Path, tmp_path: Path, perfcap: Command, option: str, suffix: str | None
) -> None:
    out = tmp_path / "stills"
    done = perfcap(["actor", "frames", film, "--out", out, "--count", 6, "--masks", option])
    assert done.code == 0 and "6 of 30 frames" in done.out, done
    images = sorted(out.glob("images/*.jpg"))
    assert len(images) == 6
    assert cv2.imread(str(out / "preview.jpg")) is not None
    if suffix is None:
        assert not (out / "masks").exists()
        return
    for image in images:
        mask = cv2.imread(str(out / "masks" / (image.stem + suffix)), cv2.IMREAD_UNCHANGED)
        assert mask.shape == (120, 90) and set(np.unique(mask)) == {0, 255}
        assert mask[40:80, 38:52].all()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--count", "2"], "expected 3 to 1000"),
        (["--frames", "99:120"], "holds no frame"),
        (["--frames", "3:4"], "hardly any motion"),
        (["--box", "1", "2", "3"], "LEFT TOP RIGHT BOTTOM"),
        (["--box", "900", "900", "990", "990"], "holds nobody in a picture of 90x120"),
        (["--box", "-300", "-300", "300", "300"], "holds nobody in a picture"),
        (["--box", "40", "40", "41", "80"], "holds nobody in a picture"),
        (["--box", "30", "10", "60", "110", "--masks", "none"], "--box: is for masks"),
    ],
)
def test_what_cannot_be_picked_is_told(
    film: Path, tmp_path: Path, perfcap: Command, more: list[str], words: str
) -> None:
    line = perfcap(["actor", "frames", film, "--out", tmp_path / "out", *more]).refused()
    assert words in line and not (tmp_path / "out").exists()
    line = perfcap(["actor", "frames", film, "--out", film]).refused()
    assert "not an empty folder" in line


@pytest.mark.long
def test_a_box_beside_the_person_is_named(film: Path, tmp_path: Path, perfcap: Command) -> None:
    """Masks then showed a piece of the wall, or half of the person, with nothing said."""
    told = []
    for name, box in {"right": (26, 4, 64, 116), "aside": (44, 4, 84, 116)}.items():
        call = ["actor", "frames", film, "--count", 6, "--out", tmp_path / name, "--box", *box]
        done = perfcap(call)
        assert done.code == 0, done
        told.append(" ".join((done.err, *done.notes)))
    assert "masks" not in told[0] and "end at the left of the box" in told[1], told


def test_masks_of_no_whole_person_are_named() -> None:
    whole = np.zeros((100, 100), bool)
    whole[10:90, 40:60] = True
    box = (0.2, 0.05, 0.8, 0.95)
    even = dict.fromkeys(range(0, 60, 10), 0.16) | {60: 0.09, 70: 0.28}
    assert not list(mask_doubts(even, [cut_off(whole, box)] * 8))
    assert not list(mask_doubts({}, []))
    (line,) = mask_doubts(even | {80: 0.01, 90: 0.5}, [cut_off(whole, box)] * 10)
    assert "(stills 80, 90)" in line and "1.0% to 50.0%" in line
    below = cut_off(whole, (0.2, 0.05, 0.8, 0.6))
    assert {side for side, share in below.items() if share} == {"bottom"}
    (line,) = mask_doubts(even, [below] * 8)
    assert "end at the bottom of the box" in line
    (line,) = mask_doubts(dict.fromkeys(range(4), 0.0), [])
    assert "(stills 0-3)" in line
