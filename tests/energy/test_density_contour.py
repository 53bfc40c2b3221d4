"""The contour energy: its slope, its curvature, its twins, and that it finds a person."""

from contextlib import nullcontext
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from checks import check_coupling, check_shapes
from numpy.typing import NDArray
from synthetic import actor, random_motion
from synthetic import cameras as circle
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.volume import GaussianCentres, Volume
from perfcap.energy.density_contour import DensityContour
from perfcap.energy.prior import PosePrior
from perfcap.errors import InputError
from perfcap.geometry.plain import torch_only
from perfcap.render.density import Splats, background
from perfcap.solve import LevenbergMarquardt, Objective, Step, solve

F64 = torch.float64


@dataclass(frozen=True)
class Seen:
    edges: NDArray[np.float32] | Tensor
    flat: NDArray[np.float32] | Tensor
    corner: tuple[int, int]


def body() -> tuple[GaussianCentres, Volume]:
    """Blobs along the limbs of the person of tubes."""
    skeleton = actor().skeleton
    rig = skeleton.rig
    ends = {p: c for c, p in reversed(list(enumerate(rig.parents))) if p >= 0}
    places, joints, widths = [], [], []
    for joint, end in ends.items():
        for share in (0.25, 0.75):
            places.append(torch.lerp(rig.positions[joint], rig.positions[end], share))
            joints.append(joint)
            widths.append(0.09 if rig.joints[joint] in ("pelvis", "spine") else 0.045)
    wide = torch.tensor(widths, dtype=F64)
    volume = Volume(torch.stack(places), wide, 3 / (2.5 * wide), torch.tensor(joints))
    return GaussianCentres(skeleton, volume), volume


def truth() -> Motion:
    rest = actor().skeleton.rest_motion(2)
    return replace(rest, angles=rest.angles + torch.tensor([[0.05], [0.1]], dtype=F64))


def seen(motion: Motion, size: int = 110) -> tuple[DensityContour, GaussianCentres]:
    """The energy of images whose edges are the contours of the body in a motion."""
    points, volume = body()
    cameras = circle(3, size=size)
    splats = Splats.seen_by(cameras, points(motion), volume.deviations, volume.densities)
    _, slope = background(splats, (size, size))
    x, y = slope.unbind(-3)
    strength = (x * x + y * y).sqrt().clamp(min=1e-9)
    double = torch.stack(((x * x - y * y) / strength, 2 * x * y / strength), -3)
    flat = (0.1 - strength).clamp(min=0)
    fields = [
        [
            Seen(
                double[f, c, :, 3:, 5:].numpy().astype(np.float32),
                flat[f, c, 3:, 5:].numpy().astype(np.float32),
                (3, 5),
            )
            for c in range(3)
        ]
        for f in range(motion.frames)
    ]
    return DensityContour(points, volume, cameras, fields, unit=1.0, offset=200.0), points


def near(motion: Motion, size: float = 0.02) -> Motion:
    here = motion.coordinates()
    draw = torch.Generator().manual_seed(3)
    return motion.retract(
        Step(size * torch.randn(here.frame.shape, generator=draw, dtype=F64), here.shared)
    )


def test_contract_of_an_energy() -> None:
    energy, _ = seen(truth())
    state = near(truth())
    check_shapes(energy, state)
    check_coupling(energy, state)
    torch.testing.assert_close(energy.per_frame(state).sum(-1), energy(state))


def test_slope_against_differences() -> None:
    energy, points = seen(truth())
    here = points(near(truth()))
    found = energy.expand(here)
    draw = torch.Generator().manual_seed(4)
    for _ in range(3):
        way = torch.randn(here.shape, generator=draw, dtype=F64)
        ahead, behind = (energy.expand(here + s * 1e-6 * way).value for s in (1, -1))
        slope = (found.gradient * way).sum((-2, -1))
        torch.testing.assert_close(slope, (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-5)
    eigenvalues = torch.linalg.eigvalsh(found.curvature)
    assert bool((eigenvalues > -1e-9 * eigenvalues.max()).all())


def test_widths_may_be_unknown() -> None:
    """Slope and curvature in centres and logarithms of widths; the rays' optical depth stays."""
    energy, points = seen(truth())
    _, volume = body()
    here = points(near(truth()))
    widths = volume.deviations.log().expand(here.shape[:-1])[..., None]
    both = torch.cat((here, widths), -1)
    torch.testing.assert_close(energy.values(both), energy.values(here))
    found = energy.expand(both)
    draw = torch.Generator().manual_seed(6)
    way = torch.randn(both.shape, generator=draw, dtype=F64)
    ahead, behind = (energy.expand(both + s * 1e-6 * way).value for s in (1, -1))
    slope = (found.gradient * way).sum((-2, -1))
    torch.testing.assert_close(slope, (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-5)
    eigenvalues = torch.linalg.eigvalsh(found.curvature)
    assert bool((eigenvalues > -1e-9 * eigenvalues.max()).all())
    assert float(found.curvature[..., 3, 3].amin()) >= 0
    assert float(found.curvature[..., 3, 3].amax()) > 0
    grown = torch.cat((here, widths + 0.3), -1)
    wider = DensityContour(
        points,
        replace(
            volume,
            deviations=volume.deviations * np.exp(0.3),
            densities=volume.densities / np.exp(0.3),
        ),
        energy.cameras,
        energy.fields,
        unit=1.0,
        offset=200.0,
    )
    torch.testing.assert_close(energy.values(grown), wider.values(here))


def test_kernels_equal_plain_torch() -> None:
    energy, points = seen(truth())
    here = points(near(truth()))
    fast = energy.expand(here)
    with torch_only():
        plain = energy.expand(here)
    torch.testing.assert_close(fast.value, plain.value, rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(fast.gradient, plain.gradient, rtol=1e-4, atol=1e-3)
    scale = float(plain.curvature.abs().max())
    torch.testing.assert_close(fast.curvature, plain.curvature, rtol=1e-4, atol=1e-5 * scale)
    torch.testing.assert_close(energy.values(here), fast.value)


def test_gradient_reaches_widths_and_images() -> None:
    energy, points = seen(truth())
    free = [
        [
            replace(
                each,
                edges=torch.tensor(each.edges).double().requires_grad_(),
                flat=torch.tensor(each.flat),
            )
            for each in row
        ]
        for row in energy.fields
    ]
    _, volume = body()
    wide = volume.deviations.clone().requires_grad_()
    loss = DensityContour(points, replace(volume, deviations=wide), energy.cameras, free)
    loss(truth()).backward()
    assert wide.grad is not None and float(wide.grad.abs().max()) > 0
    assert all(float(each.edges.grad.abs().max()) > 0 for row in free for each in row)
    step = 1e-4 * torch.randn(wide.shape, generator=torch.Generator().manual_seed(5), dtype=F64)

    def at(deviations: Tensor) -> Tensor:
        widened = replace(volume, deviations=deviations.detach())
        return DensityContour(points, widened, energy.cameras, energy.fields)(truth())

    change = at(wide + step) - at(wide - step)
    assert float((wide.grad * step).sum()) == pytest.approx(float(change) / 2, rel=1e-3)


def test_finds_the_pose_whose_contours_were_seen() -> None:
    known = truth()
    energy, points = seen(known, 160)
    energy.weight = torch.tensor(1.0, dtype=F64)
    prior = PosePrior(known.angles.mean(0), 1.5, 1e-2)
    start = near(known, 0.015)
    solution = solve(
        Objective(contour=energy, prior=prior), start, LevenbergMarquardt(max_steps=30)
    )
    before, after = (
        (points(each) - points(known)).norm(dim=-1).mean() for each in (start, solution.state)
    )
    assert float(before) > 0.015 and float(after) < 0.4 * float(before)


def test_no_pose_is_below_the_bound() -> None:
    energy, points = seen(truth())
    bound = energy.lower_bound(points(near(truth(), 0.05)))
    assert bound < float(energy.values(points(truth())).min()) < 0


def test_support_tells_edges_from_texture_and_from_nothing() -> None:
    energy, points = seen(truth())
    here = points(truth())
    noise = np.random.default_rng(0)

    def among(edges: NDArray[np.float32]) -> DensityContour:
        fields = [[replace(each, edges=edges) for each in row] for row in energy.fields]
        return DensityContour(points, body()[1], energy.cameras, fields)

    turns = noise.uniform(0, 2 * np.pi, energy.fields[0][0].flat.shape)
    texture = np.stack((np.cos(turns), np.sin(turns))).astype(np.float32)
    assert float(energy.support(here).min()) > 0.4
    assert float(among(texture).support(here).abs().max()) < 0.1
    assert float(among(0 * texture).support(here).abs().max()) == 0
    assert float(energy.support(points(near(truth(), 0.1))).max()) < 0.35


@pytest.mark.usefixtures("both_twins")
def test_an_empty_field_costs_nothing() -> None:
    energy, points = seen(truth())
    none = Seen(np.zeros((2, 0, 0), np.float32), np.zeros((0, 0), np.float32), (0, 0))
    _, volume = body()
    blind = DensityContour(points, volume, energy.cameras, [[none] * 3] * 2)
    found = blind.expand(points(truth()))
    assert float(found.value.abs().max()) == 0 and float(found.gradient.abs().max()) == 0


def test_wrong_numbers_are_refused() -> None:
    energy, points = seen(truth())
    _, volume = body()
    with pytest.raises(InputError, match="expected the same numbers"):
        DensityContour(points, volume, energy.cameras, [row[:2] for row in energy.fields])
    with pytest.raises(InputError, match="same frames"):
        energy(random_motion(actor().skeleton, 3))


def test_gaussians_are_shifted_in_images_of_another_time() -> None:
    energy, points = seen(truth())
    here = points(truth())
    _, volume = body()
    given = points, volume, energy.cameras, energy.fields
    shift = torch.zeros(2, 3, points.count, 2, dtype=F64)
    shift[:, 1] = torch.tensor([2.5, -1.5], dtype=F64)
    lens = energy.cameras.intrinsics.clone()
    lens[1, :2, 2] += shift[0, 1, 0]
    moved = DensityContour(points, volume, replace(energy.cameras, intrinsics=lens), energy.fields)
    shifted = DensityContour(*given, shift=shift)
    for ours, theirs in (
        (shifted.values(here), moved.values(here)),
        (shifted.expand(here).gradient, moved.expand(here).gradient),
        (shifted.support(here), moved.support(here)),
    ):
        torch.testing.assert_close(ours, theirs)
    with pytest.raises(InputError, match="shift of contours is"):
        DensityContour(*given, shift=shift[:1])


def test_edges_and_prices_of_other_pixels_are_refused() -> None:
    """Compiled loops read beyond the end of arrays."""
    points, volume = body()
    for edges, flat in (((2, 5, 5), (9, 9)), ((1, 9, 9), (9, 9)), ((2, 9), (9,))):
        field = Seen(np.zeros(edges, np.float32), np.zeros(flat, np.float32), (0, 0))
        with pytest.raises(InputError, match="of a field has shape"):
            DensityContour(points, volume, circle(1, size=110), [[field]] * 2)


@pytest.mark.parametrize("kind", [torch.float16, torch.bfloat16, torch.int32, F64])
def test_fields_of_any_type(kind: torch.dtype) -> None:
    points, volume = body()
    edges, flat = torch.ones(2, 60, 60), torch.ones(60, 60)
    values = [
        DensityContour(points, volume, circle(1, size=110), [[Seen(*field, (20, 20))]] * 2).values(
            points(truth())
        )
        for field in ((edges, flat), (edges.to(kind), flat.to(kind)))
    ]
    torch.testing.assert_close(*values)


@pytest.mark.long
@pytest.mark.parametrize("twin", [False, True])
def test_what_is_no_number_is_not_a_good_contour(twin) -> None:
    """A body without widths, or a frame without places, cost nothing at all."""
    energy, points = seen(truth())
    at = points(truth())
    usual = energy.values(at)
    lost = at.clone()
    lost[1, 3] = torch.nan
    with torch_only() if twin else nullcontext():
        for given in (energy.values(lost), energy.expand(lost).value):
            assert given.isnan().tolist() == [False, True]
            assert torch.allclose(given[0], usual[0])
        energy.deviations[2] = torch.nan
        assert bool(energy.values(at).isnan().all())
        assert bool(energy.expand(at).value.isnan().all())
    energy, _ = seen(truth())
    energy.cameras.rotation[1, 0, 0] = torch.inf
    assert bool(energy.values(at).isnan().all())


def test_an_unknown_frame_leaves_the_offset_of_the_others() -> None:
    energy, points = seen(truth())
    at = points(truth())
    lost = at.clone()
    lost[1] = torch.nan
    alone = float(energy.lengths(at)[0] / energy.lengths(at).amax())
    assert energy.lower_bound(lost) == pytest.approx(alone * energy.lower_bound(at))
