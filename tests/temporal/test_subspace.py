import pytest
import scipy.fft
import torch

from perfcap.errors import InputError
from perfcap.temporal.subspace import dct_basis, project, project_out


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


@pytest.mark.parametrize("frames", [1, 2, 3, 50, 301])
def test_equals_scipy(frames):
    expected = scipy.fft.dct(torch.eye(frames, dtype=torch.float64).numpy(), norm="ortho", axis=0)
    torch.testing.assert_close(
        dct_basis(frames, dtype=torch.float64), torch.from_numpy(expected), rtol=0, atol=1e-14
    )


@pytest.mark.parametrize(("frames", "rank"), [(1, 1), (50, 8), (30, 10), (400, 400)])
def test_rows_are_orthonormal(frames, rank):
    basis = dct_basis(frames, rank, torch.float64)
    assert basis.shape == (rank, frames)
    torch.testing.assert_close(basis @ basis.mT, torch.eye(rank).double(), rtol=0, atol=2e-14)


def test_float32_is_the_rounded_float64():
    assert torch.equal(dct_basis(50, 8), dct_basis(50, 8, torch.float64).float())


def test_projections_split_a_trajectory():
    values = torch.randn(2, 50, 3, dtype=torch.float64)
    basis = dct_basis(50, 8, torch.float64)
    smooth, rough = project(values, basis), project_out(values, basis)
    torch.testing.assert_close(smooth + rough, values)
    torch.testing.assert_close(project(smooth, basis), smooth)
    torch.testing.assert_close(project_out(rough, basis), rough)
    assert (basis @ rough).abs().max() < 1e-14
    assert (smooth * rough).sum((-2, -1)).abs().max() < 1e-12


def test_null_space_is_blind_to_the_basis_and_empty_at_full_rank():
    basis = dct_basis(20, 5, torch.float64)
    coefficients = torch.randn(5, 4, dtype=torch.float64)
    assert project_out(basis.mT @ coefficients, basis).abs().max() < 1e-14
    full = dct_basis(20, dtype=torch.float64)
    assert project_out(torch.randn(20, 4, dtype=torch.float64), full).abs().max() < 1e-14


@pytest.mark.parametrize(("frames", "rank"), [(0, None), (5, 6), (5, 0), (-1, None)])
def test_refuses(frames, rank):
    with pytest.raises(InputError, match=r"rank|frames"):
        dct_basis(frames, rank)


def test_whole_numbers_hold_no_cosines():
    with pytest.raises(InputError, match=r"dtype is torch\.int64"):
        dct_basis(5, 3, torch.int64)
