"""Several people in one page."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import Page, browser, find_chromium
from reported import FRAMES, START

from perfcap.errors import InputError
from perfcap.io.result import read_result
from perfcap.io.result_folder import write_people
from perfcap.metrics import skin_gap
from perfcap.report import Wanted, make_people_report, make_report


@pytest.fixture(scope="module")
def pair(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same person twice, the second one 0.8 m aside."""
    folder = tmp_path_factory.mktemp("people") / "pair"
    for number in (1, 2):
        shutil.copytree(made, folder / f"person{number}")
    place = folder / "person2"
    for name, keys in (
        ("motion.npz", ("joints3d", "root_translation")),
        ("surface.npz", ("vertices",)),
    ):
        with np.load(place / name) as file:
            arrays = dict(file)
        for key in keys:
            arrays[key] = arrays[key] + np.array([0.8, 0, 0], arrays[key].dtype)
        np.savez(place / name, **arrays)
    run = json.loads((place / "run.json").read_text())
    run["warnings"] = ["their left hand is <hidden>"]
    (place / "run.json").write_text(json.dumps(run))
    margin = {"median": 0.4, "lowest_percent": 0.2}
    write_people(folder, [{"actor": "/far/away/one.glb", "identity_margin_m": margin}] * 2)
    (folder / "run.json").write_text(json.dumps({"people": 2, "warnings": ["twins"], "stages": {}}))
    return folder


def data_of(page: Path) -> tuple[str, dict[str, Any]]:
    html = page.read_text(encoding="utf-8")
    found = re.search(r'id="data">(.*?)</script>', html, re.DOTALL)
    assert found is not None
    return html, json.loads(found[1])


def test_everybody_is_in_the_page(pair: Path) -> None:
    html, data = data_of(make_people_report(pair))
    blobs = re.findall(r'id="blob-([\w-]+)"', html)
    own = ["model", "surface"]
    wanted = [f"p{k}-{name}" for k in (1, 2) for name in own] + ["p1-video-0", "p1-video-1"]
    assert sorted(blobs) == sorted(wanted)  # videos once
    assert (data["frames"], data["first"], len(data["people"])) == (FRAMES, START, 2)
    charts = {chart["title"]: chart for chart in data["charts"]}
    (gap,) = charts["Between people"]["lines"]
    assert gap["name"] == "1 and 2"
    assert 0 < min(gap["values"]) < max(gap["values"]) < 800
    names = [line["name"] for line in charts["Knee flexion"]["lines"]]
    assert names == ["1: left", "1: right", "2: left", "2: right"]


def test_the_page_says_who_is_who(pair: Path) -> None:
    html, _ = data_of(make_people_report(pair))
    assert "away/one" in html and "/far/away" not in html.split('id="data"')[0]
    assert "0.4; 0.2" in html
    assert "person 2: their left hand is &lt;hidden&gt;" in html.lower()
    assert "Twins" in html or "twins" in html
    assert 'href="person1/"' in html or 'href="person1/report.html"' in html


def test_some_frames(pair: Path) -> None:
    _, data = data_of(make_people_report(pair, Wanted(start=START + 1, stop=START + 3)))
    assert (data["first"], data["frames"]) == (START + 1, 2)


def test_one_person_is_no_crowd(made: Path) -> None:
    with pytest.raises(InputError, match="of one person"):
        make_people_report(made)


def test_other_frames_are_refused(pair: Path, tmp_path: Path) -> None:
    folder = tmp_path / "odd"
    shutil.copytree(pair, folder)
    for name in ("motion.npz", "surface.npz"):
        with np.load(folder / "person2" / name) as file:
            arrays = dict(file)
        arrays["frames"] = arrays["frames"] + 1
        np.savez(folder / "person2" / name, **arrays)
    with pytest.raises(InputError, match="other frames each"):
        make_people_report(folder)


# --- How near two skins come ----------------------------------------------------------------------


def sphere(x: float, radius: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and normals of a ball about (x, 0, 0)."""
    random = np.random.default_rng(0)
    normals = random.normal(size=(20000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius * normals + np.array([x, 0, 0]), normals


@pytest.mark.long
@pytest.mark.parametrize("apart", [0.2, 0.05, -0.03])
def test_gap_of_two_balls(apart: float) -> None:
    assert skin_gap(sphere(0), sphere(0.6 + apart)) == pytest.approx(apart, abs=0.012)


# --- In a browser ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("browser") / "profile") as page:
        yield page


@pytest.mark.slow
@pytest.mark.skipif(find_chromium() is None, reason="needs Chromium")
def test_both_are_drawn(pair: Path, chromium: Page) -> None:
    chromium.resize(1200, 900)
    chromium.open(make_people_report(pair))
    chromium.wait("document.documentElement.dataset.state !== 'loading'")
    assert chromium.evaluate("document.documentElement.dataset.state") == "ready"
    for number in (0, 1):
        shown = chromium.evaluate(f"perfcap.vertices(2, 'captured', {number})")
        result = read_result(pair / f"person{number + 1}")
        _, representative = result.template.weld()
        vertices = np.asarray(result.shown[2:3])[0][representative]
        np.testing.assert_allclose(np.reshape(shown, (-1, 3)), vertices, atol=1e-4)
    for key in "kmjdwsc4":
        chromium.press(key)
    assert chromium.console == []
    assert chromium.requests == []


def lay_down(place: Path) -> None:
    """The person of a folder lies along x, beside where they stood."""
    with np.load(place / "motion.npz") as file:
        arrays = dict(file)
    stood = arrays["joints3d"]
    joints = stood[..., [1, 0, 2]] * [1.0, -1.0, 1.0]
    joints += [1.5, stood[..., 1].min() - joints[..., 1].min(), 0.0]  # on the same ground
    np.savez(place / "motion.npz", **arrays | {"joints3d": joints})


def test_everybody_stands_on_one_ground(pair: Path, tmp_path: Path) -> None:
    up = data_of(make_people_report(pair))[1]["scene"]["axes"][1]
    other = Path(shutil.copytree(pair, tmp_path / "other"))
    lay_down(other / "person1")
    assert data_of(make_people_report(other))[1]["scene"]["axes"][1] == up


def test_a_retargeted_person_lies_in_their_page(made: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(made, tmp_path / "lying"))
    lay_down(folder)
    assert abs(data_of(make_report(folder))[1]["scene"]["axes"][1][1]) < 0.1
    run = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(run | {"retargeted_from": "a.bvh"}))
    assert data_of(make_report(folder))[1]["scene"]["axes"][1] == [0, 1, 0]
