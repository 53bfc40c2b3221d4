"""True surfaces that contradict the true joints are named, right ones are not."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from perfcap.metrics import surface_mismatches


def body(frames: int = 40) -> tuple[Tensor, Tensor]:
    """A cloud of skin around sixteen joints that swing and walk: (F, V, 3) and (F, 16, 3), m."""
    generator = torch.Generator().manual_seed(0)
    rest = torch.rand(16, 3, generator=generator).double() * torch.tensor([0.5, 1.7, 0.3])
    time = torch.arange(frames).double()[:, None, None]
    phase = 6 * torch.rand(16, 3, generator=generator).double()
    joints = rest + 0.15 * torch.sin(time / 4 + phase) + time * torch.tensor([0.03, 0.0, 0.0])
    skin = torch.randn(16, 30, 3, generator=generator).double()
    skin = 0.06 * skin / skin.norm(dim=-1, keepdim=True)
    return (joints[:, :, None] + skin).flatten(1, 2), joints


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda v: 1000 * v, "times as large as its joints from end to end; expected metres"),
        (lambda v: torch.stack((v[..., 0], -v[..., 2], v[..., 1]), -1), "lie within the true"),
        (lambda v: v + torch.tensor([0.0, 0.0, 2.0]), "only 0% of the true joints lie within"),
        (lambda v: torch.cat((v[:1].expand(3, -1, -1), v[:-3])), "of 3 frames later fits"),
        (lambda v: torch.cat((v[1:], v[-1:])), "of 1 frame earlier fits"),
    ],
)
def test_surfaces_of_other_joints(change: Callable[[Tensor], Tensor], said: str) -> None:
    vertices, joints = body()
    (line,) = surface_mismatches(change(vertices), joints)
    assert said in line


def test_right_surfaces_and_unknown_joints_are_not_named() -> None:
    vertices, joints = body()
    assert surface_mismatches(vertices, joints) == ()
    joints[:, 3] = torch.nan
    joints[5:9, 4] = torch.nan
    assert surface_mismatches(vertices, joints) == ()
    assert surface_mismatches(1000 * vertices, torch.full_like(joints, torch.nan)) == ()
    assert surface_mismatches(vertices[:2], joints[:2]) == ()


def test_surfaces_of_few_vertices_and_truths_of_few_joints() -> None:
    vertices, joints = body()
    assert surface_mismatches(vertices[:, ::60], joints) == ()
    joints[:, 1:] = torch.nan
    assert surface_mismatches(vertices, joints) == ()
