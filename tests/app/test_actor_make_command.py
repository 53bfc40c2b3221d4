"""``perfcap actor build`` without a rig: bodies of measures, and what is refused."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from foreign_rigs import MIXAMO, Rig
from runs import Command
from takes import write_actor

from perfcap.app import actor_sheet
from perfcap.io import load_actor


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(actor_sheet, "_LARGE", 48)
    monkeypatch.setattr(actor_sheet, "_SMALL", 32)


def test_a_body_becomes_a_folder(perfcap: Command, tmp_path: Path) -> None:
    out = tmp_path / "eve"
    call = ["actor", "build", "--body", "--weight", "66", "--gender", "female", "--name", "eve"]
    done = perfcap([*call, "--out", out])
    assert done.code == 0 and "weight 6" in done.out and "CC0-1.0" in done.out
    assert 1.5 < json.loads((out / "measurements.json").read_text())["height"]["metres"] < 1.9
    assert cv2.imread(str(out / "contact_sheet.jpg")) is not None
    actor = load_actor(out)
    assert actor.template.name == "eve" and actor.template.texture is not None
    assert 1.5 < float(np.ptp(actor.template.vertices[:, 1])) < 1.9


@pytest.mark.long
def test_nothing_of_the_earlier_actor_stays(perfcap: Command, tmp_path: Path) -> None:
    """Measurements of one person lay beside the mesh of another."""
    out = tmp_path / "eve"
    call = ["actor", "build", "--name", "eve", "--out", out]
    assert perfcap([*call, "--body", "--height", "1.6"]).code == 0
    for name in ("body.npz", "fit.jpg", "notes.txt"):  # two as of `actor fit`
        (out / name).write_bytes(b"x")
    write_actor(tmp_path / "other.glb", Rig(MIXAMO).template())
    assert perfcap([*call, tmp_path / "other.glb"]).code == 0
    files = {"actor.glb", "manifest.toml", "contact_sheet.jpg", "notes.txt"}
    assert {file.name for file in out.iterdir()} == files
    assert perfcap([*call, "--body", "--height", "1.6"]).code == 0
    assert {file.name for file in out.iterdir()} == {*files, "measurements.json"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "no file is given"),
        (["scan.obj", "--body"], "leave one of them"),
        (["--body", "--height", "175"], "expected 1.3 to 2.2 metres"),
        (["--body", "--body-model", "nobody"], "ada"),
        (["scan.txt"], "expected a rigged character or a bare mesh"),
        (["scan.obj", "--overrides", "missing.toml"], "missing.toml"),
        (["scan.obj", "--detector", "nowhere"], "--detector nowhere: no such folder"),
        (["scan.obj", "--mapping", "bones.toml"], "--mapping: does nothing for a mesh without"),
        (["scan.obj", "--waist", "0.8"], "--waist: does nothing for a mesh without bones"),
        (["--body", "--detector", "nowhere"], "--detector: does nothing for --body"),
    ],
)
def test_what_cannot_be_built_is_told(
    perfcap: Command, tmp_path: Path, arguments: list[str], words: str
) -> None:
    (tmp_path / "scan.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    placed = [tmp_path / a if a.startswith("scan") else a for a in arguments]
    done = perfcap(["actor", "build", *placed, "--out", tmp_path / "out"])
    assert done.code == 2 and words in done.err.replace("\n", " ")
    assert not (tmp_path / "out").exists()
