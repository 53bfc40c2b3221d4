"""Lenses and image sizes of cameras under the names that programs give them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from calibration_files import LENS, entry, write, write_easymocap, write_toml

from perfcap.errors import InputError
from perfcap.io.calibration import read_cameras

HERE = {"width": 640, "height": 480}


def lens(path: Path) -> np.ndarray:
    distortion = read_cameras(path).cameras.distortion
    assert distortion is not None
    return distortion[-1].numpy()


@pytest.mark.parametrize("name", ["dist", "distCoeffs", "dist_coeffs", "distortion_coefficients"])
def test_lenses_of_toml(tmp_path: Path, name: str) -> None:
    path = write_toml(tmp_path)
    path.write_text(path.read_text().replace("distortions", name))
    np.testing.assert_allclose(lens(path), LENS)


@pytest.mark.parametrize("name", ["D", "distorsions", "RadialDistortion"])
def test_lenses_of_toml_that_would_be_overlooked(tmp_path: Path, name: str) -> None:
    path = write_toml(tmp_path)
    path.write_text(path.read_text().replace("distortions", name))
    with pytest.raises(InputError, match=rf"has '{name}', which is not read; call .* distortion"):
        read_cameras(path)


@pytest.mark.parametrize("name", ["D", "distortion"])
@pytest.mark.parametrize("file", ["intri.yml", "extri.yml"])
def test_lenses_of_easymocap(tmp_path: Path, name: str, file: str) -> None:
    """EasyMocap itself looks for D where it finds no dist."""
    inner = write_easymocap(tmp_path) / "intri.yml"
    text = inner.read_text().replace("dist_", f"{name}_")
    inner.write_text(text)
    if file == "extri.yml":
        start = [text.index(f"{name}_cam0{i}") for i in (1, 2)]
        ends = [text.index("H_", place) for place in start]
        blocks = [text[a:b] for a, b in zip(start, ends, strict=True)]
        inner.write_text(text.replace(blocks[0], "").replace(blocks[1], ""))
        outer = tmp_path / file
        outer.write_text(outer.read_text() + "".join(blocks))
    np.testing.assert_allclose(lens(tmp_path), LENS)


def test_dist_of_easymocap_goes_before_d(tmp_path: Path) -> None:
    inner = write_easymocap(tmp_path) / "intri.yml"
    text = inner.read_text()
    block = text[text.index("dist_cam01") : text.index("H_cam01")]
    inner.write_text(text + block.replace("dist_", "D_").replace("data: [ -0.1", "data: [ -0.7"))
    np.testing.assert_allclose(lens(tmp_path), LENS)


@pytest.mark.parametrize("name", ["distCoef", "dist_coeff"])
def test_lenses_of_json(tmp_path: Path, name: str) -> None:
    data = entry()
    data[name] = data.pop("distortion")
    np.testing.assert_allclose(lens(write(tmp_path / "camera.json", data)), LENS)


@pytest.mark.parametrize(
    "said", [{"fisheye": True}, {"camera_model": "OPENCV_FISHEYE"}, {"model": "equidistant"}]
)
def test_fisheyes_are_refused(tmp_path: Path, said: dict[str, Any]) -> None:
    """Their four coefficients were taken for k1, k2, p1, p2."""
    written = {"distortion": LENS[:4].tolist(), **said}
    path = write(tmp_path / "camera.json", {**entry(), **written})
    with pytest.raises(InputError, match="expected a pinhole camera"):
        read_cameras(path)
    views = {"views": {"a": entry(), "b": entry(1)}}
    with pytest.raises(InputError, match=r"view a: .* expected a pinhole camera"):
        read_cameras(write(path, {**views, **said}))
    key, value = next(iter(said.items()))
    with pytest.raises(InputError, match="expected a pinhole camera"):
        read_cameras(write_toml(tmp_path, f"{key} = {json.dumps(value)}"))


@pytest.mark.parametrize(
    "said",
    [
        {"fisheye": False},
        {"camera_model": "OPENCV"},
        {"distortion_model": "plumb_bob"},
        {"undistorted": False},
    ],
)
def test_pinholes_are_taken(tmp_path: Path, said: dict[str, Any]) -> None:
    np.testing.assert_allclose(lens(write(tmp_path / "camera.json", {**entry(), **said})), LENS)
    key, value = next(iter(said.items()))
    np.testing.assert_allclose(lens(write_toml(tmp_path, f"{key} = {json.dumps(value)}")), LENS)


@pytest.mark.parametrize(
    "said",
    [
        {"resolution": [640, 480]},
        {"image_size": [640, 480]},
        {"imageWidth": 640, "imageHeight": 480},
    ],
)
def test_sizes_are_read(tmp_path: Path, said: dict[str, Any]) -> None:
    """Videos of another size were said to have that of the calibration."""
    data = {key: value for key, value in entry().items() if key not in HERE}
    path = write(tmp_path / "camera.json", {**data, **said})
    toml = write_toml(tmp_path)
    lines = "\n".join(f"{key} = {value}" for key, value in said.items())
    toml.write_text(toml.read_text().replace("size = [640.0, 480.0]", lines))
    for each in (path, toml):
        rig = read_cameras(each, [(240, 320)])
        assert set(rig.cameras.size) == {(480, 640)}
        assert not rig.warnings


def test_sizes_are_height_and_width_where_both_are_there(tmp_path: Path) -> None:
    path = write(tmp_path / "camera.json", {**entry(), "resolution": [4, 2], "size": 3.5})
    assert read_cameras(path).cameras.size == ((480, 640),)


def test_capitals(tmp_path: Path) -> None:
    """Sizes are read in any; half a pixel is not left out."""
    data = {key: value for key, value in entry().items() if key not in HERE}
    path = write(tmp_path / "camera.json", {**data, "Width": 640, "Height": 480})
    assert read_cameras(path, [(240, 320)]).cameras.size == ((480, 640),)
    with pytest.raises(InputError, match="call it pixel_centre"):
        read_cameras(write(path, {**entry(), "Pixel_Centre": 0.5}))
