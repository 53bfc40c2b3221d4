"""``perfcap capture`` from files to files, with every option."""

import os
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import torch
import yaml
from runs import Command
from takes import (
    TakeFiles,
    camera_entry,
    detect,
    make_take,
    shrunk,
    write_detections,
    write_json,
    write_take,
    write_video,
)
from written_files import FILES, motion, report

from perfcap.app.capture_request import settings_of
from perfcap.commands.capture import Capture
from perfcap.io.bvh_read import joint_positions, load_bvh
from perfcap.io.gltf_read import load_template

CONTRACT = {
    "capture": ((), "U"),
    "joints3d": ((24, 16, 3), "f"),
    "joint_names": ((16,), "U"),
    "root_translation": ((24, 3), "f"),
    "root_rotation": ((24, 3), "f"),
    "contact": ((24, 2), "f"),
    "trust": ((24,), "f"),
    "angles": ((24, 27), "f"),
    "angle_names": ((27,), "U"),
    "angle_lower": ((27,), "f"),
    "angle_upper": ((27,), "f"),
    "frames": ((24,), "i"),
    "fps": ((), "f"),
}


# --- the files ------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_folder_holds_these_files_and_no_others(captured: Path) -> None:
    assert sorted(os.listdir(captured)) == FILES


def test_motion_npz_is_what_was_agreed(captured: Path, take: TakeFiles) -> None:
    arrays = motion(captured)
    assert {n: (a.shape, a.dtype.kind) for n, a in arrays.items()} == CONTRACT
    assert arrays["frames"].tolist() == list(range(24)) and arrays["fps"] == 30
    assert tuple(arrays["joint_names"][:3]) == ("head_top", "neck", "r_shoulder")
    assert all(np.isfinite(a).all() for a in arrays.values() if a.dtype.kind == "f")
    angles, lower, upper = (arrays[f"angle{s}"] for s in ("s", "_lower", "_upper"))
    assert ((angles >= lower) & (angles <= upper)).all()
    error = take.take.error_mm(torch.tensor(arrays["joints3d"]))
    assert error.mean() < 20


def test_the_same_command_writes_the_same_motion(
    captured: Path, take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    assert perfcap(take.command(tmp_path, "--no-overlay")).code == 0
    first, second = motion(captured), motion(tmp_path)
    assert all(np.array_equal(first[name], second[name]) for name in first)


def test_bvh_moves_the_same_joints(captured: Path) -> None:
    bvh = load_bvh(captured / "motion.bvh")
    joints, names = motion(captured)["joints3d"], motion(captured)["joint_names"].tolist()
    places = joint_positions(bvh)
    assert len(places) == 24 and bvh.frame_time == pytest.approx(1 / 30)
    for name in ("neck", "r_wrist", "l_ankle", "l_toe"):
        found = places[:, bvh.names.index(name)]
        assert np.abs(found - joints[:, names.index(name)]).max() < 1e-4


def test_glb_is_the_actor_again(captured: Path, take: TakeFiles) -> None:
    written, original = (load_template(p) for p in (captured / "capture.glb", take.actor))
    assert written.bone_names == original.bone_names
    np.testing.assert_allclose(written.vertices, original.vertices, atol=1e-5)
    np.testing.assert_allclose(written.bone_rest, original.bone_rest, atol=1e-5)


def test_run_json_and_config_yaml_tell_the_run(captured: Path, take: TakeFiles) -> None:
    run = report(captured)
    assert run["complete"] is True and run["not_captured"] == [] and run["warnings"] == []
    assert run["frames"] == 24 and run["fps"] == 30
    assert set(run["stages"]) == {"initialize", "track_motion"}  # type: ignore[call-overload]
    (window,) = run["windows"]  # type: ignore[misc]
    assert window["frames"] == [0, 24] and window["status"] == "converged"
    assert set(window["terms"]) == {"joints2d", "joints3d", "trajectory", "prior"}
    assert {"perfcap", "python", "packages", "peak_memory_mib", "wall_s", "request"} <= set(run)
    config = yaml.safe_load((captured / "config.yaml").read_text())
    assert config["pose"]["window"] == 50 and config["pose"]["reprojection"]["weight"] == 1.0


def test_overlay_shows_every_frame(captured: Path) -> None:
    with av.open(str(captured / "overlay.mp4")) as container:
        frames = [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]
    assert len(frames) == 24 and frames[0].shape == (120, 160, 3)
    assert np.ptp(frames[0]) > 60  # something is drawn on plain grey


# --- options --------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_part_keeps_the_numbers_of_the_video(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    assert perfcap(take.command(tmp_path, "--frames", "6:15")).code == 0
    arrays = motion(tmp_path)
    assert arrays["frames"].tolist() == list(range(6, 15))
    truth = take.take.actor.joints(take.take.truth)[6:15].numpy()
    assert np.linalg.norm(arrays["joints3d"] - truth, axis=-1).mean() < 0.02
    with av.open(str(tmp_path / "overlay.mp4")) as container:
        assert sum(1 for _ in container.decode(video=0)) == 9
    assert report(tmp_path)["windows"][0]["frames"] == [6, 15]  # type: ignore[index]


@pytest.mark.long
@pytest.mark.parametrize("frames", ["0:1", "23:", ":2"])
def test_very_short_parts(take: TakeFiles, tmp_path: Path, perfcap: Command, frames: str) -> None:
    assert perfcap(take.command(tmp_path, "--frames", frames)).code == 0
    assert np.isfinite(motion(tmp_path)["joints3d"]).all()


def test_until_initialize(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    assert perfcap(take.command(tmp_path, "--until", "initialize", "--no-overlay")).code == 0
    run = report(tmp_path)
    assert run["windows"] == [] and list(run["stages"]) == ["initialize"]  # type: ignore[call-overload]
    assert sorted(os.listdir(tmp_path)) == [f for f in FILES if f != "overlay.mp4"]


@pytest.mark.long
def test_the_published_preset(take: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    assert perfcap(take.command(tmp_path, "--preset", "monoperfcap", "--no-overlay")).code == 0
    pose = yaml.safe_load((tmp_path / "config.yaml").read_text())["pose"]
    assert pose["trajectory"]["rank"] == 8 and pose["reprojection"]["scale"] is None


@pytest.mark.parametrize("preset", ["liu2013", "rhodin2016"])
def test_presets_of_images_need_them(
    preset: str, take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    call = take.command(tmp_path, "--preset", preset, "--until", "track_motion")
    assert "--until track_motion looks at none" in perfcap(call).refused()


def test_the_preset_of_contours(take: TakeFiles) -> None:
    settings = settings_of(Capture(videos=(take.video,), preset="rhodin2016"))
    assert settings.contours.enabled and not settings.segment


@pytest.mark.long
def test_resume_does_nothing_only_where_all_is_done(
    take: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = take.command(
        tmp_path,
        *("--no-overlay", "--resume", "--overwrite", "--frames", "0:3", "--until", "initialize"),
    )
    worked: list[int] = []
    from perfcap.app import capture as module

    genuine = module.capture
    monkeypatch.setattr(module, "capture", lambda *a, **k: (worked.append(1), genuine(*a, **k))[1])

    def works() -> bool:
        worked.clear()
        assert perfcap(call).code == 0
        return bool(worked)

    assert works()
    assert not works()
    (tmp_path / "motion.bvh").unlink()
    assert works()  # a file is gone
    call[call.index("--no-overlay")] = "--overlay"
    assert works()  # another request
    assert not works()
    os.utime(take.camera, (0, 0))
    assert works()  # the camera file is another one
    assert not works()
    (tmp_path / "run.json").write_text('{"request": ')
    assert works()
    (tmp_path / "run.json").write_text("[]")
    assert works()


@pytest.mark.long
def test_a_video_in_other_pixels_than_its_calibration(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    """A half-size video with its map: detections in either pixels give the same motion."""
    write_video(tmp_path / "video.mp4", 24, (60, 80))
    half = [[2.0, 0.0, 0.5], [0.0, 2.0, 0.5]]
    write_json(tmp_path / "map.json", {"video_px_to_native_px": {"video": half, "camera": half}})
    options = ("--video-map", str(tmp_path / "map.json"))
    call = take.command(tmp_path / "a", *options, video=tmp_path / "video.mp4")
    assert perfcap(call).code == 0
    detections = take.take.detections
    small = replace(detections, joints2d=(detections.joints2d - 0.5) / 2)
    write_detections(tmp_path / "small.npz", small)
    call = take.command(
        tmp_path / "b",
        *options,
        *("--detections-in", "video"),
        video=tmp_path / "video.mp4",
        detections=tmp_path / "small.npz",
    )
    assert perfcap(call).code == 0
    a, b = (motion(tmp_path / name)["joints3d"] for name in "ab")
    np.testing.assert_allclose(a, b, atol=1e-6)
    with av.open(str(tmp_path / "a/overlay.mp4")) as container:
        assert next(container.decode(video=0)).to_ndarray(format="rgb24").shape == (60, 80, 3)


@pytest.mark.long
def test_images_run_at_the_rate_of_the_camera_file(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    (tmp_path / "images").mkdir()
    for i in range(24):
        cv2.imwrite(str(tmp_path / f"images/{i:03d}.png"), np.full((120, 160, 3), 80, np.uint8))
    write_json(tmp_path / "camera.json", camera_entry(take.take.cameras) | {"fps": 25})
    call = take.command(
        tmp_path / "out", video=tmp_path / "images", cameras=tmp_path / "camera.json"
    )
    assert perfcap(call).code == 0
    assert motion(tmp_path / "out")["fps"] == 25


@pytest.mark.long
def test_a_camera_that_moves(tmp_path: Path, perfcap: Command) -> None:
    files = write_take(tmp_path, 20, moving=True)
    assert perfcap(files.command(tmp_path / "out", "--frames", "5:")).code == 0
    truth = files.take.actor.joints(files.take.truth)[5:].numpy()
    found = motion(tmp_path / "out")["joints3d"]
    assert np.linalg.norm(found - truth, axis=-1).mean() < 0.02


@pytest.mark.long
def test_two_views_of_another_person(tmp_path: Path, perfcap: Command) -> None:
    """Everything by name, views given in another order than the camera file's; bones solved."""
    files = write_take(tmp_path, 20, lifted=False)
    tall = files.take.actor.resized(torch.full((9,), 0.1, dtype=torch.float64))
    take = make_take(20, views=3, lifted=False, actor=tall)
    cameras = shrunk(take.cameras, (120, 160))
    seen = detect(tall, cameras, take.truth, lifted=False)
    names = ["left", "right", "back"]
    views = {name: camera_entry(cameras, i) for i, name in enumerate(names)}
    write_json(tmp_path / "cameras.json", {"views": views})
    for i, name in enumerate(names):
        write_detections(tmp_path / f"{name}.npz", seen.select([i]))
        write_video(tmp_path / f"{name}.mp4", 20, (120, 160))
    order = ["back", "left", "right"]
    call = [
        *("capture", *(tmp_path / f"{n}.mp4" for n in order), "--actor", files.actor),
        *("--cameras", tmp_path / "cameras.json", "--bones", "solve", "--out", tmp_path / "out"),
        *("--until", "track_motion"),
        *("--detections", *(tmp_path / f"{n}.npz" for n in names)),
    ]
    assert perfcap(call).code == 0
    assert take.error_mm(torch.tensor(motion(tmp_path / "out")["joints3d"])).mean() < 5
    scales = report(tmp_path / "out")["bone_scales"]
    assert np.allclose(list(scales.values()), np.exp(0.1), rtol=0.01)  # type: ignore[attr-defined]
    with av.open(str(tmp_path / "out/overlay.mp4")) as container:
        assert next(container.decode(video=0)).width == 480
