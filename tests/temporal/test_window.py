import itertools

import pytest
import torch

from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.temporal.window import (
    Blender,
    Window,
    blend_rotations,
    blend_vectors,
    blend_weights,
    mean_rotations,
    mean_vectors,
    partition,
)

CASES = [(1, 50, 10), (7, 50, 10), (50, 50, 10), (51, 50, 10), (95, 50, 10), (130, 50, 10)]
CASES += [(40, 12, 0), (43, 12, 9), (29, 10, 5), (8, 1, 0), (11, 2, 1)]


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


def cut(clip, windows):
    return torch.stack([clip[window.index] for window in windows])


@pytest.mark.parametrize(("frames", "length", "overlap"), CASES)
def test_partition_covers_every_frame(frames, length, overlap):
    windows = partition(frames, length, overlap)
    assert windows[0].start == 0
    assert windows[-1].stop == frames
    assert {len(window) for window in windows} == {min(length, frames)}
    for a, b in itertools.pairwise(windows):
        assert a.start < b.start
        assert a.stop - b.start >= overlap
    covered = {frame for window in windows for frame in range(window.start, window.stop)}
    assert covered == set(range(frames))


def test_partition_of_the_paper():
    assert partition(130) == [Window(0, 50), Window(40, 90), Window(80, 130)]
    assert partition(95)[-1] == Window(45, 95)


@pytest.mark.parametrize("bad", [(0, 50, 10), (5, 0, 0), (5, 3, 3), (5, 3, -1)])
def test_partition_refuses(bad):
    with pytest.raises(InputError):
        partition(*bad)


@pytest.mark.parametrize("bad", [(-1, 4), (3, 3), (5, 2)])
def test_window_refuses(bad):
    with pytest.raises(InputError, match="window"):
        Window(*bad)


@pytest.mark.parametrize(("frames", "length", "overlap"), CASES)
def test_weights_are_a_partition_of_unity(frames, length, overlap):
    windows = partition(frames, length, overlap)
    weights = blend_weights(windows, frames, torch.float64)
    assert weights.shape == (len(windows), min(length, frames))
    assert (weights > 0).all()
    total = torch.zeros(frames, dtype=torch.float64)
    for window, row in zip(windows, weights, strict=True):
        total[window.index] += row
    torch.testing.assert_close(total, torch.ones_like(total), rtol=0, atol=1e-15)


def test_weights_cross_fade_linearly():
    weights = blend_weights(partition(90), 90, torch.float64)
    ramp = torch.arange(1, 11, dtype=torch.float64) / 11
    torch.testing.assert_close(weights[1, :10], ramp)
    torch.testing.assert_close(weights[0, 40:], 1 - ramp)
    assert (weights[0, :40] == 1).all()


def test_weights_refuse_gaps_and_disorder():
    for windows in ([Window(0, 4), Window(5, 9)], [Window(4, 8), Window(0, 4)], [Window(0, 4)]):
        with pytest.raises(InputError, match="cover"):
            blend_weights(windows, 9)
    with pytest.raises(InputError, match="lengths"):
        blend_weights([Window(0, 4), Window(4, 9)], 9)
    with pytest.raises(InputError):
        blend_vectors([], torch.zeros(0, 4))


@pytest.mark.parametrize(("frames", "length", "overlap"), CASES)
def test_blend_of_agreeing_windows_is_exact(frames, length, overlap):
    windows = partition(frames, length, overlap)
    clip = torch.randn(frames, 2, 3, dtype=torch.float64) * 4
    assert torch.equal(blend_vectors(windows, cut(clip, windows)), clip)
    assert torch.equal(blend_rotations(windows, cut(clip, windows)), clip)


def test_blend_vectors_equals_the_weighted_sum():
    windows = partition(43, 12, 9)
    values = torch.randn(len(windows), 12, 2, dtype=torch.float64)
    expected = torch.zeros(43, 2, dtype=torch.float64)
    weights = blend_weights(windows, 43, torch.float64)
    for window, value, row in zip(windows, values, weights, strict=True):
        expected[window.index] += row[:, None] * value
    torch.testing.assert_close(blend_vectors(windows, values), expected)


def test_blend_is_invariant_to_how_a_rotation_is_written():
    windows = partition(43, 12, 5)
    values = torch.randn(len(windows), 12, 3, dtype=torch.float64)
    turned = values.clone()
    axis = torch.nn.functional.normalize(values[1::2], dim=-1)
    turned[1::2] = values[1::2] - 2 * torch.pi * axis
    torch.testing.assert_close(
        rotvec_to_matrix(blend_rotations(windows, turned)),
        rotvec_to_matrix(blend_rotations(windows, values)),
    )


def test_blend_across_a_half_turn_takes_the_short_way():
    windows = [Window(0, 4), Window(1, 5)]
    angle = torch.tensor([3.1, -3.1], dtype=torch.float64)
    values = torch.zeros(2, 4, 3, dtype=torch.float64)
    values[..., 2] = angle[:, None]
    blended = blend_rotations(windows, values)
    # 0.083 rad apart through the half turn: a linear mean of the vectors would pass through zero
    assert (rotvec_to_matrix(blended)[:, 0, 0] < -0.999).all()


def test_blended_trajectory_keeps_running_past_a_half_turn():
    clip = torch.zeros(60, 3, dtype=torch.float64)
    clip[:, 1] = torch.linspace(0, 14, 60, dtype=torch.float64)
    windows = partition(60, 20, 8)
    noise = 1e-3 * torch.randn(len(windows), 20, 3, dtype=torch.float64)
    torch.testing.assert_close(
        blend_rotations(windows, cut(clip, windows) + noise), clip, rtol=0, atol=0.05
    )


@pytest.mark.parametrize(("frames", "length", "overlap"), CASES)
def test_stream_equals_batch(frames, length, overlap):
    windows = partition(frames, length, overlap)
    values = torch.randn(len(windows), len(windows[0]), 2, 3, dtype=torch.float64)
    for mean, batch in ((mean_vectors, blend_vectors), (mean_rotations, blend_rotations)):
        blender = Blender(mean)
        parts = [blender.push(w, v) for w, v in zip(windows, values, strict=True)]
        assert torch.equal(torch.cat([*parts, blender.finish()]), batch(windows, values))


@pytest.mark.parametrize("overlap", [0, 3, 8])
def test_stream_hands_out_frames_early_and_holds_few(overlap):
    windows = partition(300, 10, overlap)
    blender = Blender(mean_vectors)
    done = 0
    for window in windows:
        done += len(blender.push(window, torch.full((10, 1), 1.0)))
        assert done == window.start
        # a property of the promise, so looked up inside: memory does not grow with the clip
        assert len(blender._held) <= 10 // (10 - overlap) + 1
    assert done + len(blender.finish()) == 300


def test_stream_refuses_gaps_disorder_and_wrong_lengths():
    blender = Blender(mean_vectors)
    with pytest.raises(InputError, match="no window"):
        blender.finish()
    with pytest.raises(InputError, match="without gaps"):
        blender.push(Window(1, 5), torch.zeros(4))
    with pytest.raises(InputError, match="frames"):
        blender.push(Window(0, 5), torch.zeros(4))
    blender.push(Window(0, 5), torch.zeros(5))
    with pytest.raises(InputError, match="without gaps"):
        blender.push(Window(6, 11), torch.zeros(5))


@pytest.mark.long
def test_gradients_of_blends():
    windows = partition(5, 3, 2)
    values = torch.randn(len(windows), 3, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v: blend_vectors(windows, v), values)
    assert torch.autograd.gradcheck(lambda v: blend_rotations(windows, v), values)


def test_float32_in_float32_out():
    windows = partition(9, 5, 3)
    values = torch.randn(len(windows), 5, 3)
    assert blend_vectors(windows, values).dtype == torch.float32
    assert blend_rotations(windows, values).dtype == torch.float32


def test_blends_refuse_what_has_no_mean():
    windows = partition(9, 5, 3)
    with pytest.raises(InputError, match=r"values are torch\.int64"):
        blend_vectors(windows, torch.ones(len(windows), 5, dtype=torch.int64))
    with pytest.raises(InputError, match="are rotation matrices"):
        blend_rotations(windows, torch.eye(3).expand(len(windows), 5, 3, 3))
