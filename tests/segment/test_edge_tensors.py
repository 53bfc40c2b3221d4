"""Edges as tensors: those of arrays, and their gradients."""

import numpy as np
import pytest
import torch

from perfcap.errors import InputError
from perfcap.segment.edge_field import EdgeSettings, find_edges
from perfcap.segment.edge_tensors import TensorField, edge_tensors


def picture(size: tuple[int, int] = (40, 31)) -> np.ndarray:
    draw = np.random.default_rng(1)
    coarse = draw.integers(0, 255, (8, 8, 3)).astype(np.uint8)
    return np.kron(coarse, np.ones((5, 4, 1), np.uint8))[: size[0], : size[1]]


@pytest.mark.parametrize("settings", [EdgeSettings(), EdgeSettings(2.0, 0.1, 0.05)])
def test_they_are_those_of_arrays(settings: EdgeSettings) -> None:
    image = picture()
    known = find_edges(image, settings)
    found = edge_tensors(torch.from_numpy(image).permute(2, 0, 1).double() / 255, settings)
    field = TensorField.of(found, (3, 4))
    np.testing.assert_allclose(field.edges, known.edges, atol=2e-5)
    np.testing.assert_allclose(field.flat, known.flat, atol=2e-5)
    assert field.corner == (3, 4) and float(field.flat.max()) > 0


def test_a_batch_is_a_loop() -> None:
    image = torch.from_numpy(picture()).permute(2, 0, 1).double() / 255
    both = torch.stack((image, image.flip(-1)))
    torch.testing.assert_close(edge_tensors(both)[1], edge_tensors(image.flip(-1)))


def test_gradients_reach_pixels() -> None:
    image = torch.rand(3, 12, 13, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: edge_tensors(0.2 * x), image.requires_grad_())
    plain = torch.full((3, 12, 13), 0.5, dtype=torch.float64, requires_grad=True)
    edge_tensors(plain).sum().backward()
    assert bool(plain.grad.isfinite().all())


@pytest.mark.parametrize("shape", [(1, 20, 20), (20, 20), (3, 4, 20)])
def test_other_images_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="image has shape"):
        edge_tensors(torch.zeros(shape))
