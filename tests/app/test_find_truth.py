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


def test_a_folder_of_several_people_names_one(tmp_path: Path) -> None:
    """As of a data set, where --people 1 followed one of them."""
    for person in ("person1", "person2"):
        (tmp_path / person).mkdir()
        (tmp_path / person / "gt.npz").write_bytes(b"")
    with pytest.raises(InputError) as refused:
        find_truth(tmp_path)
    assert str(refused.value).endswith(f"of one person give {tmp_path / 'person1'}, or another")
