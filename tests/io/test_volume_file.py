"""volume.npz: written and read back, and refused where it is something else."""

from pathlib import Path

import numpy as np
import pytest
import torch

from perfcap.actor.volume import Volume
from perfcap.errors import InputError
from perfcap.io.volume_file import load_volume, save_volume


def volume() -> Volume:
    ones = torch.ones(4, dtype=torch.float64)
    places = torch.arange(12, dtype=torch.float64).reshape(4, 3)
    return Volume(places, 0.1 * ones, 20 * ones, torch.tensor([0, 1, 1, 0]), 0.05 * places)


def test_comes_back(tmp_path: Path) -> None:
    save_volume(tmp_path / "volume.npz", volume(), ("pelvis", "spine"))
    found, names = load_volume(tmp_path / "volume.npz")
    assert names == ("pelvis", "spine")
    for name in ("centres", "deviations", "densities", "joints", "colors"):
        torch.testing.assert_close(getattr(found, name), getattr(volume(), name))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"centres": None}, "lacks centres"),
        ({"joints": np.array([0, 1, 1, 7])}, "joints name 7"),
        ({"deviations": np.zeros(4)}, "wider than nothing"),
        ({"densities": np.full(4, np.nan)}, "not finite"),
        ({"joints": np.zeros(4)}, "whole numbers"),
        ({"deviations": np.ones(3)}, "expected"),
        ({"deviations": np.ones(0)}, "expected"),
        ({"deviations": np.array(1.0)}, r"deviations are float64 \(\); expected numbers \(Q,\)"),
        ({"joints": np.array(1)}, r"joints are int64 \(\); expected whole numbers"),
        ({"colours": np.array([[b""] * 3] * 4)}, "colours are"),
        ({"colours": np.full((4, 3), np.inf)}, "colours are not finite"),
    ],
)
def test_something_else_is_refused(
    tmp_path: Path, change: dict[str, np.ndarray | None], says: str
) -> None:
    save_volume(tmp_path / "volume.npz", volume(), ("pelvis", "spine"))
    with np.load(tmp_path / "volume.npz") as data:
        arrays = dict(data) | change
    np.savez(tmp_path / "other.npz", **{k: v for k, v in arrays.items() if v is not None})
    with pytest.raises(InputError, match=says):
        load_volume(tmp_path / "other.npz")
