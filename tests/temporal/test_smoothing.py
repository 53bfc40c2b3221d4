import math

import pytest
import torch

from perfcap.errors import InputError
from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.temporal.smoothing import (
    Smoother,
    binomial,
    box,
    gain,
    smooth_rotations,
    smooth_vectors,
)
from perfcap.temporal.window import mean_rotations, mean_vectors

F64 = torch.float64
FILTERS = [box(), binomial(), box(3), binomial(7), box(1)]


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


def test_filters_of_five_frames():
    assert box() == pytest.approx((0.2, 0.2, 0.2))
    assert binomial() == pytest.approx((6 / 16, 4 / 16, 1 / 16))


@pytest.mark.parametrize("taps", FILTERS)
@pytest.mark.parametrize("frequency", [0, 1 / 30, 0.1, 0.3, 0.5])
def test_gain_is_what_an_oscillation_keeps(taps, frequency):
    frame = torch.arange(60, dtype=F64)
    wave = (2 * math.pi * frequency * frame + 0.3).cos()
    inner = slice(8, -8)
    smooth = smooth_vectors(wave, taps)
    torch.testing.assert_close(smooth[inner], gain(taps, frequency) * wave[inner])


def test_gains_of_the_documentation():
    frequencies = (1 / 30, 0.1, 0.2, 0.3, 0.5)
    for taps, gains in (
        (box(), (0.957, 0.647, 0, -0.247, 0.2)),
        (binomial(), (0.978, 0.818, 0.428, 0.119, 0)),
    ):
        assert [gain(taps, f) for f in frequencies] == pytest.approx(gains, abs=5.1e-4)
    noise = torch.randn(40, 5000, dtype=F64)
    assert smooth_vectors(noise, box())[2:-2].std().item() == pytest.approx(0.447, rel=0.02)
    assert smooth_vectors(noise)[2:-2].std().item() == pytest.approx(0.523, rel=0.02)


@pytest.mark.parametrize("taps", FILTERS)
@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5, 30])
def test_constant_velocity_passes_unchanged(taps, frames):
    start, velocity = torch.randn(2, 4, 3, dtype=F64)
    line = start + velocity * torch.arange(frames, dtype=F64)[:, None, None]
    for confidence in (None, torch.rand(frames), (torch.rand(frames) > 0.3).to(F64)):
        smooth = smooth_vectors(line, taps, confidence)
        torch.testing.assert_close(smooth, line, rtol=0, atol=1e-10)


def test_constant_values_pass_to_the_last_bit():
    still = torch.randn(1, 5, 3).expand(20, -1, -1)
    assert torch.equal(smooth_vectors(still), still)
    assert torch.equal(smooth_rotations(still), still)


@pytest.mark.parametrize("taps", [box(), binomial()])
def test_windows_shrink_at_the_ends(taps):
    values = torch.randn(9, 2, dtype=F64)
    smooth = smooth_vectors(values, taps)
    torch.testing.assert_close(smooth[0], values[0])
    torch.testing.assert_close(smooth[-1], values[-1])
    a, b = taps[:2]
    second = (a * values[1] + b * (values[0] + values[2])) / (a + 2 * b)
    torch.testing.assert_close(smooth[1], second)


def test_frames_that_were_not_measured_follow_the_others():
    time = torch.arange(30, dtype=F64)
    truth = 0.01 * time**2
    values = truth.clone()
    values[[11, 20, 21]] = 1e3
    confidence = torch.ones(30)
    confidence[[11, 20, 21]] = 0
    smooth = smooth_vectors(values, None, confidence)
    assert (smooth - truth).abs().max() < 0.06


def test_confidence_weighs():
    values = torch.zeros(9, dtype=F64)
    values[4] = 1
    doubt = torch.ones(9)
    doubt[4] = 0.5
    sure, doubted = smooth_vectors(values), smooth_vectors(values, None, doubt)
    assert 0 < doubted[4] < sure[4]
    assert 0 < doubted[3] < sure[3]


def test_where_nothing_was_measured_all_count_alike():
    values = torch.randn(12, 3, dtype=F64)
    nothing = smooth_vectors(values, None, torch.zeros(12))
    torch.testing.assert_close(nothing, smooth_vectors(values))


@pytest.mark.parametrize("taps", FILTERS)
@pytest.mark.parametrize("pieces", [[1] * 23, [23], [1, 9, 2, 11], [2, 2, 19]])
def test_streaming_equals_smoothing_at_once(taps, pieces):
    values = torch.randn(23, 4, 3, dtype=F64)
    confidence = torch.rand(23)
    for mean, smooth in ((mean_vectors, smooth_vectors), (mean_rotations, smooth_rotations)):
        smoother, parts, held = Smoother(mean, taps), [], 0
        cut = zip(values.split(pieces), confidence.split(pieces), strict=True)
        for value, trust in cut:
            parts.append(smoother.push(value, trust))
            held = max(held, len(smoother._held[0]))
        assert sum(map(len, parts)) == max(23 - len(taps) + 1, 0)
        torch.testing.assert_close(
            torch.cat([*parts, smoother.finish()]), smooth(values, taps, confidence)
        )
        assert held <= 2 * (len(taps) - 1)


@pytest.mark.parametrize("taps", [(1.0,), binomial(), binomial(9)])
@pytest.mark.parametrize("lost", [range(3), range(8, 20), (5, 9, 22, 23)])
def test_streams_with_frames_that_are_no_numbers_equal_clips(taps, lost):
    values = torch.randn(24, 3, generator=torch.Generator().manual_seed(0))
    confidence = torch.linspace(0.5, 1.0, 24)
    values[list(lost)], confidence[list(lost)] = torch.nan, 0.0
    confidence[3:8] = 0.0  # whose values are numbers
    expected = smooth_vectors(values, taps, confidence)
    assert expected.isfinite().all()
    for size in (1, 4, 24):
        smoother = Smoother(mean_vectors, taps)
        parts = zip(values.split(size), confidence.split(size), strict=True)
        found = [smoother.push(*part) for part in parts]
        torch.testing.assert_close(torch.cat((*found, smoother.finish())), expected)


def test_a_stream_that_nothing_is_known_of():
    smoother = Smoother(mean_vectors)
    lost = torch.full((3, 2), torch.nan)
    with pytest.raises(InputError, match="not finite"):
        smoother.push(lost)
    assert not len(smoother.push(lost, torch.zeros(3)))
    with pytest.raises(InputError, match="all frames"):
        smoother.finish()


def test_smoother_starts_afresh():
    smoother, values = Smoother(mean_vectors), torch.randn(7, 2)
    first = torch.cat((smoother.push(values), smoother.finish()))
    again = torch.cat((smoother.push(values), smoother.finish()))
    assert torch.equal(first, again)


def test_rotations_are_smoothed_as_rotations():
    axis = torch.nn.functional.normalize(torch.randn(3, dtype=F64), dim=0)
    angle = 0.4 * torch.arange(40, dtype=F64)  # through several full turns
    turns = angle[:, None] * axis
    wrapped = ((angle + math.pi) % (2 * math.pi) - math.pi)[:, None] * axis
    for rotvecs in (turns, wrapped):
        smooth = smooth_rotations(rotvecs)
        torch.testing.assert_close(
            rotvec_to_matrix(smooth), rotvec_to_matrix(turns), rtol=0, atol=1e-12
        )


@pytest.mark.long
def test_smoothing_differentiates():
    values = torch.randn(7, 2, 3, dtype=F64, requires_grad=True)
    assert torch.autograd.gradcheck(smooth_vectors, (values,))
    turns = (0.3 * values.detach()).requires_grad_()
    assert torch.autograd.gradcheck(smooth_rotations, (turns,))


def test_bad_input_is_refused():
    values = torch.zeros(4, 3)
    for width in (0, 4, -1):
        with pytest.raises(InputError, match="width is"):
            box(width)
    for taps in ((), (0.0, 0.5), (1.0, -0.1), (math.inf,)):
        with pytest.raises(InputError, match="taps are"):
            smooth_vectors(values, taps)
    with pytest.raises(InputError, match="one number a frame"):
        smooth_vectors(values, None, torch.ones(3))
    for bad in (-1.0, math.nan):
        with pytest.raises(InputError, match="confidence holds"):
            smooth_vectors(values, None, torch.full((4,), bad))
    with pytest.raises(InputError, match="no frame was given"):
        Smoother(mean_vectors).finish()


@pytest.mark.parametrize("smooth", [smooth_vectors, smooth_rotations])
def test_frames_without_confidence_may_hold_nan(smooth):
    values, confidence = torch.rand(20, 3, dtype=F64), torch.ones(20)
    values[7], confidence[7] = values[6], 0
    wanted = smooth(values, confidence=confidence)
    values[7] = torch.nan
    found = smooth(values, confidence=confidence)
    torch.testing.assert_close(found, wanted, rtol=0, atol=1e-5)
    assert torch.equal(smooth(values[:0]), values[:0])


@pytest.mark.parametrize("confidence", [None, torch.zeros(4)])
def test_what_has_no_mean_is_refused(confidence):
    with pytest.raises(InputError, match="not finite"):
        smooth_vectors(torch.full((4, 3), torch.nan), confidence=confidence)
    with pytest.raises(InputError, match=r"values are torch\.int64"):
        smooth_vectors(torch.arange(4)[:, None], confidence=confidence)


def test_streams_refuse_whole_numbers_too():
    """Their means were cut off."""
    with pytest.raises(InputError, match=r"values are torch\.int64"):
        Smoother(mean_vectors).push(torch.arange(9)[:, None])


def test_rotation_matrices_are_no_rotation_vectors():
    """Their rows were taken for three of them."""
    matrices = rotvec_to_matrix(torch.rand(6, 2, 3, dtype=F64))
    with pytest.raises(InputError, match="are rotation matrices, expected rotation vectors"):
        smooth_rotations(matrices)
    with pytest.raises(InputError, match="expected rotation vectors"):
        smooth_rotations(torch.rand(6, 4))
    three = torch.rand(6, 3, 3, dtype=F64)
    assert smooth_rotations(three).shape == three.shape


@pytest.mark.parametrize("smooth", [smooth_vectors, smooth_rotations])
def test_gradients_reach_confidences(smooth):
    """So they can be learned; they were constants without a word."""
    values, weights = 0.3 * torch.randn(2, 9, 2, 3, dtype=F64)
    confidence = torch.rand(9, dtype=F64, requires_grad=True)
    torch.autograd.gradcheck(
        lambda sure: (smooth(values, confidence=sure) * weights).sum(), (confidence,)
    )


def test_a_whole_kernel_is_no_half_of_one():
    with pytest.raises(InputError, match="weigh other frames more than the frame itself"):
        smooth_vectors(torch.zeros(9, 3), (1 / 16, 4 / 16, 6 / 16, 4 / 16, 1 / 16))


def test_rotation_vectors_are_no_vectors_where_they_pass_half_a_turn():
    """Means of them were 113 degrees off."""
    time = torch.arange(60, dtype=F64) / 30
    turning = torch.stack((0 * time, 2.8 + 0.6 * torch.sin(4 * time), 0.1 * time), -1)
    wrapped = matrix_to_rotvec(rotvec_to_matrix(turning))
    smooth_rotations(wrapped)
    pieces = wrapped.split(7)
    for values in (wrapped, wrapped[:, None]):
        with pytest.raises(InputError, match="use smooth_rotations"):
            smooth_vectors(values)
    with pytest.raises(InputError, match="Smoother of mean_rotations"):
        smoother = Smoother(mean_vectors)
        [smoother.push(piece) for piece in pieces]
        smoother.finish()
    # as they go on, and people who walk or jump about
    smooth_vectors(turning)
    smooth_vectors(wrapped[:4])
    smooth_vectors(torch.cat((turning, -1.2 * turning)))
    smooth_vectors(3 * torch.randn(60, 16, 3, dtype=F64))


@pytest.mark.parametrize("unit", [1.0, 180 / math.pi])
def test_angles_are_no_vectors_where_they_pass_half_a_turn(unit):
    heading = torch.linspace(2.5, 3.8, 30, dtype=torch.float64)
    written = torch.remainder(heading + math.pi, math.tau) - math.pi
    with pytest.raises(InputError, match="jump a full turn"):
        smooth_vectors(unit * written)
    with pytest.raises(InputError, match="jump a full turn"):
        smooth_vectors(unit * torch.stack((written, 0 * written), -1))
    smooth_vectors(unit * heading)
    smooth_vectors(unit * torch.tensor([-3.0, 3.0, -1.0, 2.5]))  # places may lie anywhere


def test_quaternions_that_change_their_sign_are_no_vectors():
    half = torch.linspace(1.0, 2.0, 30, dtype=torch.float64)
    zero = torch.zeros_like(half)
    turning = torch.stack((half.cos(), zero, half.sin(), zero), -1)
    upper = torch.where(turning[:, :1] < 0, -turning, turning)  # of which the first is not negative
    with pytest.raises(InputError, match="quaternions that change their sign"):
        smooth_vectors(upper[:, None])
    smooth_vectors(turning)
    smooth_vectors(3 * upper)  # no quaternions
