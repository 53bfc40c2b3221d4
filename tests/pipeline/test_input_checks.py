"""What does not belong together is refused before anything is computed."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from takes import Take, make_take

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.pose_refiner import PoseRefiner
from perfcap.pipeline.stage import Stage


class Blank:
    """So many frames of nothing."""

    def __init__(self, frames: int) -> None:
        self._frames = frames

    def __len__(self) -> int:
        return self._frames

    def read_view(self, view: int, start: int, stop: int) -> np.ndarray:
        raise AssertionError("nothing is to be read")


@pytest.fixture(scope="module")
def take() -> Take:
    return make_take(6, views=2)


def images(take: Take, frames: int, views: int = 2) -> Images:
    cameras = replace(take.cameras.select(list(range(views))), size=((8, 8),) * views)
    return Images(Blank(frames), cameras)


def moved(camera: Camera, frames: int) -> Camera:
    fields = ("intrinsics", "rotation", "translation")
    poses = {name: getattr(camera, name) for name in fields}
    return replace(camera, **{name: x.expand(frames, *x.shape) for name, x in poses.items()})


def batched(found: Detections) -> Detections:
    return Detections.from_joints(found.joints2d[None], found.confidence2d[None])


@pytest.mark.parametrize(
    "rate",
    [0.0, 1e-4, -30.0, 1e12, float("nan"), float("inf"), "30", (30.0,), torch.tensor([30.0, 25])],
)
def test_rates(take: Take, rate: Any) -> None:
    with pytest.raises(InputError, match=r"rate is .* expected frames a second"):
        capture(take.actor, take.cameras, take.detections, rate)
    with pytest.raises(InputError, match=r"rate is .* expected frames a second"):
        PoseRefiner(take.actor, rate=rate)


def test_a_rate_that_is_a_tensor(take: Take) -> None:
    until = Stage.INITIALIZE
    found = capture(take.actor, take.cameras, take.detections, torch.tensor(30), until=until)  # type: ignore[call-overload]
    assert type(found.rate) is float and found.rate == 30


@pytest.mark.parametrize("confidence", [float("inf"), float("-inf")])
def test_infinite_confidences(take: Take, confidence: float) -> None:
    wrong = replace(
        take.detections, confidence2d=torch.full_like(take.detections.confidence2d, confidence)
    )
    with pytest.raises(InputError, match=f"confidences are {confidence:.3g} to .* expected 0 to 1"):
        capture(take.actor, take.cameras, wrong, 30.0)


@pytest.mark.parametrize(("frames", "views"), [(0, 2), (6, 0)])
def test_nothing_to_capture(take: Take, frames: int, views: int) -> None:
    nothing = Detections.from_joints(
        take.detections.joints2d[:frames, :views], take.detections.confidence2d[:frames, :views]
    )
    with pytest.raises(InputError, match="no frame or no view"):
        capture(take.actor, take.cameras.select(list(range(views))), nothing, 30.0)


def test_images_that_show_nothing(take: Take) -> None:
    class Dark(Blank):
        def read_view(self, view: int, start: int, stop: int) -> np.ndarray:
            return np.zeros((stop - start, 8, 8, 3), np.uint8)

    dark = replace(images(take, 6), reader=Dark(6))
    with pytest.raises(InputError, match=r"images of view 0: .* of one color"):
        capture(take.actor, take.cameras, take.detections, 30.0, images=dark)


def test_readers_that_give_too_few_frames(take: Take) -> None:
    class Short(Blank):
        def read_view(self, view: int, start: int, stop: int) -> np.ndarray:
            return np.zeros((stop - start - 1, 8, 8, 3), np.uint8)

    short = replace(images(take, 6), reader=Short(6))
    with pytest.raises(InputError, match="the reader gave 0 of frames 0 to 0"):
        capture(take.actor, take.cameras, take.detections, 30.0, images=short)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (np.zeros((8, 8), np.float32), r"gave float32 \(8, 8\), expected .* log odds \(4, 3\)"),
        (np.zeros((4, 3), np.bool_), "gave bool"),
        (torch.zeros(4, 3), "gave Tensor"),
        (np.full((4, 3), np.nan), "log odds that are NaN"),
    ],
)
def test_networks_that_answer_something_else(take: Take, answer: object, words: str) -> None:
    network = replace(images(take, 6), segmenter=lambda *_: answer).checked().segmenter
    assert network is not None
    given = np.zeros((8, 8, 3), np.uint8), np.zeros((4, 3), np.bool_), np.zeros((2, 2))
    with pytest.raises(InputError, match=words):
        network(*given, (slice(0, 4), slice(0, 3)))
    with pytest.raises(InputError, match="segmenter is a int, expected an OnnxSegmenter"):
        replace(images(take, 6), segmenter=3)  # type: ignore[arg-type]


@pytest.mark.parametrize("focal", [0.0, 1e-300, float("nan"), float("inf")])
def test_cameras_without_a_lens(take: Take, focal: float) -> None:
    intrinsics = take.cameras.intrinsics.clone()
    intrinsics[1, 0, 0] = focal
    with pytest.raises(InputError, match="cameras have focal lengths"):
        capture(take.actor, replace(take.cameras, intrinsics=intrinsics), take.detections, 30.0)


@pytest.mark.parametrize(("row", "column"), [(0, 1), (1, 0)])
def test_lenses_that_mix_x_and_y(take: Take, row: int, column: int) -> None:
    intrinsics = take.cameras.intrinsics.clone()
    intrinsics[1, row, column] = -intrinsics[1, 0, 0]
    with pytest.raises(InputError, match="mix x and y"):
        capture(take.actor, replace(take.cameras, intrinsics=intrinsics), take.detections, 30.0)


@pytest.mark.parametrize("change", [1.5, 0.0, -1.0])
def test_rotations_that_are_none(take: Take, change: float) -> None:
    rotation = take.cameras.rotation.clone()
    rotation[1] *= change
    with pytest.raises(InputError, match="cameras have a rotation that is none"):
        capture(take.actor, replace(take.cameras, rotation=rotation), take.detections, 30.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: replace(c, intrinsics=2 * c.intrinsics), "expected 0 0 1: divide"),
        (lambda c: replace(c, intrinsics=c.intrinsics.mT.contiguous()), "transposed"),
        (lambda c: replace(c, translation=1000 * c.translation), "divide millimetres by 1000"),
        (lambda c: replace(c, translation=torch.nan * c.translation), "not finite"),
        (lambda c: replace(c, distortion=torch.full((2, 5), torch.nan).double()), "not finite"),
    ],
)
def test_cameras_of_other_conventions(
    take: Take, change: Callable[[Camera], Camera], words: str
) -> None:
    cameras = change(take.cameras)
    with pytest.raises(InputError, match=words):
        capture(take.actor, cameras, take.detections, take.rate)
    with pytest.raises(InputError, match=words):
        PoseRefiner(take.actor)(cameras, take.detections.joints2d)


@pytest.mark.parametrize("factor", [100.0, -1.0])
def test_confidences_that_are_no_shares(take: Take, factor: float) -> None:
    seen = take.detections
    given = replace(seen, confidence2d=factor * seen.confidence2d)
    with pytest.raises(InputError, match="expected 0 to 1"):
        capture(take.actor, take.cameras, given, take.rate)
    with pytest.raises(InputError, match="expected 0 to 1"):
        PoseRefiner(take.actor)(take.cameras, given.joints2d, given.confidence2d)


def test_normalised_joints_of_an_estimator(take: Take) -> None:
    with pytest.raises(InputError, match="multiply normalised joints"):
        PoseRefiner(take.actor)(take.cameras, take.detections.joints2d / 2000)


def test_joints_that_are_no_numbers_are_unseen(take: Take) -> None:
    seen = take.detections
    assert seen.joints3d is not None
    joints, poses, confidence = (
        x.clone() for x in (seen.joints2d, seen.joints3d, seen.confidence2d)
    )
    joints[1, 0, 3], confidence[2, 1, 4], poses[3, 1, 5] = torch.nan, torch.nan, torch.inf
    given = replace(seen, joints2d=joints, joints3d=poses, confidence2d=confidence)
    sure, trusted = seen.confidence2d.clone(), seen.trusted3d.clone()
    sure[1, 0, 3], sure[2, 1, 4], trusted[3, 1] = 0, 0, False
    expected = replace(seen, confidence2d=sure, trusted3d=trusted)
    found, same = (
        capture(take.actor, take.cameras, each, take.rate).joints() for each in (given, expected)
    )
    assert found.isfinite().all()
    torch.testing.assert_close(found, same)


def test_normalised_joints(take: Take) -> None:
    shrunk = replace(take.detections, joints2d=take.detections.joints2d / 2000)
    with pytest.raises(InputError, match=r"expected pixels; multiply normalised joints"):
        capture(take.actor, take.cameras, shrunk, 30.0)


@pytest.mark.parametrize("views", [[0], [0, 1, 0]])
def test_cameras_of_other_views(take: Take, views: list[int]) -> None:
    with pytest.raises(InputError, match=f"cameras are of {len(views)} views, detections of 2"):
        capture(take.actor, take.cameras.select(views), take.detections, 30.0)


@pytest.mark.parametrize("frames", [5, 7])
def test_cameras_that_move_for_another_time(take: Take, frames: int) -> None:
    with pytest.raises(InputError, match=f"moving cameras have {frames} frames but the clip has 6"):
        capture(take.actor, moved(take.cameras, frames), take.detections, 30.0)


def test_a_batch(take: Take) -> None:
    with pytest.raises(InputError, match=r"\(1, 6, 2, 16, 2\), expected one clip"):
        capture(take.actor, take.cameras, batched(take.detections), 30.0)


@pytest.mark.parametrize("frames", [5, 12, 600])
def test_images_of_other_frames(take: Take, frames: int) -> None:
    with pytest.raises(InputError, match=f"images are {frames} frames, detections 6"):
        capture(take.actor, take.cameras, take.detections, 30.0, images=images(take, frames))


def test_a_part_of_the_images() -> None:
    class Numbered(Blank):
        def read_view(self, view: int, start: int, stop: int) -> np.ndarray:
            return np.arange(start, min(stop, len(self)))

    part = images(make_take(30), 30, 1)
    part = (
        Images(Numbered(30), moved(part.cameras, 30)).frames(slice(10, 20)).frames(slice(2, None))
    )
    assert len(part.reader) == 8 == len(part.cameras.intrinsics)
    assert part.reader.read_view(0, 1, 3).tolist() == [13, 14]
    assert part.reader.read_view(0, 0, 50).tolist() == list(range(12, 20))
    with pytest.raises(ValueError, match="every 2 frames"):
        part.frames(slice(0, 4, 2))


def test_images_of_other_views(take: Take) -> None:
    with pytest.raises(InputError, match="cameras of the images are of 1 views"):
        capture(take.actor, take.cameras, take.detections, 30.0, images=images(take, 6, 1))


def test_moving_cameras_that_fit(take: Take) -> None:
    fixed, moving = (
        capture(take.actor, cameras, take.detections, 30.0).joints()
        for cameras in (take.cameras, moved(take.cameras, 6))
    )
    assert torch.isfinite(moving).all()
    torch.testing.assert_close(moving, fixed, atol=1e-6, rtol=0)


def test_half_precision_is_refused() -> None:
    """Found by tools/fuzz.py."""
    take = make_take(3)
    half = replace(take.detections, joints2d=take.detections.joints2d.half())
    with pytest.raises(InputError, match="float16"):
        capture(take.actor, take.cameras, half, 30.0)


def test_types_that_differ() -> None:
    take = make_take(6)
    seen = take.detections
    assert seen.joints3d is not None
    mixed = replace(seen, joints3d=seen.joints3d.float(), confidence2d=seen.confidence2d.float())
    found = capture(take.actor, take.cameras, mixed, 30.0, until=Stage.INITIALIZE)
    assert bool(found.motion.translation.isfinite().all())
    whole = replace(take.cameras, intrinsics=take.cameras.intrinsics.to(torch.uint64))
    with pytest.raises(InputError, match=r"of torch.uint64, .* expected floating-point"):
        capture(take.actor, whole, seen, 30.0, until=Stage.INITIALIZE)


class Shown(Blank):
    """Frames of a size and type of their own."""

    def __init__(self, frames: int, shape: tuple[int, ...], kind: type = np.uint8) -> None:
        super().__init__(frames)
        self.shape, self.kind = shape, kind

    def read_view(self, view: int, start: int, stop: int) -> np.ndarray:
        return np.zeros((stop - start, *self.shape), self.kind)


@pytest.mark.parametrize(
    ("shape", "kind"),
    [((4, 4, 3), np.uint8), ((16, 16, 3), np.uint8), ((8, 8), np.uint8), ((8, 8, 3), np.float32)],
)
def test_images_that_are_not_those_of_their_cameras(
    take: Take, shape: tuple[int, ...], kind: type
) -> None:
    """Compiled kernels would read beyond them."""
    given = Images(Shown(6, shape, kind), images(take, 6).cameras)
    call = (take.actor, take.cameras, take.detections, 30.0)
    capture(*call, images=given, until=Stage.TRACK_MOTION)  # where nothing looks at them
    with pytest.raises(InputError, match="images of view 0 are"):
        capture(*call, images=given)


@pytest.mark.long
def test_what_the_doctor_knows_is_told_in_python() -> None:
    """Mistakes that robust energies get along with: told with the result, not refused."""
    take = make_take(24, views=3)
    cameras, seen = take.cameras, take.detections
    assert seen.joints3d is not None
    wild = torch.tensor([-5.0, 30.0, 0.0, 0.0, -100.0], dtype=torch.float64).expand(3, 5)
    centre = -(cameras.rotation.mT @ cameras.translation[..., None])[..., 0]
    flipped = seen.joints3d * torch.tensor([1.0, -1.0, -1.0])
    cases = {
        "its distortion moves": (replace(cameras, distortion=wild), seen),
        "look camera-to-world": (
            replace(cameras, rotation=cameras.rotation.mT, translation=centre), seen),
        "3D y runs against": (cameras, replace(seen, joints3d=flipped)),
        "joints3d must be metres": (cameras, replace(seen, joints3d=1000 * seen.joints3d)),
    }  # fmt: skip
    assert not capture(take.actor, cameras, seen, take.rate, until=Stage.INITIALIZE).warnings
    for words, (views, joints) in cases.items():
        for given in (views, replace(views, size=())):
            found = capture(take.actor, given, joints, take.rate, until=Stage.INITIALIZE)
            assert any(words in line for line in found.warnings)


@pytest.mark.parametrize("size", [((240, 320),) * 2, (240, 320, 240), torch.ones(3, 2)])
def test_image_sizes_that_are_not_one_a_view(size: Any) -> None:
    take = make_take(6, views=3)
    with pytest.raises(InputError, match=r"image sizes .* for 3 views"):
        capture(take.actor, replace(take.cameras, size=size), take.detections, take.rate)


def test_doubts_of_confidences_and_poses() -> None:
    """Confidences that hardly count, and 3D poses of which none does."""
    take = make_take(12)
    seen = take.detections
    assert seen.joints3d is not None
    faint = replace(seen, confidence2d=0.01 * seen.confidence2d)
    crown = torch.arange(16)[:, None] == 0
    lacking = replace(seen, joints3d=torch.where(crown, torch.nan, seen.joints3d))
    for words, joints in (("confidences are 0.01", faint), ("no pose of them counts", lacking)):
        found = capture(take.actor, take.cameras, joints, take.rate, until=Stage.INITIALIZE)
        assert any(words in line for line in found.warnings)
