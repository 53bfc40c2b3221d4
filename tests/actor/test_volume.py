"""Gaussians of a body: where they lie, how they move, and that they look like the mesh."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from synthetic import actor, random_motion

from perfcap.actor.motion import BONES
from perfcap.actor.volume import GaussianCentres, Volume
from perfcap.actor.volume_fit import Silhouettes, VolumeFit, fit_volume, interior, place_gaussians
from perfcap.errors import InputError
from perfcap.io.actor import load_actor
from perfcap.solve import Step

F64 = torch.float64


def some_volume() -> Volume:
    person = actor()
    draw = torch.Generator().manual_seed(1)
    joints = torch.arange(16).repeat_interleave(2)
    centres = person.skeleton.rest_positions[joints]
    centres = centres + 0.05 * torch.randn(centres.shape, generator=draw, dtype=F64)
    ones = torch.ones(len(joints), dtype=F64)
    return Volume(centres, 0.05 * ones, 10 * ones, joints)


def test_centres_ride_on_their_joints() -> None:
    person, volume = actor(), some_volume()
    motion = random_motion(person.skeleton, 3)
    rotation, shift = person.joint_transforms(motion)
    expected = (rotation[:, volume.joints] @ volume.centres[..., None]).squeeze(-1)
    expected = expected + shift[:, volume.joints]
    torch.testing.assert_close(GaussianCentres(person.skeleton, volume)(motion), expected)


@pytest.mark.parametrize("bones", [False, True])
def test_derivatives_of_centres(bones: bool) -> None:
    skeleton = actor().skeleton
    points, motion = GaussianCentres(skeleton, some_volume()), random_motion(skeleton, 2)
    if bones:
        motion = replace(
            motion, shared={BONES: torch.full((len(skeleton.group_names),), 0.1).double()}
        )
    value, frame, shared = points.linearize(motion)
    torch.testing.assert_close(value, points(motion))
    assert (shared is not None) is bones
    draw = torch.Generator().manual_seed(2)
    here = motion.coordinates()
    step = Step(
        torch.randn(here.frame.shape, generator=draw, dtype=F64),
        torch.randn(here.shared.shape, generator=draw, dtype=F64),
    )
    size = 1e-6
    ahead, behind = (
        points(motion.retract(Step(s * size * step.frame, s * size * step.shared))) for s in (1, -1)
    )
    change = (frame @ step.frame[:, None, :, None]).squeeze(-1)
    if shared is not None:
        change = change + shared @ step.shared
    torch.testing.assert_close(change, (ahead - behind) / (2 * size), atol=1e-8, rtol=1e-6)


def test_longer_bones_carry_their_gaussians_along() -> None:
    skeleton, volume = actor().skeleton, some_volume()
    points, rest = GaussianCentres(skeleton, volume), skeleton.rest_motion()
    longer = torch.zeros(len(skeleton.group_names), dtype=F64)
    shin = skeleton.rig.bone_groups[skeleton.rig.joints.index("l_ankle")]
    longer[skeleton.group_names.index(shin)] = 0.2
    moved = points(replace(rest, shared={BONES: longer}))[0] - points(rest)[0]
    joints = skeleton.rig.joints
    ankle = volume.joints == joints.index("l_ankle")
    knee = volume.joints == joints.index("l_knee")
    assert float(moved[ankle, 1].max()) < -0.05
    assert bool((moved[volume.joints == joints.index("head")].abs() < 1e-9).all())
    # what rides on the shin stretches with it: further down, further along
    below = volume.centres[knee, 1] - skeleton.rest_positions[joints.index("l_knee"), 1]
    assert bool(((moved[knee, 1] < 0) == (below < 0)).all())


@pytest.mark.long
def test_interior_of_a_person_of_tubes() -> None:
    person = load_actor("sam")
    points = interior(person, 0.02)
    # 68 kg of a body as dense as water fill 8500 cubes of 2 cm
    assert 6000 < len(points) < 14000
    low, high = person.vertices.amin(0).numpy(), person.vertices.amax(0).numpy()
    assert (points >= low - 1e-6).all() and (points <= high + 1e-6).all()
    head = points[:, 1] > high[1] - 0.1
    assert np.ptp(points[head, 0]) < 0.25


def test_a_mesh_without_an_inside_is_refused() -> None:
    person = load_actor("sam")
    turned = replace(person.template, faces=person.template.faces[:, ::-1].copy())
    with pytest.raises(InputError, match="closed mesh"):
        interior(type(person)(turned))


def test_too_few_gaussians_are_refused() -> None:
    with pytest.raises(InputError, match="at least"):
        place_gaussians(load_actor("sam"), 10, np.random.default_rng(0))


def test_volumes_that_do_not_fit_are_refused() -> None:
    volume = some_volume()
    with pytest.raises(InputError, match="expected"):
        replace(volume, deviations=volume.deviations[:-1])
    with pytest.raises(InputError, match="joints"):
        GaussianCentres(actor().skeleton, replace(volume, joints=volume.joints + 1))


@pytest.mark.long
def test_few_steps_help_and_many_fill_the_silhouettes() -> None:
    person = load_actor("sam").double()
    rng = np.random.default_rng(0)
    placed = place_gaussians(person, 91, rng)
    assert placed.count == 91 and int(torch.bincount(placed.joints).max()) <= 12
    # other views and poses than those of the fit
    unseen = Silhouettes(person, VolumeFit(height=160, views=5, poses=1), np.random.default_rng(9))
    volume = fit_volume(person, settings=VolumeFit(height=160, poses=2, steps=200))
    before, after = unseen.overlap(placed), unseen.overlap(volume)
    assert np.mean(after) > np.mean(before) + 0.05
    assert np.mean(after) > 0.9


@pytest.mark.slow
def test_volume_covers_the_mesh_at_rest() -> None:
    person = load_actor("sam").double()
    six = Silhouettes(person, VolumeFit(height=400, views=6, poses=0), np.random.default_rng(1))
    assert np.mean(six.overlap(fit_volume(person))) > 0.94


@pytest.mark.parametrize("spacing", [0.0, -1.0, math.nan, math.inf])
def test_grids_of_no_size_are_refused(spacing: float) -> None:
    with pytest.raises(InputError, match="spacing is"):
        interior(actor(), spacing)


@pytest.mark.usefixtures("both_twins")
@pytest.mark.parametrize(
    ("part", "value"),
    [("deviations", -0.05), ("deviations", 0.0), ("densities", -1.0), ("centres", math.nan)],
)
def test_gaussians_that_are_none(part: str, value: float) -> None:
    """Negative widths were drawn, and moved like others."""
    volume = some_volume()
    numbers = getattr(volume, part).clone()
    numbers[3] = value
    with pytest.raises(InputError, match=r"^volume has deviations from"):
        replace(volume, **{part: numbers})
