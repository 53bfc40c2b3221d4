"""Places in another unit or other axes than bones, by the foot that stands."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.io.moving_rig import MovingRig, read_moving_rig
from perfcap.pipeline.joint_motion import JointMotion, carried_landmarks, leg_length
from perfcap.pipeline.place_units import place_doubts
from perfcap.pipeline.retargeting import retarget

RATE, LEGS = 30.0, 0.9
RECORDED = Path(__file__).parents[2] / "../shared/data"
CMU, BANDAI = RECORDED / "mocap_cmu_bvh", RECORDED / "mocap_bandai_bvh"
needs_recordings = pytest.mark.skipif(
    not (CMU.is_dir() and BANDAI.is_dir()), reason="needs ../shared/data/mocap_*_bvh"
)


def said(landmarks: Tensor) -> list[str]:
    """All that is odd about a motion."""
    return list(place_doubts(landmarks, RATE, LEGS))


def walk(factor: float = 1.0, speed: float = 1.2, frames: int = 90) -> Tensor:
    """Hips that go over one foot after the other, at places that are wrong by a factor."""
    time = torch.arange(frames).double() / RATE
    hips = torch.stack((speed * time, 0.9 + 0.02 * (12 * time).sin(), 0 * time), -1)
    points = hips[:, None].repeat(1, 16, 1)
    for side, late in (("l", 0.0), ("r", 0.5)):
        phase = (time + late) % 1.0
        stands = phase < 0.5
        start = speed * (time - phase)
        along = torch.where(stands, start + 0.25 * speed, start + speed * (2 * phase - 0.75))
        up = torch.where(stands, 0.08, 0.08 + 0.2 * (2 * torch.pi * (phase - 0.5)).sin())
        for name, ahead in (("ankle", 0.0), ("toe", 0.15)):
            place = torch.stack((along + ahead, up, 0 * time), -1)
            points[:, LANDMARKS.index(f"{side}_{name}")] = place
    return points + (factor - 1) * hips[:, None]


@pytest.mark.parametrize("factor", [0.01, 0.0254, 0.39, 2.54, 100.0])
def test_other_units_are_found(factor: float) -> None:
    (line,) = place_doubts(walk(factor), RATE, LEGS)
    assert "another unit than its bones" in line
    found = float(line.split("places were ")[1].split(" times")[0])
    assert found == pytest.approx(1 / factor, rel=0.1)


@pytest.mark.parametrize(
    ("axes", "told"),
    [
        ([-1.0, 1.0, 1.0], "(-x, y, z)"),
        ([[0.0, 0, 1], [0, 1, 0], [1, 0, 0]], "(z, y, x)"),
        ([1.0, 1.0, -1.0], ""),  # along which nobody walks
    ],
)
def test_other_axes_are_found(axes: list[float], told: str) -> None:
    """A person walked backwards or aside while their legs went ahead, with nothing said."""
    right = walk()
    turn = torch.tensor(axes).double()
    turn = torch.diag(turn) if turn.ndim == 1 else turn
    hips = mid_hip(right)[:, None]
    lines = list(place_doubts(right + hips @ turn.mT - hips, RATE, LEGS))
    assert len(lines) == bool(told) and all(told in line for line in lines), lines


def test_right_units_and_motions_that_do_not_say() -> None:
    assert not said(walk())
    assert not said(walk(0.7))  # a stylised figure
    spot = walk()
    spot = spot - torch.stack((spot[:, 1, 0], 0 * spot[:, 1, 0], 0 * spot[:, 1, 0]), -1)[:, None]
    assert not said(spot)
    assert not said(walk(0.01)[:10])
    still = walk(0.01)[:1].repeat(60, 1, 1)
    assert not said(still)
    floats = walk()
    floats[:, [LANDMARKS.index(name) for name in ("l_ankle", "r_ankle", "l_toe", "r_toe")]] = (
        torch.rand(90, 4, 3, generator=torch.Generator().manual_seed(0)).double()
    )
    assert not said(floats)


@pytest.mark.parametrize("factor", [0.01, 0.0254, 0.39, 2.54, 100.0])
def test_units_of_a_root_about_which_the_pelvis_turns(factor: float) -> None:
    """What the pelvis's turns add is of bones: it hid roots in metres beside centimetres."""
    right = walk()
    turn = 0.4 * (2 * torch.pi * torch.arange(len(right)).double() / RATE).sin()
    arm = 0.12 * torch.stack((turn.sin(), 0 * turn, turn.cos()), -1)  # from the root to the hips
    root = mid_hip(right) - arm
    (line,) = place_doubts(right + (factor - 1) * root[:, None], RATE, LEGS, factor * root)
    assert named(line) == pytest.approx(1 / factor, rel=0.1)
    assert not list(place_doubts(right, RATE, LEGS, root))


def test_places_of_the_middle_of_the_hips_of_a_skeleton_with_another_root() -> None:
    """As of predicted poses."""
    wrong = walk(0.01)
    turn = torch.arange(len(wrong)).double().sin()
    root = mid_hip(wrong) + 0.12 * torch.stack((turn.cos(), 0 * turn, turn.sin()), -1)
    (line,) = place_doubts(wrong, RATE, LEGS, root)
    assert named(line) == pytest.approx(100, rel=0.1)


def test_places_relative_to_the_pelvis() -> None:
    """A walk became one on the spot, with nothing said."""
    right = walk()
    root = mid_hip(right)
    spot = right - root[:, None]
    (line,) = place_doubts(spot, RATE, LEGS, root - root)
    assert "the pelvis stays at one place to the last digit" in line and "in the world" in line
    # a detector's pelvis moves, and so does that of who walks on a treadmill
    swaying = 1e-3 * torch.randn(root.shape, generator=torch.Generator().manual_seed(0)).double()
    assert not list(place_doubts(spot + swaying[:, None], RATE, LEGS, swaying))
    # who sits or stands still has a foot that stays
    seated = spot.clone()
    feet = [LANDMARKS.index(name) for name in ("l_ankle", "l_toe")]
    seated[:, feet] = seated[:1, feet] - torch.tensor([0.0, 0.3, 0.0])
    assert not list(place_doubts(seated, RATE, LEGS, root - root))


@needs_recordings
def test_retarget_names_places_relative_to_the_pelvis(tmp_path: Path) -> None:
    rig = recorded(CMU / "02_02.bvh", tmp_path, 1.0)
    position = torch.tensor(rig.position)
    joints = JointMotion(torch.tensor(rig.rotation), position - position[:, :1])
    assert not said_of(rig)
    with pytest.raises(UserWarning, match="the pelvis stays at one place"):  # before it solves
        retarget(rig.actor, joints, rig.actor, rig.rate, examined=True)


def named(line: str) -> float:
    """The factor that a sentence has."""
    return float(line.split("places were ")[1].split(" times")[0])


def recorded(path: Path, tmp_path: Path, factor: float, *, column: int = 0) -> MovingRig:
    """A file whose three numbers of a place from some column on are multiplied."""
    head, motion = path.read_text().split("MOTION")
    count, time, *lines = motion.strip().split("\n")
    rows = [line.split() for line in lines]
    for row in rows:
        at = slice(column, column + 3)
        row[at] = [f"{factor * float(number):.6f}" for number in row[at]]
    table = "\n".join(" ".join(row) for row in rows)
    made = tmp_path / "a.bvh"
    made.write_text(f"{head}MOTION\n{count}\n{time}\n{table}\n")
    return read_moving_rig(made, slice(1, None))


def said_of(rig: MovingRig, frames: slice = slice(None)) -> list[str]:
    """All that is odd about a part of what was read."""
    joints = JointMotion(torch.tensor(rig.rotation[frames]), torch.tensor(rig.position[frames]))
    points = carried_landmarks(rig.actor.skeleton, joints)
    root = joints.position[:, 0]
    return list(place_doubts(points, rig.rate, leg_length(rig.actor), root))


@needs_recordings
@pytest.mark.parametrize("factor", [0.01, 0.0254, 1.0, 2.54])
@pytest.mark.parametrize(
    ("path", "column"),
    [
        (CMU / "02_02.bvh", 0),
        (CMU / "02_03.bvh", 0),
        (BANDAI / "dataset-1_slash_normal_001.bvh", 6),  # hips under a root that stays
    ],
)
def test_units_of_roots_of_recorded_motions(
    path: Path, column: int, factor: float, tmp_path: Path
) -> None:
    lines = said_of(recorded(path, tmp_path, factor, column=column))
    assert len(lines) == (factor != 1.0), lines
    for line in lines:
        assert named(line) == pytest.approx(1 / factor, rel=0.3)


@needs_recordings
def test_legs_that_dangle_say_nothing_of_units(tmp_path: Path) -> None:
    rig = recorded(CMU / "01_08.bvh", tmp_path, 1.0)
    for start in range(1700, 1860, 10):
        assert not said_of(rig, slice(start, start + 50)), start


@needs_recordings
def test_retarget_names_a_root_in_another_unit(tmp_path: Path) -> None:
    rig = recorded(CMU / "02_02.bvh", tmp_path, 0.01)
    joints = JointMotion(torch.tensor(rig.rotation), torch.tensor(rig.position))
    with pytest.raises(UserWarning, match="another unit than its bones"):  # before it solves
        retarget(rig.actor, joints, rig.actor, rig.rate, examined=True)
