"""2D tracks as lifters see them."""

import torch

from perfcap.detect.joint_set import LANDMARKS16
from perfcap.detect.lifter import mirrored_features
from perfcap.detect.lifting import FEATURES, lifting_features
from perfcap.detect.viewing_ray import toward

F64 = torch.float64


def track(frames: int = 50, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    joints = 0.15 * torch.randn(1, 16, 2, generator=generator, dtype=F64)
    sway = 0.02 * torch.randn(frames, 16, 2, generator=generator, dtype=F64)
    return joints + sway, torch.rand(frames, 16, generator=generator, dtype=F64) + 0.1


def test_toward_turns_the_axis_onto_the_ray_and_is_a_rotation() -> None:
    plane = torch.randn(40, 2, dtype=F64)
    turn = toward(plane)
    ray = torch.nn.functional.normalize(
        torch.cat((plane, torch.ones(40, 1, dtype=F64)), -1), dim=-1
    )
    torch.testing.assert_close(turn[..., 2], ray)
    torch.testing.assert_close(turn @ turn.mT, torch.eye(3, dtype=F64).expand(40, 3, 3))
    assert (torch.linalg.det(turn) > 0).all()
    torch.testing.assert_close(toward(torch.zeros(2, dtype=F64)), torch.eye(3, dtype=F64))


def test_features_do_not_depend_on_where_the_person_is_seen() -> None:
    """Turning the camera moves and distorts the image; the features stay."""
    plane, confidence = track()
    there = toward(torch.tensor([0.2, -0.1], dtype=F64))
    rays = torch.cat((plane, torch.ones(*plane.shape[:-1], 1, dtype=F64)), -1) @ there.mT
    moved = rays[..., :2] / rays[..., 2:]
    here, _ = lifting_features(plane, confidence)
    other, _ = lifting_features(moved, confidence)
    assert here.shape == (50, FEATURES)
    assert (here - other).abs().max() < 0.08  # up to the middle, an average of the image
    far, _ = lifting_features(0.5 * plane, confidence)
    assert (here - far)[:, :32].abs().max() < 0.03
    torch.testing.assert_close((here - far)[:, -1].mean(), torch.tensor(2.0, dtype=F64).log(),
                               atol=0.01, rtol=0)  # fmt: skip


def test_unseen_joints_and_frames_are_zeros_and_finite() -> None:
    plane, confidence = track()
    confidence[:, 3] = 0
    confidence[10:30] = 0
    plane[:, 3] = torch.nan
    features, turn = lifting_features(plane, confidence)
    assert features.isfinite().all() and turn.isfinite().all()
    assert (features[:, 6:8] == 0).all() and (features[10:30, :48] == 0).all()
    nothing, _ = lifting_features(plane, torch.zeros_like(confidence))
    assert nothing.isfinite().all()


def test_features_of_the_mirror_image() -> None:
    plane, confidence = track()
    order = list(LANDMARKS16.mirrored())
    flipped = plane[:, order] * torch.tensor([-1.0, 1.0], dtype=F64)
    expected, _ = lifting_features(flipped, confidence[:, order])
    found = mirrored_features(lifting_features(plane, confidence)[0])
    torch.testing.assert_close(found, expected)


def test_batch_equals_loop() -> None:
    tracks = [track(seed=s) for s in range(3)]
    together, turns = lifting_features(*(torch.stack(parts) for parts in zip(*tracks, strict=True)))
    for i, (plane, confidence) in enumerate(tracks):
        alone, turn = lifting_features(plane, confidence)
        torch.testing.assert_close((together[i], turns[i]), (alone, turn))
