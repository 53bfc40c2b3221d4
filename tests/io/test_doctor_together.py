"""Names of files of joints, and views that these list themselves."""

from pathlib import Path

import numpy as np
import pytest

from perfcap.io.doctor.together import of_others

CAMERAS = ["cam01", "cam02", "cam03", "cam04"]


def listing(path: Path, views: list[str]) -> Path:
    """A file of the joints of one frame."""
    pixels = np.zeros((1, len(views), 16, 2))
    np.savez(path, joints2d=pixels, confidence2d=pixels[..., 0], view_names=np.array(views))
    return path


@pytest.mark.parametrize("name", ["2.npz", "cam02.npz"])
def test_a_file_of_all_views_may_be_called_anything(tmp_path: Path, name: str) -> None:
    path = listing(tmp_path / name, CAMERAS)
    assert not list(of_others([path], ["cam01", "cam04"], CAMERAS))


@pytest.mark.parametrize("views", [["cam02"], ["cam02", "cam03"], []])
def test_a_file_of_other_views_is_named(tmp_path: Path, views: list[str]) -> None:
    path = tmp_path / "cam02.npz"
    if views:
        listing(path, views)
    else:
        path.write_text("no archive")
    (line,) = of_others([path], ["cam01", "cam04"], CAMERAS)
    assert "is named after the view cam02, the videos are of cam01, cam04" in line
