"""Exports: what is written is what was captured, in every format, axis and unit."""

import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from foreign_rigs import RIGS
from scipy.spatial.transform import Rotation
from takes import make_take, person

from perfcap.actor.actor import Actor
from perfcap.errors import InputError
from perfcap.geometry.rotation import turn_to_y
from perfcap.io import gltf_morph
from perfcap.io.bvh_read import joint_positions, load_bvh
from perfcap.io.export import FORMATS, Options, Recording
from perfcap.io.export.meshes import SeamlessNormals
from perfcap.io.export.options import unique_names, word
from perfcap.io.export.recording import Z_UP
from perfcap.io.gltf_animation import read_bone_transforms
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import read_template
from perfcap.io.gltf_write import vertex_normals
from perfcap.io.mesh import read_mesh
from perfcap.io.result import read_result
from perfcap.pipeline import CaptureConfig
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface

FRAMES, START = 12, 40
NAME = "Zoë dances"


def painted() -> Actor:
    """The person of tubes with a texture, and bones whose names are hard to write."""
    template = person().template
    names = {"l_elbow": "arm (links)/Ellbogen", "r_elbow": "arm ü"}
    rng = np.random.default_rng(0)
    image = cv2.imencode(".png", rng.integers(0, 255, (8, 8, 3), np.uint8))[1].tobytes()
    joints = {name: bone for bone, name in enumerate(template.bone_names)}
    return Actor(
        replace(
            template,
            bone_names=tuple(names.get(name, name) for name in template.bone_names),
            joint_bones=joints,
            uv=rng.random((len(template.vertices), 2)),
            texture=image,
        )
    )


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    take = make_take(FRAMES, turns=0.5, actor=painted())
    parts = (take.actor, take.cameras, take.detections, take.truth, take.rate, CaptureConfig())
    skinned = SkinnedSurface(take.actor, take.truth)
    folder = tmp_path_factory.mktemp("results") / "a result"
    waves = 0.01 + 0.01 * torch.arange(FRAMES).sin()[:, None, None]
    surface = StoredSurface(skinned[:].float() + waves)
    Performance(*parts, surface=surface).save(folder, first_frame=START)
    return Recording(read_result(folder), NAME, 0, FRAMES)


def write(kind: str, folder: Path, recording: Recording, **options: object) -> Path:
    folder.mkdir(exist_ok=True)
    FORMATS[kind].write(folder, recording, Options(**options))  # type: ignore[arg-type]
    return folder


def close(found: np.ndarray, expected: np.ndarray, metres: float = 1e-5) -> None:
    np.testing.assert_allclose(found, expected, atol=metres, rtol=0)


# --- recordings -----------------------------------------------------------------------------------


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_any_axis_is_turned_up(up: str) -> None:
    axis = np.eye(3)["xyz".index(up[-1])] * (-1 if up[0] == "-" else 1)
    turn = turn_to_y(torch.from_numpy(axis)).numpy()
    np.testing.assert_allclose(turn @ axis, (0, 1, 0), atol=1e-15)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1)


def test_bones_skin_and_landmarks_turn_together(recording: Recording) -> None:
    turned = replace(
        recording, upright=turn_to_y(torch.tensor([0.0, 0.0, 1.0]).double()).numpy()
    ).facing_up("z")
    turn = Z_UP @ turned.upright
    np.testing.assert_allclose(turn, np.eye(3), atol=1e-15)  # z up once more
    close(turned.landmarks, recording.landmarks)
    close(turned.vertices(2, 5), recording.vertices(2, 5))
    close(turned.posed_bones[..., 3], recording.posed_bones[..., 3])
    rest = recording.template.vertices
    np.testing.assert_allclose(turned.template.vertices, rest @ Z_UP.T, atol=1e-12)
    # the transforms take the turned rest pose to where the others take theirs
    points = np.c_[rest, np.ones(len(rest))] @ recording.bone_transforms[3, 5].T
    again = np.c_[turned.template.vertices, np.ones(len(rest))] @ turned.bone_transforms[3, 5].T
    np.testing.assert_allclose(again, points, atol=1e-12)


def test_a_part_has_its_own_frames(recording: Recording) -> None:
    part = recording.part(3, 9).part(1, 4)
    assert part.numbers.tolist() == [44, 45, 46] and part.frames == 3
    np.testing.assert_allclose(part.times, np.array([44, 45, 46]) / 30)
    close(np.concatenate(list(part.blocks(2))), recording.vertices(4, 7), 0)
    close(part.vertices(1, 99), recording.vertices(5, 7), 0)  # not beyond its end
    with pytest.raises(InputError, match="expected some of the 12"):
        recording.part(5, 13)


def test_normals_are_those_of_the_actor(recording: Recording) -> None:
    template = recording.template
    found = SeamlessNormals(template)(template.vertices)
    np.testing.assert_allclose(found, vertex_normals(template), atol=1e-12)


# --- formats --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
@pytest.mark.parametrize("up", ["y", "z"])
def test_bvh(unit: str, metres: float, up: str, recording: Recording, tmp_path: Path) -> None:
    turned = recording.facing_up(up)
    back = load_bvh(write("bvh", tmp_path, turned, unit=unit) / f"{NAME}.bvh", metres)
    names = unique_names(turned.template.bone_names, word)
    order = [back.names.index(name) for name in names]
    close(joint_positions(back)[:, order], turned.posed_bones[..., :3, 3])
    rest = turned.template.bone_rest[:, :3, 3]
    offsets = rest - rest[turned.template.bone_parents]
    close(back.offsets[order][1:], offsets[1:])
    assert back.frame_time == pytest.approx(1 / 30, abs=1e-9)


def test_glb_plays_the_same_motion(recording: Recording, tmp_path: Path) -> None:
    path = write("glb", tmp_path, recording.part(2, 9)) / f"{NAME}.glb"
    document = open_document(path)
    found = read_bone_transforms(document, read_template(document), 7)
    close(found, recording.bone_transforms[2:9])
    assert len(document.tree["meshes"][0]["primitives"][0]["targets"]) == 7
    plain = write("glb", tmp_path / "plain", recording, surface=False) / f"{NAME}.glb"
    assert "targets" not in open_document(plain).tree["meshes"][0]["primitives"][0]


def test_bones_in_centimetres_name_no_skeleton(tmp_path: Path) -> None:
    """Blender takes bind matrices to be relative to what holds a named one, without its scale."""
    skins = []
    for number, (kind, rig) in enumerate(RIGS.items()):
        rig.write(tmp_path / f"{number}.glb")
        skin = open_document(tmp_path / f"{number}.glb").tree["skins"][0]
        skins.append((kind, "skeleton" in skin))
    assert dict(skins)["Mixamo, centimetres, armature"] is False
    assert dict(skins)["Unreal, 150 bones"] is True


def test_surfaces_of_long_clips_come_in_pieces(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from perfcap.io.export import characters

    monkeypatch.setattr(gltf_morph, "MAX_TARGETS", 5)
    monkeypatch.setattr(characters, "MAX_TARGETS", 5)
    write("glb", tmp_path, recording)
    names = [f"{NAME}_surface_{span}.glb" for span in ("000040-000043", "000044-000047",
                                                       "000048-000051")]  # fmt: skip
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"{NAME}.glb", *names]
    assert (
        "targets" not in open_document(tmp_path / f"{NAME}.glb").tree["meshes"][0]["primitives"][0]
    )
    for number, name in enumerate(names):
        document = open_document(tmp_path / name)
        assert len(document.tree["meshes"][0]["primitives"][0]["targets"]) == 4
        found = read_bone_transforms(document, read_template(document), 4)
        close(found, recording.bone_transforms[4 * number : 4 * number + 4])


@pytest.mark.parametrize(("kind", "unit", "scale"), [("obj", "mm", 1e3), ("ply", "m", 1.0)])
def test_meshes_keep_order_seams_and_texture(
    kind: str, unit: str, scale: float, recording: Recording, tmp_path: Path
) -> None:
    folder = write(kind, tmp_path, recording.facing_up("z"), unit=unit) / f"{NAME}_{kind}"
    files = sorted(folder.glob(f"*.{kind}"))
    assert [file.name for file in files][::11] == [f"{NAME}_{n:06d}.{kind}" for n in (40, 51)]
    expected = recording.vertices(11, 12)[0] @ Z_UP.T
    mesh = read_mesh(files[-1])
    close(mesh.vertices / scale, expected, 2e-6)
    template = recording.template
    np.testing.assert_array_equal(mesh.faces, template.faces)
    assert (folder / "texture.png").read_bytes() == template.texture
    assert mesh.uv is not None and template.uv is not None and mesh.texture == template.texture
    np.testing.assert_allclose(mesh.uv, template.uv, atol=1e-6)


def test_ply_has_normals_and_coordinates_from_below(recording: Recording, tmp_path: Path) -> None:
    path = write("ply", tmp_path, recording) / f"{NAME}_ply" / f"{NAME}_000043.ply"
    head, _, body = path.read_bytes().partition(b"end_header\n")
    assert b"comment TextureFile texture.png\n" in head
    template, vertices = recording.template, recording.vertices(3, 4)[0]
    assert template.uv is not None
    rows = np.frombuffer(body, "<f4", 8 * len(vertices)).reshape(-1, 8)
    close(rows[:, :3], vertices, 0)
    np.testing.assert_allclose(rows[:, 3:6], SeamlessNormals(template)(vertices), atol=1e-6)
    np.testing.assert_allclose(rows[:, 6:], np.c_[template.uv[:, 0], 1 - template.uv[:, 1]],
                               atol=1e-6)  # fmt: skip


def read_trc(path: Path) -> tuple[list[str], list[str], np.ndarray]:
    """Fields, marker names, and rows of numbers."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = np.array([[float(x) for x in line.split("\t")] for line in lines[5:]])
    return lines[2].split("\t"), [n for n in lines[3].split("\t")[2:] if n], rows


def test_trc(recording: Recording, tmp_path: Path) -> None:
    fields, names, rows = read_trc(write("trc", tmp_path, recording, unit="mm") / f"{NAME}.trc")
    assert fields == ["30", "30", "12", "16", "mm", "30", "41", "12"] and names[0] == "head_top"
    assert rows[:, 0].tolist() == list(range(41, 53))  # counted from 1
    np.testing.assert_allclose(rows[:, 1], np.arange(40, 52) / 30, atol=1e-9)
    close(rows[:, 2:].reshape(12, 16, 3) / 1000, recording.landmarks, 1e-8)
    path = write("trc", tmp_path, recording, unit="m", markers="bones") / f"{NAME}.trc"
    _, names, rows = read_trc(path)
    assert "arm_(links)/Ellbogen" in names and len(names) == len(recording.template.bone_names)
    close(rows[:, 2:].reshape(12, -1, 3), recording.posed_bones[..., :3, 3], 1e-7)


def read_c3d(path: Path) -> tuple[np.ndarray, float, tuple[int, int]]:
    """Points (F, M, 3), rate and first and last frame, by the published layout of the header."""
    data = path.read_bytes()
    count, first, last, start = struct.unpack_from("<2xH2x2H6xH", data)
    (rate,) = struct.unpack_from("<f", data, 20)
    frames = last - first + 1
    values = np.frombuffer(data, "<f4", 4 * count * frames, 512 * (start - 1))
    return values.reshape(frames, count, 4)[..., :3], rate, (first, last)


def test_c3d(recording: Recording, tmp_path: Path) -> None:
    pytest.importorskip("ezc3d", reason="the extra mocap is not installed")
    path = write("c3d", tmp_path, recording.facing_up("z"), unit="mm") / f"{NAME}.c3d"
    places, rate, frames = read_c3d(path)
    assert rate == 30 and frames == (41, 52)  # the first frame of a C3D file is number 1
    close(places / 1000, recording.landmarks @ Z_UP.T, 1e-6)
    assert b"+Z" in path.read_bytes()[:4096]
    path = write("c3d", tmp_path, recording, unit="m", markers="bones") / f"{NAME}.c3d"
    close(read_c3d(path)[0], recording.posed_bones[..., :3, 3], 1e-6)


def test_c3d_says_when_frames_cannot_be_counted(recording: Recording, tmp_path: Path) -> None:
    late = replace(recording.result, frame_numbers=recording.result.frame_numbers + 65_490)
    with pytest.raises(InputError, match="frame 65541 is beyond the 65535"):
        write("c3d", tmp_path, replace(recording, result=late))


def test_a_c3d_file_that_a_full_disk_cut_is_noticed(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ezc3d = pytest.importorskip("ezc3d", reason="the extra mocap is not installed")

    def cut(self: object, path: str) -> None:
        written(self, path)
        Path(path).write_bytes(Path(path).read_bytes()[:2048])

    written = ezc3d.c3d.write
    monkeypatch.setattr(ezc3d.c3d, "write", cut)
    with pytest.raises(InputError, match="cannot be written"):
        write("c3d", tmp_path, recording)


def test_csv(recording: Recording, tmp_path: Path) -> None:
    folder = write("csv", tmp_path, recording.part(2, 7))
    joints = np.genfromtxt(folder / f"{NAME}_joints.csv", delimiter=",", names=True)
    assert joints["frame"].tolist() == [42, 43, 44, 45, 46]
    close(joints["l_wrist_y"], recording.landmarks[2:7, 7, 1], 1e-8)
    angles = np.genfromtxt(folder / f"{NAME}_angles.csv", delimiter=",", names=True)
    with np.load(recording.result.folder / "motion.npz", allow_pickle=False) as motion:
        knee = motion["angle_names"].tolist().index("l_knee_flexion")
        close(angles["l_knee_flexion_deg"], np.degrees(motion["angles"][2:7, knee]), 1e-6)
        close(angles["root_x"], motion["root_translation"][2:7, 0], 1e-8)
        of = np.degrees(motion["angles"][2:7, knee])
    lines = (folder / f"{NAME}_ranges.csv").read_text().splitlines()
    rows = {line.split(",")[0]: [float(v) for v in line.split(",")[1:]] for line in lines[1:]}
    assert lines[0].startswith("angle,lower_deg,upper_deg,least_deg,most_deg")
    assert len(rows) == len(lines) - 1
    close(np.array(rows["l_knee_flexion"][2:]), [of.min(), of.max(), of.mean(), np.ptp(of)], 1e-6)


@pytest.mark.parametrize("up", ["y", "z"])
def test_npz_poses_the_rest_pose(up: str, recording: Recording, tmp_path: Path) -> None:
    """Arrays belong together: root rotation and translation are those of the pelvis bone."""
    turned = replace(recording, upright=Rotation.random(rng=np.random.default_rng(1)).as_matrix())
    path = write("npz", tmp_path, turned.facing_up(up).part(1, 5), unit="cm") / f"{NAME}.npz"
    with np.load(path, allow_pickle=False) as data:
        assert data["unit"].item() == "cm"
        close(data["vertices"] / 100, turned.facing_up(up).vertices(1, 5))
        pelvis = data["bone_transforms"][:, 0]
        found = Rotation.from_rotvec(data["root_rotation"]).as_matrix()
        np.testing.assert_allclose(pelvis[:, :3, :3], found, atol=1e-6)
        place = pelvis @ data["bone_rest"][0, :, 3]
        close(place[:, :3], data["root_translation"], 1e-3)
        posed = (data["bone_transforms"] @ data["bone_rest"])[..., :3, 3]
        knee, bones = data["joint_names"].tolist().index("l_knee"), data["bone_names"].tolist()
        close(posed[:, bones.index("l_knee")], data["joints3d"][:, knee], 1e-3)
        assert data["frames"].tolist() == [41, 42, 43, 44]
        assert data["bone_names"].tolist() == list(recording.template.bone_names)


def test_results_without_angles_still_leave(recording: Recording, tmp_path: Path) -> None:
    """Folders of older versions."""
    with np.load(recording.result.folder / "motion.npz", allow_pickle=False) as data:
        arrays = {name: data[name] for name in ("joints3d", "frames", "fps")}
    np.savez(tmp_path / "motion.npz", **arrays)
    older = replace(recording, result=replace(recording.result, folder=tmp_path))
    write("csv", tmp_path / "out", older)
    write("npz", tmp_path / "out", older)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        f"{NAME}.npz",
        f"{NAME}_joints.csv",
    ]


@pytest.mark.parametrize("damage", ["missing", "another shape", "another type"])
def test_ranges_do_without_limits(recording: Recording, tmp_path: Path, damage: str) -> None:
    with np.load(recording.result.folder / "motion.npz", allow_pickle=False) as data:
        arrays = {name: data[name] for name in data.files}
    upper = arrays.pop("angle_upper")
    if damage != "missing":
        arrays["angle_upper"] = upper[:-1] if damage == "another shape" else upper.astype(np.int64)
    np.savez(tmp_path / "motion.npz", **arrays)
    damaged = replace(recording, result=replace(recording.result, folder=tmp_path))
    folder = write("csv", tmp_path / "out", damaged)
    rows = (folder / f"{NAME}_ranges.csv").read_text().splitlines()[1:]
    assert len(rows) == len(upper) and all(row.split(",")[2] == "nan" for row in rows)
    lower = [row.split(",")[1] == "nan" for row in rows]
    assert all(lower) if damage == "another type" else not any(lower)


def test_archives_hold_no_time_of_day(recording: Recording, tmp_path: Path) -> None:
    one, two = (write("npz", tmp_path / n, recording) / f"{NAME}.npz" for n in "ab")
    assert one.read_bytes() == two.read_bytes() and zipfile.is_zipfile(one)
