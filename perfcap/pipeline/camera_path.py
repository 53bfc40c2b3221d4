"""Cameras that look at a capture from anywhere."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.array_checks import require_shape
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.metrics.missing import check_metres
from perfcap.pipeline.resized_cameras import exchanged_sides
from perfcap.pipeline.surroundings import Surroundings
from perfcap.rates import frame_rate
from perfcap.render import look_at

SMALLEST, LARGEST = 16, 4096  # px, side of a picture
_ANGLE = math.radians(30.0)  # of view, along the shorter side of the picture
_ELEVATION = math.radians(10.0)  # of the orbiting camera above the middle of the body
_MARGIN = 1.2  # times the reach of the landmarks: flesh, hair and cloth
_RADIANS = 0.5, 1.0, 2.0, 4.0  # times pi; turns that are asked for in radians
_CALM = 0.5  # s, deviation of the average that the camera follows


@dataclass(frozen=True)
class CameraPath:
    """Pictures to make: the frame each shows, and the camera that sees it.

    Attributes:
        frames: rows of the capture, (N,) int64.
        cameras: one view at N times, batch (N, 1), with its size.
    """

    frames: Tensor
    cameras: Camera

    def __post_init__(self) -> None:
        if self.cameras.intrinsics.shape[:-2] != (len(self.frames), 1) or not len(self.frames):
            raise ValueError(
                f"{len(self.frames)} frames for cameras {tuple(self.cameras.intrinsics.shape)}, "
                "expected one or more, and a camera of one view for each"
            )

    def __len__(self) -> int:
        return len(self.frames)

    def camera(self, index: int) -> Camera:
        """The camera of one picture, batch (1,)."""
        here = self.cameras.frames(slice(index, index + 1))
        distortion = None if here.distortion is None else here.distortion[0]
        return Camera(
            here.intrinsics[0], here.rotation[0], here.translation[0], distortion, here.size
        )


def orbit(
    joints: Tensor,
    around: Surroundings,
    frames: Sequence[int],
    size: tuple[int, int],
    rate: float,
    degrees: float = 360.0,
) -> CameraPath:
    """A camera that begins in front of the person and goes around, to the person's left.

    It keeps its distance, from which the person fits into the picture in every frame, and follows
    the body's place calmly.

    Args:
        joints: landmarks of the capture, (F, 16, 3) m.
        around: where up and ahead are.
        frames: rows to show, one a picture; the same row again and again for a turntable.
        size: height and width of the pictures, px.
        rate: pictures a second.
        degrees: angle over all pictures; whole turns close seamlessly.

    Raises:
        InputError: a size that cannot be drawn, an angle that is not finite, no such rows, or no
            such rate.
    """
    _check_size(size)
    rate = frame_rate(rate)
    if len(frames) == 0 or not all(-len(joints) <= frame < len(joints) for frame in frames):
        raise InputError(
            f"frames are {list(frames)!r:.80}; expected one or more rows of {len(joints)} joints"
        )
    if not math.isfinite(degrees):
        raise InputError(f"--orbit {degrees}: expected degrees, such as 360")
    if any(math.isclose(abs(degrees), turn * math.pi, rel_tol=1e-4) for turn in _RADIANS):
        warnings.warn(
            f"orbit goes around by {degrees:.4g} degrees; if these are radians, give "
            f"{math.degrees(degrees):.4g}",
            stacklevel=2,
        )
    require_shape(joints, "joints", (None, len(LANDMARKS), 3), "(F, 16, 3) m")
    check_metres(joints=joints)
    shown = joints[list(frames)].double()
    up, ahead = around.up.double(), around.ahead.double()
    heights = (shown @ up).flatten()
    middle = (torch.minimum(heights.min(), heights.new_tensor(around.ground)) + heights.max()) / 2
    place = shown.mean(1)
    place = _calm(place - (place @ up)[:, None] * up, _CALM * rate) + middle * up
    turn = math.radians(degrees) * torch.arange(len(shown)).to(shown) / len(shown)
    side = torch.linalg.cross(up, ahead)
    level = turn.cos()[:, None] * ahead + turn.sin()[:, None] * side
    towards = math.cos(_ELEVATION) * level + math.sin(_ELEVATION) * up
    reach = _MARGIN * float((shown - place[:, None]).norm(dim=-1).max())
    # the smallest sphere around the person touches the borders of the picture
    distance = reach / math.sin(_ANGLE / 2)
    rotation, translation = look_at(place + distance * towards, place, up)
    focal = 0.5 * min(size) / math.tan(_ANGLE / 2)
    intrinsics = shown.new_tensor(
        [[focal, 0, (size[1] - 1) / 2], [0, focal, (size[0] - 1) / 2], [0, 0, 1]]
    ).expand(len(shown), 1, 3, 3)
    cameras = Camera(intrinsics, rotation[:, None], translation[:, None], None, (size,))
    return CameraPath(torch.tensor(list(frames)), cameras)


def calibrated(
    camera: Camera,
    frames: Sequence[int],
    numbers: Sequence[int],
    size: tuple[int, int] | None = None,
) -> CameraPath:
    """A camera of a file, fixed or moving along with the video.

    Args:
        camera: of one view, (1,) or (F, 1), with its size.
        frames: rows to show, one a picture.
        numbers: number of each of these frames in the video, which a moving camera counts by.
        size: height and width of the pictures if they should differ from the camera's: all that
            the camera sees is then fitted into them.

    Raises:
        InputError: a size that cannot be drawn, or a moving camera that ends too early.
    """
    _check_size(size or camera.size[0])
    if size is not None:
        for line in exchanged_sides(size, camera.size):
            warnings.warn(line, stacklevel=2)
    if len(numbers) != len(frames) or min(numbers, default=0) < 0:
        raise InputError(
            f"numbers are {list(numbers)!r:.80} of {len(frames)} frames; expected the number of "
            "each in the video, from 0 on"
        )
    if camera.moving:
        count = camera.intrinsics.shape[0]
        if max(numbers) >= count:
            raise InputError(
                f"--camera: has {count} frames, expected one for frame {max(numbers)} of the "
                "video; give a fixed camera, or fewer frames"
            )
        chosen = camera.frames(torch.tensor(list(numbers)))
    else:
        lens = camera.distortion
        count = len(frames)
        chosen = replace(
            camera,
            intrinsics=camera.intrinsics.expand(count, 1, 3, 3),
            rotation=camera.rotation.expand(count, 1, 3, 3),
            translation=camera.translation.expand(count, 1, 3),
            distortion=None if lens is None else lens.expand(count, 1, 5),
        )
    return CameraPath(torch.tensor(list(frames)), chosen if size is None else _fitted(chosen, size))


def _fitted(camera: Camera, size: tuple[int, int]) -> Camera:
    """The same view in the middle of a picture of another size."""
    height, width = camera.size[0]
    scale = min(size[0] / height, size[1] / width)
    shift = ((size[1] - scale * width - 1) / 2, (size[0] - scale * height - 1) / 2)
    # image corners, not pixel centres, are scaled
    matrix = torch.tensor(
        [[scale, 0, shift[0] + scale / 2], [0, scale, shift[1] + scale / 2], [0, 0, 1]]
    ).to(camera.intrinsics)
    return replace(camera, intrinsics=matrix @ camera.intrinsics, size=(size,))


def _calm(places: Tensor, deviation: float) -> Tensor:
    """Gaussian average along time (N, 3), its ends reflected about their values."""
    width = min(math.ceil(3 * deviation), len(places) - 1)
    if width < 1:
        return places
    offsets = torch.arange(-width, width + 1).to(places)
    weights = torch.softmax(-0.5 * (offsets / deviation) ** 2, 0)
    before = 2 * places[:1] - places[1 : width + 1].flip(0)
    after = 2 * places[-1:] - places[-width - 1 : -1].flip(0)
    padded = torch.cat([before, places, after])
    return torch.einsum("nkw,w->nk", padded.unfold(0, 2 * width + 1, 1), weights)


def _check_size(size: tuple[int, int]) -> None:
    if not all(SMALLEST <= side <= LARGEST for side in size):
        raise InputError(
            f"--size {size[1]} {size[0]}: expected width and height from {SMALLEST} to {LARGEST}"
        )
