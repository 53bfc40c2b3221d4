"""A result becomes one page; what is missing is left out and named."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from reported import FRAMES, START, VIEWS

from perfcap.errors import InputError
from perfcap.io.result import read_result
from perfcap.io.result_folder import PAGE
from perfcap.pipeline.performance import Performance
from perfcap.report import (
    Places,
    Wanted,
    make_comparison,
    make_people_report,
    make_report,
)
from perfcap.report.content import Pack, unpack
from perfcap.report.model import restore


def read(page: Path) -> tuple[str, dict[str, Any], dict[str, str]]:
    """The page, its data, and its blobs."""
    html = page.read_text(encoding="utf-8")
    data = re.search(r'id="data">(.*?)</script>', html, re.DOTALL)
    assert data is not None
    blobs = dict(re.findall(r'id="blob-([\w-]+)">([^<]*)<', html))
    return html, json.loads(data[1]), blobs


def text(html: str) -> str:
    """What a person reads."""
    return re.sub(r"<[^>]+>", " ", re.sub(r"<script.*?</script>", "", html, flags=re.DOTALL))


def change(folder: Path, alter: Callable[[dict[str, Any]], object]) -> None:
    path = folder / "run.json"
    run = json.loads(path.read_text())
    alter(run)
    path.write_text(json.dumps(run))


def test_everything_is_in_the_page(made: Path, take_performance: Performance) -> None:
    path = make_report(made)
    assert path == made / PAGE
    html, data, blobs = read(path)
    assert sorted(blobs) == ["model", "surface", "video-0", "video-1"]
    assert (data["frames"], data["first"], data["rate"]) == (FRAMES, START, 30)
    assert [view["name"] for view in data["views"]] == list(VIEWS)
    assert all(v["mask"] and v["outline"] and v["video"] for v in data["views"])
    titles = [chart["title"] for chart in data["charts"]]
    assert "Distance to the detections" in titles and "Acceleration" in titles
    assert "Not in this report" not in html
    assert 'a "result" &lt;b&gt; ö' in html.replace("&quot;", '"')

    arrays = unpack(Pack(blobs["model"], data["arrays"]))
    joints = take_performance.joints().numpy()
    np.testing.assert_allclose(arrays["joints"], joints, atol=1e-6)
    pixels = take_performance.cameras.project(take_performance.joints()).numpy()
    np.testing.assert_allclose(arrays["joints2d-1"], pixels[:, 1] + 0.5, atol=1e-3)
    np.testing.assert_allclose(arrays["detected-1"], pixels[:, 1] + 0.5, atol=1e-3)


def test_the_surface_is_a_twentieth_of_a_millimetre_off(made: Path) -> None:
    _, data, blobs = read(make_report(made))
    coded = unpack(Pack(blobs["surface"], data["surface"]["arrays"]))["coded"]
    found = data["surface"]["origin"] + data["surface"]["step"] * restore(coded).astype(float)
    arrays = unpack(Pack(blobs["model"], data["arrays"]))
    surface = read_result(made).surface
    assert surface is not None
    apart = np.abs(found[:, arrays["welded"]] - surface.vertices)
    assert apart.max() < 0.51e-4


def test_videos_have_a_frame_for_each_of_the_capture(made: Path) -> None:
    _, _, blobs = read(make_report(made))
    with av.open(io.BytesIO(base64.b64decode(blobs["video-1"]))) as container:
        stream = container.streams.video[0]
        times = [frame.time for frame in container.decode(stream)]
        assert stream.codec_context.name == "h264" and stream.profile.endswith("Baseline")
    np.testing.assert_allclose(times, np.arange(FRAMES) / 30, atol=1e-6)


def test_the_same_result_makes_the_same_page(made: Path) -> None:
    assert make_report(made).read_bytes() == make_report(made).read_bytes()


def test_a_part_of_the_frames(made: Path) -> None:
    _, data, blobs = read(make_report(made, Wanted(start=START + 2, stop=START + 7)))
    assert (data["frames"], data["first"]) == (5, START + 2)
    arrays = unpack(Pack(blobs["model"], data["arrays"]))
    assert len(arrays["joints"]) == len(arrays["mask-rings-0"]) == 5
    assert all(len(line["values"]) == 5 for chart in data["charts"] for line in chart["lines"])
    with pytest.raises(InputError, match="holds frames 3 to 14"):
        make_report(made, Wanted(start=90))


def test_curves_of_errors_against_a_truth(made: Path, take_performance: Performance) -> None:
    joints = take_performance.joints().numpy()
    truth = {START + row: frame + np.array([0.01, 0, 0]) for row, frame in enumerate(joints)}
    _, data, _ = read(make_report(made, Wanted(truth=truth)))
    chart = next(chart for chart in data["charts"] if chart["title"] == "Joint error")
    lines = {line["name"]: line["values"] for line in chart["lines"]}
    assert lines["absolute"] == pytest.approx([10] * FRAMES)
    assert lines["roots aligned"] == pytest.approx([0] * FRAMES, abs=1e-6)
    del truth[START + 1]
    with pytest.raises(InputError, match="lacks 1 of the 12 frames"):
        make_report(made, Wanted(truth=truth))


def test_without_its_inputs_the_page_says_so(folder: Path) -> None:
    change(folder, lambda run: run["request"].update(videos=["gone.mp4", "gone too.mp4"]))
    html, data, blobs = read(make_report(folder))
    assert "video-0" not in blobs and [v["name"] for v in data["views"]] == list(VIEWS)
    assert data["views"][0]["outline"] and "gone.mp4" in text(html)
    change(folder, lambda run: run["request"].update(cameras="gone.json"))
    html, data, _ = read(make_report(folder))
    assert data["views"] == [] and "gone.json" in text(html)
    assert "Distance to the detections" not in [chart["title"] for chart in data["charts"]]


@pytest.mark.parametrize("video", [True, False])
def test_a_report_that_has_lost_the_names_of_its_views(
    made: Path, folder: Path, tmp_path: Path, video: bool
) -> None:
    """One view is known without its name, with its video or with the camera alone."""
    inputs = made.parent / "inputs"
    entry = json.loads((inputs / "cameras.json").read_text())["views"][VIEWS[0]]
    (tmp_path / "one.json").write_text(json.dumps(entry))
    place = str(inputs / "one.mp4") if video else "gone.mp4"
    request = {"videos": [place], "cameras": str(tmp_path / "one.json"), "detections": []}
    change(folder, lambda run: run.update(views=[], request=request))
    _, data, _ = read(make_report(folder))
    assert [view["name"] for view in data["views"]] == ["one"]


def test_inputs_that_have_moved_can_be_named(made: Path, folder: Path, tmp_path: Path) -> None:
    moved = Path(shutil.copytree(made.parent / "inputs", tmp_path / "moved here"))
    change(folder, lambda run: run["request"].update(videos=["a", "b"], cameras="c"))
    places = Places((moved / "one.mp4", moved / "two.mp4"), moved / "cameras.json")
    _, data, blobs = read(make_report(folder, Wanted(places=places)))
    assert "video-1" in blobs and data["views"][1]["outline"]
    with pytest.raises(InputError, match="views"):
        make_report(folder, Wanted(places=Places(places.videos[:1])))
    with pytest.raises(InputError, match=r"nothing\.json"):
        make_report(folder, Wanted(places=Places(cameras=moved / "nothing.json")))


def test_the_overlay_stands_in_for_a_lost_input(made: Path, folder: Path) -> None:
    change(folder, lambda run: run["request"].update(videos=["gone.mp4", "b"]))
    shutil.copy(made.parent / "inputs" / "one.mp4", folder / "overlay.mp4")
    html, data, blobs = read(make_report(folder))
    assert [view["name"] for view in data["views"]] == ["overlay.mp4"]
    assert "video-0" in blobs and "instead of the input" in text(html)


def test_a_motion_without_a_surface_or_masks(folder: Path) -> None:
    (folder / "surface.npz").unlink()
    shutil.rmtree(folder / "masks")
    change(folder, lambda run: run.pop("surface"))
    _, data, blobs = read(make_report(folder))
    assert "surface" not in data and "surface" not in blobs
    assert data["views"][0]["outline"] and "mask" not in data["views"][0]


def test_a_result_of_an_older_version(folder: Path) -> None:
    """A run.json that says next to nothing."""

    def forget(run: dict[str, Any]) -> None:
        kept = {"surface": run["surface"], "complete": True}
        run.clear()
        run.update(kept)

    change(folder, forget)
    (folder / "config.yaml").unlink()
    html, data, _ = read(make_report(folder))
    curves = [c["title"] for c in data["charts"] if c["group"] == "frames"]
    assert data["views"] == [] and curves == ["Acceleration"]
    assert "does not say which videos" in text(html)


def test_a_report_that_makes_no_sense_is_not_believed(folder: Path) -> None:
    nonsense: dict[str, Any] = {
        "warnings": ["<img src=x onerror=alert(1)>", 3],
        "windows": [{"frames": ["a", None]}, 3, {"frames": [3, 9], "terms": {"x": "y"}}],
        "stages": {"<b>": {"wall_s": "long"}, "other": []},
        "energy": {"<i>": [1.0] * FRAMES, "short": [1.0], "mixed": [None, "x"] * 6},
        "refinement": {"pose": [], "mask_confidence": "high", "scene_cuts": [5, "x", -1, 6]},
        "not_captured": [[4, 6], [1], "x"],
        "quality": {"not_trusted": [3, {"frames": [2, "x"]}, {"frames": [7, 9], "reason": 4}]},
        "packages": [],
        "views": "left",
        "peak_memory_mib": None,
    }
    change(folder, lambda run: run.update(nonsense))
    html, data, _ = read(make_report(folder))
    assert "<img" not in html and "&lt;img" in html
    assert [mark["text"] for mark in data["marks"]] == [
        "not captured",
        "scene cut",
        "not to be trusted",
    ]
    energy = next(chart for chart in data["charts"] if chart["title"] == "Energy")
    assert [line["name"] for line in energy["lines"]] == ["<i>", "mixed"]


def test_frames_that_are_not_to_be_trusted_are_listed_with_their_reason(folder: Path) -> None:
    doubt = {"frames": [4, 6], "reason": "<b>depth</b> is a guess"}
    change(folder, lambda run: run.update(quality={"not_trusted": [doubt]}))
    html, data, _ = read(make_report(folder))
    (mark,) = (m for m in data["marks"] if "trusted" in m["text"])
    assert (mark["start"], mark["stop"], mark["kind"]) == (4, 6, "odd")
    assert "not to be trusted: &lt;b&gt;depth" in html and "every frame was solved" not in text(
        html
    )


@pytest.mark.parametrize("name", ["run.json", "motion.npz", "capture.glb", "surface.npz"])
def test_half_a_result_is_refused_in_one_line(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(InputError) as error:
        make_report(folder)
    assert name in str(error.value) and "\n" not in str(error.value)
    assert not (folder / PAGE).exists()


def test_long_clips_leave_the_surface_out(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("perfcap.report.model.SURFACE_LIMIT", 1000)
    html, data, _ = read(make_report(made))
    assert "surface" not in data and "--frames A:B" in text(html)
    monkeypatch.setattr("perfcap.report.make.LONGEST", 5)
    html, data, _ = read(make_report(made))
    assert data["frames"] == 5 and "first 5 of 12 frames" in text(html)


def test_nothing_outside_the_folder_ends_up_in_the_page(folder: Path, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text('{"mpjpe_mm": 777333.0, "note": "a secret"}')
    for name in ("config.yaml", "metrics.json"):
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(secret)
    page = make_report(folder).read_text()
    assert "a secret" not in page and "777333" not in page


@pytest.mark.parametrize("wrong", [3, None, b"", ""])
def test_what_is_no_folder_is_refused(take_performance: Performance, wrong: Any) -> None:
    """They ended in tracebacks, or wrote where one was."""
    for call in (
        make_report,
        make_people_report,
        take_performance.save,
        read_result,
        lambda name: make_comparison(("a", "b"), name),
    ):
        with pytest.raises(InputError, match=r"expected the name of"):
            call(wrong)
    with pytest.raises(InputError, match="got a Performance, expected the name of the folder"):
        make_report(take_performance)  # type: ignore[arg-type]


def test_what_is_wanted_is_of_its_kind(folder: Path) -> None:
    for wrong in ({"start": 0.5}, {"stop": "3"}, {"truth": [1]}, {"places": "x.mp4"}):
        with pytest.raises(InputError, match="wanted: "):
            Wanted(**wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"wanted: is a tuple, expected Wanted\("):
        make_report(folder, (0, 5))  # type: ignore[arg-type]
    joints = read_result(folder).joints
    numbers = range(START, START + len(joints))
    for factor, part, words in ((1000, 16, "expected metres"), (1, 5, r"expected \(16, 3\) each")):
        truth = {n: factor * each[:part] for n, each in zip(numbers, joints, strict=True)}
        with pytest.raises(InputError, match=words):
            make_report(folder, Wanted(truth=truth))
