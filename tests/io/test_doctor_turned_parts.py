"""Left and right, or near and far, that are exchanged in a part of a clip."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from doctored_views import FRAMES, NAMES, detections, one, person, rig
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io import models_folder
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.detections import read_detections
from perfcap.io.doctor import Severity, examine_detections
from perfcap.io.doctor.sides import bearings, examine_sides

DATA = Path(__file__).parents[3] / "shared" / "data" / "rendered"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data beside this tree")
MIRROR = list(LANDMARKS16.mirrored())
Change = Callable[[Detections, slice], Detections]


def one_view() -> tuple[CameraRig, Detections]:
    """The first of the views, with 3D poses."""
    camera = CameraRig(NAMES[:1], rig().cameras.select([0]))
    places = camera.cameras.to_camera(person())
    pose = places - 0.5 * (places[..., 8:9, :] + places[..., 12:13, :])
    pose = pose + 0.02 * torch.randn(pose.shape, generator=torch.Generator().manual_seed(1))
    seen = detections().select([0])
    return camera, Detections.from_joints(seen.joints2d, seen.confidence2d, pose)


def recorded(folder: Path) -> tuple[CameraRig, Detections]:
    camera = read_cameras(folder / "camera.json")
    return camera, read_detections([folder / "detections.npz"], views=camera.names)[0]


def exchanged(seen: Detections, there: slice, *, poses: bool = True) -> Detections:
    assert seen.joints3d is not None
    joints, confidence, pose = (
        x.clone() for x in (seen.joints2d, seen.confidence2d, seen.joints3d)
    )
    for values in (joints, confidence, *([pose] if poses else [])):
        values[there] = values[there][:, :, MIRROR]
    return replace(seen, joints2d=joints, confidence2d=confidence, joints3d=pose)


def negated(seen: Detections, there: slice) -> Detections:
    assert seen.joints3d is not None
    pose = seen.joints3d.clone()
    pose[there, ..., 2] *= -1
    return replace(seen, joints3d=pose)


@pytest.mark.parametrize("there", [slice(12, FRAMES), slice(0, 10), slice(8, 18)])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (exchanged, "left and right look exchanged in 2D and 3D in frames"),
        (negated, "the depth of 3D poses looks negated"),
    ],
)
def test_poses_that_are_mirror_images_for_a_while(change: Change, words: str, there: slice) -> None:
    camera, seen = one_view()
    assert examine_detections(camera, seen) == []
    finding = one(examine_detections(camera, change(seen, there)))
    assert finding.severity is Severity.WARNING and words in finding.what
    assert finding.frames == tuple(range(FRAMES))[there] and finding.views == (0,)


@pytest.mark.long
@needs_data
@pytest.mark.parametrize(
    ("name", "start", "stop"),
    [
        ("dev_tight", 30, 100), ("dev_tight", 30, 50), ("dev_tight", 50, 70),
        ("dev_skirt", 30, 50), ("dev_skirt", 50, 100),
    ],
)  # fmt: skip
@pytest.mark.parametrize("change", [exchanged, negated])
def test_the_same_of_noisy_poses(change: Change, name: str, start: int, stop: int) -> None:
    camera, seen = recorded(DATA / name)
    assert examine_detections(camera, seen) == []
    finding = one(examine_detections(camera, change(seen, slice(start, stop))))
    assert len(set(finding.frames) ^ set(range(start, stop))) <= 4 and finding.views == (0,)


def _limbs(first: int, second: int) -> Change:
    """Of joints from the first up to the second."""

    def change(seen: Detections, there: slice) -> Detections:
        order = list(range(16))
        for joint in range(first, second):
            order[joint], order[MIRROR[joint]] = MIRROR[joint], joint
        joints, pose = seen.joints2d.clone(), torch.as_tensor(seen.joints3d).clone()
        for values in (joints, pose):
            values[there] = values[there][:, :, order]
        return replace(seen, joints2d=joints, joints3d=pose)

    return change


@pytest.mark.parametrize(("limbs", "first", "second"), [("arms", 2, 5), ("legs", 8, 12)])
def test_limbs_of_one_view_that_are_exchanged_for_a_while(
    limbs: str, first: int, second: int
) -> None:
    camera, seen = one_view()
    finding = one(examine_detections(camera, _limbs(first, second)(seen, slice(8, 18))))
    assert f"left and right of the {limbs} look exchanged in frames 8-17" in finding.what
    assert finding.frames == tuple(range(8, 18)) and finding.views == (0,)


@pytest.mark.parametrize(
    ("words", "first", "second"),
    [("right of the arms look", 2, 5), ("right of the legs look", 8, 12), ("in 3D in", 2, 12)],
)
def test_limbs_of_3d_poses_alone(words: str, first: int, second: int) -> None:
    camera, seen = one_view()
    alone = replace(seen, confidence2d=0 * seen.confidence2d)
    assert examine_detections(camera, alone, coverage=False) == []
    spoiled = _limbs(first, second)(alone, slice(8, 18))
    finding = one(examine_detections(camera, spoiled, coverage=False))
    assert words in finding.what and finding.frames == tuple(range(8, 18))


@pytest.mark.parametrize("edges", [(50,), (80, 100)])
def test_sides_that_change_places_where_there_is_no_pose(edges: tuple[int, ...]) -> None:
    """Which part is wrong is unknown; one exchange of eight frames is what a person can do."""
    camera, seen = recorded(models_folder() / "demo")
    flat = Detections(seen.joints2d, seen.confidence2d, None, torch.zeros_like(seen.trusted3d))
    assert examine_detections(camera, flat, coverage=False) == []
    spoiled = exchanged(seen, slice(edges[0], (*edges, None)[1]))
    spoiled = replace(flat, joints2d=spoiled.joints2d, confidence2d=spoiled.confidence2d)
    finding = one(examine_detections(camera, spoiled, coverage=False))
    where = ", ".join(map(str, edges))
    assert finding.what.startswith(f"left and right change places at frame {where} (of the")
    assert finding.severity is Severity.WARNING and not finding.frames


def test_somebody_who_bends_down_faces_no_other_way() -> None:
    """Chests look behind hips that hang upside down, but toes point ahead of their shanks."""
    camera, seen = one_view()
    points = person()
    across, hips = points[:, 12] - points[:, 8], 0.5 * (points[:, 8:9] + points[:, 12:13])
    lean = torch.linspace(0, 4, FRAMES, dtype=torch.float64).clamp(max=2.8)[:, None]
    turn = rotvec_to_matrix(lean * torch.nn.functional.normalize(across, dim=-1))
    bent = points.clone()
    bent[:, :8] = (points[:, :8] - hips) @ turn.mT + hips
    assert bool((bearings(bent)[0] > 0.2).all()) and examine_sides("", bent[-8:]) == []
    assert examine_detections(camera, _seen_by(camera, seen, bent)) == []


def test_feet_that_turn_little_by_little_turn_nothing_over() -> None:
    """Toes point backwards in the end, as of a lifter that is wrong about feet."""
    camera, seen = one_view()
    points = person()
    turned = points.clone()
    for knee, ankle, toe in ((9, 10, 11), (13, 14, 15)):
        shank = torch.nn.functional.normalize(points[:, knee] - points[:, ankle], dim=-1)
        angle = torch.linspace(0, 4, FRAMES, dtype=torch.float64).clamp(max=2.8)[:, None]
        turn = rotvec_to_matrix(angle * shank)
        foot = (points[:, toe] - points[:, ankle])[..., None]
        turned[:, toe] = points[:, ankle] + (turn @ foot)[..., 0]
    assert bool((bearings(turned)[0][-8:] < -0.2).all())
    assert examine_detections(camera, _seen_by(camera, seen, turned)) == []


def _seen_by(camera: CameraRig, seen: Detections, points: Tensor) -> Detections:
    """Landmarks (F, 16, 3) in the image and as 3D poses."""
    places = camera.cameras.to_camera(points)
    pose: Tensor = places - 0.5 * (places[..., 8:9, :] + places[..., 12:13, :])
    return replace(seen, joints2d=camera.cameras.project(points), joints3d=pose)
