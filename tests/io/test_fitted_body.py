"""``body.npz`` of a result: written, read again, refused where it is something else."""

from pathlib import Path

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.io.fitted_body import FittedBody, load_fitted_body, save_fitted_body


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4))
    body = FittedBody(rng.normal(size=4), root @ root.T, "ada")
    save_fitted_body(tmp_path / "body.npz", body)
    again = load_fitted_body(tmp_path / "body.npz")
    assert again.model == "ada" and np.array_equal(again.shape, body.shape)
    assert np.array_equal(again.covariance, body.covariance)
    with np.load(tmp_path / "body.npz", allow_pickle=False) as arrays:
        assert np.allclose(arrays["deviation"] ** 2, np.diagonal(body.covariance))


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"shape": np.zeros(3)}, "lacks covariance, model"),
        ({"shape": np.zeros(3), "covariance": np.eye(2), "model": np.array("a")}, "(2, 2)"),
        ({"shape": np.full(2, np.nan), "covariance": np.eye(2), "model": np.array("a")}, "finite"),
        ({"shape": np.zeros(2), "covariance": -np.eye(2), "model": np.array("a")}, "negative"),
        ({"shape": np.zeros(2), "covariance": np.eye(2), "model": np.zeros(1)}, "name of a model"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, arrays: dict[str, np.ndarray], words: str) -> None:
    np.savez(tmp_path / "body.npz", **arrays)
    with pytest.raises(InputError) as error:
        load_fitted_body(tmp_path / "body.npz")
    assert words in str(error.value)
