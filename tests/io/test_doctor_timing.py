"""Joints, poses and images that do not belong together: exchanged axes, other frames, no image."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from doctored_views import detections, one, rig
from numpy.typing import NDArray
from takes import Take, make_take

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.clip import Clip
from perfcap.io.detections import read_detections
from perfcap.io.doctor import examine_agreement, examine_detections
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.footage import examine_blank, examine_footage

DEMO = Path(__file__).parents[2] / "models" / "demo"


def lively(**options: bool) -> tuple[CameraRig, Detections]:
    take: Take = make_take(60, turns=0.2, **options)
    return CameraRig(("a",), take.cameras), take.detections


def late(seen: Detections, frames: int, *, poses_only: bool = False) -> Detections:
    """What was detected so many frames before; the first frame stands still."""
    index = (torch.arange(seen.frame_count) - frames).clamp(0, seen.frame_count - 1)
    moved = seen.frames(index)
    return replace(seen, joints3d=moved.joints3d) if poses_only else moved


# --- 2D joints and 3D poses ---------------------------------------------------------------------


def test_good_poses_are_quiet() -> None:
    assert examine_detections(*lively()) == []


def test_exchanged_axes_are_named() -> None:
    cameras, seen = lively()
    assert seen.joints3d is not None
    for wrong in (
        replace(seen, joints2d=seen.joints2d.flip(-1)),
        replace(seen, joints3d=seen.joints3d[..., [1, 0, 2]]),
    ):
        finding = one(examine_detections(cameras, wrong))
        assert finding.severity is Severity.ERROR and "x and y look exchanged" in finding.what


@pytest.mark.parametrize("frames", [10, -10, 4])
def test_poses_of_other_frames_are_named(frames: int) -> None:
    cameras, seen = lively()
    finding = one(examine_detections(cameras, late(seen, frames, poses_only=True)))
    word = f"{abs(frames)} frames {'late' if frames > 0 else 'early'}"
    assert finding.severity is Severity.ERROR and word in finding.what


def test_poses_of_other_joints_are_named() -> None:
    cameras, seen = lively()
    assert seen.joints3d is not None
    order = torch.randperm(16, generator=torch.Generator().manual_seed(3))
    mixed = seen.joints3d[..., order, :]
    hips = [LANDMARKS.index(name) for name in ("r_hip", "l_hip")]
    mixed = mixed - mixed[..., hips, :].mean(-2, keepdim=True)
    finding = one(examine_detections(cameras, replace(seen, joints3d=mixed)))
    assert finding.severity is Severity.WARNING and "miss the 2D joints" in finding.what


def test_exchanged_axes_without_poses_lie_on_the_side() -> None:
    cameras, seen = lively(lifted=False)
    assert examine_detections(cameras, seen) == []
    finding = one(examine_detections(cameras, replace(seen, joints2d=seen.joints2d.flip(-1))))
    assert finding.severity is Severity.WARNING and "lies" in finding.what


# --- several views ------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("frames", [10, -7])
def test_a_view_that_is_far_from_synchronous_is_named(frames: int) -> None:
    take = make_take(60, views=4, turns=0.2)
    views = CameraRig(("a", "b", "c", "d"), take.cameras)
    joints = take.detections.joints2d.clone()
    joints[:, 2] = late(take.detections, frames).joints2d[:, 2]
    assert examine_agreement(views, take.detections) == []
    finding = one(examine_agreement(views, replace(take.detections, joints2d=joints)))
    assert finding.subject == "c"
    assert f"{abs(frames)} or so frames {'late' if frames > 0 else 'early'}" in finding.what


def test_half_the_focal_length_is_named() -> None:
    good = rig()
    half = torch.diag(torch.tensor([0.5, 0.5, 1.0])).double()
    middle = good.cameras.intrinsics.clone()
    middle[..., :2, :2] = middle[..., :2, :2] @ half[:2, :2]
    wrong = replace(good, cameras=replace(good.cameras, intrinsics=middle))
    assert [f for f in examine_agreement(wrong, detections()) if f.severity is Severity.ERROR]


# --- joints and videos --------------------------------------------------------------------------


class Painted:
    """A video of bright limbs on a dark, noisy wall."""

    name, lost, warnings = "painted", 0, ()

    def __init__(self, places: NDArray[np.float64], size: tuple[int, int]) -> None:
        self.places, self.size, self.total = places, size, len(places)
        self.fps, self.timestamps = 30.0, None

    def __len__(self) -> int:
        return len(self.places)

    def read(self, start: int, stop: int) -> NDArray[np.uint8]:
        height, width = self.size
        y, x = np.mgrid[:height, :width]
        wall = np.random.default_rng(0).integers(20, 90, self.size, dtype=np.uint8)
        images = np.repeat(wall[None, ..., None], stop - start, 0).repeat(3, -1)
        for image, joints in zip(images, self.places[start:stop], strict=True):
            for near in np.hypot(x - joints[:, 0, None, None], y - joints[:, 1, None, None]):
                image[near < height / 30] = 220
        return images

    def close(self) -> None: ...


def painted(frames: int) -> tuple[Clip, Detections]:
    """Limbs where joints are, and detections so many frames late."""
    _, seen = lively()
    walk = torch.linspace(-40, 40, 60).double()[:, None, None] * torch.tensor([1.0, 0.0])
    seen = replace(seen, joints2d=seen.joints2d / 5 + walk[:, None])
    ends = seen.joints2d[:, 0].numpy()
    links = np.array([(0, 1), (1, 8), (1, 12), (2, 3), (3, 4), (5, 6), (6, 7)])
    links = np.concatenate((links, [(8, 9), (9, 10), (12, 13), (13, 14)]))
    share = np.linspace(0, 1, 4)[:, None, None]
    limbs = (1 - share) * ends[:, None, links[:, 0]] + share * ends[:, None, links[:, 1]]
    return Clip([Painted(limbs.reshape(len(ends), -1, 2), (120, 120))], 30.0), late(seen, frames)


@pytest.mark.long
@pytest.mark.parametrize("frames", [0, 10, -10])
def test_joints_of_other_frames_of_the_video(frames: int) -> None:
    clip, seen = painted(frames)
    findings = examine_footage(clip, clip.sizes, seen, seen.joints2d)
    if not frames:
        assert findings == []
        return
    finding = one(findings)
    word = "late" if frames > 0 else "early"
    assert word in finding.what and finding.severity is Severity.ERROR
    assert finding.views == (0,)
    assert abs(int(finding.what.split()[2]) - abs(frames)) <= 1


def test_a_video_in_which_nothing_moves() -> None:
    """It is none of a person who does; of one who does not it says nothing."""
    clip, seen = painted(0)
    still = np.repeat(clip.read(0, 1)[:, 0], 60, 0)

    class Still(Painted):
        def read(self, start: int, stop: int) -> NDArray[np.uint8]:
            return still[start:stop]

    source = Still(seen.joints2d[:, 0].numpy(), (120, 120))
    clip = Clip([source], 30.0)
    finding = one(examine_footage(clip, clip.sizes, seen, seen.joints2d))
    assert "lie on what moves" in finding.what and finding.severity is Severity.WARNING
    rest = seen.joints2d[:1].expand_as(seen.joints2d)
    assert examine_footage(clip, clip.sizes, seen, rest) == []


def test_joints_of_another_video() -> None:
    clip, seen = painted(0)
    elsewhere = seen.joints2d.flip(0) * torch.tensor([-1.0, 1.0]) + torch.tensor([120.0, 55.0])
    finding = one(examine_footage(clip, clip.sizes, seen, elsewhere))
    # only warned of, as where a camera moves: no view is said to be wrong
    assert "of another video" in finding.remedy and not finding.views


def demonstrated() -> tuple[Clip, Detections]:
    clip = Clip.open(DEMO / "video.mp4")
    cameras = read_cameras(DEMO / "camera.json", clip.sizes)
    return clip, read_detections([DEMO / "detections.npz"], views=cameras.names)[0]


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "scale", "shift"),
    [
        ("mirrored", (-1.0, 1.0), (1.0, 0.0)),
        ("upside down", (-1.0, -1.0), (1.0, 1.0)),
        ("of a video half as large", (0.5, 0.5), (0.0, 0.0)),
        ("of a video twice as large", (2.0, 2.0), (0.0, 0.0)),
    ],
)
def test_joints_of_another_picture(
    words: str, scale: tuple[float, float], shift: tuple[float, float]
) -> None:
    clip, seen = demonstrated()
    height, width = clip.sizes[0]
    last = torch.tensor([width - 1.0, height - 1.0])
    moved = torch.tensor(scale) * seen.joints2d + torch.tensor(shift) * last
    finding = one(examine_footage(clip, clip.sizes, seen, moved))
    assert f"joints look {words} against the video" in finding.what
    assert finding.severity is Severity.ERROR and finding.views == (0,)


@pytest.mark.long
@pytest.mark.parametrize(("name", "turns"), [("a quarter", 1), ("three quarters", 3)])
def test_joints_of_a_video_that_was_turned(name: str, turns: int) -> None:
    """Turned by cv2.rotate after its joints were found."""
    clip, seen = demonstrated()
    side = clip.sizes[0][0] - 1.0
    assert clip.sizes[0] == (side + 1, side + 1)
    there = seen.joints2d
    for _ in range(turns):  # where the turned picture has what is at these joints
        there = torch.stack((there[..., 1], side - there[..., 0]), -1)
    finding = one(examine_footage(clip, clip.sizes, seen, there))
    assert f"joints look {name} turned" in finding.what


@pytest.mark.long
def test_the_demo_is_in_time_and_a_shift_of_it_is_not() -> None:
    clip, seen = demonstrated()
    assert examine_footage(clip, clip.sizes, seen, seen.joints2d) == []
    shifted = late(seen, 10)
    assert "late" in one(examine_footage(clip, clip.sizes, shifted, shifted.joints2d)).what


def blank(share: float, level: int) -> list[Finding]:
    plain = round(60 * share)

    class Dark(Painted):
        def read(self, start: int, stop: int) -> NDArray[np.uint8]:
            images = super().read(start, stop)
            images[: max(0, plain - start)] = level
            return images

    return examine_blank(Clip([Dark(np.full((60, 1, 2), 60.0), (120, 120))], 30.0), ["a"])


def test_images_that_show_nothing() -> None:
    assert blank(0, 0) == []
    for level in (0, 255):
        assert one(blank(1, level)).severity is Severity.ERROR
    finding = one(blank(0.3, 0))
    assert finding.severity is Severity.WARNING and "frames 0, 15 of 5" in finding.what
