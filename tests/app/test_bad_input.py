"""Every mistake is one line that names it and exit code 2; no traceback, no half result."""

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mistakes import Case, Mistake, register, require_one_line
from runs import Command
from takes import (
    TakeFiles,
    camera_entry,
    marked_template,
    write_actor,
    write_detections,
    write_json,
    write_video,
)

CASES: dict[str, Case] = {}
case = register(CASES)


def put(path: Path, data: bytes = b"") -> Path:
    path.write_bytes(data)
    return path


# --- the video ------------------------------------------------------------------------------------


@case("a.mp4: is empty")
def an_empty_video(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"video": put(at / "a.mp4")}


@case("a.mp4: is not a video")
def a_video_without_its_head(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"video": put(at / "a.mp4", take.video.read_bytes()[200:])}


@case("no such file")
def no_video(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"video": at / "a.mp4"}


@case("holds no images")
def a_folder_without_images(take: TakeFiles, at: Path) -> dict[str, Any]:
    (at / "images").mkdir()
    return {"video": at / "images"}


@case("160x120")
def a_calibration_of_another_size(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_video(at / "a.mp4", 24, (60, 80))
    return {"video": at / "a.mp4"}


# --- detections -----------------------------------------------------------------------------------


@case("a.json: is empty")
def a_json_of_zero_bytes(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"detections": put(at / "a.json")}


@case("a.json: is not valid JSON")
def a_json_cut_short(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"detections": put(at / "a.json", b'[{"image_id": "0.jpg", ')}


@case("expected detections.npz")
def detections_of_an_unknown_kind(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"detections": put(at / "a.xyz", b"x")}


@case("a.pkl: is a pickle")
def detections_that_could_run_code(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"detections": put(at / "a.pkl", b"x")}


@case("a.npz: is not a readable npz")
def an_npz_of_noise(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"detections": put(at / "a.npz", bytes(range(256)) * 9)}


@case("a.npz: is not a readable npz")
def an_npz_cut_short(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"detections": put(at / "a.npz", take.detections.read_bytes()[:-300])}


@case("a.npz: is not a readable npz")
def an_npz_with_flipped_bytes(take: TakeFiles, at: Path) -> dict[str, Any]:
    data = bytearray(take.detections.read_bytes())
    data[400:1200] = bytes(800)
    return {"detections": put(at / "a.npz", bytes(data))}


@case("a.npz: is not a readable npz")
def an_npz_of_objects(take: TakeFiles, at: Path) -> dict[str, Any]:
    np.savez(at / "a.npz", joints2d=np.array([{"a": 1}], dtype=object), confidence2d=np.ones(1))
    return {"detections": at / "a.npz"}


@case("20 joints and no joint_names")
def more_joints_than_named(take: TakeFiles, at: Path) -> dict[str, Any]:
    np.savez(at / "a.npz", joints2d=np.ones((24, 20, 2)), confidence2d=np.ones((24, 20)))
    return {"detections": at / "a.npz"}


@case("12 joints and no joint_names")
def fewer_joints_than_named(take: TakeFiles, at: Path) -> dict[str, Any]:
    np.savez(at / "a.npz", joints2d=np.ones((24, 12, 2)), confidence2d=np.ones((24, 12)))
    return {"detections": at / "a.npz"}


@case("confidence2d has shape (24, 12)")
def arrays_that_do_not_fit(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_detections(at / "a.npz", take.take.detections, confidence2d=np.ones((24, 12)))
    return {"detections": at / "a.npz"}


@case("numbers of frames differ")
def detections_of_a_shorter_video(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_detections(at / "a.npz", take.take.detections.frames(slice(0, 10)))
    return {"detections": at / "a.npz"}


@case("numbers of frames differ")
def detections_that_end_before_the_part(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_detections(at / "a.npz", take.take.detections.frames(slice(0, 10)))
    return {"detections": at / "a.npz", "frames": "2:24"}


@case("numbers of frames differ")
def detections_that_end_before_the_part_starts(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_detections(at / "a.npz", take.take.detections.frames(slice(0, 10)))
    return {"detections": at / "a.npz", "frames": "10:12"}


@case("nobody is detected in any frame")
def nobody_anywhere(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_detections(at / "a.npz", take.take.detections, confidence2d=np.zeros((24, 16)))
    return {"detections": at / "a.npz"}


@case("in no frame")
def nobody_in_the_part(take: TakeFiles, at: Path) -> dict[str, Any]:
    confidence = np.zeros((24, 16))
    confidence[20:] = 1
    write_detections(at / "a.npz", take.take.detections, confidence2d=confidence)
    return {"detections": at / "a.npz", "frames": "0:10"}


@case("nobody is detected in any frame")
def nothing_but_nan(take: TakeFiles, at: Path) -> dict[str, Any]:
    write_detections(at / "a.npz", take.take.detections, joints2d=np.full((24, 16, 2), np.nan))
    return {"detections": at / "a.npz"}


@case("looks like metres")
def a_3d_pose_in_metres(take: TakeFiles, at: Path) -> dict[str, Any]:
    poses = take.take.detections.joints3d
    assert poses is not None
    write_detections(at / "a.npz", take.take.detections, joints3d_mm=poses[:, 0].numpy())
    return {"detections": at / "a.npz"}


# --- cameras --------------------------------------------------------------------------------------


def camera(take: TakeFiles, at: Path, **changes: Any) -> dict[str, Any]:
    write_json(at / "c.json", camera_entry(take.take.cameras) | changes)
    return {"cameras": at / "c.json"}


@case("R mirrors space")
def a_mirrored_camera(take: TakeFiles, at: Path) -> dict[str, Any]:
    mirrored = np.diag([-1.0, 1, 1]) @ take.take.cameras.rotation[0].numpy()
    return camera(take, at, R=mirrored.tolist())


@case("R is not orthonormal")
def a_camera_with_scale(take: TakeFiles, at: Path) -> dict[str, Any]:
    return camera(take, at, R=(1.1 * take.take.cameras.rotation[0]).tolist())


@case("NaN")
def a_camera_with_nan(take: TakeFiles, at: Path) -> dict[str, Any]:
    return camera(take, at, t=[0, float("nan"), 5])


@case("has no K")
def a_camera_without_intrinsics(take: TakeFiles, at: Path) -> dict[str, Any]:
    return camera(take, at, K=None)


@case("c.json: is empty")
def a_camera_file_of_zero_bytes(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"cameras": put(at / "c.json")}


@case("not a camera file I know")
def a_camera_file_of_an_unknown_kind(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"cameras": put(at / "c.xml", b"<a/>")}


@case("has 10 frames")
def a_moving_camera_that_ends_early(take: TakeFiles, at: Path) -> dict[str, Any]:
    shifts = np.tile(take.take.cameras.translation[0].numpy(), (10, 1))
    shifts[:, 0] += np.arange(10)
    return camera(take, at, t=shifts.tolist())


@case("hold 1 views, the cameras are 2")
def two_videos_for_one_detections_file(take: TakeFiles, at: Path) -> dict[str, Any]:
    entry = camera_entry(take.take.cameras)
    write_json(at / "c.json", {"views": {"a": entry, "b": entry}})
    for name in "ab":
        write_video(at / f"{name}.mp4", 24, (120, 160))
    return {"video": at / "a.mp4", "more": [at / "b.mp4"], "cameras": at / "c.json"}


# --- the actor ------------------------------------------------------------------------------------


def chunked(tree: dict[str, Any]) -> bytes:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    size = 20 + len(text)
    return struct.pack("<4sII", b"glTF", 2, size) + struct.pack("<I4s", len(text), b"JSON") + text


@case("a.glb: has no skinned mesh")
def an_actor_without_a_skin(take: TakeFiles, at: Path) -> dict[str, Any]:
    tree = {"asset": {"version": "2.0"}, "nodes": [{"name": "a"}], "scenes": [{"nodes": [0]}]}
    return {"actor": put(at / "a.glb", chunked(tree))}


@case("no bone found for pelvis")
def an_actor_whose_joints_nobody_can_tell(take: TakeFiles, at: Path) -> dict[str, Any]:
    marked = marked_template()
    names = tuple(f"Bone.{i:03d}" for i in range(len(marked.bone_names)))
    rest = marked.bone_rest.copy()
    rest[:, :3, 3] = rest[::-1, :3, 3]
    write_actor(at / "a.glb", replace(marked, bone_names=names, bone_rest=rest))
    return {"actor": at / "a.glb"}


@case("metres_per_unit")
def an_actor_as_tall_as_a_house(take: TakeFiles, at: Path) -> dict[str, Any]:
    marked = marked_template()
    rest = marked.bone_rest.copy()
    rest[:, :3, 3] *= 17
    write_actor(at / "a.glb", replace(marked, vertices=17 * marked.vertices, bone_rest=rest))
    return {"actor": at / "a.glb"}


@case("a.glb")
def an_actor_cut_short(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"actor": put(at / "a.glb", take.actor.read_bytes()[:-500])}


@case("a.glb")
def an_actor_with_damaged_json(take: TakeFiles, at: Path) -> dict[str, Any]:
    data = bytearray(take.actor.read_bytes())
    data[24:60] = b"}" * 36
    return {"actor": put(at / "a.glb", bytes(data))}


@case("a.glb: is empty")
def an_actor_of_zero_bytes(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"actor": put(at / "a.glb")}


@case("no shipped actor has that name; expected a skinned .glb")
def an_unknown_actor(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"actor": "nobody"}


@case("no such file")
def a_folder_without_an_actor(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"actor": at}


# --- options --------------------------------------------------------------------------------------


def frames(text: str) -> Mistake:
    return lambda take, at: {"frames": text}


for _text in ("5", "a:b", "1:2:3", "-3:5", "²:5", "5:5", "8:2", "24:", "90:99", ":0", "1.5:3", " "):
    CASES[f"frames {_text!r}"] = (frames(_text), "--frames")


@case("--device nonsense")
def an_unknown_device(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"device": "nonsense"}


@case("--device meta")
def a_device_that_cannot_compute(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"device": "meta"}


@case("--out")
def a_file_in_place_of_the_folder(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"out": put(at / "result", b"x")}


@case("--out")
def a_folder_inside_a_file(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"out": put(at / "result", b"x") / "deeper"}


@case("m.json: has no 'video_px_to_native_px'")
def a_video_map_of_another_kind(take: TakeFiles, at: Path) -> dict[str, Any]:
    return {"video-map": put(at / "m.json", b"{}")}


@pytest.mark.parametrize("name", CASES)
def test_one_line_and_code_2(take: TakeFiles, tmp_path: Path, perfcap: Command, name: str) -> None:
    require_one_line(CASES[name], take, tmp_path, perfcap)
