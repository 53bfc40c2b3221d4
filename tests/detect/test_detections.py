"""The detections value."""

from dataclasses import replace

import pytest
import torch

from perfcap.detect.detections import Detections
from perfcap.errors import InputError


def example(frames: int = 5, views: int = 3) -> Detections:
    generator = torch.Generator().manual_seed(0)
    joints = torch.randn(frames, views, 16, 3, generator=generator, dtype=torch.float64)
    return Detections.from_joints(joints[..., :2], joints[..., 2].abs(), joints)


def test_slicing_frames_and_views_commutes() -> None:
    detections = example()
    once = detections.frames(slice(1, 4)).select([2, 0])
    other = detections.select([2, 0]).frames(slice(1, 4))
    assert (once.frame_count, once.views) == (3, 2)
    for name in ("joints2d", "confidence2d", "joints3d", "trusted3d"):
        assert torch.equal(getattr(once, name), getattr(other, name))
    assert torch.equal(once.joints2d, detections.joints2d[1:4][:, [2, 0]])


def test_doubts_go_with_the_joints() -> None:
    whole = example()
    doubted = torch.zeros(5, 3, dtype=torch.bool)
    doubted[3, 2] = True
    marked = replace(whole, doubted=doubted)
    part = marked.frames(slice(2, 5)).select([2, 0])
    assert part.doubted is not None
    assert part.doubted.tolist() == [[False, False], [True, False], [False, False]]
    others = part.undoubted()
    assert others.doubted is None and not others.trusted3d[1, 0]
    assert not others.confidence2d[1, 0].any()
    same = torch.ones(3, 2, dtype=torch.bool)
    same[1, 0] = False
    for name in ("confidence2d", "trusted3d"):
        assert torch.equal(getattr(others, name)[same], getattr(part, name)[same])
    assert whole.undoubted() is whole
    single = marked.to(torch.zeros(1, dtype=torch.float32)).doubted
    assert single is not None and torch.equal(single, doubted)
    for wrong in (doubted[:4], doubted.double()):
        with pytest.raises(ValueError, match="doubted"):
            replace(whole, doubted=wrong)


def test_slicing_keeps_leading_batch_axes() -> None:
    one = example()
    stacked = Detections.from_joints(one.joints2d[None], one.confidence2d[None], None)
    part = stacked.frames(slice(2)).select([1])
    assert part.joints2d.shape == (1, 2, 1, 16, 2)
    assert part.joints3d is None and not part.trusted3d.any()


def test_to_follows_a_tensor() -> None:
    single = example().to(torch.zeros(1, dtype=torch.float32))
    assert single.joints2d.dtype == single.confidence2d.dtype == torch.float32
    assert single.trusted3d.dtype == torch.bool and single.trusted3d.all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"joints2d": torch.zeros(5, 3, 17, 2)}, "joints2d has shape"),
        ({"joints2d": torch.zeros(16, 2)}, "expected"),
        ({"confidence2d": torch.zeros(5, 16)}, "confidence2d has shape"),
        ({"joints3d": torch.zeros(5, 3, 16, 2)}, "joints3d has shape"),
        ({"trusted3d": torch.zeros(5, 3)}, "expected torch.bool"),
        ({"trusted3d": torch.zeros(5, dtype=torch.bool)}, "trusted3d has shape"),
        ({"joints2d": torch.zeros(5, 3, 16, 2, dtype=torch.int64)}, "floating-point"),
    ],
)
def test_wrong_shapes_are_named(change: dict[str, torch.Tensor], words: str) -> None:
    good = example()
    fields = {
        name: getattr(good, name) for name in ("joints2d", "confidence2d", "joints3d", "trusted3d")
    }
    with pytest.raises(ValueError, match=words):
        Detections(**{**fields, **change})


@pytest.mark.parametrize("like", [torch.float32, "cpu", torch.device("cpu")])
def test_types_and_devices_come_with_a_tensor(like: object) -> None:
    with pytest.raises(InputError, match="expected a tensor of the type and device"):
        example().to(like)  # type: ignore[arg-type]


def test_arrays_are_refused_by_name() -> None:
    pixels, sure = example().joints2d.numpy(), example().confidence2d.numpy()
    with pytest.raises(InputError, match="got a ndarray, expected tensors"):
        Detections.from_joints(pixels, sure)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="got a ndarray, expected tensors"):
        replace(example(), joints2d=pixels)  # type: ignore[arg-type]


def test_zeros_of_what_is_not_seen_are_no_poses() -> None:
    """Zeros stand for joints that were not found where the images do not show them either."""
    whole = example()
    assert whole.joints3d is not None
    poses, sure = whole.joints3d.clone(), whole.confidence2d.clone() + 0.1
    poses[1, 0, 4] = poses[3, 2, 15] = poses[4, 1, 0] = 0.0
    sure[1, 0, 4], sure[3, 2, 15], sure[2, 2, 7] = 0.0, torch.nan, 0.0
    found = replace(whole, joints3d=poses, confidence2d=sure).finite()
    trusted = torch.ones(5, 3, dtype=torch.bool)
    trusted[1, 0] = trusted[3, 2] = False  # a joint alone that is not seen, or a zero, is none
    assert torch.equal(found.trusted3d, trusted)
