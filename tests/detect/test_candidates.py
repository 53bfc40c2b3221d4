"""Second peaks of heat maps."""

import torch

from perfcap.detect.candidates import Candidates, find_candidates, merge_candidates
from perfcap.detect.heatmap import argmax2d


def maps(*blobs: tuple[int, float, float, float], joints: int = 3, side: int = 40) -> torch.Tensor:
    """Heat maps (1, J, side, side) of Gaussians: joint, x, y, height."""
    axis = torch.arange(side, dtype=torch.float32)
    total = torch.zeros(1, joints, side, side)
    for joint, x, y, height in blobs:
        row = torch.exp(-0.5 * ((axis - y) / 1.2) ** 2)
        column = torch.exp(-0.5 * ((axis - x) / 1.2) ** 2)
        total[0, joint] += height * row[:, None] * column
    return total


MIRRORED = (1, 0, 2)


def test_both_peaks_of_both_maps_and_what_speaks_for_them() -> None:
    heat = maps((0, 10.3, 8.0, 1.0), (0, 25.0, 30.4, 0.5), (1, 25.0, 30.4, 0.8), (2, 5.0, 5.0, 0.3))
    heat = heat + maps((1, 33.0, 4.0, 0.2))
    confidence = torch.tensor([[0.9, 0.6, 0.4]])
    points = torch.tensor([[[10.3, 8.0], [25.0, 30.4], [5.0, 5.0]]])
    found = find_candidates(heat, points, confidence, MIRRORED)
    assert found.places.shape == (1, 3, 4, 2)
    expected = torch.tensor([[10.3, 8.0], [25.0, 30.0], [25.0, 30.4], [33.0, 4.0]])
    assert torch.equal(found.places[0, 0], expected)
    assert torch.equal(found.places[0, 1], expected[[2, 3, 0, 1]])
    torch.testing.assert_close(found.support[..., 0], confidence)
    # by mass in proportion; nothing of its own is at the counterpart's second peak
    share = found.support[0, 0] / 0.9
    assert share[1] == share[2] and 0.45 < share[1] < 0.55 and share[3] < 1e-3
    # a map with one peak has no second, or one that nothing speaks for
    assert (found.support[0, 2, [1, 3]] < 1e-6).all()


def test_the_slope_of_a_wide_peak_is_no_second_peak() -> None:
    axis = torch.arange(40.0)
    wide = torch.exp(-0.5 * ((axis - 20) / 4) ** 2)
    heat = (wide[:, None] * wide)[None, None] + maps((0, 33.0, 33.0, 0.2), joints=1)
    found = find_candidates(heat, torch.tensor([[[20.0, 20.0]]]), torch.ones(1, 1), (0,))
    assert found.places[0, 0, 1].tolist() == [33.0, 33.0]


def test_batch_equals_loop_and_flat_or_broken_maps_say_nothing() -> None:
    torch.manual_seed(0)
    heat, confidence = torch.rand(5, 3, 16, 12), torch.rand(5, 3)
    points, _ = argmax2d(heat)
    whole = find_candidates(heat, points, confidence, MIRRORED)
    for n in range(5):
        alone = find_candidates(heat[[n]], points[[n]], confidence[[n]], MIRRORED)
        assert torch.equal(alone.places[0], whole.places[n])
        assert torch.equal(alone.support[0], whole.support[n])
    assert ((whole.support >= 0) & (whole.support <= 1)).all()
    heat[0], heat[1] = 0.0, float("nan")
    points, _ = argmax2d(heat)
    dull = find_candidates(heat, points, confidence, MIRRORED)
    assert dull.places.isfinite().all() and (dull.support[:2, :, 1:] == 0).all()
    assert torch.equal(dull.support[..., 0], confidence)
    assert torch.equal(dull.support[2:], whole.support[2:])


def test_two_looks_agree_or_add() -> None:
    one = Candidates(torch.tensor([[[[10.0, 10.0], [50.0, 50.0]]]]), torch.tensor([[[0.8, 0.2]]]))
    other = Candidates(torch.tensor([[[[52.0, 50.0], [90.0, 10.0]]]]), torch.tensor([[[0.6, 0.1]]]))
    merged = merge_candidates(one, other, 5.0)
    torch.testing.assert_close(merged.support, torch.tensor([[[0.4, 0.4]]]))
    places = merged.places[0, 0].tolist()
    assert [10.0, 10.0] in places and [51.5, 50.0] in places
    close = Candidates(torch.tensor([[[[10.0, 10.0], [16.0, 10.0]]]]), one.support)
    for same in (one, close):  # each is seconded by the nearest, not by the strongest nearby
        merged = merge_candidates(same, same, 5.0)
        torch.testing.assert_close(merged.places, same.places)
        torch.testing.assert_close(merged.support, same.support)
