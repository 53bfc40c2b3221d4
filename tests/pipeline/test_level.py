"""A level world: everything is seen as before, upright, on the floor."""

import pytest
import torch
from takes import make_take

from perfcap.energy import PosePrior
from perfcap.errors import InputError
from perfcap.pipeline import capture
from perfcap.pipeline.move import moved_cameras, moved_motion

F64 = torch.float64
# a camera that is tilted by 20 degrees, its y down
TILT = torch.tensor(
    [[1, 0, 0, 0.3], [0, -0.9397, 0.3420, 1.0], [0, -0.3420, -0.9397, 2.0], [0, 0, 0, 1]],
    dtype=F64,
)


def rigid() -> torch.Tensor:
    transform = TILT.clone()
    u, _, v = torch.linalg.svd(transform[:3, :3])
    transform[:3, :3] = u @ v
    return transform


def test_what_is_moved_is_seen_at_the_same_place() -> None:
    take, transform = make_take(4, views=2), rigid()
    before = take.cameras.project(take.actor.joints(take.truth))
    motion = moved_motion(take.truth, transform)
    after = moved_cameras(take.cameras, transform).project(take.actor.joints(motion))
    torch.testing.assert_close(after, before, rtol=0, atol=1e-7)
    local = take.actor.joints(take.truth) @ transform[:3, :3].mT + transform[:3, 3]
    torch.testing.assert_close(take.actor.joints(motion), local, rtol=0, atol=1e-9)


def test_a_capture_with_an_unknown_camera_ends_upright() -> None:
    take = make_take(30, views=1)
    own = moved_cameras(take.cameras, _to_camera(take))
    assert torch.allclose(own.rotation[0], torch.eye(3, dtype=F64), atol=1e-9)
    found = capture(take.actor, own, take.detections, take.rate, level=True)
    body = found.joints()
    up = body[:, 0] - body[:, [10, 14]].mean(1)
    assert (torch.nn.functional.normalize(up, dim=-1)[:, 1] > 0.8).all()
    seen = found.cameras.project(found.joints())
    torch.testing.assert_close(seen, take.detections.joints2d, rtol=0, atol=12.0)
    if found.floor is not None:
        assert float(found.floor.normal[1]) == pytest.approx(1)
        assert float(found.floor.height) == pytest.approx(0, abs=1e-9)


def test_own_energies_and_another_world_are_refused() -> None:
    take = make_take(4)
    parts = take.actor, take.cameras, take.detections, take.rate
    with pytest.raises(InputError, match="mine are of the world of the cameras"):
        capture(
            *parts, level=True, energies={"mine": lambda actor, where: PosePrior(torch.zeros(1))}
        )


def _to_camera(take: object) -> torch.Tensor:
    """From the world to the axes of the first camera."""
    camera = take.cameras  # type: ignore[attr-defined]
    transform = torch.eye(4, dtype=F64)
    transform[:3, :3], transform[:3, 3] = camera.rotation[0], camera.translation[0]
    return transform
