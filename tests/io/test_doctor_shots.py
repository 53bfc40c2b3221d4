"""Videos that are cut, and tripods that are knocked, among cameras that rest."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from doctored_views import one
from numpy.typing import NDArray

from perfcap.io.clip import Clip
from perfcap.io.detections import read_detections
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.shots import examine_shots, examine_standing

DEMO = Path(__file__).parents[2] / "models" / "demo"
FRAMES, SIDE, CUT = 90, 240, 37

Image = NDArray[np.uint8]


def wall(seed: int) -> Image:
    spots = np.random.default_rng(seed).integers(0, 255, (40, 40), dtype=np.uint8)
    return np.asarray(cv2.resize(spots, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC), np.uint8)


class Filmed:
    """A bright person who walks before a wall, another one from some frame on."""

    name, lost, warnings, fps, timestamps = "filmed", 0, (), 30.0, None
    size, total = (SIDE, SIDE), FRAMES

    def __init__(self, later: Image, until: int = FRAMES, fade: int = 1, cut: int = CUT) -> None:
        self.later, self.until, self.fade, self.cut = later, until, fade, cut
        self.before = wall(0)

    def __len__(self) -> int:
        return FRAMES

    def joints(self) -> NDArray[np.float64]:
        """(F, 1, 16, 2)."""
        body = np.stack((np.tile((70.0, 90.0), 8), np.linspace(60, 180, 16)), -1)
        return np.stack([[body + np.array((0.8 * frame, 0))] for frame in range(FRAMES)])

    def read(self, start: int, stop: int) -> Image:
        images = []
        for frame, joints in enumerate(self.joints()[start:stop, 0], start):
            share = np.clip((frame - self.cut + 1) / self.fade, 0, 1) if frame < self.until else 0.0
            image = cv2.addWeighted(self.before, 1 - share, self.later, share, 0)
            (x0, y0), (x1, y1) = joints.min(0).astype(int), joints.max(0).astype(int)
            image[y0:y1, x0:x1] = 250
            images.append(image)
        return np.stack(images)[..., None].repeat(3, -1)

    def close(self) -> None: ...


def looked_at(source: Filmed) -> list[Finding]:
    joints = source.joints()
    return examine_shots(
        Clip([source], 30.0), ["left"], 30.0, joints, np.ones(joints.shape[:-1]), 100
    )


@pytest.mark.long
@pytest.mark.parametrize(
    "later",
    [wall(1), np.roll(wall(0), (2, 3), (0, 1)), cv2.resize(wall(0)[40:200, 40:200], (SIDE, SIDE))],
    ids=["another", "knocked", "nearer"],
)
def test_a_background_that_does_not_stay_is_named(later: Image) -> None:
    found = one(looked_at(Filmed(later)))
    assert found.severity is Severity.WARNING and found.subject == "left"
    assert f"from frame {100 + CUT} on" in found.what
    assert found.remedy.endswith(f"--frames {100 + CUT}:{100 + FRAMES}")


@pytest.mark.parametrize(("kept", "named"), [(0, 1), (20, 1), (45, 0), (120, 0)])
def test_further_people_before_the_camera_are_no_cut(kept: int, named: int) -> None:
    """Who comes and stays hides much of what was there."""
    later = np.hstack((wall(0)[:, :kept], wall(1)[:, kept:]))
    assert len(looked_at(Filmed(later))) == named


def test_shots_that_dissolve_are_named() -> None:
    found = one(looked_at(Filmed(wall(1), fade=12)))
    frame = int(found.what.split("from frame ")[1].split()[0])
    assert 100 + CUT <= frame <= 100 + CUT + 12


@pytest.mark.parametrize(
    "later",
    [
        wall(0),
        (0.3 * wall(0)).astype(np.uint8),
        np.minimum(1.7 * wall(0).astype(float), 255).astype(np.uint8),
        np.full((SIDE, SIDE), 90, np.uint8),
    ],
    ids=["the same", "dark", "bright", "plain"],
)
def test_a_background_that_stays_or_shows_nothing(later: Image) -> None:
    assert looked_at(Filmed(later)) == []


@pytest.mark.parametrize(("begin", "end"), [(40, 75), (0, 20), (70, 90)])
def test_a_camera_that_moves_for_a_while_is_named(begin: int, end: int) -> None:
    """As a phone that is picked up at the end."""
    large = np.tile(wall(0), (1, 2))

    class Turned(Filmed):
        def read(self, start: int, stop: int) -> Image:
            images = []
            for frame in range(start, stop):
                left = 2 * (np.clip(frame, begin, end) - begin)
                image = large[:, left : left + SIDE].copy()
                image[60:180, 70 + frame // 2 : 78 + frame // 2] = 250
                images.append(image)
            return np.stack(images)[..., None].repeat(3, -1)

    found = one(looked_at(Turned(wall(0))))
    first, last = (int(each) for each in found.what.split("frames ")[1].split(",")[0].split(" to "))
    assert abs(first - 100 - begin) <= 1 and abs(last - 100 - min(end, FRAMES - 1)) <= 1


def test_somebody_who_goes_by_is_no_cut() -> None:
    assert looked_at(Filmed(wall(1), until=CUT + 20)) == []


@pytest.mark.long
@pytest.mark.parametrize("at_end", [True, False])
def test_a_few_frames_of_little_at_an_end(at_end: bool) -> None:
    """Frames behind the last one, or before the first, were asked for."""
    little = np.full((SIDE, SIDE), 90, np.uint8)
    little[:60, 175:] = wall(6)[:60, 175:]
    filmed = Filmed(little if at_end else wall(0), cut=FRAMES - 6 if at_end else 6)
    filmed.before = wall(0) if at_end else little
    assert looked_at(filmed) == []


@pytest.mark.long
def test_the_demo_is_one_shot() -> None:
    clip = Clip.open(DEMO / "video.mp4")
    seen, _ = read_detections([DEMO / "detections.npz"], views=("camera",))
    joints, certain = (part.double().numpy() for part in (seen.joints2d, seen.confidence2d))
    assert examine_standing(clip, clip.names, clip.fps, joints, certain) == []
