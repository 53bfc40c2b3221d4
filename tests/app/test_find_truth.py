"""What is given as a truth and is none."""

from pathlib import Path

import pytest

from perfcap.app.truth import find_truth
from perfcap.errors import InputError


def test_a_capture_is_no_truth(tmp_path: Path) -> None:
    (tmp_path / "motion.npz").touch()
    with pytest.raises(InputError, match=r"is the folder of a capture, no truth; .*motion\.npz"):
        find_truth(tmp_path)


def test_a_folder_without_truth(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no truth\.npz and no gt\.npz"):
        find_truth(tmp_path)


def test_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        find_truth(tmp_path / "nothing")
