"""``perfcap capture`` with a character in several files."""

import json
import os
from pathlib import Path

from runs import Command
from takes import TakeFiles

from perfcap.io.gltf_document import companions

QUICK = ("--no-overlay", "--until", "initialize", "--frames", "0:6")


def test_buffers_of_a_character_are_inputs(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    """A changed .bin beside a .gltf gave the old result again."""
    mesh = write_gltf(take.actor, tmp_path)
    call = take.command(tmp_path / "out", *QUICK, actor=mesh)
    assert perfcap(call).code == 0
    files = json.loads((tmp_path / "out" / "run.json").read_text())["input_files"]
    assert {str(mesh), str(tmp_path / "buffer.bin")} <= files.keys()
    assert perfcap([*call, "--resume"]).code == 0
    os.utime(tmp_path / "buffer.bin", (1, 1))
    assert "inputs that have changed" in perfcap([*call, "--resume"]).refused()


def test_companions_of_no_character(tmp_path: Path) -> None:
    for text in ("{", "[]", '{"buffers": 3, "images": [4, {"uri": 5}, {"uri": "data:,"}]}'):
        (tmp_path / "a.gltf").write_text(text)
        assert companions(tmp_path / "a.gltf") == ()
    (tmp_path / "a.gltf").write_text('{"images": [{"uri": "a%20b.png"}, {"uri": "\\u0000"}]}')
    assert companions(tmp_path / "a.gltf") == (tmp_path / "a b.png",)
    assert companions(tmp_path / "a.glb") == companions(tmp_path / "no.gltf") == ()


def write_gltf(glb: Path, folder: Path) -> Path:
    """A .glb as a .gltf with its buffer beside it."""
    data = glb.read_bytes()
    size = int.from_bytes(data[12:16], "little")
    tree = json.loads(data[20 : 20 + size])
    tree["buffers"][0]["uri"] = "buffer.bin"
    (folder / "buffer.bin").write_bytes(data[28 + size :])
    path = folder / "character.gltf"
    path.write_text(json.dumps(tree))
    return path
