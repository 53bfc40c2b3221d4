"""Calls and files that are meant to trip the program: one line each, never a traceback."""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from runs import Command
from takes import TakeFiles

from perfcap.app.console import PlainConsole
from perfcap.cli import main
from perfcap.commands.capture import Doctor

# --- one place for what any call can meet ---------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "not enough memory"),
        (RecursionError(), "nested too deep"),
        (PermissionError(13, "Permission denied", "secret.npz"), "secret.npz: cannot be used"),
    ],
)
def test_no_traceback(
    perfcap: Command, monkeypatch: pytest.MonkeyPatch, error: BaseException, words: str
) -> None:
    def fail(_: Doctor) -> int:
        raise error

    monkeypatch.setattr("perfcap.app.doctor.run_doctor", fail)
    assert words in perfcap(["doctor"]).refused()


def test_mistakes_of_the_program_keep_their_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Doctor) -> int:
        raise KeyError("a bug")

    monkeypatch.setattr("perfcap.app.doctor.run_doctor", fail)
    with pytest.raises(KeyError):
        main(["doctor"])


# --- options --------------------------------------------------------------------------------------


def test_an_option_of_pages_is_refused_at_once(perfcap: Command) -> None:
    assert "is no option" in perfcap(["doctor", 300 * "--detections"]).refused()
    for word in (4000 * "--detections", 5000 * "x"):
        line = perfcap(["doctor", "--cameras", "c.json", word]).refused()
        assert "letters, expected 4096 at most" in line and len(line) < 200


@pytest.mark.parametrize("options", [["--out", ""], ["--out="], ["", "--out", "out"]])
def test_a_variable_that_is_not_set(perfcap: Command, options: list[str]) -> None:
    """An empty name is the working directory, which was written into."""
    line = perfcap(["capture", "a.mp4", *options]).refused()
    assert "is empty, expected a value" in line
    assert ("after --out" in line or "--out=" in line) == (options[0] != "")


def test_a_forgotten_video(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    call = take.command(tmp_path)
    assert "VIDEO: is missing" in perfcap([call[0], *call[2:]]).refused()


def test_a_video_after_an_option_that_takes_several(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    """It is taken for another actor, and was refused as another person."""
    call = ["capture", "--out", tmp_path, "--actor", "sam", take.video]
    assert "VIDEO: is missing; expected a video" in perfcap(call).refused()
    line = perfcap([call[0], take.video, *call[1:]]).refused()
    assert f"--actor: names sam, {take.video}" in line and "videos before --actor" in line


@pytest.mark.parametrize("name", ["a\0b", "x" * 300, "/".join(["y" * 200] * 25)])
@pytest.mark.parametrize("option", ["out", "cameras", "detections", "actor", "video"])
def test_impossible_names(
    take: TakeFiles, tmp_path: Path, perfcap: Command, name: str, option: str
) -> None:
    call = take.command(**{"out": tmp_path / "out", option: tmp_path / name})  # type: ignore[arg-type]
    line = perfcap(call).refused()
    assert len(line) < 2000 and "\0" not in line


def test_control_characters_never_reach_a_terminal(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    line = perfcap(take.command(tmp_path, cameras=tmp_path / "\x1b]0;x\x07.json")).refused()
    assert line.isprintable() and r"\x1b" in line


# --- names that look like markup ------------------------------------------------------------------


@pytest.mark.parametrize("text", ["a[/]b", "[/x]", "[bold]c", ":smile:", "[red"])
def test_text_is_printed_letter_for_letter(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    from rich.table import Table

    table = Table("name")
    table.add_row(text)
    console = PlainConsole(width=80)
    console.print(text, soft_wrap=True)
    console.print(table)
    console.print(f"{text}\x1b[2J", style="yellow")
    out = capsys.readouterr().out
    assert out.count(text) == 3 and "\x1b" not in out and r"\x1b[2J" in out


def test_an_actor_and_a_truth_with_such_names(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    folder = tmp_path / "a[/]b"
    folder.mkdir(parents=True)
    (folder / "actor.glb").write_bytes(take.actor.read_bytes())
    (folder / "manifest.toml").write_text('licence = "[/x]"\n')
    outcome = perfcap(["actor", "inspect", folder])
    assert outcome.code in (0, 2) and "[/x]" in outcome.out and not outcome.said


# --- files ----------------------------------------------------------------------------------------


def test_toml_nested_deep(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    (tmp_path / "Calib.toml").write_text("a = " + "[" * 3000 + "]" * 3000)
    line = perfcap(take.command(tmp_path, cameras=tmp_path / "Calib.toml")).refused()
    assert "nested too deep" in line


@pytest.mark.long
def test_a_report_nested_deep(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    for depth in (900, 3000):
        nested = '{"a":' * depth + "1" + "}" * depth
        for text in (nested, f'{{"frames": 24, "request": {nested}}}'):
            folder = tmp_path / f"{depth}{len(text)}"
            folder.mkdir()
            for path in captured.iterdir():
                if path.is_file():
                    os.link(path, folder / path.name)
            (folder / "run.json").unlink()
            (folder / "run.json").write_text(text)
            outcome = perfcap(["report", folder])
            assert outcome.code == 0 or outcome.refused()


def spoiled_actor(take: TakeFiles, path: Path, change: dict[str, object], node: int) -> Path:
    """The actor with other numbers in one of its nodes."""
    data = take.actor.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + size])
    tree["nodes"][node % len(tree["nodes"])].update(change)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = data[:8] + struct.pack("<II4s", 20 + len(text) + len(rest), len(text), b"JSON")
    path.write_bytes(head + text + rest)
    return path


@pytest.mark.parametrize("node", [0, 3])
@pytest.mark.parametrize(
    "change",
    [
        {"scale": [1e300] * 3},
        {"scale": [0, 0, 0]},
        {"scale": [1e-300] * 3},
        {"rotation": [0, 0, 0, 0]},
        {"rotation": [1e-200] * 4},
        {"rotation": [1e200] * 4},
        {"translation": [1e300] * 3},
    ],
)
def test_wild_nodes_of_an_actor(
    take: TakeFiles, tmp_path: Path, perfcap: Command, change: dict[str, object], node: int
) -> None:
    path = spoiled_actor(take, tmp_path / "actor.glb", change, node)
    outcome = perfcap(["actor", "inspect", path])
    assert outcome.code == 0 or outcome.code == 2
    assert "Traceback" not in outcome.err


def test_a_pipe_as_buffer_is_not_waited_for(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    os.mkfifo(tmp_path / "buffer.bin")
    tree = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "buffer.bin", "byteLength": 4}],
    }
    (tmp_path / "actor.gltf").write_text(json.dumps(tree))
    assert "not a file" in perfcap(["actor", "inspect", tmp_path / "actor.gltf"]).refused()


@pytest.mark.parametrize("number", [2**63, 2**70, -(2**70)])
def test_faces_of_an_off_mesh_beyond_all_numbers(tmp_path: Path, number: int) -> None:
    from perfcap.errors import InputError
    from perfcap.io.datasets.monoperfcap import read_off

    path = tmp_path / "a.off"
    path.write_text(f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 {number}\n")
    with pytest.raises(InputError, match=r"a\.off"):
        read_off(path)


def test_long_texts_of_files_are_not_repeated(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    names = np.array(["x" * 90_000 + "\x1b[2J" + str(i) for i in range(16)])
    np.savez(
        tmp_path / "a.npz",
        joints2d=np.zeros((24, 16, 2)),
        confidence2d=np.ones((24, 16)),
        joint_names=names,
    )
    line = perfcap(take.command(tmp_path, detections=tmp_path / "a.npz")).refused()
    assert len(line) < 2000 and line.isprintable()
