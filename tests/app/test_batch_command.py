"""``perfcap batch``: lists of clips; a clip that fails or dies stops no other."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from runs import Command
from takes import TakeFiles

from perfcap.app.batch_clip import Job, Outcome, is_done, last_line, read_outcome, run_clip
from perfcap.app.capture_folder import states_of
from perfcap.io.result import read_result

# a stand-in for `python -m perfcap capture`: the folder is behind --out
STAND_IN = """#!/bin/sh
video=$4
for each in "$@"; do [ "$last" = --out ] && out=$each; last=$each; done
mkdir -p "$out"
echo "$@" >> "$out/calls"
case $video in
  *bad*) echo "perfcap: $video: is no video" >&2; exit 2;;
  *dies*) [ -e "$out/once" ] || { touch "$out/once"; kill -9 $$; };;
  *mortal*) kill -9 $$;;
  *gaps*) code=3;;
esac
cp -r "$RESULT/." "$out"
touch "$out/run.json"
exit ${code:-0}
"""


@pytest.fixture
def clips(captured: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A list of clips, captured by a stand-in that copies a result."""
    script = tmp_path / "stand-in"
    script.write_text(STAND_IN)
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))
    monkeypatch.setenv("RESULT", str(captured))
    names = ("good", "bad", "dies", "gaps")
    for name in names:
        (tmp_path / f"{name}.mp4").write_text("x")
    path = tmp_path / "clips.csv"
    path.write_text("\n".join(["videos,actor,refine_cameras", *(f"{n}.mp4,sam,no" for n in names)]))
    return path


def table(out: Path) -> dict[str, dict[str, str]]:
    with (out / "summary.csv").open(newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def calls(out: Path, name: str) -> list[str]:
    return (out / name / "calls").read_text().splitlines()


def test_everything_that_can_happen(clips: Path, tmp_path: Path, perfcap: Command) -> None:
    out = tmp_path / "out"
    outcome = perfcap(["batch", clips, "--out", out, "--processes", "2"])
    assert outcome.code == 3 and not outcome.said
    rows = table(out)
    states = {name: row["state"] for name, row in rows.items()}
    assert states == {"good": "done", "bad": "failed", "dies": "done", "gaps": "gaps"}
    assert rows["bad"]["message"].endswith("bad.mp4: is no video")
    assert rows["dies"]["tries"] == "2" and rows["good"]["tries"] == "1"
    assert int(rows["good"]["frames"]) > 0 and 0 < float(rows["good"]["mean_trust"]) <= 1
    page = (out / "index.html").read_text()
    assert page.count("<main>") == 1 and "<th></th>" not in page
    assert "4 clips: 2 done, 1 gaps, 1 failed" in page
    assert 'src="pictures/good.jpg"' in page and 'href="good/overlay.mp4"' in page
    assert (out / "pictures" / "good.jpg").stat().st_size > 500
    first = calls(out, "dies")
    assert "--no-refine-cameras" in first[0] and "--overwrite" not in first[0]
    assert all("--resume" in call for call in first) and "--overwrite" in first[1]


def test_warnings_are_counted_and_shown(
    clips: Path, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = tmp_path / "warned"
    shutil.copytree(os.environ["RESULT"], result)
    monkeypatch.setenv("RESULT", str(result))
    report = json.loads((result / "run.json").read_text())
    report |= {"input_warnings": ["cam2: looks 3 frames late", "<b>"], "warnings": ["a gap", "<b>"]}
    (result / "run.json").write_text(json.dumps(report))
    out = tmp_path / "out"
    said = perfcap(["batch", clips, "--out", out, "--processes", "1"]).out
    assert "good: captured, 3 warnings (" in said
    assert "gaps: captured with gaps or doubts, 3 warnings (" in said
    assert table(out)["good"]["warnings"] == "3" and table(out)["bad"]["warnings"] == ""
    page = (out / "index.html").read_text()
    assert "<div>cam2: looks 3 frames late</div><div>&lt;b&gt;</div><div>a gap</div>" in page


def test_what_is_captured_is_not_captured_again(
    clips: Path, tmp_path: Path, perfcap: Command
) -> None:
    out = tmp_path / "out"
    call = ["batch", clips, "--out", out, "--no-report"]
    perfcap(call)
    before = {name: len(calls(out, name)) for name in ("good", "bad", "dies", "gaps")}
    assert "4 clips, 3 of them captured already" in perfcap(call).out
    after = {name: len(calls(out, name)) for name in before}
    assert after == {**before, "bad": before["bad"] + 1}
    # another option of one clip, and another video of another, ask for them again
    clips.write_text(clips.read_text().replace("gaps.mp4,sam", "gaps.mp4,auto"))
    os.utime(tmp_path / "dies.mp4", (5, 5))
    perfcap(call)
    last = {name: len(calls(out, name)) for name in before}
    assert last == {**after, "bad": after["bad"] + 1, "gaps": 2, "dies": 3}
    assert "--overwrite" in calls(out, "gaps")[-1]


def test_what_an_earlier_call_left_is_named_so(
    clips: Path, tmp_path: Path, perfcap: Command
) -> None:
    out, pages = tmp_path / "out", []
    for video in ("good", "bad"):
        clips.write_text(f"name,videos\nwalk,{video}.mp4\n")
        perfcap(["batch", clips, "--out", out])
        pages.append((out / "index.html").read_text())
    assert all('href="walk/overlay.mp4"' in page for page in pages)
    assert "an earlier result: " not in pages[0] and 'src="pictures/walk.jpg"' in pages[0]
    assert "an earlier result: <a" in pages[1] and 'src="pictures' not in pages[1]


def test_a_list_that_cannot_be_used(tmp_path: Path, perfcap: Command) -> None:
    (tmp_path / "clips.csv").write_text("videos,overlay\na.mp4,perhaps\n")
    call = ["batch", tmp_path / "clips.csv", "--out", tmp_path / "out"]
    assert "overlay is 'perhaps'; expected yes or no" in perfcap(call).refused()
    (tmp_path / "clips.csv").write_text("videos,overlay\na.mp4,no;yes\n")
    assert "overlay is 'no;yes'; expected yes or no" in perfcap(call).refused()
    assert "expected 1 or more" in perfcap([*call, "--processes", "0"]).refused()
    assert not (tmp_path / "out" / "index.html").exists()


def test_a_network_beside_the_list_is_taken_and_watched(
    clips: Path, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    network, away = tmp_path / "masks", tmp_path / "away"
    network.mkdir()
    away.mkdir()
    (network / "manifest.toml").write_text("x")
    edges = tmp_path / "mine.safetensors"
    edges.write_text("x")
    clips.write_text("videos,actor,segmenter,edges\ngood.mp4,sam,masks,mine.safetensors\n")
    monkeypatch.chdir(away)
    call, out = ["batch", clips, "--out", tmp_path / "out"], tmp_path / "out"
    assert perfcap(call).code == 0
    assert all(str(path) in calls(out, "good")[-1] for path in (network, edges))
    for changed in (network / "manifest.toml", edges):
        assert "1 of them captured already" in perfcap(call).out
        changed.write_text("other")
        assert "0 of them captured already" in perfcap(call).out


@pytest.mark.long
def test_options_that_no_capture_has_are_told_in_words(tmp_path: Path) -> None:
    log = tmp_path / "log"
    perfcap = Path(sys.executable).parent / "perfcap"
    for wrong, words in (
        (("--frames", "0:3", "4:5"), "Unrecognized options: 4:5"),
        (("--box", "1 2 3 4"), "Error parsing --box: Could not find valid parse for arguments:"),
    ):
        with log.open("wb") as file:
            call = [str(perfcap), "capture", "a.mp4", *wrong]
            subprocess.run(call, stdout=file, stderr=file, check=False)
        assert last_line(log).startswith(words)


def test_a_cluster_without_ray(
    clips: Path, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    call = ["batch", clips, "--out", tmp_path / "out", "--cluster", "local"]
    assert "pip install 'perfcap[cluster]'" in perfcap(call).refused()


def job(folder: Path, video: str) -> Job:
    arguments = ("capture", video, "--out", str(folder / "clip"))
    state, seen = folder / "state.json", (folder / video, folder / "frames")
    return Job("clip", arguments, folder / "clip", folder / "log", state, seen)


def test_a_clip_that_always_dies(clips: Path, tmp_path: Path) -> None:
    found = run_clip(job(tmp_path, "mortal.mp4"))
    assert found.code == -9 and found.tries == 4 and not found.captured
    assert "ended by signal 9" in found.message


def test_outcomes_are_kept_and_judged(clips: Path, tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    (frames / "0.png").write_bytes(b"x")
    made = job(tmp_path, "good.mp4")
    found = run_clip(made)
    assert read_outcome(made) == found and is_done(made, found)
    assert not is_done(made, None) and not is_done(made, Outcome("clip", (), 0, 1.0))
    assert not is_done(replace(made, inputs=(*made.inputs, tmp_path / "nothing")), found)
    for text in ("{", "[]", '{"name": 1}', json.dumps({"arguments": 3})):
        made.state.write_text(text)
        assert read_outcome(made) is None
    about = (frames / "0.png").stat()
    (frames / "0.png").write_bytes(b"")  # overwritten in place
    os.utime(frames / "0.png", ns=(about.st_atime_ns, about.st_mtime_ns))
    assert not is_done(made, found)
    found = run_clip(made)
    assert is_done(made, found)
    report = json.loads((tmp_path / "clip" / "run.json").read_text())
    nested = frames / "calibration" / "Calib.toml"  # of a project's folder
    nested.parent.mkdir()
    found = run_clip(made)
    nested.write_text("x")
    report["input_files"] = states_of([nested]) | {"/elsewhere/sam.glb": "another machine's"}
    (tmp_path / "clip" / "run.json").write_text(json.dumps(report))
    assert is_done(made, found)
    nested.write_text("changed")
    assert not is_done(made, found)
    shutil.rmtree(tmp_path / "clip")
    assert not is_done(made, found)


def listed(take: TakeFiles, folder: Path, until: str) -> Path:
    """A list of the same clip, twice."""
    files = (take.video, take.camera, take.detections, take.actor, until)
    lines = [f"{name}," + ",".join(map(str, files)) for name in ("one", "two")]
    path = folder / "clips.csv"
    path.write_text("\n".join(["name,videos,cameras,detections,actor,until", *lines]))
    return path


@pytest.mark.slow
def test_real_clips(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    out = tmp_path / "out"
    assert perfcap(["batch", listed(take, tmp_path, "track_motion"), "--out", out]).code == 0
    for name in ("one", "two"):
        assert (out / name / "report.html").is_file()
    one, two = (read_result(out / name).joints for name in ("one", "two"))
    assert np.array_equal(one, two)


def kill_a_worker(out: Path, killed: list[int]) -> None:
    """Kill the process that began the first capture into a folder, once it runs."""
    for _ in range(2000):
        for place in Path("/proc").glob("[0-9]*"):
            with suppress(OSError, ValueError):
                words = (place / "cmdline").read_bytes().decode().split("\0")
                if "capture" in words and any(word.startswith(str(out)) for word in words):
                    parent = int((place / "stat").read_text().rpartition(")")[2].split()[1])
                    os.kill(parent, signal.SIGKILL)
                    killed.append(parent)
                    return
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Ray
def test_a_worker_of_a_cluster_that_is_killed(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    """Two workers, one killed with its capture: the clip is captured by another."""
    pytest.importorskip("ray", reason="the extra cluster is not installed")
    out, killed = tmp_path / "out", list[int]()
    killer = Thread(target=kill_a_worker, args=(out, killed))
    killer.start()
    call = ["batch", listed(take, tmp_path, "initialize"), "--out", out, "--no-report"]
    assert perfcap([*call, "--cluster", "local", "--processes", "2"]).code == 0
    killer.join()
    assert killed
    assert {row["state"] for row in table(out).values()} == {"done"}
