"""``perfcap export``: a folder of results to files of other programs."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from runs import Command

from perfcap.app.export import _recording
from perfcap.app.level import level_of
from perfcap.commands.results import Export
from perfcap.io import export
from perfcap.io.bvh_read import load_bvh
from perfcap.io.result import read_result

PLAIN = ("glb", "bvh", "obj", "ply", "trc", "npz", "csv")  # nothing else is needed for them


@pytest.fixture
def folder(captured: Path, tmp_path: Path) -> Path:
    """A copy of the one captured folder, under a name that few expect."""
    return Path(shutil.copytree(captured, tmp_path / "Zoë & Łukasz (2)"))


def change_motion(folder: Path, **arrays: object) -> None:
    with np.load(folder / "motion.npz", allow_pickle=False) as data:
        kept = {name: data[name] for name in data.files} | arrays
    np.savez(folder / "motion.npz", **kept)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_angles_that_are_no_numbers(folder: Path, perfcap: Command, value: float) -> None:
    with np.load(folder / "motion.npz", allow_pickle=False) as data:
        rotation = data["root_rotation"].copy()
    rotation[5, 1] = value
    change_motion(folder, root_rotation=rotation)
    line = perfcap(["export", folder, "--to", "npz"]).refused()
    assert "root_rotation holds what is no number or too large" in line


def test_turns_of_another_shape_are_left_out(folder: Path, perfcap: Command) -> None:
    with np.load(folder / "motion.npz", allow_pickle=False) as data:
        rotation = data["root_rotation"][:, :2]
    change_motion(folder, root_rotation=rotation)
    assert perfcap(["export", folder, "--to", "npz", "--name", "a"]).code == 0
    with np.load(folder / "export" / "a.npz", allow_pickle=False) as data:
        assert "root_rotation" not in data


def test_several_formats_at_once(folder: Path, perfcap: Command) -> None:
    outcome = perfcap(["export", folder, "--to", *PLAIN, "--frames", "3:7"])
    assert outcome.code == 0 and not outcome.said
    name = folder.name
    written = {f"{name}{ending}" for ending in (".glb", ".bvh", "_obj", "_ply", ".trc", ".npz",
                                                "_joints.csv", "_angles.csv",
                                                "_ranges.csv")}  # fmt: skip
    assert {path.name for path in (folder / "export").iterdir()} == written
    assert len(list((folder / "export" / f"{name}_obj").glob("*.obj"))) == 4
    assert sorted(Path(line).name for line in outcome.out.splitlines()) == sorted(written)


def test_older_files_of_a_name_are_told(folder: Path, tmp_path: Path, perfcap: Command) -> None:
    """Those of another capture, say, of which some formats would stay."""
    call = ["export", folder, "--name", "walk", "--out", tmp_path / "all", "--to"]
    assert "replaces" not in perfcap([*call, "bvh", "trc"]).out
    lines = perfcap([*call, "bvh", "npz"]).out.splitlines()
    assert [line.endswith("walk.bvh (replaces an older file)") for line in lines] == [True, False]


def test_extras(folder: Path, tmp_path: Path, perfcap: Command) -> None:
    pytest.importorskip("pxr", reason="the extra usd is not installed")
    pytest.importorskip("ezc3d", reason="the extra mocap is not installed")
    call = ["export", folder, "--to", "usd", "usdz", "c3d", "--out", tmp_path / "out"]
    assert perfcap([*call, "--name", "Lučka's take 1"]).code == 0
    found = {path.name for path in (tmp_path / "out").iterdir()}
    assert found == {f"Lučka's take 1{ending}" for ending in (".usdc", ".usdz", ".c3d")}


def test_axes_and_units(folder: Path, tmp_path: Path, perfcap: Command) -> None:
    call = ["export", folder, "--to", "bvh", "--name", "a", "--out", tmp_path / "out"]
    assert perfcap(call).code == 0
    usual = load_bvh(tmp_path / "out" / "a.bvh", 0.01)
    assert perfcap([*call, "--unit", "m", "--up", "z", "--order", "XYZ"]).code == 0
    turned = load_bvh(tmp_path / "out" / "a.bvh", 1.0)
    x, y, z = usual.positions[:, 0].T
    np.testing.assert_allclose(turned.positions[:, 0], np.stack([x, -z, y], -1), atol=2e-6)
    text = (tmp_path / "out" / "a.bvh").read_text()
    assert text.count("Xrotation Yrotation Zrotation") == text.count("CHANNELS")


@pytest.mark.parametrize("axis", ["-y", "z"])
def test_captures_whose_world_lies_on_its_side_come_out_upright(
    axis: str, folder: Path, tmp_path: Path, perfcap: Command
) -> None:
    with np.load(folder / "motion.npz", allow_pickle=False) as data:
        joints = data["joints3d"]
    x, y, z = np.moveaxis(joints, -1, 0)
    lying = {"-y": np.stack([x, -y, -z], -1), "z": np.stack([x, -z, y], -1)}[axis]
    change_motion(folder, joints3d=lying)
    call = ["export", folder, "--to", "csv", "--name", "a", "--out", tmp_path / "out"]
    outcome = perfcap(call)
    assert outcome.code == 0 and f"turned upright: {axis} is up" in outcome.out
    table = np.genfromtxt(tmp_path / "out" / "a_joints.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["l_knee_y"], joints[:, 13, 1], atol=1e-6)
    outcome = perfcap([*call, "--world-up", "y"])
    assert outcome.code == 0 and "turned" not in outcome.out
    table = np.genfromtxt(tmp_path / "out" / "a_joints.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["l_knee_z"], lying[:, 13, 2], atol=1e-6)


def test_the_same_call_makes_the_same_files(folder: Path, tmp_path: Path, perfcap: Command) -> None:
    for name in "ab":
        call = ["export", folder, "--to", *PLAIN, "--frames", "0:3", "--name", "x"]
        assert perfcap([*call, "--out", tmp_path / name]).code == 0
    for one in sorted((tmp_path / "a").rglob("*.*")):
        assert one.read_bytes() == (tmp_path / "b" / one.relative_to(tmp_path / "a")).read_bytes()


def test_folders_of_a_dot_have_names(
    folder: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert perfcap(["export", ".", "--to", "trc"]).code == 0
    assert [p.name for p in (folder / "export").iterdir()] == [f"{folder.name}.trc"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--frames", "24:30"), "holds frames 0 to 23"),
        (("--frames", ":0"), "holds frames 0 to 23"),
        (("--frames", "5"), "--frames 5"),
        (("--name", "a/b"), "--name 'a/b'"),
        (("--name", "a\\b"), "--name"),
        (("--name", ".."), "--name '..'"),
        (("--name", " "), "--name ' '"),
        (("--name", "a\nb"), "--name 'a\\nb'"),
        (("--name", "ö" * 99), "too long"),
        (("--out", "file"), "file: cannot be written"),
        (("--out", "file/inside"), "cannot be written"),
        (("--to", "glb", "--up", "z"), "--up: means nothing to glb"),
        (("--to", "glb", "--unit", "cm"), "--unit: means nothing to glb"),
        (("--to", "glb", "csv", "--order", "ZXY"), "--order: means nothing to glb, csv"),
        (("--to", "bvh", "--markers", "bones"), "--markers: means nothing to bvh"),
        (("--to", "bvh", "--no-surface"), "--no-surface: means nothing to bvh"),
    ],
)
def test_wrong_calls_are_one_line_and_write_nothing(
    captured: Path,
    tmp_path: Path,
    perfcap: Command,
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    out = () if "--out" in options else ("--out", "out")
    call = ["export", captured, "--to", "bvh", "csv", *out, *options]
    assert message in perfcap(call).refused()
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("kind", ["usd", "c3d"])
def test_a_missing_package_is_named_with_its_extra(
    kind: str, captured: Path, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export.formats, "find_spec", lambda name: None)
    call = ["export", captured, "--to", "bvh", kind, "--out", tmp_path / "out"]
    message = perfcap(call).refused()
    assert f"--to {kind}" in message and "pip install" in message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", PLAIN)
def test_a_full_disk_leaves_nothing(
    kind: str, captured: Path, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full when a file gets its name, after all of them were begun."""

    def full(old: Path, new: Path) -> None:
        raise OSError(28, os.strerror(28), str(new))

    monkeypatch.setattr(os, "replace", full)
    call = ["export", captured, "--to", kind, "--frames", "0:2", "--out", tmp_path / "a" / "b"]
    message = perfcap(call).refused()
    assert "No space left" in message and ".tmp" not in message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only for the superuser")
def test_a_read_only_folder(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    tmp_path.chmod(0o500)
    message = perfcap(["export", captured, "--to", "bvh", "--out", tmp_path]).refused()
    tmp_path.chmod(0o700)
    assert str(tmp_path) in message and "cannot be written" in message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("rate", [0.0, -30.0, np.nan, np.inf])
def test_frame_rates_that_are_none(
    rate: float, folder: Path, tmp_path: Path, perfcap: Command
) -> None:
    change_motion(folder, fps=np.array(rate))
    message = perfcap(["export", folder, "--to", "bvh", "--out", tmp_path / "out"]).refused()
    assert f"fps is {rate}" in message
    assert not (tmp_path / "out").exists()


def test_unfinished_folders_are_refused(folder: Path, tmp_path: Path, perfcap: Command) -> None:
    call = ["--to", *PLAIN, "--out", tmp_path / "out"]
    assert "no such folder" in perfcap(["export", tmp_path / "none", *call]).refused()
    report = json.loads((folder / "run.json").read_text())
    for name, message in (("capture.glb", "lacks capture.glb"), ("run.json", "no run.json")):
        kept = (folder / name).read_bytes()
        (folder / name).write_bytes(kept[: len(kept) // 2])
        perfcap(["export", folder, *call]).refused()
        (folder / name).unlink()
        assert message in perfcap(["export", folder, *call]).refused()
        (folder / name).write_bytes(kept)
    (folder / "run.json").write_text(json.dumps(report | {"surface": {"vertices": 1}}))
    assert "lacks surface.npz" in perfcap(["export", folder, *call]).refused()
    assert not (tmp_path / "out").exists()


def test_older_results_are_read(folder: Path, perfcap: Command) -> None:
    """Before there were angles in motion.npz, and frames in run.json."""
    with np.load(folder / "motion.npz", allow_pickle=False) as data:
        old = {name: data[name] for name in ("joints3d", "frames", "fps")}
    np.savez(folder / "motion.npz", **old)
    (folder / "run.json").write_text("{}")
    assert perfcap(["export", folder, "--to", *PLAIN, "--frames", ":2"]).code == 0
    assert not list((folder / "export").glob("*_angles.csv"))


def test_nothing_is_written_through_a_link(folder: Path, tmp_path: Path, perfcap: Command) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (folder / "export").symlink_to(elsewhere)
    assert "is a link" in perfcap(["export", folder, "--to", "bvh"]).refused()
    assert not list(elsewhere.iterdir())
    assert perfcap(["export", folder, "--to", "bvh", "--out", elsewhere]).code == 0


def test_the_result_itself_is_not_replaced(folder: Path, perfcap: Command) -> None:
    before = (folder / "motion.npz").read_bytes()
    call = ["export", folder, "--to", "npz", "--name", "motion", "--out", folder]
    assert "motion.npz, which the result" in perfcap(call).refused()
    assert (folder / "motion.npz").read_bytes() == before


def test_who_is_upside_down_or_lies_is_named(folder: Path, perfcap: Command) -> None:
    told = {
        up: perfcap(["export", folder, "--to", "trc", f"--world-up={up}"]).out
        for up in ("auto", "y", "-y", "x")
    }
    down = {up for up, out in told.items() if "upside down" in out}
    assert len(down) == 1 and down < {"y", "-y"}
    assert {up for up, out in told.items() if "the person lies" in out} == {"x"}


def test_a_retargeted_motion_keeps_its_world(captured: Path, tmp_path: Path) -> None:
    """Whose y is up also where the person lies; of a capture, the person's trunk decides."""
    result = read_result(captured)
    lying = replace(result, joints=result.joints[..., [1, 0, 2]] * np.array([1.0, -1.0, 1.0]))
    request = Export(captured, ("trc",), out=tmp_path)
    assert abs(_recording(request, "a", lying, level_of([lying])).upright[1, 0]) > 0.9
    assert not lying.level
    level = replace(lying, report={**lying.report, "retargeted_from": "a.bvh"})
    kept = _recording(request, "a", level, level_of([level]))
    assert np.array_equal(kept.upright, np.eye(3))
