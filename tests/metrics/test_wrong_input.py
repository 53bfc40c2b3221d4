"""Metrics name what would be compared with something else, or spread over it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from perfcap.errors import InputError
from perfcap.metrics import (
    Alignment,
    acceleration_error,
    align,
    aligned_distances,
    angle_error,
    attach_markers,
    bone_angle_error,
    bone_length_variation,
    boundary_f,
    correct_share,
    counted_joints,
    floor_contact,
    foot_skate,
    girth_errors,
    image_correct_share,
    jerk,
    joint_errors,
    limit_violations,
    marker_error,
    mask_overlap,
    penetration,
    torso_size,
)

F64 = torch.float64
GENERATOR = torch.Generator().manual_seed(2)
TRUTH = torch.rand(6, 16, 3, generator=GENERATOR, dtype=F64)
FOUND = TRUTH + 0.01 * torch.rand(6, 16, 3, generator=GENERATOR, dtype=F64)
ALL = torch.ones(6, 16, dtype=torch.bool)
UP = torch.tensor([0.0, 1.0, 0.0], dtype=F64)
STEPS = torch.ones(5, 2, dtype=torch.bool)


@pytest.mark.parametrize("alignment", Alignment)
def test_alignments_go_by_name_too(alignment: Alignment) -> None:
    """A name that is not the enumeration's own object was no alignment at all."""
    name = "".join(alignment.value)
    assert torch.equal(align(FOUND, TRUTH, ALL, name), align(FOUND, TRUTH, ALL, alignment))
    expected = aligned_distances(FOUND, TRUTH, ALL, alignment)
    assert torch.equal(aligned_distances(FOUND, TRUTH, ALL, name), expected)
    for function in (align, aligned_distances):
        with pytest.raises(InputError, match=r"alignment is 'procrustes', expected one of 'abs"):
            function(FOUND, TRUTH, ALL, "procrustes")


@pytest.mark.parametrize("kind", [torch.uint8, torch.int64, F64])
def test_masks_are_bool(kind: torch.dtype) -> None:
    """A byte of 255 counted 255 times in the mean."""
    errors = 1000 * (FOUND - TRUTH).norm(dim=-1)
    assert correct_share(errors, ALL) == 100
    with pytest.raises(InputError, match="valid is torch"):
        correct_share(errors, 255 * ALL.to(kind))
    with pytest.raises(InputError, match="valid is torch"):
        aligned_distances(FOUND, TRUTH, ALL.to(kind), Alignment.SIMILARITY)
    with pytest.raises(InputError, match="contact is torch"):
        foot_skate(FOUND[:, :2], STEPS.to(kind), UP)


@pytest.mark.parametrize(
    "compare",
    [
        acceleration_error,
        lambda a, b: bone_angle_error(a, b, [(0, 1)]),
        lambda a, b: joint_errors(a, b, 30.0),
        lambda a, b: jerk(b[0], 30.0),
    ],
)
def test_one_frame_is_not_spread_over_all(compare) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match="give joints of the same frames"):
        compare(FOUND, TRUTH[:1])


def test_arrays_are_named() -> None:
    with pytest.raises(InputError, match="estimate is a ndarray"):
        joint_errors(FOUND.numpy(), TRUTH.numpy(), 30.0)  # type: ignore[arg-type]


def test_hips_of_other_joints_are_asked_for() -> None:
    """Joints 8 and 12 of another set are no hips."""
    found, truth = (torch.cat((each, each[:, :1]), -2) for each in (FOUND, TRUTH))
    for known in ({}, {"hips": (12, 11)}, {"trunk": (12, 11, 0)}):
        with pytest.raises(InputError, match="there are 17 joints, not the 16 landmarks"):
            joint_errors(found, truth, 30.0, **known)  # type: ignore[arg-type]
    assert joint_errors(found, truth, 30.0, (12, 11), trunk=(12, 11, 0)).mpjpe < 20
    for hips in ((16, 17), ("r_hip", "l_hip")):
        with pytest.raises(InputError, match="are not among 16 joints"):
            joint_errors(FOUND, TRUTH, 30.0, hips)  # type: ignore[arg-type]


def test_limits_of_other_angles_are_refused() -> None:
    angles, lower = torch.zeros(6, 27, dtype=F64), -torch.ones(27, dtype=F64)
    assert limit_violations(angles, lower, -lower).share == 0
    for other in (angles[:, :1], angles[0]):
        with pytest.raises(InputError, match="of the same rig"):
            limit_violations(other, lower, -lower)
    for wrong in (-lower, lower * torch.nan):
        with pytest.raises(InputError, match="a lower limit is above"):
            limit_violations(angles, wrong, lower)


def test_directions_shares_and_bones_that_are_none() -> None:
    with pytest.raises(InputError, match=r"up is \[0.0, 2.0, 0.0\]"):
        foot_skate(FOUND[:, :2], STEPS, 2 * UP)
    pixels = TRUTH[..., :2]
    for share in (20, 0, float("nan")):
        with pytest.raises(InputError, match="share is"):
            image_correct_share(pixels, pixels, torso_size(pixels), share)
    seen = torch.rand(9, 16, 2, generator=torch.Generator().manual_seed(0))
    with pytest.raises(InputError, match="times what the true joints span"):  # 100 % of any joints
        image_correct_share(seen, seen, 640 * torso_size(seen), 0.2)
    assert image_correct_share(seen, seen, 1.2 * seen.new_ones(9) * 2**0.5, 0.2) == 100  # of a box
    few = seen.where((torch.arange(16) < 3)[:, None], torch.nan)
    assert image_correct_share(few, few, seen.new_full((9,), 9.0), 0.2) == 100
    for bones in ([], (0, 1)):
        with pytest.raises(InputError, match="expected pairs of joints"):
            bone_length_variation(TRUTH, bones)  # type: ignore[arg-type]


def test_masks_that_are_none() -> None:
    mask = np.ones((4, 5), dtype=bool)
    for other in (mask[None], mask[..., None]):
        with pytest.raises(InputError, match=r"expected \(H, W\)"):
            mask_overlap(other, other)
    for radius in (-1, 0.008):
        with pytest.raises(InputError, match=r"radius is .* expected a whole number"):
            boundary_f(torch.tensor(mask), torch.tensor(mask), radius)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="give masks of one size"):
        boundary_f(torch.tensor(mask[:0]), torch.tensor(mask[:0]))


@pytest.mark.parametrize("bones", [[(2, 16)], [(-1, 2)], [(1, 2, 3)]])
def test_bones_of_other_joints(bones: list[tuple[int, ...]]) -> None:
    with pytest.raises(InputError, match="expected pairs of the joints 0 to 15"):
        bone_angle_error(FOUND, TRUTH, bones)  # type: ignore[arg-type]


def test_the_worst_of_nothing_is_not_zero() -> None:
    nothing = torch.full((2, 4, 3), torch.nan, dtype=F64)
    nothing[0] = 0.5
    limit = torch.ones(3, dtype=F64)
    worst = limit_violations(nothing, -limit, limit).worst
    assert float(worst[0]) == 0 and worst[1].isnan()
    depth = penetration(nothing).worst
    assert float(depth[0]) == 0 and depth[1].isnan()


@pytest.mark.parametrize("unit", [100, 1000])
def test_other_units_of_length(unit: float) -> None:
    with pytest.raises(InputError, match=r"^estimate spans .* expected metres; convert them"):
        joint_errors(FOUND * unit, TRUTH, 30)
    with pytest.raises(InputError, match=r"^truth spans .* expected metres; convert them"):
        joint_errors(FOUND, TRUTH * unit, 30)


def test_degrees() -> None:
    angles = torch.linspace(-1, 1, 10, dtype=F64).expand(4, 10)
    limit = torch.full((10,), 1.5, dtype=F64)
    for found, edge in ((angles, limit.rad2deg()), (angles.rad2deg(), limit)):
        with pytest.raises(InputError, match="expected radians"):
            limit_violations(found, -edge, edge)
    with pytest.raises(InputError, match="expected radians"):
        angle_error(angles, angles.rad2deg())


def test_markers_that_are_not_on_the_surface() -> None:
    corners = torch.eye(3, dtype=F64)
    faces = torch.tensor([[0, 1, 2]])
    with pytest.raises(InputError, match="mm off the surface; expected metres"):
        attach_markers(corners, faces, 1000 * corners)
    assert attach_markers(corners, faces, corners + 0.05).height.shape == (3,)


def test_joints_in_space_are_no_pixels_and_a_trunk_has_three_ends() -> None:
    with pytest.raises(InputError, match=r"expected \(\*b, F, J, 2\)"):
        image_correct_share(FOUND, TRUTH, torch.ones(6, dtype=F64), 0.2)
    with pytest.raises(InputError, match="expected three joints: right hip, left hip, neck"):
        joint_errors(FOUND, TRUTH, 30, trunk=(8, 8, 1))


def test_so_few_joints_that_anything_fits() -> None:
    """Two joints have no error after a similarity, nor has one after a translation."""
    found = FOUND.clone()
    found[0, 2:] = torch.nan
    found[1, 1:] = torch.nan
    errors = joint_errors(found, TRUTH, 30, partial=True)
    rest = joint_errors(FOUND[2:], TRUTH[2:], 30)
    torch.testing.assert_close(errors.mpjpe_similarity, rest.mpjpe_similarity)
    valid = counted_joints(found, TRUTH, partial=True)
    shifted = aligned_distances(found, TRUTH, valid, "translation")
    assert shifted[0, :2].isfinite().all() and shifted[1].isnan().all()


def test_feet_of_unknown_height_do_not_stand() -> None:
    still = torch.zeros(5, 2, 3, dtype=F64)
    height = still[..., 1].clone()
    height[:, 1] = torch.nan
    assert floor_contact(still, height, 30).sum(0).tolist() == [4, 0]
    for limits in ({"rise": float("nan")}, {"speed": -1.0}):
        with pytest.raises(InputError, match="expected a finite number of 0 or more"):
            floor_contact(still, height, 30, **limits)
    for heights in (still[:, 0, 1], still[:, :0, 1]):
        with pytest.raises(InputError, match=r"expected \(\*b, F, N\)"):
            penetration(heights)


def test_truth_that_was_not_measured() -> None:
    """Any estimate fits a frame of zeros once it is scaled: half of them halved PA-MPJPE."""
    truth = TRUTH.clone()
    truth[4:, :12] = 0
    with pytest.raises(InputError, match=r"several joints at 0, 0, 0 in 2 of 6 frames .*row 4\)"):
        joint_errors(FOUND, truth, 30)
    sure = ALL.clone()
    sure[4:, :12] = False
    assert joint_errors(FOUND, truth, 30, confidence=sure).frames == 4
    truth = TRUTH - TRUTH[:, 8:9]  # relative to a joint
    assert joint_errors(FOUND, truth, 30).frames == 6


def test_frames_in_which_an_estimator_found_nobody() -> None:
    """They were a metre off, in a mean of millimetres."""
    found = FOUND.clone()
    found[4:] = 0
    with pytest.raises(InputError, match=r"estimate has several joints at 0, 0, 0 in 2 of 6 fr.*"):
        joint_errors(found, TRUTH, 30)
    sure = ALL.clone()
    sure[4:] = False
    assert joint_errors(found, TRUTH, 30, confidence=sure).frames == 4
    found[4:] = torch.nan
    assert joint_errors(found, TRUTH, 30).frames == 4


def test_motion_in_millimetres_and_seconds_of_a_frame() -> None:
    for measure in (
        lambda points: jerk(points, 30.0),
        lambda points: acceleration_error(points, points),
        lambda points: bone_length_variation(points, [(0, 1)]),
    ):
        measure(TRUTH)
        with pytest.raises(InputError, match="expected metres; convert them"):
            measure(1000 * TRUTH)
    with pytest.warns(UserWarning, match="a frame takes 0.03333 s, give 30"):
        jerk(TRUTH, 1 / 30)


@pytest.mark.parametrize("unit", [200, 1000])
def test_feet_markers_and_heights_in_another_unit(unit: float) -> None:
    feet = TRUTH[:, :2]
    for measure in (
        lambda scale: foot_skate(scale * feet, STEPS, UP),
        lambda scale: floor_contact(scale * feet, scale * feet[..., 1], 30.0),
        lambda scale: marker_error(scale * FOUND, TRUTH),
        lambda scale: marker_error(FOUND, scale * TRUTH),
        lambda scale: penetration(scale * TRUTH[..., 1]),
    ):
        measure(1.0)
        with pytest.raises(InputError, match=r"spans .* in a frame, expected metres; convert"):
            measure(unit)


def test_heights_in_another_unit_than_the_feet() -> None:
    feet = TRUTH[:, :2]
    with pytest.raises(InputError, match=r"times as much as feet move, expected metres in both"):
        floor_contact(feet, 1000 * feet[..., 1], 30.0)


def test_markers_with_gaps_in_millimetres() -> None:
    measured = 1000 * TRUTH
    measured[:, 3] = torch.nan
    with pytest.raises(InputError, match=r"^measured spans .* expected metres; convert them"):
        marker_error(FOUND, measured)


def test_the_place_of_an_estimate_is_no_unit() -> None:
    assert float(penetration(TRUTH[..., 1] - 500).depth) > 499_000
    assert float(marker_error(FOUND + 500, TRUTH + 500).mean) < 20


@pytest.mark.parametrize("unit", [100, 1000])
def test_girths_in_another_unit(unit: float) -> None:
    body = {"chest": 1.0, "waist": 0.8, "wrist": 0.15}
    other = {name: unit * value for name, value in body.items()}
    for found, truth, whose in ((other, body, "found"), (body, other, "true")):
        with pytest.raises(InputError, match=f"^{whose} measures are about .* expected metres"):
            girth_errors(found, truth)
    with pytest.raises(InputError, match="expected metres"):
        girth_errors({"wrist": 12.0}, {"wrist": 0.12})
