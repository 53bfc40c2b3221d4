from __future__ import annotations

import pytest
import torch

from perfcap.errors import InputError
from perfcap.geometry.camera import look_at


def random_view(seed: int = 0, batch: int = 5):
    rng = torch.Generator().manual_seed(seed)
    return torch.randn(3, batch, 3, generator=rng, dtype=torch.float64).unbind(0)


def test_rotation_is_proper_and_the_target_is_straight_ahead() -> None:
    eye, target, up = random_view()
    rotation, translation = look_at(eye, target, up)
    identity = torch.eye(3, dtype=torch.float64).expand(5, 3, 3)
    torch.testing.assert_close(rotation @ rotation.mT, identity)
    torch.testing.assert_close(torch.linalg.det(rotation), torch.ones(5, dtype=torch.float64))
    seen = (rotation @ target[..., None]).squeeze(-1) + translation
    ahead = torch.zeros_like(seen)
    ahead[:, 2] = (target - eye).norm(dim=-1)
    torch.testing.assert_close(seen, ahead)
    centre = (rotation @ eye[..., None]).squeeze(-1) + translation
    torch.testing.assert_close(centre, torch.zeros_like(centre))


def test_up_points_up_in_the_image() -> None:
    eye, target, up = random_view(1)
    rotation, _ = look_at(eye, target, up)
    seen = (rotation @ up[..., None]).squeeze(-1)
    assert (seen[:, 1] < 0).all()
    torch.testing.assert_close(seen[:, 0], torch.zeros(5, dtype=torch.float64))


def test_a_camera_in_front_of_a_person_sees_the_world_x_axis_to_the_right() -> None:
    eye, target = torch.tensor([0.0, 1.0, 5.0]), torch.tensor([0.0, 1.0, 0.0])
    rotation, translation = look_at(eye, target, torch.tensor([0.0, 1.0, 0.0]))
    torch.testing.assert_close(rotation, torch.diag(torch.tensor([1.0, -1.0, -1.0])))
    torch.testing.assert_close(translation, torch.tensor([0.0, 1.0, 5.0]))


@pytest.mark.parametrize(
    ("target", "up"),
    [([0.0, 0, 0], [0.0, 1, 0]), ([0.0, 3, 0], [0.0, 1, 0]), ([1.0, 0, 0], [0.0, 0, 0])],
)
def test_undefined_views_are_refused(target: list[float], up: list[float]) -> None:
    with pytest.raises(InputError, match="up"):
        look_at(torch.zeros(3), torch.tensor(target), torch.tensor(up))
