"""Second peaks of heat maps."""

import torch

from perfcap.detect.candidates import Candidates, find_candidates, merge_candidates


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
    found = find_candidates(heat, confidence, MIRRORED)
    assert found.places.shape == (1, 3, 4, 2)
    expected = torch.tensor([[10.3, 8.0], [25.0, 30.4], [25.0, 30.4], [33.0, 4.0]])
    torch.testing.assert_close(found.places[0, 0], expected, atol=0.05, rtol=0)
    torch.testing.assert_close(found.places[0, 1], expected[[2, 3, 0, 1]], atol=0.05, rtol=0)
    torch.testing.assert_close(found.support[..., 0], confidence)
    # by mass in proportion; nothing of its own is at the counterpart's second peak
    share = found.support[0, 0] / 0.9
    assert share[1] == share[2] and 0.45 < share[1] < 0.55 and share[3] < 1e-3
    torch.testing.assert_close(found.places[0, 2, :2], found.places[0, 2, 2:])


def test_batch_equals_loop_and_flat_or_broken_maps_say_nothing() -> None:
    torch.manual_seed(0)
    heat, confidence = torch.rand(5, 3, 16, 12), torch.rand(5, 3)
    whole = find_candidates(heat, confidence, MIRRORED)
    for n in range(5):
        alone = find_candidates(heat[[n]], confidence[[n]], MIRRORED)
        assert torch.equal(alone.places[0], whole.places[n])
        assert torch.equal(alone.support[0], whole.support[n])
    assert ((whole.support >= 0) & (whole.support <= 1)).all()
    heat[0], heat[1] = 0.0, float("nan")
    dull = find_candidates(heat, confidence, MIRRORED)
    assert dull.places.isfinite().all() and (dull.support[:2] == 0).all()
    assert torch.equal(dull.support[2:], whole.support[2:])


def test_two_looks_agree_or_add() -> None:
    one = Candidates(torch.tensor([[[[10.0, 10.0], [50.0, 50.0]]]]), torch.tensor([[[0.8, 0.2]]]))
    other = Candidates(torch.tensor([[[[52.0, 50.0], [90.0, 10.0]]]]), torch.tensor([[[0.6, 0.1]]]))
    merged = merge_candidates(one, other, 5.0)
    torch.testing.assert_close(merged.support, torch.tensor([[[0.4, 0.4]]]))
    places = merged.places[0, 0].tolist()
    assert [10.0, 10.0] in places and [51.5, 50.0] in places
    same = merge_candidates(one, one, 5.0)
    torch.testing.assert_close(same.places, one.places)
    torch.testing.assert_close(same.support, one.support)
