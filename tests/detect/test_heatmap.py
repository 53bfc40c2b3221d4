"""Heat maps to joints."""

import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.detect.heatmap import (
    HeatmapHead,
    argmax2d,
    decode_dark,
    decode_quarter,
    map_to_input,
    soft_argmax,
)
from perfcap.detect.joint_set import COCO17, LANDMARKS, map_to_landmarks
from perfcap.errors import InputError

F64 = torch.float64
CENTERS = torch.tensor([[7.3, 11.8], [20.0, 5.0], [14.49, 16.51]], dtype=F64)


def gaussian(
    centers: torch.Tensor, size: tuple[int, int] = (24, 32), sigma: float = 1.7
) -> torch.Tensor:
    y = torch.arange(size[0], dtype=F64)[:, None]
    x = torch.arange(size[1], dtype=F64)
    dx, dy = (x - centers[:, 0, None, None]), (y - centers[:, 1, None, None])
    return torch.exp(-(dx.square() + dy.square()) / (2 * sigma**2))


def test_dark_is_exact_on_gaussians_and_better_than_a_quarter() -> None:
    maps = gaussian(CENTERS)
    dark = (decode_dark(maps)[0] - CENTERS).norm(dim=-1)
    quarter = (decode_quarter(maps)[0] - CENTERS).norm(dim=-1)
    assert dark.max() < 0.01 and quarter.max() < 0.4
    assert (quarter < (argmax2d(maps)[0] - CENTERS).norm(dim=-1) + 0.36).all()


def test_soft_argmax_is_exact_on_logits_and_knows_its_spread() -> None:
    maps = gaussian(CENTERS, sigma=1.5)
    points, spread = soft_argmax(maps.log())
    assert (points - CENTERS).norm(dim=-1).max() < 1e-3
    torch.testing.assert_close(spread, torch.full((3,), 1.5 * 2**0.5, dtype=F64), atol=1e-2, rtol=0)


@pytest.mark.parametrize("decode", [decode_quarter, decode_dark])
def test_borders_flat_maps_and_batches(decode: object) -> None:
    corner = gaussian(torch.tensor([[0.0, 0.0], [31.0, 23.0]], dtype=F64))
    points, value = decode(corner)  # type: ignore[operator]
    torch.testing.assert_close(points, torch.tensor([[0.0, 0.0], [31.0, 23.0]], dtype=F64))
    assert (value == 1).all()
    flat, _ = decode(torch.zeros(2, 3, 24, 32))  # type: ignore[operator]
    assert flat.isfinite().all() and flat.shape == (2, 3, 2)
    many = gaussian(CENTERS)[None].repeat(4, 1, 1, 1)
    torch.testing.assert_close(decode(many)[0][2], decode(many[2])[0])  # type: ignore[operator]


def test_map_pixels_to_input_pixels() -> None:
    last = torch.tensor([47.0, 63.0])
    maps, size = (64, 48), (256, 192)
    assert map_to_input(last, maps, size, "corners").tolist() == [191, 255]
    assert map_to_input(last, maps, size, "scale").tolist() == [188, 252]
    assert map_to_input(last, maps, size, "centers").tolist() == [189.5, 253.5]


def test_soft_argmax_gradient() -> None:
    logits = torch.randn(2, 5, 6, dtype=F64, requires_grad=True)
    assert torch.autograd.gradcheck(soft_argmax, logits)


def test_head_learns_where_features_point_and_maps_by_name() -> None:
    """Features with a blob a joint: the head learns to copy them, through the detections."""
    torch.manual_seed(0)
    head = HeatmapHead(17, COCO17)
    centers = torch.rand(6, 17, 2, dtype=F64) * torch.tensor([20.0, 14.0]) + 5
    features = torch.stack([gaussian(c) for c in centers]).float()[:, None]  # F C channels h w
    to_image = torch.tensor([[2.0, 0, 10], [0, 2, -3]]).expand(6, 1, 2, 3)
    optimizer = torch.optim.Adam(head.parameters(), lr=0.3)
    hip = (COCO17.joints.index("l_hip"), 12)
    truth = 2 * centers[:, hip[0]].float() + torch.tensor([10.0, -3.0])
    errors = []
    for _ in range(40):
        found = head(features, to_image)
        loss = (found.joints2d[:, 0, hip[1]] - truth).norm(dim=-1).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append(loss.item())
    assert errors[-1] < 0.2 * errors[0]
    toe = LANDMARKS.index("l_toe")
    assert (found.confidence2d[:, :, toe] == 0).all()  # COCO-17 has no toes


@pytest.mark.parametrize("width", [16, 64, 128])
def test_a_head_that_was_never_trained_has_gradients(width: int) -> None:
    """exp(-(spread / 3)^2 / 2) of a map that shows nothing yet was 1e-17: nothing was learned."""
    torch.manual_seed(0)
    head = HeatmapHead(8)
    features, place = torch.randn(1, 1, 8, width, width), torch.eye(2, 3).expand(1, 1, 2, 3)
    seen = head(features, place)
    assert 1e-3 < seen.confidence2d.min() < seen.confidence2d.max() < 0.3  # sure of no joint
    (moved,) = torch.autograd.grad(seen.confidence2d.log().sum(), head.maps.weight)
    assert moved.norm() > 1e-3


def test_head_doubles_resolution() -> None:
    head = HeatmapHead(8, COCO17, doublings=2, hidden=16)
    assert head.logits(torch.zeros(2, 3, 8, 6, 5)).shape == (2, 3, 17, 24, 20)
    state = HeatmapHead(8, COCO17, doublings=2, hidden=16)
    state.load_state_dict(head.state_dict())


def test_an_unknown_alignment_is_refused() -> None:
    with pytest.raises(InputError, match="'align_corners', expected scale, corners or centers"):
        map_to_input(torch.zeros(2), (8, 8), (64, 64), "align_corners")


def test_joints_by_the_name_of_their_set() -> None:
    """A name has a length of its own, and was an AttributeError later."""
    assert HeatmapHead(8, "coco-17").joint_set is COCO17
    with pytest.raises(InputError, match="joints 'COCO' is not known; expected one of landmarks16"):
        HeatmapHead(8, "COCO")
    with pytest.raises(InputError, match="joints is a tuple, expected the name of a known set"):
        HeatmapHead(8, LANDMARKS)  # type: ignore[arg-type]
    values, confidence = torch.rand(17, 2), torch.rand(17)
    for mapped, same in zip(
        map_to_landmarks(values, confidence, "COCO-17"),
        map_to_landmarks(values, confidence, COCO17),
        strict=True,
    ):
        assert torch.equal(mapped, same)


@pytest.mark.parametrize("kind", [torch.bfloat16, torch.float16])
@pytest.mark.parametrize("joints", ["landmarks16", "COCO-17"])
@torch.no_grad()
def test_a_head_in_half_precision_has_pixels_in_full(kind: torch.dtype, joints: str) -> None:
    """Within bfloat16 joints of an image of 1700 px were 2.5 px off in the mean, and up to 6."""
    head = HeatmapHead(channels=17, joints=joints).eval()
    head.maps.weight.copy_(torch.eye(17)[: len(head.joint_set), :, None, None])
    head.maps.bias.zero_()
    grid = torch.stack(torch.meshgrid(torch.arange(72), torch.arange(72), indexing="xy"), -1)
    places = 5 + 60 * torch.rand(4, 1, 17, 2, generator=torch.Generator().manual_seed(0))
    maps = -(grid - places[..., None, None, :]).square().sum(-1) / 4
    to_image = torch.tensor([[20.0, 0.0, 300.0], [0.0, 20.0, 200.0]]).expand(4, 1, 2, 3)
    full = head(maps, to_image)
    with torch.autocast("cpu", kind):
        found = head(maps, to_image)
    assert found.joints2d.dtype == torch.float32
    seen = full.confidence2d > 0
    assert float((found.joints2d - full.joints2d)[seen].abs().max()) < 1.0  # of maps of 20 px
    half = head.to(kind)(maps.to(kind), to_image)
    assert half.joints2d.dtype == torch.float32
    assert float((half.joints2d - full.joints2d)[seen].abs().max()) < 1.0


@pytest.mark.parametrize(
    ("features", "to_image", "said"),
    [
        (
            torch.zeros(2, 1, 4, 5, 6),
            torch.zeros(2, 1, 3, 2),
            r"to_image has .*expected \(2, 1, 2, 3\)",
        ),
        (torch.zeros(2, 1, 4, 5, 6), torch.zeros(3, 1, 2, 3), "to_image has shape"),
        (torch.zeros(2, 1, 4, 5, 6), torch.zeros(2, 3).long(), "to_image: are torch.int64"),
        (torch.zeros(2, 1, 4, 5, 6).long(), torch.zeros(2, 3), "features: are torch.int64"),
        (np.zeros((2, 1, 4, 5, 6)), torch.zeros(2, 3), "features: are a ndarray"),
        (torch.zeros(2, 1, 3, 5, 6), torch.zeros(2, 3), r"features: have shape .*\(..., 4, h, w\)"),
        (torch.zeros(5, 6), torch.zeros(2, 3), "features: have shape"),
    ],
)
def test_a_head_names_what_it_cannot_take(features: Tensor, to_image: Tensor, said: str) -> None:
    with pytest.raises(InputError, match=said):
        HeatmapHead(4)(features, to_image)


def test_a_head_takes_maps_that_views_share() -> None:
    features, head = torch.rand(2, 3, 4, 5, 6), HeatmapHead(4)
    to_image = torch.tensor([[4.0, 0.0, 1.0], [0.0, 4.0, 2.0]])
    whole = head(features, to_image.expand(2, 3, 2, 3)).joints2d
    for shared in (to_image, to_image.expand(3, 2, 3), to_image.expand(2, 1, 2, 3)):
        assert torch.equal(head(features, shared).joints2d, whole)
