"""The lens of a video that nobody calibrated."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import av
import numpy as np
import pytest
import torch

from perfcap.errors import InputError
from perfcap.io.calibration import read_cameras
from perfcap.io.calibration.assumed import ASSUMED_FOV, assumed_rig, save_assumed
from perfcap.io.clip import Clip
from perfcap.io.video_index import FILM_FOCAL


@dataclass
class Source:
    """Frames that nobody reads."""

    name: str = "a"
    size: tuple[int, int] = (480, 640)
    lost: int = 0
    total: int | None = 3
    warnings: tuple[str, ...] = ()
    fps: float | None = 30.0
    timestamps: None = None

    def __len__(self) -> int:
        return 3


def clip(views: int = 1, size: tuple[int, int] = (480, 640)) -> Clip:
    return Clip([Source(size=size) for _ in range(views)], 30.0)


@pytest.mark.parametrize("size", [(480, 640), (640, 480)])
def test_the_angle_is_seen_across_the_longer_side(size: tuple[int, int]) -> None:
    for fov in (None, 90.0):
        rig = assumed_rig(clip(size=size), fov)
        tangent = math.tan(math.radians(0.5 * (fov or ASSUMED_FOV)))
        edge = torch.tensor([[tangent, 0.0, 1.0]] if size[1] == 640 else [[0.0, tangent, 1.0]])
        pixel = rig.cameras.project(edge.double())[0, 0]
        longest = pixel[0] if size[1] == 640 else pixel[1]
        assert float(longest) == pytest.approx(639.5)  # pixel centres are at integers
        assert f"{fov or ASSUMED_FOV:g} degrees" in rig.warnings[0]
        assert rig.guessed == (fov is None)


def test_bars_are_no_part_of_what_a_lens_sees() -> None:
    """A film of a phone that is held upright, in a wide video."""
    alone, wide, picture = clip(size=(640, 360)), clip(size=(640, 1138)), (640, 360)
    between = assumed_rig(wide, None, picture)
    focal = float(assumed_rig(alone).cameras.intrinsics[0, 0, 0])
    assert float(between.cameras.intrinsics[0, 0, 0]) == focal and between.guessed
    words = "60 degrees across the longer side of the picture between bars (92 of the image)"
    assert words in between.warnings[0]
    said = assumed_rig(wide, 92.0, picture)
    assert float(said.cameras.intrinsics[0, 0, 0]) == pytest.approx(focal, rel=0.01)
    assert "92 degrees, as --fov says of the image with its bars (60 without)" in said.warnings[0]
    for fov in (None, 60.0):  # a dark edge of some pixels is not worth a word
        assert "bars" not in assumed_rig(alone, fov, (638, 360)).warnings[0]
    assert assumed_rig(alone, 60.0, picture).warnings[0].endswith("as --fov says")


def test_several_views_are_told_what_calibrates_them() -> None:
    with pytest.raises(InputError, match=r"missing for 2 views.*Pose2Sim"):
        assumed_rig(clip(2))


@pytest.mark.parametrize("fov", [0.0, -60.0, 180.0, math.nan])
def test_no_lens_has_such_an_angle(fov: float) -> None:
    with pytest.raises(InputError, match="--fov"):
        assumed_rig(clip(), fov)


@pytest.mark.parametrize(("text", "focal"), [("26", 640 * 26 / 36), ("wide", None), ("0", None)])
def test_a_phones_metadata_say_the_lens(tmp_path: Path, text: str, focal: float | None) -> None:
    path = tmp_path / "phone.mov"
    options = {"movflags": "use_metadata_tags"}
    with av.open(str(path), "w", options=options) as out:
        out.metadata[FILM_FOCAL] = text
        stream = out.add_stream("mpeg4", rate=30)
        stream.width, stream.height, stream.pix_fmt = 640, 480, "yuv420p"
        for _ in range(3):
            picture = av.VideoFrame.from_ndarray(np.zeros((480, 640, 3), np.uint8), "rgb24")
            out.mux(stream.encode(picture))
        out.mux(stream.encode())
    rig = assumed_rig(Clip.open(path))
    expected = focal or 320 / math.tan(math.radians(0.5 * ASSUMED_FOV))
    assert float(rig.cameras.intrinsics[0, 0, 0]) == pytest.approx(expected)
    assert ("equivalent to 26 mm" in rig.warnings[0]) == (focal is not None)
    assert rig.guessed == (focal is None)


def test_what_was_assumed_can_be_read_again(tmp_path: Path) -> None:
    rig = assumed_rig(clip(), 70.0)
    save_assumed(tmp_path / "camera.json", rig.cameras, rig.names, 30.0)
    again = read_cameras(tmp_path / "camera.json")
    assert again.names == rig.names and again.fps == 30.0
    torch.testing.assert_close(again.cameras.intrinsics, rig.cameras.intrinsics)
    assert again.cameras.size == rig.cameras.size


def test_a_camera_that_moves_can_be_read_again(tmp_path: Path) -> None:
    """It is counted from the first frame of the video."""
    known = assumed_rig(clip(), 70.0)
    moving = known.cameras.every_frame(4)
    shift = torch.arange(12, dtype=torch.float64).reshape(4, 1, 3)
    moving = replace(moving, translation=moving.translation + shift)
    save_assumed(tmp_path / "camera.json", moving, known.names, 30.0, start=2)
    again = read_cameras(tmp_path / "camera.json").cameras
    assert again.moving and again.size == moving.size
    torch.testing.assert_close(again.translation[2:], moving.translation)
    torch.testing.assert_close(again.translation[:2], moving.translation[:1].expand(2, 1, 3))
    torch.testing.assert_close(again.intrinsics[3], moving.intrinsics[0])
