"""``perfcap retarget``: captures, BVH files and characters that move, onto other characters."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from foreign_rigs import MIXAMO, RIGS
from runs import Command
from synthetic import actor
from takes import make_take, sway

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.bvh_read import bvh_motion
from perfcap.io.bvh_write import save_bvh
from perfcap.io.gltf_document import open_document
from perfcap.io.result import read_result
from perfcap.pipeline.retarget_doubts import floor_doubts, lying_doubts


@pytest.fixture(scope="module")
def hero(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A character with Mixamo's names, in centimetres."""
    path = tmp_path_factory.mktemp("hero") / "hero.glb"
    RIGS["Mixamo, centimetres, armature"].write(path)
    return path


def limbs(path: Path) -> dict[str, float]:
    report = json.loads((path / "run.json").read_text())
    return report["retarget"]["limbs_degrees"]


def test_a_capture_on_another_character(
    captured: Path, hero: Path, tmp_path: Path, perfcap: Command
) -> None:
    out = tmp_path / "out"
    outcome = perfcap(["retarget", captured, "--actor", hero, "--out", out])
    assert outcome.code == 0 and not outcome.said
    assert "limbs" in outcome.out and "opens in Blender" in outcome.out
    found, source = read_result(out), read_result(captured)
    assert found.frames == source.frames and found.rate == source.rate
    assert found.frame_numbers.tolist() == source.frame_numbers.tolist()
    names = {node.get("name") for node in open_document(out / "capture.glb").tree["nodes"]}
    assert {"mixamorig:Hips", "mixamorig:LeftForeArm"} <= names
    assert limbs(out)["q95"] < 3
    # and on: other commands take it
    assert perfcap(["export", out, "--to", "bvh", "--name", "a"]).code == 0
    assert perfcap(["report", out]).code == 0
    again = tmp_path / "again"
    bvh = out / "export" / "a.bvh"
    assert perfcap(["retarget", bvh, "--actor", hero, "--out", again]).code == 0
    assert limbs(again)["median"] < 1
    # the same rig, so the same joints, but for the floor that is found anew
    apart = read_result(again).joints - found.joints
    assert np.abs(apart - apart.mean((0, 1))).max() < 0.03


@pytest.mark.long
def test_what_no_person_does_is_told(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    """A capture that was not trusted, and a clip whose places and times are in other units."""
    doubted = Path(shutil.copytree(captured, tmp_path / "doubted"))
    report = json.loads((doubted / "run.json").read_text())
    report["quality"] = {"trusted": False}
    (doubted / "run.json").write_text(json.dumps(report))
    outcome = perfcap(["retarget", doubted, "--actor", "sam", "--out", tmp_path / "a"])
    assert outcome.code == 0 and any("not to be trusted" in line for line in outcome.notes)
    assert perfcap(["export", captured, "--to", "bvh", "--out", tmp_path, "--name", "b"]).code == 0
    text = (tmp_path / "b.bvh").read_text()
    head, _, time = text.partition("Frame Time:")
    (tmp_path / "c.bvh").write_text(head + "Frame Time: 8.3333\n" + time.partition("\n")[2])
    outcome = perfcap(["retarget", tmp_path / "c.bvh", "--actor", "sam", "--out", tmp_path / "c"])
    assert outcome.code == 0 and any("check its frame time" in line for line in outcome.notes)
    assert any("retarget: rate is 0.12 frames a second" in line for line in outcome.notes)


@pytest.mark.long
def test_a_root_in_another_unit_than_the_bones_is_told(tmp_path: Path, perfcap: Command) -> None:
    person = actor()
    motion = sway(person, 60, 30.0)
    feet = [LANDMARKS.index(name) for name in ("l_ankle", "r_ankle", "l_toe", "r_toe")]
    points = person.joints(motion)[:, feet]
    lower = (points[1:, :, 1] + points[:-1, :, 1]).argmin(1)
    slid = points.diff(dim=0)[torch.arange(len(lower)), lower].cumsum(0)  # of who should stand
    moved = motion.translation - torch.nn.functional.pad(slid, (0, 0, 1, 0))
    stands = replace(motion, translation=moved)
    names = tuple(MIXAMO[name] for name in person.template.bone_names)
    template = replace(person.template, bone_names=names, joint_bones={}, landmarks={})
    source, transforms = tmp_path / "a.bvh", person.bone_transforms(stands).numpy()
    save_bvh(source, bvh_motion(template, transforms, 30.0))
    head, _, rows = source.read_text().partition("Frame Time:")
    first, *lines = (line.split() for line in rows.strip().splitlines())
    for factor, told in ((1.0, False), (0.01, True)):
        scaled = [[str(factor * float(v)) for v in line[:3]] + line[3:] for line in lines]
        text = "\n".join(" ".join(line) for line in [first, *scaled])
        source.write_text(f"{head}Frame Time: {text}\n")
        out = tmp_path / f"{told}"
        done = perfcap(["retarget", source, "--actor", "sam", "--out", out])
        assert done.code == 0, done
        found = [line for line in done.notes if "another unit than its bones" in line]
        assert bool(found) == told, done.notes
        kept = json.loads((out / "run.json").read_text())["warnings"]
        assert all(line in kept for line in found)


@pytest.mark.long
def test_what_is_told_is_kept(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    """In the result and on its page; as of a capture, doubts alone are no failure."""
    assert perfcap(["export", captured, "--to", "bvh", "--out", tmp_path, "--name", "b"]).code == 0
    head, _, frames = (tmp_path / "b.bvh").read_text().partition("Frame Time:")
    (tmp_path / "fast.bvh").write_text(head + "Frame Time: 0.0005\n" + frames.partition("\n")[2])
    out = tmp_path / "out"
    outcome = perfcap(["retarget", tmp_path / "fast.bvh", "--actor", "sam", "--out", out])
    kept = json.loads((out / "run.json").read_text())["warnings"]
    doubts = ("faster than any runner", "check its frame time")
    assert outcome.code == 0
    assert all(any(words in line for line in outcome.notes) for words in doubts)
    assert all(any(words in line for line in kept) for words in doubts)
    assert len(set(kept)) == len(kept) == len(outcome.notes)
    assert perfcap(["report", out]).code == 0
    page = (out / "report.html").read_text()
    assert all(words in page for words in doubts)


def test_places_that_no_person_is_in_are_told() -> None:
    """Above the floor, below it, and lying all the time; not who stands, jumps or falls."""
    take = make_take(20)
    joints = take.actor.joints(take.truth)
    joints = joints - torch.stack([torch.zeros(()), joints[..., 1].min(), torch.zeros(())])
    high = joints + torch.tensor([0.0, 0.9, 0.0])
    lying = joints[..., [0, 2, 1]]

    def said(case: torch.Tensor) -> list[str]:
        return [*floor_doubts(case), *lying_doubts(case)]

    cases = {"m above the floor": high, "m below the floor": -high, "lies": lying}
    assert not said(joints)
    assert not said(torch.where(torch.arange(20)[:, None, None] < 8, high, joints))
    assert not said(torch.cat((joints, lying)))
    for words, case in cases.items():
        assert any(words in line for line in said(case))


@pytest.mark.long
def test_part_of_a_moving_character(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    call = ["retarget", captured / "capture.glb", "--actor", "sam", "--out", tmp_path / "out"]
    assert perfcap([*call, "--frames", "3:9", "--floor", "none"]).code == 0
    kept = yaml.safe_load((tmp_path / "out" / "config.yaml").read_text())
    assert kept["contact"]["enabled"] is False  # as it was solved
    found = read_result(tmp_path / "out")
    assert found.frame_numbers.tolist() == [3, 4, 5, 6, 7, 8]
    assert found.report["floor"] is None
    said = perfcap(call).refused()
    assert "holds a result already; add --overwrite" in said
    assert perfcap([*call, "--overwrite"]).code == 0


def test_a_capture_is_in_metres(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    (tmp_path / "map.toml").write_text("metres_per_unit = 0.01\n")
    more = ("--source-mapping", tmp_path / "map.toml", "--out", tmp_path / "out")
    said = perfcap(["retarget", captured, "--actor", "sam", *more]).refused()
    assert "is a capture, which is in metres" in said


def test_several_people(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    several = tmp_path / "several"
    for name in ("person1", "person2"):
        shutil.copytree(captured, several / name)
    people = [{"folder": "person1"}, {"folder": "person2"}]
    (several / "people.json").write_text(json.dumps({"K": 2, "people": people}))
    (several / "run.json").write_text("{}")
    out = tmp_path / "out"
    assert perfcap(["retarget", several, "--actor", "sam", "--out", out]).code == 0
    assert (out / "scene.glb").is_file() and read_result(out / "person2").frames > 0
    call = ["retarget", several, "--actor", "sam", "sam", "sam", "--out", tmp_path / "b"]
    assert "3 actors for 2 people" in perfcap(call).refused()
    assert not (tmp_path / "b" / "run.json").exists()


@pytest.mark.parametrize(
    ("source", "said"),
    [("nothing.bvh", "cannot be read"), ("folder", "has no run.json"), ("a.fbx", "no such file")],
)
def test_what_cannot_be_a_source(source: str, said: str, tmp_path: Path, perfcap: Command) -> None:
    (tmp_path / "folder").mkdir()
    call = ["retarget", tmp_path / source, "--actor", "sam", "--out", tmp_path / "out"]
    assert said in perfcap(call).refused()


def test_nothing_is_written_over_what_is_read(
    captured: Path, tmp_path: Path, perfcap: Command
) -> None:
    folder = Path(shutil.copytree(captured, tmp_path / "own"))
    before = (folder / "motion.npz").read_bytes()
    call = ["retarget", folder, "--actor", "sam", "--out", folder, "--overwrite"]
    assert "would replace the input" in perfcap(call).refused()
    assert (folder / "motion.npz").read_bytes() == before
