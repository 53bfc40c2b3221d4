"""Points of one person that are in another, pushed out of the skin."""

from __future__ import annotations

import pytest
import torch
from checks import check_energy
from synthetic import actor
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy.skin_contact import SkinContact
from perfcap.errors import InputError
from perfcap.solve.compound import Compound

FRAMES, POINTS = 3, 5
PERSON = actor()


def motion(seed: int) -> Motion:
    random = torch.Generator().manual_seed(seed)
    size = len(PERSON.skeleton.rig.hinges)
    parts = [torch.randn(FRAMES, n, generator=random, dtype=torch.float64) for n in (3, 3, size)]
    return Motion(0.05 * parts[0], 0.3 * parts[1], 0.2 * parts[2])


def points(seed: int, person: Actor = PERSON) -> SkinnedPoints:
    random = torch.Generator().manual_seed(seed)
    count = len(person.vertices)
    corners = torch.randint(count, (FRAMES, POINTS, 1), generator=random)
    return SkinnedPoints(person, corners, torch.ones(corners.shape))


def normals() -> Tensor:
    random = torch.Generator().manual_seed(9)
    given = torch.randn(FRAMES, POINTS, 3, generator=random, dtype=torch.float64)
    return torch.nn.functional.normalize(given, dim=-1)


def contact(**options: Tensor) -> SkinContact:
    given = ("one", "other"), points(0), points(1), normals()
    return SkinContact(*given, unit=0.01, **options)


STATE = Compound({"other": motion(1), "one": motion(0)})  # in another order than the names


def test_derivatives_of_both_people() -> None:
    share = torch.linspace(0, 1, FRAMES * POINTS, dtype=torch.float64).reshape(FRAMES, POINTS)
    energy = contact(confidence=share, allowed=0.01 * share)
    depths = energy.residual(STATE).value
    assert 3 < (depths > 0).sum() < FRAMES * POINTS  # some touch, some do not
    check_energy(energy, STATE)


def test_it_is_the_depth_below_the_skin() -> None:
    below = (normals() * (points(1)(STATE.parts["other"]) - points(0)(STATE.parts["one"]))).sum(-1)
    torch.testing.assert_close(contact()(STATE), (below.clamp(min=0) / 0.01).square().sum())
    allowed = torch.full((FRAMES, POINTS), float(below.max()), dtype=torch.float64)
    assert contact(allowed=allowed)(STATE) == 0


def test_what_does_not_belong_together_is_refused() -> None:
    with pytest.raises(InputError, match=r"5 and 5 points and normals \(3, 4, 3\)"):
        SkinContact(("one", "other"), points(0), points(1), normals()[:, :4])
    with pytest.raises(InputError, match="give two people"):
        SkinContact(("one", "one"), points(0), points(1), normals())
    with pytest.raises(InputError, match="confidences or depths"):
        contact(allowed=torch.zeros(FRAMES, 1))
    with pytest.raises(InputError, match=r"unit is 0\.0"):
        SkinContact(("one", "other"), points(0), points(1), normals(), unit=0.0)


def test_normals_and_confidences_that_are_none() -> None:
    """Pairs of confidence below zero were pulled into each other."""
    given = ("one", "other"), points(0), points(1)
    for wrong in (2 * normals(), torch.nan * normals()):
        with pytest.raises(InputError, match="not of length one everywhere"):
            SkinContact(*given, wrong)
    padded = normals()
    padded[0, 0] = 0
    sure = torch.ones(FRAMES, POINTS)
    sure[0, 0] = 0
    SkinContact(*given, padded, sure)
    with pytest.raises(InputError, match="expected numbers from 0 on"):
        contact(confidence=-sure)
    with pytest.raises(InputError, match="directions have shape"):
        SkinContact(*given, normals()[:1]).linearize(STATE)
