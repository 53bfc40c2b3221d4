"""``perfcap actor``: what people see, and what is refused."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from foreign_rigs import MIXAMO, NAMELESS, RIGS, Z_UP, Rig, transformed
from runs import Command
from takes import TakeFiles, marked_template, write_actor

from perfcap.app import actor_sheet
from perfcap.io.actor import load_actor
from perfcap.io.actor_folder import read_manifest
from perfcap.io.result import read_result


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(actor_sheet, "_LARGE", 48)
    monkeypatch.setattr(actor_sheet, "_SMALL", 32)


def test_a_foreign_rig_is_told_and_drawn(perfcap: Command, tmp_path: Path) -> None:
    RIGS["Biped, centimetres, z up"].write(tmp_path / "own.glb")
    done = perfcap(["actor", "inspect", tmp_path / "own.glb", "--out", tmp_path / "out"])
    assert done.code == 0
    for word in ("Biped", "Bip01 L Thigh", "in centimetres, z up, facing -y", " m "):
        assert word in done.out
    assert "warning: scale" in done.out and "warning: axes" in done.out
    sheet = cv2.imread(str(tmp_path / "out/contact_sheet.jpg"))
    assert sheet.shape == (2 * 48 + 32, 4 * 48, 3)
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["contact_sheet.jpg"]


def test_a_rig_becomes_a_folder(perfcap: Command, tmp_path: Path) -> None:
    RIGS["no names, inches, z up"].write(tmp_path / "own.glb")
    out = tmp_path / "me"
    done = perfcap(
        ["actor", "build", tmp_path / "own.glb", "--out", out, "--name", "me", "--licence", "mine"]
    )
    assert done.code == 0 and f"--actor {out}" in done.out.replace("\n", "")
    names = {"actor.glb", "manifest.toml", "contact_sheet.jpg"}
    assert {file.name for file in out.iterdir()} == names
    manifest = read_manifest(out / "manifest.toml")
    assert (manifest.name, manifest.licence) == ("me", "mine")
    assert manifest.joints["l_knee"] == NAMELESS["l_knee"]
    again = perfcap(["actor", "inspect", out])
    assert again.code == 0 and "manifest" in again.out
    actor = load_actor(out)
    assert float(np.ptp(actor.template.vertices[:, 1])) == pytest.approx(1.75, abs=0.02)


def test_the_character_that_is_read_stays(perfcap: Command, tmp_path: Path) -> None:
    own = tmp_path / "actor.glb"
    RIGS["no names, inches, z up"].write(own)
    before = own.read_bytes()
    line = perfcap(["actor", "build", own, "--out", tmp_path]).refused()
    assert "actor.glb of the actor would replace the input" in line
    assert own.read_bytes() == before


def test_a_mapping_file_is_used(perfcap: Command, tmp_path: Path) -> None:
    Rig(MIXAMO, spines=("mixamorig:Spine",)).write(tmp_path / "own.glb")
    (tmp_path / "map.toml").write_text('spine = "mixamorig:Spine"\n')
    call = ["actor", "inspect", tmp_path / "own.glb", "--mapping", tmp_path / "map.toml"]
    done = perfcap(call)
    row = next(line for line in done.out.splitlines() if "spine" in line.split())
    assert "mixamorig:Spine " in row and "mapping" in row


@pytest.mark.long
def test_captures_with_ones_own_character_find_the_same_motion(
    perfcap: Command, take: TakeFiles, captured: Path, tmp_path: Path
) -> None:
    """The actor of the take under other names, in centimetres with z up, as file and as folder."""
    ends = {"head_top": "mixamorig:HeadTop_End", "l_toe": "mixamorig:LeftToe_End",
            "r_toe": "mixamorig:RightToe_End"}  # fmt: skip
    plain = marked_template()
    names = tuple({**MIXAMO, **ends}[name] for name in plain.bone_names)
    turned = transformed(replace(plain, bone_names=names), 100 * Z_UP, np.zeros(3))
    write_actor(tmp_path / "own.glb", turned)
    folder = tmp_path / "me"
    assert perfcap(["actor", "build", tmp_path / "own.glb", "--out", folder]).code == 0
    expected = read_result(captured)
    for number, actor in enumerate((tmp_path / "own.glb", folder)):
        out = tmp_path / f"out{number}"
        assert perfcap(take.command(out, "--no-overlay", actor=actor)).code == 0
        found = read_result(out)
        np.testing.assert_allclose(found.joints, expected.joints, atol=1e-3)
        assert found.template.bone_names == names
        theirs, ours = (each.vertices(slice(0, 3)) for each in (found, expected))
        np.testing.assert_allclose(theirs, ours, atol=2e-3)


def test_building_tells_what_was_put_right(perfcap: Command, tmp_path: Path) -> None:
    """A VRM is a binary glTF; the folder is in metres, so that only the import can tell."""
    source, out = tmp_path / "own.glb", tmp_path / "me"
    write_actor(source, transformed(Rig(MIXAMO).template(), 100 * np.eye(3), np.zeros(3)))
    done = perfcap(["actor", "build", source.rename(tmp_path / "own.vrm"), "--out", out])
    assert done.code == 0
    assert any("own.vrm: warning: scale: the file is in centimetres" in n for n in done.notes)


def test_options_that_do_nothing_are_refused(perfcap: Command, tmp_path: Path) -> None:
    call = ["actor", "build", write(tmp_path / "a.glb"), "--out", tmp_path / "me"]
    assert (
        "--height: does nothing for a character with bones"
        in perfcap([*call, "--height", "1.7"]).refused()
    )
    assert not (tmp_path / "me").exists()


def test_a_capture_is_no_actor(perfcap: Command, captured: Path) -> None:
    assert "capture.glb for the person in it" in perfcap(["actor", "inspect", captured]).refused()


@pytest.mark.long
def test_another_actor_is_not_replaced(perfcap: Command, tmp_path: Path) -> None:
    folder = tmp_path / "me"
    call = ["actor", "build", write(tmp_path / "a.glb"), "--out", folder, "--name"]
    for name in ("eve", "eve"):  # who is made again may be
        assert perfcap([*call, name]).code == 0
    before = (folder / "manifest.toml").read_bytes()
    assert "holds the actor 'eve'" in perfcap([*call, "bob"]).refused()
    assert (folder / "manifest.toml").read_bytes() == before


@pytest.mark.long
@pytest.mark.parametrize("name", ["actor.glb", "contact_sheet.jpg", "measurements.json", "fit.jpg"])
def test_files_of_nobody_perfcap_built_are_not_replaced(
    name: str, perfcap: Command, tmp_path: Path
) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / name).write_bytes(b"of another program")
    (folder / "notes.txt").write_bytes(b"to be kept")
    call = ["actor", "build", write(tmp_path / "a.glb"), "--out", folder]
    assert f"holds {name} but no actor that perfcap has built" in perfcap(call).refused()
    assert (folder / name).read_bytes() == b"of another program"
    assert {file.name for file in folder.iterdir()} == {name, "notes.txt"}
    (folder / name).unlink()
    for _ in range(2):  # what stands beside is nobody's concern, and one's own is made again
        assert perfcap(call).code == 0
    assert (folder / "notes.txt").read_bytes() == b"to be kept"


def test_a_manifest_of_something_else_is_not_replaced(perfcap: Command, tmp_path: Path) -> None:
    """Networks have one, too."""
    manifest = tmp_path / "net/manifest.toml"
    manifest.parent.mkdir()
    manifest.write_text('kind = "detector"\n')
    call = ["actor", "build", write(tmp_path / "a.glb"), "--out", manifest.parent]
    assert "holds manifest.toml but no actor" in perfcap(call).refused()
    assert manifest.read_text() == 'kind = "detector"\n'


def write(path: Path, **changes: object) -> Path:
    write_actor(path, replace(Rig(MIXAMO).template(), **changes))  # type: ignore[arg-type]
    return path


def seated(folder: Path) -> Path:
    template = Rig(MIXAMO).template()
    rest = template.bone_rest.copy()
    for side in ("Left", "Right"):
        knee, ankle = (template.bone(f"mixamorig:{side}{part}") for part in ("Leg", "Foot"))
        shank = rest[ankle, :3, 3] - rest[knee, :3, 3]
        rest[knee, :3, 3] = rest[template.bone(f"mixamorig:{side}UpLeg"), :3, 3] + [0, 0, 0.42]
        rest[ankle, :3, 3] = rest[knee, :3, 3] + shank
    return write(folder / "a.glb", bone_rest=rest)


def half_a_texture(folder: Path) -> Path:
    """An image whose header is sound."""
    return _textured(folder, _picture()[:40])


def garbled_texture(folder: Path) -> Path:
    """An image of whole chunks that hold something else."""
    data = _picture()
    start = data.index(b"IDAT") + 4
    return _textured(folder, data[:start] + b"\xff" * 20 + data[start + 20 :])


def _picture() -> bytes:
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    return bytes(cv2.imencode(".png", noise)[1])


def _textured(folder: Path, data: bytes) -> Path:
    uv = np.zeros((len(Rig(MIXAMO).template().vertices), 2))
    return write(folder / "a.glb", texture=data, uv=uv)


def another_format(folder: Path) -> Path:
    (folder / "a.3ds").write_bytes(b"MM")
    return folder / "a.3ds"


def for_blender(folder: Path) -> Path:
    (folder / "a.fbx").write_bytes(b"Kaydara FBX")
    return folder / "a.fbx"


def huge(folder: Path) -> Path:
    with (folder / "a.glb").open("wb") as file:
        file.truncate(2 << 30)
    return folder / "a.glb"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (seated, "far from T or A"),
        (half_a_texture, "image 0 is damaged"),
        (garbled_texture, "cannot be decoded"),
        (another_format, "expected a rigged character"),
        (for_blender, "open it in Blender"),
        (huge, "2147483648 bytes"),
        (lambda folder: folder / "none.glb", "cannot be read"),
    ],
)
def test_bad_characters_are_refused_and_nothing_is_written(
    make: object, message: str, perfcap: Command, tmp_path: Path
) -> None:
    source, out = make(tmp_path), tmp_path / "out"  # type: ignore[operator]
    line = perfcap(["actor", "build", source, "--out", out]).refused()
    assert message in line
    assert not out.exists()


def test_what_would_spoil_a_capture_is_code_2(perfcap: Command, tmp_path: Path) -> None:
    done = perfcap(["actor", "inspect", seated(tmp_path)])
    assert done.code == 2 and "error: rest pose" in done.out and "errors" in done.out
