"""A network of edges: as they are at first, weights from files, and what it makes of pictures."""

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from perfcap.errors import InputError
from perfcap.segment.edge_field import find_edges
from perfcap.segment.edge_network import EdgeNetwork


def picture(size: tuple[int, int]) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 255, (*size, 3)).astype(np.uint8)


def stirred() -> EdgeNetwork:
    torch.manual_seed(2)
    network = EdgeNetwork()
    for each in network.parameters():
        torch.nn.init.normal_(each, 0, 0.05)
    return network


def test_at_first_edges_are_as_they_are() -> None:
    image = picture((30, 41))
    known, found = find_edges(image), EdgeNetwork().look(image)
    np.testing.assert_allclose(found[:2], known.edges, atol=1e-5)
    np.testing.assert_allclose(found[2], known.flat, atol=1e-5)


@pytest.mark.parametrize("size", [(1, 1), (3, 60), (40, 2)])
def test_small_pictures_are_looked_at_too(size: tuple[int, int]) -> None:
    found = stirred().look(picture(size))
    assert found.shape == (3, *size) and bool(np.isfinite(found).all())


def test_weights_change_what_counts_and_never_the_direction() -> None:
    image = picture((30, 41))
    plain, found = EdgeNetwork().look(image), stirred().look(image)
    across = plain[0] * found[1] - plain[1] * found[0]
    np.testing.assert_allclose(across, 0, atol=1e-6)
    assert float(np.abs(found - plain).max()) > 1e-3
    assert float((plain[:2] * found[:2]).sum(0).min()) >= 0


def test_weights_are_kept(tmp_path: Path) -> None:
    network, path = stirred(), tmp_path / "weights.safetensors"
    save_file(network.state_dict(), path)
    image = picture((20, 20))
    np.testing.assert_array_equal(EdgeNetwork.load(path).look(image), network.look(image))


def test_answers_are_finite() -> None:
    network = EdgeNetwork()
    with torch.no_grad():
        network.layers[-1].bias.fill_(3e38)
        network.layers[-1].weight.fill_(3e38)
    with pytest.raises(InputError, match="too large"):
        network.look(picture((20, 20)))


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    with pytest.raises(InputError, match="no weights"):
        EdgeNetwork.load(path)
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(InputError, match="no weights"):
        EdgeNetwork.load(path)
    path.write_bytes(bytes(1 << 21))
    with pytest.raises(InputError, match="is larger than"):
        EdgeNetwork.load(path)
    weights = EdgeNetwork().state_dict()
    save_file(weights | {"layers.0.bias": torch.zeros(3)}, path)
    with pytest.raises(InputError, match="no finite weights"):
        EdgeNetwork.load(path)
    save_file(weights | {"layers.0.bias": torch.full((16,), torch.nan)}, path)
    with pytest.raises(InputError, match="no finite weights"):
        EdgeNetwork.load(path)
