"""Whole files of every kind, made by the helpers of the tests, and their readers."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import calibration_files
import cv2
import detection_files
import network_bodies
import numpy as np
import project_files
import robots
import trimesh
from fuzzing import mutate
from fuzzing.arrays import arrays
from fuzzing.mutate import Random
from fuzzing.networks import networks
from fuzzing.recordings import data_sets
from fuzzing.stored import stored
from fuzzing.targets import Target, command
from takes import TakeFiles, detect, make_take, shrunk, write_take
from tiny_networks import write_tiny

from perfcap.io.actor import load_actor
from perfcap.io.body_model import load_body_model
from perfcap.io.bvh_read import BvhMotion, load_bvh
from perfcap.io.calibration import read_cameras, read_pixel_map
from perfcap.io.clip_list import read_clip_list
from perfcap.io.datasets.monoperfcap import read_off
from perfcap.io.datasets.safe_pickle import read_pickle
from perfcap.io.datasets.trc import read_trc
from perfcap.io.detections import read_detections
from perfcap.io.image_file import read_silhouette
from perfcap.io.mesh import read_mesh
from perfcap.io.moving_rig import read_moving_rig
from perfcap.io.project import open_project
from perfcap.io.result import Result, read_result
from perfcap.io.robot import load_robot

SIZES = ((480, 640), (480, 640))


def targets(root: Path) -> list[Target]:
    """Everything that reads, with files below ``root``."""
    take = write_take(_new(root, "take"), 4, size=(48, 64))
    out = root / "result"
    command(take.command(out, "--no-overlay", "--until", "initialize"))
    # all that a capture uses is compiled here, or it counts as a case's time
    command(take.command(root / "whole", "--no-overlay", "--until", "refine_surface"))
    return [
        *_cameras(root),
        *_detections(root),
        *_projects(root),
        *_shapes(root, take),
        *networks(root),
        Target("result", out, lambda f, _: _whole(read_result(f))),
        *_commands(root, take, out),
        *stored(root, root / "whole"),
        *arrays(root),
        *data_sets(root),
    ]


def _new(root: Path, name: str) -> Path:
    (root / name).mkdir(parents=True)
    return root / name


def _cameras(root: Path) -> list[Target]:
    places = [_new(root, f"cameras_{kind}") for kind in ("json", "toml", "easymocap", "colmap")]
    calibration_files.write(places[0] / "camera.json", calibration_files.entry())
    calibration_files.write_toml(places[1])
    calibration_files.write_easymocap(places[2])
    calibration_files.write_colmap(places[3])
    maps = _new(root, "pixel_map")
    calibration_files.write(maps / "map.json", _MAPS)

    def read(folder: Path, _: Random) -> Any:
        inside = [path for path in folder.iterdir() if path.suffix in (".json", ".toml")]
        return read_cameras(inside[0] if inside else folder, SIZES).cameras

    found = [Target(place.name, place, read) for place in places]
    return [*found, Target("pixel_map", maps, lambda f, _: read_pixel_map(f / "map.json"))]


def _detections(root: Path) -> list[Target]:
    arrays, folder = _new(root, "detections_npz"), root / "detections_openpose"
    detection_files.write_npz(arrays / "a.npz", joints3d_mm=detection_files.pose3d_mm())
    people = np.random.default_rng(0).random((6, 1, 25, 3)) * 200
    detection_files.write_openpose(folder / "a", [[p for p in row] for row in people])
    smpl, bodies = _new(root, "detections_smpl"), _new(root, "detections_bodies")
    np.savez(smpl / "a.npz", **network_bodies.smpl_arrays())
    points = network_bodies.sam_arrays()
    detection_files.write_json(bodies / "a.json", {k: v.tolist() for k, v in points.items()})
    coco = _new(root, "detections_coco")
    entries = [
        {"image_id": f"{i}.jpg", "keypoints": (people[i, 0, :17] + 1).reshape(-1).tolist()}
        | {"category_id": 1, "score": 1.0}
        for i in range(6)
    ]
    detection_files.write_json(coco / "a.json", entries)

    landmarks, plain = _new(root, "detections_landmarks"), _new(root, "detections_npy")
    points = [[{"x": x, "y": y, "visibility": c} for x, y, c in row[0, :17].tolist()]
              for row in people]  # fmt: skip
    detection_files.write_json(landmarks / "a.json", [{"pose_landmarks": [p]} for p in points])
    np.save(plain / "a.npy", people[:, :, :17] * (1, 1, 0.005))  # with confidences below 1
    sapiens = root / "detections_sapiens" / "a"
    sapiens.mkdir(parents=True)
    for number, row in enumerate(people[:, 0, :17]):
        one = {"keypoints": row[:, :2].tolist(), "keypoint_scores": row[:, 2].tolist()}
        detection_files.write_json(sapiens / f"{number}.json", {"instance_info": [one]})

    def read(folder: Path, _: Random) -> Any:
        (path,) = folder.iterdir()
        return read_detections(path, sizes=SIZES[:1])[0]

    places = (arrays, folder, smpl, bodies, coco, landmarks, plain, sapiens.parent)
    return [Target(place.name, place, read) for place in places]


def _projects(root: Path) -> list[Target]:
    take = make_take(4, views=2)
    take = replace(take, cameras=shrunk(take.cameras, project_files.SIZE))
    take = replace(take, detections=detect(take.actor, take.cameras, take.truth, False))
    places = {"project_pose2sim": project_files.write_pose2sim,
              "project_freemocap": project_files.write_freemocap}  # fmt: skip

    def read(folder: Path, _: Random) -> Any:
        found = open_project(folder)
        if found is None:
            return None
        rig = read_cameras(found.cameras, [project_files.SIZE] * len(found.videos))
        joints = read_detections(list(found.detections), views=rig.names)[0]
        return rig.cameras, joints

    return [Target(name, write(root / name, take), read) for name, write in places.items()]


def _shapes(root: Path, take: TakeFiles) -> list[Target]:
    actor, meshes, bvh = (_new(root, name) for name in ("actor", "meshes", "bvh"))
    (actor / "actor.glb").write_bytes(take.actor.read_bytes())
    (actor / "manifest.toml").write_text('licence = "CC0-1.0"\n')
    body, off, trc = (_new(root, name) for name in ("body", "off", "trc"))
    source = Path(__file__).parents[2] / "models" / "bodies" / "ada" / "body.npz"
    (body / "body.npz").write_bytes(source.read_bytes())
    (off / "a.off").write_text("OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n4 0 1 2 3\n")
    (trc / "a.trc").write_text(_TRC)
    (meshes / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 1\nf 1/1 2/2 3/1\nf -1 -2 -3 -4\n"
    )
    (meshes / "b.obj").write_text(
        "mtllib b.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 0 0 1 1 1 1\nvt 0 0\nvt 1 1\n"
        "usemtl a\nf 1/1 2/2 3/1\nusemtl b\nf 2 3 4\n"
    )
    (meshes / "b.mtl").write_text(
        "newmtl a\nKd 1 0.5 0\nmap_Kd -s 1 1 1 -o 0 0 0 b.png\nnewmtl b\nKd 0.2 0.2 0.2\nd 1.0\n"
    )
    cv2.imwrite(str(meshes / "b.png"), np.full((4, 4, 3), 90, np.uint8))
    plys, stls, gltf = (_new(root, name) for name in ("ply", "stl", "gltf"))
    box = trimesh.creation.box()
    box.visual.vertex_colors = np.full((8, 4), 200, np.uint8)
    (plys / "text.ply").write_bytes(box.export(file_type="ply", encoding="ascii"))
    (plys / "binary.ply").write_bytes(box.export(file_type="ply"))
    (plys / "image.ply").write_text(_PLY)
    cv2.imwrite(str(plys / "a.png"), np.full((4, 4, 3), 90, np.uint8))
    (stls / "binary.stl").write_bytes(box.export(file_type="stl"))
    (stls / "text.stl").write_text(box.export(file_type="stl_ascii"))
    _write_gltf(gltf / "a.gltf")
    (bvh / "a.bvh").write_bytes((root / "result" / "motion.bvh").read_bytes())
    clips = _new(root, "clip_list")
    (clips / "a.csv").write_text("name,videos,actor\nwalk,a.mp4;b.mp4,sam\n,c.mp4,\n")
    moving = _new(root, "moving")
    (moving / "a.glb").write_bytes((root / "result" / "capture.glb").read_bytes())
    humanoids = [_new(root, kind) for kind in ("robot_urdf", "robot_mjcf")]
    for folder, (name, content) in zip(
        humanoids, (("a.urdf", robots.urdf()), ("a.xml", robots.mjcf())), strict=True
    ):
        (folder / name).write_text(content)
    masks, pickles = _new(root, "masks"), _new(root, "pickles")
    picture = np.zeros((40, 30), np.uint8)
    picture[10:30, 5:20] = 1
    cv2.imwrite(str(masks / "a.png"), picture)
    (pickles / "a.pkl").write_bytes(_PICKLE)
    return [
        Target("actor", actor, lambda f, _: load_actor(str(f)).template),
        Target("body", body, lambda f, _: load_body_model(f / "body.npz"), weight=0.3),
        Target("obj", meshes, _meshes),
        Target("ply", plys, _meshes),
        Target("stl", stls, _meshes),
        Target("gltf", gltf, _meshes),
        Target("off", off, lambda f, _: read_off(f / "a.off")),
        Target("trc", trc, lambda f, _: read_trc(f / "a.trc").rate),
        Target("bvh", bvh, lambda f, _: _played(load_bvh(f / "a.bvh"))),
        Target("moving", moving, lambda f, _: _joints(f / "a.glb")),
        Target("moving_bvh", bvh, lambda f, _: _joints(f / "a.bvh")),
        Target("clip_list", clips, lambda f, _: _listed(f / "a.csv")),
        *(Target(each.name, each, _robot) for each in humanoids),
        Target("masks", masks, lambda f, _: read_silhouette(f / "a.png")),
        Target("pickles", pickles, lambda f, _: (read_pickle(f / "a.pkl", "a test"), None)[1]),
    ]


def _robot(folder: Path, _: Random) -> Any:
    (path,) = folder.iterdir()
    return load_robot(path).template


def _meshes(folder: Path, _: Random) -> Any:
    beside = (".bin", ".mtl", ".png")
    return [read_mesh(path) for path in sorted(folder.iterdir()) if path.suffix not in beside]


def _write_gltf(path: Path) -> None:
    """A box of separate files: a tree, and the numbers beside it."""
    exported = trimesh.creation.box().export(file_type="gltf")
    for name, data in exported.items():
        (path if name.endswith(".gltf") else path.with_name(name)).write_bytes(data)


def _results(folder: str, take: TakeFiles) -> list[list[str]]:
    """Calls that show a result."""
    small = ["--size", "32", "24", "--frames", "0:2"]
    return [
        ["render", folder, "--out", "OUT.mp4", *small],
        ["render", folder, "--out", "OUT.mp4", "--camera", str(take.camera), *small],
        ["report", folder, "--frames", "0:2", "--truth", str(take.truth)],
    ]


def _commands(root: Path, take: TakeFiles, out: Path) -> list[Target]:
    place = root / "commands"
    shutil.copytree(out, place)
    write_tiny(place, "vitpose")
    plain = take.command(Path("OUT"), "--until", "initialize", "--no-overlay", "--overwrite")
    calls = [
        plain,
        [
            *("doctor", str(take.video), "--cameras", str(take.camera)),
            *("--detections", str(take.detections)),
        ],
        ["evaluate", "RESULT", "--truth", str(take.truth)],
        ["export", "RESULT", "--to", "bvh", "trc", "csv", "--frames", "0:2"],
        [*("export", "RESULT", "--to", "npz", "glb", "--up", "z", "--unit", "mm")],
        ["evaluate", "RESULT", "--dataset", "rendered", "--truth", "RESULT", "--sequence", "x"],
        ["actor", "inspect", str(take.actor)],
        ["actor", "build", str(take.actor), "--out", "OUT", "--height", "1.7"],
        *_results("RESULT", take),
        ["retarget", "RESULT", "--actor", str(take.actor), "--out", "OUT", "--frames", "0:2"],
        ["retarget", "RESULT/motion.bvh", "--actor", "sam", "--out", "OUT", "--frames", "0:2"],
        ["models", "list", "RESULT"],
        ["models", "manifest", "RESULT/vitpose/model.onnx"],
        ["train", "lifter", "--motion", "RESULT", "--out", "OUT", "--loop.steps", "1"],
    ]
    words = ("", "-", "--", "0:", "3:1", "a:b", "nan", "1e300", "here", "[/x]", "é\x1b", "RESULT")
    words += (
        "--resume",
        "--overwrite",
        "--until",
        "--frames",
        "\0",
        "x" * 300,
        "-1",
        "sam",
        "meta",
    )

    def run(folder: Path, rng: Random) -> None:
        call = [each.replace("RESULT", str(folder)) for each in rng.choice(calls)]
        for _ in range(rng.choice((1, 1, 2, 3))):
            at = rng.randrange(len(call))
            kind = rng.randrange(4)
            if kind == 0:
                del call[at]
            elif kind == 1:
                call.insert(at, rng.choice(words))
            elif kind == 2:
                call[at] = rng.choice(words)
            else:
                call[at] = mutate.text(rng, call[at])
        os.chdir(folder)  # names that are left of a call land here
        command([each.replace("OUT", str(folder / "new")) for each in call or [""]])

    def show(folder: Path, rng: Random) -> None:
        os.chdir(folder)
        names = (".", str(folder.with_name("shown")))
        call = rng.choice([call for call in calls if "RESULT" in call])
        command([each.replace("RESULT", names[0]).replace("OUT", names[1]) for each in call])

    return [
        Target("commands", place, run, mutates_files=False, weight=0.5),
        Target("shown", out, show, weight=0.5),
    ]


def _played(motion: BvhMotion) -> Any:
    return replace(motion, ends=np.nan_to_num(motion.ends))  # NaN where a bone has no end


def _listed(path: Path) -> Any:
    return read_clip_list(path, ("videos", "actor", "height"), ("videos",), ("actor",))


def _joints(path: Path) -> Any:
    found = read_moving_rig(path)
    return found.rotation, found.position, found.rate


def _whole(result: Result) -> Any:
    return result.joints, result.vertices(slice(0, 2)), result.rate


_MAPS = {"video_px_to_native_px": {"cam01": [[1, 0, 0], [0, 1, 0]]}}
_TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\t"
    "OrigNumFrames\n30\t30\t2\t2\tm\t30\t1\t2\n"
    "Frame#\tTime\tNeck\t\t\tHip\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
    "1\t0\t0\t1\t0\t0\t0.5\t0\n2\t0.033\t0\t1\t0\t0\t0.5\t0.1\n"
)
_PLY = (
    "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 4\nproperty float x\n"
    "property float y\nproperty float z\nproperty float s\nproperty float t\nelement face 2\n"
    "property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0 0 1 1 0 1\n"
)
# {'a': [1, 2.5, 'x'], 'b': (None, True)} as a pickle of protocol 2
_PICKLE = (
    b"\x80\x02}q\x00(X\x01\x00\x00\x00aq\x01]q\x02(K\x01G@\x04\x00\x00\x00\x00\x00\x00X\x01\x00\x00"
    b"\x00xq\x03eX\x01\x00\x00\x00bq\x04N\x88\x86q\x05u."
)
