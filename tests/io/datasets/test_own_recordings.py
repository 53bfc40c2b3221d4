"""The rendered sequences and Pose2Sim recordings, made in the test and, where they are, real."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import FRAMES, Floats, assert_landmarks, cameras, person

from perfcap.detect.joint_set import LANDMARKS16, JointSet
from perfcap.errors import InputError
from perfcap.io.datasets import find_dataset
from perfcap.io.datasets.trc import read_trc

RENDERED, POSE2SIM = find_dataset("rendered"), find_dataset("pose2sim")
DATA = Path(__file__).parents[3] / ".." / "shared" / "data"
TRC_NAMES = ("RHip", "RKnee", "RAnkle", "RBigToe", "LHip", "Neck", "Head", "RShoulder", "LWrist")
TRC_SET = JointSet(
    "trc",
    (
        *("r_hip", "r_knee", "r_ankle", "r_big_toe", "l_hip", "neck", "head_top"),
        *("r_shoulder", "l_wrist"),
    ),
)


def surface_arrays() -> dict[str, np.ndarray]:
    """A template of four vertices of which the actor's file shows one twice."""
    return {
        "faces": np.array([[0, 1, 2], [0, 2, 3]]),
        "part": np.array([0, 1, 1, 0]),
        "part_names": np.array(["skin", "skirt"]),
        "glb_vertex_map": np.array([2, 0, 1, 3, 0]),
    }


def write_rendered(folder: Path) -> Floats:
    place = folder / "dev"
    (place / "masks").mkdir(parents=True)
    camera, points = cameras(1), person(LANDMARKS16)
    k = camera.intrinsics[0].clone()
    k[:2, 2] += 0.5
    entry = {
        "pixel_centre": 0.5,
        "K": [k.tolist()] * FRAMES,
        "R": [camera.rotation[0].tolist()] * FRAMES,
        "t": [camera.translation[0].tolist()] * FRAMES,
        "width": 600,
        "height": 600,
        "fps": 30,
    }
    (place / "camera.json").write_text(json.dumps(entry))
    pixels = camera.project(torch.from_numpy(points))[:, 0].numpy() + 0.5
    vertices = np.random.default_rng(0).normal(size=(FRAMES, 4, 3))
    np.savez(place / "gt.npz", joints3d=points, joints2d=pixels, vertices=vertices)
    np.savez(place / "template.npz", **surface_arrays())
    for frame in range(FRAMES):
        (place / "masks" / f"{frame:04d}.png").write_bytes(b"png")
    return vertices


def test_one_view(tmp_path: Path) -> None:
    vertices = write_rendered(tmp_path)
    assert RENDERED.sequences(tmp_path) == ("dev",)
    sequence = RENDERED.read(tmp_path, "dev")
    assert sequence.joints3d is not None and sequence.rig is not None
    assert_landmarks(sequence.joints3d, person(LANDMARKS16), LANDMARKS16)
    assert sequence.pixels is not None  # pixel centres at integers, as the cameras
    torch.testing.assert_close(sequence.pixels, sequence.rig.cameras.project(sequence.joints3d))
    assert sequence.rate == 30 and len(sequence.masks) == FRAMES and sequence.surface is not None
    surface = sequence.surface()
    np.testing.assert_array_equal(surface.vertices, vertices)
    assert surface.loose.tolist() == [False, True, True, False]
    glb = vertices[:, surface_arrays()["glb_vertex_map"]]
    np.testing.assert_array_equal(glb[:, surface.order], vertices)


def test_several_views(tmp_path: Path) -> None:
    place = tmp_path / "duo" / "person2"
    place.mkdir(parents=True)
    camera, points = cameras(3), person(LANDMARKS16)
    views = {
        f"cam{view}": {
            "K": camera.intrinsics[view].tolist(),
            "R": camera.rotation[view].tolist(),
            "t": camera.translation[view].tolist(),
        }
        for view in range(3)
    }
    values = {"width": 600, "height": 600, "fps": 25, "views": views}
    (tmp_path / "duo" / "cameras.json").write_text(json.dumps(values))
    pixels = camera.project(torch.from_numpy(points)).numpy()
    scale = 1 / 4096
    whole = np.random.default_rng(0).integers(-4000, 4000, (FRAMES, 3, 4))
    steps = np.diff(whole, axis=0, prepend=0)
    np.savez(
        place / "gt.npz",
        joints3d=points,
        joints2d=pixels,
        vertices_delta=steps.astype(np.int16),
        vertices_scale=scale,
    )
    np.savez(place / "template.npz", **surface_arrays())
    assert RENDERED.sequences(tmp_path) == ("duo/2",)
    sequence = RENDERED.read(tmp_path, "duo/2")
    assert sequence.rig is not None and sequence.rig.names == ("cam0", "cam1", "cam2")
    assert sequence.rate == 25 and sequence.pixels is not None and sequence.surface is not None
    torch.testing.assert_close(sequence.pixels, torch.from_numpy(pixels))
    np.testing.assert_allclose(sequence.surface().vertices, scale * whole.transpose(0, 2, 1))


def test_truth_that_cannot_be_used(tmp_path: Path) -> None:
    write_rendered(tmp_path)
    truth = tmp_path / "dev" / "gt.npz"
    np.savez(truth, joints3d=np.zeros((3, 15, 3)))
    with pytest.raises(InputError, match=r"joints3d: is float64 \(3, 15, 3\)"):
        RENDERED.read(tmp_path, "dev")
    np.savez(truth, joints3d=np.zeros((3, 16, 3)), joints2d=np.zeros((3, 16, 2)))
    with pytest.raises(InputError, match="has 5 masks for 3 frames"):
        RENDERED.read(tmp_path, "dev")
    write = surface_arrays() | {"glb_vertex_map": np.array([9])}
    np.savez(tmp_path / "dev" / "template.npz", **write)
    np.savez(
        truth,
        joints3d=np.zeros((5, 16, 3)),
        joints2d=np.zeros((5, 16, 2)),
        vertices=np.zeros((5, 4, 3)),
    )
    surface = RENDERED.read(tmp_path, "dev").surface
    assert surface is not None
    with pytest.raises(InputError, match="glb_vertex_map name vertices"):
        surface()


def test_truth_of_numbers_that_are_none(tmp_path: Path) -> None:
    write_rendered(tmp_path)
    truth = tmp_path / "dev" / "gt.npz"
    points, vertices = np.zeros((5, 16, 3)), np.zeros((5, 4, 3))
    points[1, 2], vertices[1, 2] = np.inf, np.nan
    np.savez(truth, joints3d=points, joints2d=points[..., :2], vertices=vertices)
    sequence = RENDERED.read(tmp_path, "dev")
    assert sequence.joints3d is not None and sequence.pixels is not None
    assert sequence.joints3d[1, 2].isnan().all() and sequence.pixels[1, 0, 2].isnan().all()
    assert sequence.surface is not None
    with pytest.raises(InputError, match="vertices are not all numbers"):
        sequence.surface()
    np.savez(truth, joints3d=points, joints2d=points[..., :2], vertices=0 * np.nan_to_num(vertices))
    one_name = surface_arrays() | {"part_names": np.array("skirt")}
    np.savez(tmp_path / "dev" / "template.npz", **one_name)
    surface = RENDERED.read(tmp_path, "dev").surface
    assert surface is not None
    with pytest.raises(InputError, match="part_names has no axis"):
        surface()


def write_trc(path: Path, points: Floats, unit: str = "m") -> None:
    """As Pose2Sim writes it: Y up."""
    names = "\t\t\t".join(TRC_NAMES)
    axes = "\t".join(f"{a}{i + 1}" for i in range(len(TRC_NAMES)) for a in "XYZ")
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate",
        f"60\t60\t{len(points)}\t{len(TRC_NAMES)}\t{unit}\t60",
        f"Frame#\tTime\t{names}\t\t",
        f"\t\t{axes}",
    ]
    for frame, row in enumerate(points):
        cells = ["" if np.isnan(x) else repr(float(x)) for x in row[:, [1, 2, 0]].ravel()]
        lines.append("\t".join([str(frame + 1), repr(frame / 60), *cells]))
    path.write_text("\n".join(lines) + "\n")


def write_pose2sim(folder: Path, unit: str = "m") -> Floats:
    place = folder / "trial"
    (place / "calibration").mkdir(parents=True)
    (place / "pose-3d").mkdir()
    (place / "calibration" / "Calib_demo.toml").write_text(
        '[cam1]\nname = "cam1"\nsize = [1088.0, 1920.0]\n'
        "matrix = [[1600.0, 0.0, 540.0], [0.0, 1600.0, 960.0], [0.0, 0.0, 1.0]]\n"
        "distortions = [0.0, 0.0, 0.0, 0.0]\nrotation = [0.1, 0.2, 0.3]\n"
        "translation = [0.0, 0.0, 4.0]\nfisheye = false\n[metadata]\nerror = 0.0\n"
    )
    points = person(TRC_SET)
    points[1, 3] = np.nan
    write_trc(place / "pose-3d" / "trial.trc", points, unit)
    return points


def test_pose2sim_turns_axes_to_the_calibration(tmp_path: Path) -> None:
    points = write_pose2sim(tmp_path)
    assert POSE2SIM.sequences(tmp_path) == ("trial",)
    sequence = POSE2SIM.read(tmp_path, "trial")
    assert sequence.joints3d is not None and sequence.rate == 60
    assert_landmarks(sequence.joints3d, points, TRC_SET)
    assert sequence.joints3d[1, 11].isnan().all()
    np.testing.assert_allclose(
        read_trc(tmp_path / "trial" / "pose-3d" / "trial.trc").points, points[..., [1, 2, 0]]
    )


@pytest.mark.parametrize(("lost", "said"), [(0, False), (1, True)])
def test_a_trc_that_lost_its_end(tmp_path: Path, lost: int, said: bool) -> None:
    points = write_pose2sim(tmp_path)
    path = tmp_path / "trial" / "pose-3d" / "trial.trc"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[: len(lines) - lost]))
    warnings = POSE2SIM.read(tmp_path, "trial").warnings
    line = f"trial.trc: says NumFrames {len(points)} and has {len(points) - 1}; is it whole?"
    assert (line in warnings) == said


def test_millimetres(tmp_path: Path) -> None:
    write_pose2sim(tmp_path, "mm")
    sequence = POSE2SIM.read(tmp_path, "trial")
    assert sequence.joints3d is not None and sequence.joints3d.nan_to_num().abs().max() < 1e-3


def test_rows_of_a_trc_are_the_frames_that_it_numbers(tmp_path: Path) -> None:
    write_pose2sim(tmp_path)
    path = tmp_path / "trial" / "pose-3d" / "trial.trc"
    whole = path.read_text()
    header, first, *rows = [whole.partition("\n1\t")[0], *whole.splitlines()[5:]]
    for start in (0, 1):  # of a whole video
        path.write_text(whole if start else re.sub(r"(?m)^([1-9])(?=\t)", minus_one, whole))
        assert POSE2SIM.read(tmp_path, "trial").frames.tolist() == list(range(FRAMES))
    path.write_text("\n".join((header, first, *rows[1:])))  # a row was lost
    assert POSE2SIM.read(tmp_path, "trial").frames.tolist() == [0, *range(2, FRAMES)]
    path.write_text("\n".join((header, *rows)))  # a part
    part = POSE2SIM.read(tmp_path, "trial")
    assert part.frames.tolist() == list(range(1, FRAMES))
    assert "numbered from 2" in part.warnings[1]
    path.write_text(whole)
    assert len(POSE2SIM.read(tmp_path, "trial").warnings) == 1
    path.rename(path.with_name("trial_30-60_filt_butterworth.trc"))
    assert "begins with frame 30" in POSE2SIM.read(tmp_path, "trial").warnings[1]


def minus_one(found: re.Match[str]) -> str:
    return str(int(found[1]) - 1)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("\tm\t60", "\tfeet\t60", "Units 'feet'"),
        ("60\t60\t5", "0\t60\t5", "DataRate 0"),
        ("\n3\t", "\nthree\t", "where a number should be"),
        ("\n3\t", "\n\t3\t", "has 30 cells"),
        ("PathFileType", "\n\n\n\n\n\n", "Units ''"),
        ("\n3\t", "\n2\t", "numbered 1, 2, 2, 4"),
        ("\n1\t", "\n-1\t", "numbered -1"),
        ("\n5\t", f"\n{2**70}\t", "4, ..., 1.18059e+21; expected whole numbers from 0 to"),
        ("\n\t\tX1", "\n1\t0", "frames begin in line 5"),
    ],
)
def test_trc_files_that_cannot_be_used(
    tmp_path: Path, before: str, after: str, message: str
) -> None:
    write_pose2sim(tmp_path)
    path = tmp_path / "trial" / "pose-3d" / "trial.trc"
    path.write_text(path.read_text().replace(before, after))
    with pytest.raises(InputError) as error:
        read_trc(path)
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.skipif(not (DATA / "rendered").is_dir(), reason="no recordings beside the checkout")
@pytest.mark.parametrize("name", ["rendered", "rendered_multi"])
def test_real_truth_projects_onto_itself(name: str) -> None:
    for sequence in (RENDERED.read(DATA / name, n) for n in RENDERED.sequences(DATA / name)):
        assert sequence.rig is not None and sequence.joints3d is not None
        apart = sequence.rig.cameras.project(sequence.joints3d) - sequence.pixels
        assert apart.abs().max() < 1e-3


@pytest.mark.skipif(not DATA.is_dir(), reason="no recordings beside the checkout")
def test_real_recordings_of_pose2sim() -> None:
    names = POSE2SIM.sequences(DATA)
    assert {name.partition("/")[0] for name in names} >= {"pose2sim_balancing"}
    sequence = POSE2SIM.read(DATA, "pose2sim_balancing")
    assert sequence.joints3d is not None and sequence.joints3d.shape == (60, 16, 3)
    assert sequence.rig is not None and sequence.rig.cameras.views == 4 and sequence.rate == 60
