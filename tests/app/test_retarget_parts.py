"""Parts of a file that are put on a character one by one."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from runs import Command

from perfcap.io.result import Result, read_result

RECORDED = Path(__file__).parents[3] / "shared" / "data" / "mocap_cmu_bvh"
ALIKE = 0.01  # m: feet are tied to the mean of where they stand, and a part may end before

pytestmark = pytest.mark.skipif(not RECORDED.exists(), reason="needs recorded motion in ../shared")


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "frames"),
    [("01_08", "1201:1401"), ("05_05", "200:300"), ("07_01", "100:200")],
    ids=["sits on a bar with dangling feet", "dances", "walks"],
)
def test_a_part_is_a_part_of_the_whole(
    name: str, frames: str, tmp_path: Path, perfcap: Command
) -> None:
    """Soles of dangling feet were taken for the floor of their part, a metre lower."""
    command = ["retarget", RECORDED / f"{name}.bvh", "--actor", "sam"]
    assert perfcap([*command, "--frames", "1:1500", "--out", tmp_path / "whole"]).code == 0
    assert perfcap([*command, "--frames", frames, "--out", tmp_path / "part"]).code == 0
    whole, part = (read_result(tmp_path / each) for each in ("whole", "part"))
    here = np.isin(whole.frame_numbers, part.frame_numbers)
    away = np.linalg.norm(_joints(whole)[here] - _joints(part), axis=-1)
    assert len(away) >= 100 and away.mean() < ALIKE


@pytest.mark.long
def test_a_part_of_a_result_or_of_its_model_is_one_too(tmp_path: Path, perfcap: Command) -> None:
    sits = RECORDED / "01_08.bvh"
    first = tmp_path / "first"
    assert (
        perfcap(["retarget", sits, "--actor", "sam", "--frames", "1:1500", "--out", first]).code
        == 0
    )
    whole = _joints(read_result(first))
    for source, frames, begun in (
        (first, "1201:1301", 1200),
        (first / "capture.glb", "1200:1300", 1200),
    ):
        command = ["retarget", source, "--actor", "sam", "--frames", frames, "--overwrite"]
        assert perfcap([*command, "--out", tmp_path / "part"]).code == 0
        part = _joints(read_result(tmp_path / "part"))
        away = np.linalg.norm(whole[begun : begun + 100] - part, axis=-1)
        assert len(part) == 100 and away.mean() < ALIKE


def _joints(result: Result) -> NDArray[np.float64]:
    moved, rest = result.bone_transforms, result.template.bone_rest[:, :3, 3]
    places: NDArray[np.float64] = (moved[..., :3, :3] @ rest[..., None])[..., 0]
    return places + moved[..., :3, 3]
