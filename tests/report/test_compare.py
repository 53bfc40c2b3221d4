"""Two results in one page."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reported import FRAMES, START

from perfcap.errors import InputError
from perfcap.report import make_comparison


def data_of(page: Path) -> tuple[str, dict[str, Any]]:
    html = page.read_text(encoding="utf-8")
    found = re.search(r'id="data">(.*?)</script>', html, re.DOTALL)
    assert found is not None
    return html, json.loads(found[1])


def shift(folder: Path, **changes: Any) -> None:
    with np.load(folder / "motion.npz") as file:
        arrays = {**file, **changes}
    np.savez(folder / "motion.npz", **arrays)


def test_both_results_are_in_the_page(made: Path, folder: Path, tmp_path: Path) -> None:
    with np.load(folder / "motion.npz") as file:
        joints = file["joints3d"]
    shift(folder, joints3d=joints + np.array([0.03, 0, 0.04]))
    page = make_comparison((made, folder), tmp_path / "both.html")
    html, data = data_of(page)
    blobs = re.findall(r'id="blob-([\w-]+)"', html)
    wanted = ["a-model", "a-surface", "a-video-0", "a-video-1", "b-model", "b-surface"]
    assert sorted(blobs) == wanted
    assert (data["frames"], data["first"], data["rate"]) == (FRAMES, START, 30)
    assert [result["name"] for result in data["results"]] == [made.name, "copy"]
    charts = {chart["title"]: chart for chart in data["charts"]}
    apart = {line["name"]: line["values"] for line in charts["Distance between A and B"]["lines"]}
    np.testing.assert_allclose(apart["absolute"], 50, atol=0.1)
    np.testing.assert_allclose(apart["similarity-aligned"], 0, atol=0.1)
    names = [line["name"] for line in charts["Knee flexion"]["lines"]]
    assert names == ["A: left", "A: right", "B: left", "B: right"]
    assert '<b class="badge">B</b> copy' in html


def test_terms_that_add_up_become_their_sum(made: Path, folder: Path, tmp_path: Path) -> None:
    run = json.loads((folder / "run.json").read_text())
    run["energy"] = {"joints2d": [1.0] * FRAMES, "prior": [2.0] * (FRAMES - 1) + [None]}
    (folder / "run.json").write_text(json.dumps(run))
    _, data = data_of(make_comparison((folder, folder), tmp_path / "both.html"))
    (energy,) = (chart for chart in data["charts"] if chart["title"] == "Energy")
    assert not energy["stacked"]
    assert [line["name"] for line in energy["lines"]] == ["A: sum", "B: sum"]
    assert energy["lines"][0]["values"] == [3.0] * (FRAMES - 1) + [None]


def test_other_frames_and_rates_are_refused(made: Path, folder: Path, tmp_path: Path) -> None:
    numbers = np.arange(START + 1, START + 1 + FRAMES)
    (folder / "surface.npz").unlink()
    run = json.loads((folder / "run.json").read_text())
    del run["surface"]
    (folder / "run.json").write_text(json.dumps(run))
    path = tmp_path / "both.html"
    shift(folder, frames=numbers)
    with pytest.raises(
        InputError, match=r"copy: holds 12 frames, frames 4 to 15, .* 12, .*3 to 14"
    ):
        make_comparison((made, folder), path)
    shift(folder, frames=numbers - 1, fps=np.array(60.0))
    with pytest.raises(InputError, match=r"copy: runs at 60 frames a second, .* at 30; expected"):
        make_comparison((made, folder), path)
    with pytest.raises(InputError, match="no such folder"):
        make_comparison((made, tmp_path / "nothing"), path)
    assert not path.exists()


def test_folders_of_one_name_are_told_apart(made: Path, tmp_path: Path) -> None:
    places = [Path(shutil.copytree(made, tmp_path / name / "take")) for name in ("one", "two")]
    html, _ = data_of(make_comparison((places[0], places[1]), tmp_path / "both.html"))
    assert "one/take" in html and "two/take" in html


def test_one_folder_is_no_pair(made: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected those of two results"):
        make_comparison(str(made), tmp_path / "page.html")  # type: ignore[arg-type]


def test_other_videos_of_the_same_name_get_a_warning(
    folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    # cameras call videos alike in every take; a copy of one has its size
    twin = Path(shutil.copytree(folder, tmp_path / "twin"))
    for place, size, warned in ((folder, 1000, True), (twin, 1000, False), (twin, 2000, True)):
        run = json.loads((place / "run.json").read_text())
        run["request"]["videos"] = [f"{place.name}/cam1.mp4"]
        run["input_files"] = {f"{place.name}/cam1.mp4": f"{size} bytes of 17"}
        (place / "run.json").write_text(json.dumps(run))
        caplog.clear()
        make_comparison((folder, twin), tmp_path / "both.html")
        assert ("distances say something" in caplog.text) == warned, caplog.text
    assert "copy/cam1.mp4" in caplog.text and "twin/cam1.mp4" in caplog.text


@pytest.mark.parametrize("other", [["b/solo.mp4"], ["b/one.mp4"], None])
def test_results_of_other_videos_get_a_warning(
    made: Path,
    folder: Path,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    other: list[str] | None,
) -> None:
    run = json.loads((folder / "run.json").read_text())
    run["request"]["videos"] = other
    (folder / "run.json").write_text(json.dumps(run))
    make_comparison((made, folder), tmp_path / "both.html")
    told = "was captured from one.mp4, two.mp4" in caplog.text and "from solo.mp4" in caplog.text
    assert told == (other == ["b/solo.mp4"])
