"""``.osim`` and ``.mot``: read back by plain kinematics of their own, written here."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import robots
from runs import Command
from scipy.spatial.transform import Rotation

from perfcap.actor.anatomy import JOINTS
from perfcap.app.export import run_export
from perfcap.commands.results import Export
from perfcap.io.datasets.trc import read_trc
from perfcap.io.export.opensim import _steady
from perfcap.io.moving_rig import read_moving_rig
from perfcap.io.result import read_result

TO_OPENSIM = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # x ahead, y up, z right


def read_mot(path: Path) -> tuple[list[str], np.ndarray]:
    """Columns and rows, after checking what the header says of them."""
    head, _, rest = path.read_text().partition("endheader\n")
    assert "inDegrees=yes" in head and "version=1" in head
    names, *rows = [line.split("\t") for line in rest.splitlines()]
    assert f"nRows={len(rows)}" in head and f"nColumns={len(names)}" in head
    return names, np.array(rows, dtype=float)


def numbers(element: ElementTree.Element, path: str) -> np.ndarray:
    return np.array([float(word) for word in element.findtext(path).split()])


def posed(model: ElementTree.Element, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Body-to-ground transforms (4, 4), from the file's joints alone."""
    world = {"/ground": np.eye(4)}
    for joint in next(model.iter("JointSet")).find("objects"):
        parent, child = joint.find("frames")
        pose = world[parent.findtext("socket_parent")].copy()
        pose[:3, 3] += pose[:3, :3] @ numbers(parent, "translation")
        assert not numbers(child, "translation").any()
        moved, turn = np.zeros(3), np.eye(3)
        for axis in joint.iter("TransformAxis"):
            value = values[name] if (name := axis.findtext("coordinates")) else 0.0
            along = numbers(axis, "axis")
            if axis.get("name").startswith("translation"):
                moved += value * along
            else:
                step = np.radians(value) * along / np.linalg.norm(along)
                turn = turn @ Rotation.from_rotvec(step).as_matrix()
        pose[:3, 3] += pose[:3, :3] @ moved
        pose[:3, :3] = pose[:3, :3] @ turn
        world[child.findtext("socket_parent")] = pose
    return world


@pytest.fixture(scope="module")
def pair(
    captured: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[ElementTree.Element, list[str], np.ndarray, Path]:
    out = tmp_path_factory.mktemp("osim")
    assert run_export(Export(captured, ("osim", "trc"), out, "a")) == 0
    return ElementTree.parse(out / "a.osim").getroot(), *read_mot(out / "a.mot"), out / "a.trc"


def test_the_pair_puts_joints_where_the_capture_has_them(captured: Path, pair) -> None:
    model, names, rows, _ = pair
    result = read_result(captured)
    assert len(rows) == result.frames
    assert np.allclose(rows[:, 0], result.frame_numbers / result.rate)
    rig = read_moving_rig(captured)
    # the export turns the capture's world upright: both are compared as seen from the pelvis
    kinds = {"spine": "torso", "shoulder": "humerus", "elbow": "ulna", "wrist": "hand",
             "hip": "femur", "knee": "tibia", "ankle": "foot"}  # fmt: skip
    bodies, first = [], np.zeros((16, 3, 3))
    for joint in JOINTS:
        kind, side = (joint[2:], "_" + joint[0]) if joint[1] == "_" else (joint, "")
        bodies.append("/bodyset/" + kinds.get(kind, kind) + side)
    for frame, row in enumerate(rows):
        world = posed(model, dict(zip(names, row, strict=True)))
        found = np.array([world[body][:3, 3] for body in bodies])
        turns = np.array([world[body][:3, :3] for body in bodies])
        expected = rig.position[frame] @ TO_OPENSIM.T
        apart = np.linalg.norm(found[:, None] - found, axis=-1)
        assert np.allclose(apart, np.linalg.norm(expected[:, None] - expected, axis=-1), atol=1e-4)
        # turns since the first frame, as angles between joints
        if frame:
            mine = first.mT @ turns
            theirs = rig.rotation[0].mT @ rig.rotation[frame]
            angles = [Rotation.from_matrix(each).magnitude() for each in (mine, theirs)]
            assert np.degrees(np.abs(angles[0] - angles[1])).max() < 0.01
        else:
            first = turns


def test_markers_are_the_landmarks(captured: Path, pair) -> None:
    """In the world of the markers that other formats hold: they are opened together."""
    model, names, rows, trc = pair
    landmarks = read_trc(trc)
    markers = list(next(model.iter("MarkerSet")).find("objects"))
    for frame in (0, len(rows) - 1):
        world = posed(model, dict(zip(names, rows[frame], strict=True)))
        found = np.array([
            (world[m.findtext("socket_parent_frame")] @ [*numbers(m, "location"), 1.0])[:3]
            for m in markers
        ])  # fmt: skip
        expected = [landmarks.points[frame, landmarks.names.index(m.get("name"))] for m in markers]
        assert len(markers) == 16 and np.allclose(found, expected, atol=1e-4)


def test_names_and_signs_are_anatomical(pair) -> None:
    """A positive value moves as its name says, on both sides."""
    model, names, *_ = pair
    zero = dict.fromkeys(names, 0.0)
    rest = posed(model, zero)

    def moved(body: str, **values: float) -> np.ndarray:
        change = posed(model, zero | values)[f"/bodyset/{body}"]
        return change[:3, 3] - rest[f"/bodyset/{body}"][:3, 3]

    for side, out in (("r", 1.0), ("l", -1.0)):  # z is right
        assert moved(f"foot_{side}", **{f"hip_flexion_{side}": 30})[0] > 0.2
        assert moved(f"foot_{side}", **{f"hip_adduction_{side}": 20})[2] * out < -0.1
        assert moved(f"foot_{side}", **{f"knee_angle_{side}": 60})[0] < -0.2
        assert moved(f"hand_{side}", **{f"arm_flex_{side}": 30})[0] > 0.1
        assert moved(f"hand_{side}", **{f"arm_add_{side}": -60})[2] * out > 0.1
        assert moved(f"hand_{side}", **{f"elbow_flex_{side}": 60})[0] > 0.05
        turned = posed(model, zero | {f"hip_rotation_{side}": 30})[f"/bodyset/foot_{side}"]
        assert turned[2, 0] * out < -0.4  # toes point inwards
        lifted = posed(model, zero | {f"ankle_angle_{side}": 20})[f"/bodyset/foot_{side}"]
        assert lifted[1, 0] > 0.3  # toes up
    assert moved("head", lumbar_extension=20)[0] < -0.1
    assert moved("pelvis", pelvis_ty=1)[1] == pytest.approx(1)


def test_somersaults_turn_steadily() -> None:
    """Seen from the side they lean through a quarter turn about x, where angles are not unique."""
    turns = Rotation.from_euler("ZXY", [[0.1, lean, 1.5] for lean in np.linspace(0, 6, 61)])
    found = _steady(turns.as_euler("ZXY").T)
    assert np.allclose(
        Rotation.from_euler("ZXY", found.T).as_matrix(), turns.as_matrix(), atol=1e-9
    )
    assert np.abs(np.diff(np.unwrap(found), axis=1)).max() < 0.11


def test_no_model_of_a_robot(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    robot, out = robots.write(tmp_path)["urdf"], tmp_path / "out"
    assert perfcap(["retarget", captured, "--actor", robot, "--out", out]).code == 0
    assert "is a robot's" in perfcap(["export", out, "--to", "osim"]).refused()
