"""The page in a real browser: it plays, scrubs, hears the keyboard, and asks for nothing."""

from __future__ import annotations

import csv
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from chromium import Page, browser, find_chromium
from reported import FRAMES, START, VIEWS

from perfcap.io.result import read_result
from perfcap.report import make_comparison, make_report

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_chromium() is None, reason="needs Chromium"),
]

FRAME = "perfcap.player.frame"
# whether the picture of a canvas has more than one colour
DRAWN = """(() => {{
  const copy = document.createElement("canvas");
  const source = document.getElementById("{}");
  copy.width = 64; copy.height = 64;
  copy.getContext("2d").drawImage(source, 0, 0, 64, 64);
  const data = copy.getContext("2d").getImageData(0, 0, 64, 64).data;
  return new Set(new Uint32Array(data.buffer)).size;
}})()"""


@pytest.fixture(scope="module")
def report(made: Path) -> Path:
    return make_report(made)


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("browser") / "profile") as page:
        yield page


@pytest.fixture
def page(chromium: Page, report: Path) -> Iterator[Page]:
    """The page as if just opened; at the end it has been quiet."""
    chromium.resize(1200, 900)
    chromium.open(report).evaluate("perfcap.player.seek(0)")
    yield chromium
    assert chromium.console == []
    assert chromium.requests == []


def seen(page: Page) -> int:
    """Number of the frame that the page says it shows."""
    return int(page.evaluate("document.getElementById('frame').textContent"))


def test_it_opens_with_a_good_frame_and_plays_from_the_first(page: Page, report: Path) -> None:
    page.open(report)
    assert page.evaluate("document.title") == 'a "result" <b> ö · perfcap'
    opening = page.evaluate("JSON.parse(document.getElementById('data').textContent).opening")
    assert seen(page) == START + opening and opening > 0
    page.wait("document.getElementById('video').readyState >= 2")
    assert page.evaluate("document.getElementById('video').videoWidth") == 128
    names = page.evaluate("[...document.getElementById('view').options].map((o) => o.text)")
    assert names == list(VIEWS)
    shown = "Math.floor(document.getElementById('video').currentTime * 30)"
    page.wait(f"{shown} === {opening}")
    page.evaluate("perfcap.player.setSpeed(0.1)")
    page.click("#play")
    page.wait(f"{FRAME} < {opening}")


def test_it_plays_repeats_and_pauses(page: Page) -> None:
    page.click("#play")
    page.wait(f"{FRAME} > 0")
    assert page.evaluate("document.getElementById('play').ariaLabel") == "Pause"
    page.wait(f"{FRAME} > {FRAMES // 2}")
    page.wait(f"{FRAME} < {FRAMES // 2}")  # once more from the start
    page.click("#play")
    assert page.evaluate("perfcap.player.playing") is False
    stopped = page.evaluate(FRAME)
    page.wait("!document.getElementById('video').seeking")
    video = page.evaluate("document.getElementById('video').currentTime")
    assert page.evaluate(FRAME) == stopped == int(video * 30)


def test_without_repeating_it_stops_at_the_end(page: Page) -> None:
    page.click("#loop")
    page.evaluate("perfcap.player.setSpeed(2)")
    page.press(" ")
    page.wait("!perfcap.player.playing")
    assert page.evaluate(FRAME) == FRAMES - 1


def test_the_keyboard(page: Page) -> None:
    def after(key: str, shift: bool = False) -> int:
        page.press(key, shift)
        frame: int = page.evaluate(FRAME)
        return frame

    assert [after("ArrowRight"), after("ArrowRight"), after("ArrowLeft")] == [1, 2, 1]
    assert after("ArrowRight", shift=True) == 11
    assert [after("Home"), after("End"), after("ArrowRight")] == [0, 11, 11]
    page.press(" ")
    page.wait("perfcap.player.playing")
    page.press(" ")
    page.wait("!perfcap.player.playing")
    page.press("[")
    assert page.evaluate("document.getElementById('speed').value") == "0.5"


def test_letters_and_buttons_agree(page: Page) -> None:
    for key, name in (("w", "wireframe"), ("k", "skeleton"), ("m", "mask"), ("j", "joints")):
        pressed = f"document.getElementById('toggle-{name}').ariaPressed"
        assert page.evaluate(pressed) == "false"
        page.press(key)
        assert page.evaluate(pressed) == "true"
        page.click(f"#toggle-{name}")
        assert page.evaluate(pressed) == "false"
    page.press("s")
    assert page.evaluate("document.querySelector('input[name=surface]:checked').value") == "skinned"


def test_scrubbing_moves_the_video_too(page: Page) -> None:
    page.click("#scrub", across=0.6)
    frame = page.evaluate(FRAME)
    assert 5 <= frame <= 8
    page.wait(f"Math.floor(document.getElementById('video').currentTime * 30) === {frame}")
    left, top, width, height = page.box("#scrub")
    page.drag((left + 0.6 * width, top + height / 2), (left + width, top + height / 2))
    assert page.evaluate(FRAME) == FRAMES - 1


def test_curves_lead_to_frames(page: Page) -> None:
    page.click(".plot svg", across=0.3)
    assert page.evaluate(FRAME) == 3
    left, top, width, height = page.box(".plot svg")
    page.drag((left + 0.3 * width, top + height / 2), (left + 0.9 * width, top + height / 2))
    assert page.evaluate(FRAME) == 10
    page.click(".chart .jump")
    assert page.evaluate(FRAME) == page.evaluate(
        f"Number(document.querySelector('.chart .jump').textContent.split(' at ')[1]) - {START}"
    )


def test_other_views(page: Page) -> None:
    page.evaluate("perfcap.player.seek(4)")
    page.evaluate(
        "(() => { const view = document.getElementById('view'); view.value = '1';"
        "view.dispatchEvent(new Event('change')); })()"
    )
    page.wait("document.getElementById('video').readyState >= 2")
    page.wait("Math.floor(document.getElementById('video').currentTime * 30) === 4")
    page.click("#look-camera")
    assert page.evaluate("document.getElementById('look-camera').ariaPressed") == "true"
    left, top, width, height = page.box("#scene")
    middle = (left + width / 2, top + height / 2)
    page.drag(middle, (middle[0] + 40, middle[1]))  # leaves the camera's place
    assert page.evaluate("document.getElementById('look-camera').ariaPressed") == "false"


def test_turning_and_zooming_change_the_picture(page: Page) -> None:
    left, top, width, height = page.box("#scene")
    middle = (left + width / 2, top + height / 2)
    clip = {"x": left, "y": top, "width": width, "height": height, "scale": 0.25}
    pictures = [page.screenshot(clip=clip)]
    for act in (
        lambda: page.drag(middle, (middle[0] + 120, middle[1] + 20)),
        lambda: page.scroll(middle, -400),
        lambda: page.drag(middle, (middle[0] + 60, middle[1]), button="right"),
    ):
        act()
        page.evaluate("new Promise((done) => setTimeout(done, 700))")
        pictures.append(page.screenshot(clip=clip))
    assert len(set(pictures)) == 4


@pytest.mark.parametrize("kind", ["captured", "skinned"])
def test_vertices_are_those_of_the_files(page: Page, made: Path, kind: str) -> None:
    result = read_result(made)
    _, representative = result.template.weld()
    for frame in (0, FRAMES - 1):
        found = np.array(page.evaluate(f"perfcap.vertices({frame}, '{kind}')")).reshape(-1, 3)
        if kind == "captured":
            true = result.vertices(slice(frame, frame + 1))[0]
            assert np.abs(found - true).max() < 0.51e-4
        else:
            object.__setattr__(result, "surface", None)
            true = result.vertices(slice(frame, frame + 1))[0]
            assert np.abs(found - true[representative]).max() < 1e-5


def test_colours_follow_the_system_until_somebody_chooses(page: Page) -> None:
    background = "getComputedStyle(document.body).backgroundColor"
    page.media(prefers_color_scheme="dark")
    dark = page.evaluate(background)
    page.media(prefers_color_scheme="light")
    light = page.evaluate(background)
    assert dark != light
    page.click("#theme")  # light
    page.click("#theme")  # dark
    assert page.evaluate(background) == dark
    page.click("#theme")
    assert page.evaluate(background) == light


def test_nothing_is_wider_than_a_phone(page: Page, report: Path) -> None:
    page.resize(360, 740, 2, mobile=True)
    page.open(report)
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    small = page.evaluate(
        "[...document.querySelectorAll('button, select, input')].filter((e) => e.offsetParent)"
        ".filter((e) => e.offsetHeight < 24 && e.type !== 'radio').map((e) => e.id || e.outerHTML)"
    )
    assert small == []


def test_on_a_phone_the_video_comes_first(page: Page) -> None:
    order = "['scene-pane', 'video-pane'].map((id) => document.getElementById(id).offsetTop)"
    wide = page.evaluate(order)
    assert wide[0] == wide[1]
    page.resize(390, 800, 2, mobile=True)
    scene, video = page.evaluate(order)
    assert video < scene
    # all controls in one row below the slider
    tops = page.evaluate(
        "['play', 'loop', 'full'].map((id) => document.getElementById(id).getBoundingClientRect())"
        ".map((box) => (box.top + box.bottom) / 2)"
    )
    assert max(tops) - min(tops) < 2


def test_full_screen_and_back(page: Page) -> None:
    page.click("#full")
    page.wait("document.fullscreenElement !== null")
    hidden = "document.getElementById('frames').offsetParent === null"
    assert page.evaluate(hidden)
    assert page.evaluate("document.getElementById('full').ariaPressed") == "true"
    _, top, _, height = page.box("#play")
    assert top + height <= page.evaluate("innerHeight")
    page.click("#full")
    page.wait("document.fullscreenElement === null")
    page.wait(f"!({hidden})")


def test_angles_are_drawn_with_their_limits(page: Page) -> None:
    angles = "#angles-charts .chart"
    page.wait(f"document.querySelectorAll('{angles}').length > 12")
    page.click(f"{angles} .jump")
    text = page.evaluate(f"document.querySelector('{angles} .jump').textContent")
    assert "from its limit at " in text
    assert page.evaluate(FRAME) == int(text.rsplit(" ", 1)[1]) - START
    assert page.evaluate("document.querySelectorAll('#angles line.limit').length") > 0
    cursor = f"document.querySelector('{angles} line.cursor').getAttribute('x1')"
    assert int(page.evaluate(cursor)) == page.evaluate(FRAME)


def test_cameras_stand_in_the_3d_view(page: Page) -> None:
    page.click("#toggle-cameras")
    page.wait(f"{DRAWN.format('scene-marks')} > 3")
    page.press("c")
    page.wait(f"{DRAWN.format('scene-marks')} === 1")


def test_curves_are_saved_as_csv(page: Page, tmp_path: Path) -> None:
    where = str(tmp_path.resolve())
    page.send("Browser.setDownloadBehavior", behavior="allow", downloadPath=where)
    data = page.evaluate("JSON.parse(document.getElementById('data').textContent).charts")
    for button, group in (("#frames-csv", "frames"), ("#angles-csv", "angles")):
        page.click(button)
        path = tmp_path / f"a_result_b_ö_{'curves' if group == 'frames' else group}.csv"
        end = time.monotonic() + 20
        while not path.is_file():
            assert time.monotonic() < end, list(tmp_path.iterdir())
            time.sleep(0.05)
        rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
        lines = [line["values"] for c in data if c["group"] == group for line in c["lines"]]
        assert len(rows) == 1 + FRAMES and len(rows[0]) == 2 + len(lines)
        assert [row[0] for row in rows[1:]] == [str(START + k) for k in range(FRAMES)]
        last = [float(row[-1]) if row[-1] else None for row in rows[1:]]
        assert last == lines[-1]


def test_two_results_move_together(chromium: Page, made: Path, tmp_path: Path) -> None:
    chromium.resize(1200, 900)
    page = chromium.open(make_comparison((made, made), tmp_path / "both.html"))
    page.click("#scrub", across=0.6)
    frame = page.evaluate(FRAME)
    assert 5 <= frame <= 8
    page.wait(f"Math.floor(document.getElementById('video').currentTime * 30) === {frame}")

    left, top, width, height = page.box("#scene")
    clip = {"x": left, "y": top, "width": width, "height": height, "scale": 0.25}
    before = page.screenshot(clip=clip)
    left, top, width, height = page.box("#scene-b")
    middle = (left + width / 2, top + height / 2)
    page.drag(middle, (middle[0] + 90, middle[1]))
    one, other = page.evaluate("perfcap.sides()")
    assert one == other and one["yaw"] != pytest.approx(0.45)
    page.evaluate("new Promise((done) => setTimeout(done, 700))")
    assert page.screenshot(clip=clip) != before
    page.press("w")
    assert page.evaluate("document.getElementById('toggle-wireframe').ariaPressed") == "true"
    assert chromium.console == [] and chromium.requests == []


def test_every_control_has_a_name(page: Page) -> None:
    tree = page.send("Accessibility.getFullAXTree")["nodes"]
    roles = {"button", "slider", "combobox", "radio", "link", "img", "video", "figure"}
    nodes = [node for node in tree if not node.get("ignored")]
    controls = [n for n in nodes if n.get("role", {}).get("value") in roles - {"figure", "video"}]
    nameless = [n["role"]["value"] for n in controls if not n.get("name", {}).get("value")]
    assert len(controls) > 30 and nameless == []
    landmarks = {n.get("role", {}).get("value") for n in nodes}
    assert {"banner", "main", "contentinfo", "region"} <= landmarks


def test_pictures_are_drawn(page: Page) -> None:
    page.press("k")
    page.press("j")
    page.wait(f"{DRAWN.format('scene-marks')} > 3")
    page.wait(f"{DRAWN.format('video-marks')} > 3")
