"""``perfcap models``, ``--version`` and words that are no command."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tiny_networks import rtmpose
from tiny_people import people

from perfcap import __version__
from perfcap.cli import main
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.people import OnnxFinder
from perfcap.io.actor import models_folder

DETECTORS = models_folder() / "detectors"


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_:
        main([str(a) for a in arguments])
    streams = capsys.readouterr()
    return int(exit_.value.code or 0), streams.out, streams.err


def test_shipped_models_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "models")
    assert code == 0
    for name in ("sam", "ada", "multipose", "thunder", "blazepose", "blazepose_heavy", "cmu"):
        assert name in out
    assert run(capsys, "models", "list", DETECTORS)[1].count("COCO-17") == 6


def test_files_that_are_not_there_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("lost", "cut"):
        (tmp_path / name).mkdir()
        shutil.copy(DETECTORS / "lightning" / "manifest.toml", tmp_path / name)
    (tmp_path / "cut" / "model.onnx").write_bytes(b"x" * 70)
    shipped = run(capsys, "models")[1]
    cut, lost = run(capsys, "models", "list", tmp_path)[1].splitlines()[-2:]
    assert "missing" not in shipped and "copy it again" not in shipped
    assert lost.endswith("model.onnx is missing") and "model.onnx has 70 bytes, not" in cut


@pytest.mark.long
@pytest.mark.parametrize("name", ["thunder", "blazepose"])
def test_a_manifest_that_was_written_serves(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "model.onnx"
    shutil.copy(DETECTORS / name / "model.onnx", model)
    code, out, _ = run(capsys, "models", "manifest", model, "--licence", 'a "b" \\ c')
    assert code == 0 and "perfcap capture VIDEO --detector" in out
    guessed = OnnxDetector(tmp_path).manifest
    shipped = OnnxDetector(DETECTORS / name).manifest
    assert guessed.output == shipped.output and guessed.joint_set == shipped.joint_set
    assert guessed.input.turns == shipped.input.turns
    assert guessed.file.licence == 'a "b" \\ c'
    code, _, err = run(capsys, "models", "manifest", model)
    assert code == 2 and "--overwrite" in err


@pytest.mark.long
@pytest.mark.parametrize(("name", "size"), [("multipose", 384), ("tiny", 192)])
def test_a_network_of_several_people_is_known_by_its_layout(
    tmp_path: Path, name: str, size: int, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "model.onnx"
    if name == "tiny":
        model.write_bytes(people().SerializeToString())
    else:
        shutil.copy(DETECTORS / name / "model.onnx", model)
    code, out, _ = run(capsys, "models", "manifest", model)
    assert code == 0 and f"--detector {tmp_path} thunder" in out.replace("\n", " ")
    assert ("takes others than 384" in out) == (name == "multipose")
    guessed = OnnxFinder(tmp_path).manifest
    assert guessed.input.size == (size, size) and guessed.joint_set.name == "COCO-17"
    assert guessed.output == OnnxFinder(DETECTORS / "multipose").manifest.output


@pytest.mark.parametrize(
    ("content", "more", "words"),
    [
        (b"not a network", (), "is not an ONNX model"),
        (None, ("--joints", "COCO-7"), "expected one of landmarks16, COCO-17"),
        (None, (), "no such file"),
    ],
)
def test_what_is_no_network_is_refused(
    tmp_path: Path,
    content: bytes | None,
    more: tuple[str, ...],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "model.onnx"
    if content is not None:
        path.write_bytes(content)
    code, _, err = run(capsys, "models", "manifest", path, *more)
    assert code == 2 and words in err and err.count("\n") == 1
    assert not (tmp_path / "manifest.toml").exists()


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("captur", "did you mean capture?"),
        ("dance.mp4", "perfcap capture dance.mp4"),
        ("x", "demo"),
    ],
)
def test_typing_errors_are_answered(
    word: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = run(capsys, word)
    assert code == 2 and meant in err and err.count("\n") == 1


def test_version_by_module() -> None:
    call = [sys.executable, "-m", "perfcap", "--version"]
    found = subprocess.run(call, capture_output=True, text=True, check=True)
    assert found.stdout == f"perfcap {__version__}\n"


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "joints", "words"),
    [
        ("blazepose", "COCO-17", "whose joints are BlazePose-33"),
        ("lightning", "Halpe-26", "whose joints are COCO-17"),
        (None, "COCO-17", "are 17 joints"),
    ],
)
def test_joints_that_a_network_has_not_are_refused(
    tmp_path: Path,
    name: str | None,
    joints: str,
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """They were not looked at, or written down for an output of another number."""
    model = tmp_path / "model.onnx"
    if name is None:
        model.write_bytes(rtmpose(26).SerializeToString())
    else:
        shutil.copy(DETECTORS / name / "model.onnx", model)
    code, _, err = run(capsys, "models", "manifest", model, "--joints", joints)
    assert code == 2 and words in err and err.count("\n") == 1
    assert not (tmp_path / "manifest.toml").exists()
    own = {"blazepose": "BlazePose-33", "lightning": "COCO-17", None: "Halpe-26"}[name]
    code, out, _ = run(capsys, "models", "manifest", model, "--joints", own)
    assert code == 0 and "to check: " in out  # how values are scaled, no shape tells
