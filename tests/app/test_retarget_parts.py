"""Parts of a file that are put on a character one by one."""

from pathlib import Path

import pytest
from runs import Command

from perfcap.io.result import read_result

CLIMBS = Path(__file__).parents[3] / "shared" / "data" / "mocap_cmu_bvh" / "01_08.bvh"
MOVED = "so that the floor that feet stand on in these frames is at y = 0"
UNIT = "check the unit of the source's places"

pytestmark = pytest.mark.skipif(not CLIMBS.exists(), reason="needs recorded motion in ../shared")


@pytest.mark.long
def test_a_part_says_by_how_much_it_was_moved(tmp_path: Path, perfcap: Command) -> None:
    """They sit on a bar with dangling feet, whose soles were taken for a floor."""
    command = ["retarget", CLIMBS, "--actor", "sam", "--frames", "1201:1401"]
    moved = perfcap([*command, "--out", tmp_path / "moved"])
    assert (
        moved.code == 0
        and MOVED in " ".join(moved.notes)
        and "moved down by" in " ".join(moved.notes)
    )
    assert any(MOVED in line for line in read_result(tmp_path / "moved").report["warnings"])
    left = perfcap([*command, "--floor", "none", "--out", tmp_path / "left"])
    assert left.code == 0 and MOVED not in " ".join(left.notes) and UNIT not in " ".join(left.notes)


@pytest.mark.long
def test_all_of_a_file_has_one_floor(tmp_path: Path, perfcap: Command) -> None:
    walk = CLIMBS.with_name("07_01.bvh")
    whole = perfcap(["retarget", walk, "--actor", "sam", "--frames", "1:", "--out", tmp_path / "a"])
    assert whole.code == 0 and MOVED not in " ".join(whole.notes)
