"""Markers on surfaces, and vertices of one template."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.metrics import attach_markers, marker_error, marker_positions, vertex_error

F64 = torch.float64


def sheet(side: int = 6) -> tuple[Tensor, Tensor]:
    """A flat square sheet of triangles, (V, 3) and (T, 3)."""
    line = torch.linspace(0, 1, side, dtype=F64)
    x, y = torch.meshgrid(line, line, indexing="ij")
    vertices = torch.stack((x, y, torch.zeros_like(x)), -1).reshape(-1, 3)
    index = torch.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    halves = (torch.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d)))
    return vertices, torch.cat(list(halves))


def test_markers_follow_the_surface() -> None:
    vertices, faces = sheet()
    torch.manual_seed(0)
    markers = torch.rand(20, 3, dtype=F64)
    markers[:, 2] = 0.01  # on the cloth
    sites = attach_markers(vertices, faces, markers)
    torch.testing.assert_close(marker_positions(sites, vertices[None]), markers[None])
    turn = rotvec_to_matrix(torch.randn(4, 3, dtype=F64))
    moved = vertices @ turn.mT + 3
    torch.testing.assert_close(marker_positions(sites, moved), markers @ turn.mT + 3)


def test_a_marker_beside_the_surface_sits_on_its_edge() -> None:
    vertices, faces = sheet()
    markers = torch.tensor([[-0.1, 0.5, 0.0], [1.2, 1.2, 0.0]], dtype=F64)
    sites = attach_markers(vertices, faces, markers)
    found = marker_positions(sites, vertices[None])[0]
    expected = torch.tensor([[0.0, 0.5, 0], [1, 1, 0]], dtype=F64)
    torch.testing.assert_close(found, expected)


def test_triangles_without_area_are_their_edges() -> None:
    line = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], dtype=F64)
    sites = attach_markers(
        line, torch.tensor([[0, 1, 2]]), torch.tensor([[1.5, 0.1, 0]], dtype=F64)
    )
    expected = torch.tensor([[[1.5, 0, 0]]], dtype=F64)
    torch.testing.assert_close(marker_positions(sites, line[None]), expected)


def test_errors_leave_out_markers_that_were_not_measured() -> None:
    measured = torch.zeros(2, 3, 4, 3, dtype=F64)
    found = measured.clone()
    found[..., :2, 0] = 0.01
    measured[0, 0, 0] = torch.nan
    errors = marker_error(found, measured)
    assert errors.missing.tolist() == [1, 0]
    torch.testing.assert_close(errors.mean[1], errors.mean.new_tensor(5.0))
    torch.testing.assert_close(errors.deviation[1], errors.mean.new_tensor(5.0))
    torch.testing.assert_close(errors.mean[0], errors.mean.new_tensor(50 / 11))
    with pytest.raises(InputError, match="markers have shape"):
        marker_error(found, measured[..., :3, :])
    with pytest.raises(InputError, match="finite"):
        attach_markers(*sheet(), measured[0, 0])


def test_vertex_errors_are_up_to_a_translation() -> None:
    torch.manual_seed(0)
    truth = torch.randn(2, 3, 10, 3, dtype=F64)
    moved = truth + torch.tensor([0.3, 0.0, 0.4], dtype=F64)
    assert vertex_error(moved, truth).max() < 1e-9
    expected = torch.full((2, 3), 500.0, dtype=F64)
    torch.testing.assert_close(vertex_error(moved, truth, translated=False), expected)
    part = torch.arange(10) < 3
    truth[..., 3:, :] = 0
    found = vertex_error(torch.zeros_like(truth), truth, part, translated=False)
    torch.testing.assert_close(found, 1e3 * truth[..., :3, :].norm(dim=-1).mean(-1))
    moved[1, 2, 0] = torch.nan
    assert vertex_error(moved, truth).isnan().sum() == 1
    with pytest.raises(InputError, match="one template"):
        vertex_error(moved, truth[..., :9, :])
