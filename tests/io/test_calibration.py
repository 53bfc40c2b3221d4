"""Camera files of every kind, good and bad."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from calibration_files import (
    LENS,
    NAMES,
    K,
    entry,
    pose,
    write,
    write_colmap,
    write_easymocap,
    write_toml,
)

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import CameraRig, read_cameras

DATA = Path(__file__).parents[2] / "../shared/data"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data beside this tree")


def pixels_by_opencv(i: int, points: np.ndarray, lens: np.ndarray = LENS) -> np.ndarray:
    rotation, translation = pose(i)
    return cv2.projectPoints(points, rotation, translation, K, lens)[0].reshape(-1, 2)


POINTS = np.random.default_rng(0).uniform(-0.6, 0.6, (7, 3))


def check_views(rig: CameraRig, lens: np.ndarray = LENS, shift: float = 0.0) -> None:
    """The rig projects as OpenCV does with the numbers that were written."""
    assert rig.cameras.size == ((480, 640),) * len(rig.names)
    pixels = rig.cameras.project(torch.from_numpy(POINTS))
    for i in range(len(rig.names)):
        expected = torch.from_numpy(pixels_by_opencv(i, POINTS, lens)) + shift
        torch.testing.assert_close(pixels[i], expected, atol=1e-6, rtol=0)


# --- good files ---------------------------------------------------------------------------------


def test_camera_json(tmp_path: Path) -> None:
    rig = read_cameras(write(tmp_path / "camera.json", {**entry(), "fps": 25}))
    assert (rig.names, rig.fps, rig.pixel_offset) == (("camera",), 25.0, 0.0)
    check_views(rig)


@pytest.mark.parametrize("name", ["lens_distortion", "D", "k1"])
def test_lenses_that_would_be_overlooked(tmp_path: Path, name: str) -> None:
    data = entry()
    data[name] = data.pop("distortion")
    with pytest.raises(InputError, match=f"has '{name}', which is not read; call .* distortion"):
        read_cameras(write(tmp_path / "camera.json", data))


def test_names_that_are_misspelled(tmp_path: Path) -> None:
    """Half a pixel, or a size that is not compared with the video's, was left out."""
    for name, meant in (("pixel_center", "pixel_centre"), ("heigth", "height")):
        path = write(tmp_path / "camera.json", {**entry(), name: 1})
        with pytest.raises(InputError, match=f"has '{name}', which is not read; call it {meant}"):
            read_cameras(path)


@pytest.mark.parametrize("name", ["dist", "distCoeffs", "distortions"])
def test_lenses_under_other_names(tmp_path: Path, name: str) -> None:
    data = entry()
    data[name] = data.pop("distortion")
    check_views(read_cameras(write(tmp_path / "camera.json", {**data, "unit": "metres"})))


def test_a_toml_lens_in_the_singular(tmp_path: Path) -> None:
    path = write_toml(tmp_path)
    path.write_text(path.read_text().replace("distortions", "distortion"))
    check_views(read_cameras(path))


def test_corner_origin_shifts_pixels_and_asks_detections_to_follow(tmp_path: Path) -> None:
    rig = read_cameras(write(tmp_path / "camera.json", {**entry(), "pixel_centre": 0.5}))
    assert rig.pixel_offset == -0.5
    check_views(rig, shift=-0.5)


def test_several_views(tmp_path: Path) -> None:
    views = {name: entry(i) for i, name in enumerate(NAMES)}
    for view in views.values():
        del view["width"], view["height"]
    data = {"views": views, "width": 640, "height": 480}
    rig = read_cameras(write(tmp_path / "cameras.json", data))
    assert rig.names == NAMES
    check_views(rig)


def test_per_frame_poses_collapse_when_equal_and_stay_when_not(tmp_path: Path) -> None:
    frames = {**entry(), "K": [K.tolist()] * 4, "R": [entry()["R"]] * 4, "t": [entry()["t"]] * 4}
    still = read_cameras(write(tmp_path / "camera.json", {**frames, "frames": 4}))
    assert not still.cameras.moving
    frames["t"] = [[0, 0, 4 + 0.1 * f] for f in range(4)]
    moving = read_cameras(write(tmp_path / "camera.json", frames)).cameras
    assert moving.intrinsics.shape == (4, 1, 3, 3) and moving.distortion is not None
    assert moving.translation[3, 0].tolist() == [0, 0, 4.3]


def test_a_still_view_follows_a_moving_one(tmp_path: Path) -> None:
    moving = {**entry(1), "t": [[0, 0, 4], [0, 0, 5]]}
    rig = read_cameras(write(tmp_path / "cameras.json", {"views": {"a": entry(0), "b": moving}}))
    assert rig.cameras.translation.shape == (2, 2, 3)
    assert torch.equal(rig.cameras.translation[0, 0], rig.cameras.translation[1, 0])


def test_toml(tmp_path: Path) -> None:
    rig = read_cameras(write_toml(tmp_path))
    assert rig.names == ("int_cam01_img", "int_cam02_img")
    check_views(rig)


@pytest.mark.parametrize("rotation_vector", [False, True])
@pytest.mark.parametrize("file", ["", "intri.yml", "extri.yml"])
def test_easymocap(tmp_path: Path, file: str, rotation_vector: bool) -> None:
    rig = read_cameras(write_easymocap(tmp_path, rotation_vector=rotation_vector) / file)
    assert rig.names == NAMES
    check_views(rig)


def test_easymocap_that_contradicts_itself(tmp_path: Path) -> None:
    """The matrix was taken, whichever of both was edited; EasyMocap itself takes the vector."""
    read_cameras(write_easymocap(tmp_path, turn=0.0))
    with pytest.raises(InputError, match=r"Rot_.* and R_.* differ by up to 0\.05") as caught:
        read_cameras(write_easymocap(tmp_path, turn=3.0))
    assert "out of date" in str(caught.value)


def test_easymocap_without_sizes_takes_those_of_the_videos_and_says_so(tmp_path: Path) -> None:
    folder = write_easymocap(tmp_path, sizes=False)
    with pytest.raises(InputError, match="does not say the image size of cam01, cam02"):
        read_cameras(folder)
    with pytest.raises(InputError, match="does not say the image size"):
        read_cameras(folder, [(480, 640), (480, 640), (1, 1)])
    check_views(read_cameras(folder, [(480, 640)]))
    rig = read_cameras(folder, [(480, 640)] * 2)
    check_views(rig)
    assert "size of the video" in rig.warnings[0]


@pytest.mark.parametrize("file", ["", "images.txt"])
def test_colmap(tmp_path: Path, file: str) -> None:
    rig = read_cameras(write_colmap(tmp_path) / file)
    assert rig.names == NAMES and "no scale" in rig.warnings[0]
    check_views(rig, np.array([*LENS[:4], 0]), shift=-0.5)


@pytest.mark.parametrize(
    ("model", "lens"),
    [("PINHOLE", []), ("SIMPLE_PINHOLE", []), ("SIMPLE_RADIAL", [-0.1]), ("RADIAL", [-0.1, 0.05])],
)
def test_colmap_models(tmp_path: Path, model: str, lens: list[float]) -> None:
    camera = read_cameras(write_colmap(tmp_path, model)).cameras
    assert camera.intrinsics[0, 1, 1] == (910 if model == "PINHOLE" else 900)
    found = [0.0] * 5 if camera.distortion is None else camera.distortion[0].tolist()
    assert found == [*lens, *[0.0] * (5 - len(lens))]


def test_colmap_folders_are_views_and_a_shared_camera_moves(tmp_path: Path) -> None:
    write_colmap(tmp_path, names=("b/1", "a/2", "a/10", "b/3"))
    text = (tmp_path / "images.txt").read_text()
    for i, name in enumerate(("b/1", "a/2", "a/10", "b/3"), 1):
        text = text.replace(f" {i} {name}.png", f" {1 if name[0] == 'a' else 2} {name}.png")
    (tmp_path / "images.txt").write_text(text)
    rig = read_cameras(tmp_path)
    assert rig.names == ("a", "b") and rig.cameras.translation.shape == (2, 2, 3)
    np.testing.assert_allclose(rig.cameras.translation[:, 0], [pose(1)[1], pose(2)[1]])
    for i, name in enumerate(("b/1", "a/2", "a/10", "b/3")):
        text = text.replace(f"{1 if name[0] == 'a' else 2} {name}.png", f"1 frame{i}.png")
    (tmp_path / "images.txt").write_text(text)
    moving = read_cameras(tmp_path)
    assert moving.names == ("camera",) and moving.cameras.translation.shape == (4, 1, 3)


@needs_data
@pytest.mark.parametrize(
    ("file", "views", "size"),
    [
        ("pose2sim_balancing/calibration/Calib_scene.toml", 4, (1920, 1088)),
        ("pose2sim_balancing/calibration/Calib_qualisys.toml", 4, (1920, 1088)),
        ("sports2d_demo/Calib_demo.toml", 1, (994, 1768)),
        ("rendered/dev_skirt/camera.json", 1, (640, 640)),
        ("rendered_multi/dev_views/cameras.json", 6, (480, 480)),
    ],
)
def test_real_files(file: str, views: int, size: tuple[int, int]) -> None:
    camera = read_cameras(DATA / file).cameras
    assert isinstance(camera, Camera)
    assert camera.size == (size,) * views and not camera.moving


# --- bad files ----------------------------------------------------------------------------------


def mirrored(i: int = 0) -> list[list[float]]:
    return (np.diag([1.0, 1, -1]) @ pose(i)[0]).tolist()


BAD_ENTRIES: dict[str, tuple[dict[str, Any], str]] = {
    "no K": ({"K": None}, "has no K"),
    "ragged": ({"K": [[1, 2], [3]]}, "not a regular array"),
    "words": ({"t": ["a", "b", "c"]}, "not a regular array"),
    "shape": ({"R": [1, 2, 3]}, r"expected \(3, 3\)"),
    "empty": ({"R": []}, "has shape"),
    "nan": ({"t": [0, 0, float("nan")]}, "NaN or infinity"),
    "scaled": ({"R": (pose(0)[0] * 1.1).tolist()}, "not orthonormal"),
    "mirrored": ({"R": mirrored()}, "mirrors space"),
    "focal": ({"K": [[-900, 0, 320], [0, 900, 240], [0, 0, 1]]}, "focal length -900"),
    "transposed": ({"K": K.T.tolist()}, "transposed"),
    "lens": ({"distortion": [0.1] * 8}, "8 coefficients"),
    "two lenses": ({"dist": [0.1] * 5}, "has distortion and dist"),
    "unit": ({"units": "mm"}, "units is 'mm'; expected t in metres"),
    "scale": ({"scale": 0.001}, "scale is 0.001"),
    "lens nan": ({"distortion": [float("inf")] * 5}, "distortion holds NaN"),
    "no size": ({"width": None}, "image size of camera"),
    "size": ({"width": 0}, "image size 0x480"),
    "listed size": ({"width": [640, 480], "height": [480, 640]}, "image size has 4 numbers"),
    "frames": ({"R": [pose(0)[0].tolist()] * 3, "t": [[0, 0, 4]] * 2}, "1, 3, 2 frames"),
    "count": ({"t": [[0, 0, 4], [0, 0, 5]], "frames": 3}, "says frames = 3"),
    "centre": ({"pixel_centre": 1}, "pixel_centre is 1"),
    "fps": ({"fps": -1}, "fps is -1"),
    "views": ({"views": [1]}, "expected an object by name"),
    "view": ({"views": {"a": 3}}, "view a: is a int"),
    "none": ({"views": {}}, "holds no cameras"),
}


@pytest.mark.parametrize("case", BAD_ENTRIES)
def test_bad_camera_json(tmp_path: Path, case: str) -> None:
    change, words = BAD_ENTRIES[case]
    with pytest.raises(InputError, match=words) as caught:
        read_cameras(write(tmp_path / "camera.json", {**entry(), **change}))
    assert "camera.json" in str(caught.value) and "\n" not in str(caught.value)


def test_moving_views_of_unequal_length(tmp_path: Path) -> None:
    views = {
        "a": {**entry(), "t": [[0, 0, 4], [0, 0, 5]]},
        "b": {**entry(), "t": [[0, 0, 4], [0, 0, 5], [0, 0, 6]]},
    }
    with pytest.raises(InputError, match="2 and 3 frames"):
        read_cameras(write(tmp_path / "cameras.json", {"views": views}))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("camera.json", b"", "is empty"),
        ("camera.json", b'{"K": [1,', "not valid JSON"),
        ("camera.json", b"[1, 2]", "holds a list"),
        ("camera.json", b"\xff\xfe\x00", "not UTF-8"),
        ("camera.json", b"[" * 100_000, "nested too deep"),
        ("Calib.toml", b"[a\n", "is not TOML"),
        ("Calib.toml", b"[metadata]\nerror = 1\n", "holds no cameras"),
        ("Calib.toml", b"[a]\nsize = 3\n", r"expected \[width, height\]"),
        ("camera.txt", b"hello", "not a camera file I know"),
        ("intri.yml", b"%YAML:1.0\nnames: [a\n", "not OpenCV YAML"),
        ("intri.yml", b"!!python/object/apply:os.getcwd []\n", "not OpenCV YAML"),
        ("intri.yml", b"K_a: !!opencv-matrix\n  rows: 3\n  cols: 3\n  data: [1, 2]\n", "2 numbers"),
        ("intri.yml", b"just text", "holds no entries"),
        ("intri.yml", b"a: &a [1, 1]\nb: [*a, *a]\n", "no aliases"),
        ("cameras.txt", b"1 FISHEYE 640 480 1 2 3\n", "camera model FISHEYE"),
        ("cameras.txt", b"1 PINHOLE 640 480 1 2 3\n", "expected 6 finite numbers"),
        ("cameras.txt", b"1 PINHOLE 640 480 1 2 3 x\n", "could not convert"),
        ("images.txt", b"1 1 0 0 0\n", "5 fields"),
        ("images.txt", b"1 0 0 0 0 0 0 0 1 a.png\n\n", "quaternion is zero"),
        ("images.txt", b"1 1 0 0 0 0 0 0 9 a.png\n\n", "camera 9 is not in"),
    ],
)
def test_broken_files(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    if name.endswith(".yml"):
        write_easymocap(tmp_path)
    elif name.endswith("s.txt"):
        write_colmap(tmp_path)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        read_cameras(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_fisheye_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fisheye = true"):
        read_cameras(write_toml(tmp_path, "fisheye = true"))


@pytest.mark.parametrize("name", ["nothing.json", "", "sub"])
def test_missing_and_unknown_paths(tmp_path: Path, name: str) -> None:
    (tmp_path / "sub").mkdir()
    with pytest.raises(InputError, match=r"expected camera\.json"):
        read_cameras(tmp_path / name)


def test_half_an_easymocap_pair(tmp_path: Path) -> None:
    (write_easymocap(tmp_path) / "extri.yml").unlink()
    with pytest.raises(InputError, match=r"extri.yml: no such file"):
        read_cameras(tmp_path)


# --- views by name ------------------------------------------------------------------------------


def test_match_selects_by_name_or_keeps_the_order(tmp_path: Path) -> None:
    rig = read_cameras(write_toml(tmp_path))
    swapped = rig.match(["cam02", "cam01"])
    assert swapped.names == rig.names[::-1]
    assert torch.equal(swapped.cameras.translation, rig.cameras.translation.flip(0))
    assert rig.match(["cam02"]).names == ("int_cam02_img",)
    assert rig.match(["left", "right"]) is rig
    for names in (["left"], ["cam01", "right"], ["cam01", "cam01"]):
        with pytest.raises(InputError, match="do not match the videos"):
            rig.match(names)
