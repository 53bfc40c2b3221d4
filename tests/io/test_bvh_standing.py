"""BVH files whose offsets are no pose of a person: a frame in which it stands serves."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foreign_rigs import MIXAMO
from synthetic import actor
from takes import sway

from perfcap.actor.anatomy import JOINTS
from perfcap.errors import InputError
from perfcap.io.bvh_read import BvhMotion, bvh_motion, joint_positions, load_bvh
from perfcap.io.bvh_standing import standing_pose
from perfcap.io.bvh_write import save_bvh
from perfcap.io.moving_rig import MovingRig, read_moving_rig

PERSON = actor()
MOTION = sway(PERSON, 12, 24.0)
BANDAI = Path(__file__).parents[2] / "../shared/data/mocap_bandai_bvh"


def turn(axis: int, degrees: float) -> np.ndarray:
    """A turn about an axis of the world, (3, 3)."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    found = np.eye(3)
    found[a, a], found[a, b], found[b, a], found[b, b] = cos, -sin, sin, cos
    return found


def sway_motion() -> BvhMotion:
    """The swaying person, with feet, and Mixamo's names."""
    template = PERSON.template
    names = tuple(MIXAMO[name] for name in template.bone_names)
    motion = bvh_motion(template, PERSON.bone_transforms(MOTION).numpy(), 24.0)
    ends = np.full(motion.offsets.shape, np.nan)
    parents = set(motion.parents.tolist())
    for bone in range(len(names)):
        if bone not in parents:
            ends[bone] = 0.2 * motion.offsets[bone]
    for side in "lr":
        ends[template.bone_names.index(f"{side}_ankle")] = 0.0, -0.05, 0.15
    return replace(motion, names=names, ends=ends)


def of(joint: str) -> int:
    return PERSON.template.bone_names.index(joint)


def with_offsets(motion: BvhMotion, frames: Mapping[str, np.ndarray]) -> BvhMotion:
    """The same motion with other axes of some joints, and so with other offsets below them."""
    axes = np.tile(np.eye(3), (len(motion.names), 1, 1))
    for joint, rotation in frames.items():
        axes[of(joint)] = rotation
    root = (motion.parents < 0)[:, None, None]
    above = np.where(root, np.eye(3), axes[np.maximum(motion.parents, 0)])
    assert motion.ends is not None
    return replace(
        motion,
        offsets=(above.mT @ motion.offsets[..., None])[..., 0],
        rotations=above.mT @ motion.rotations @ axes,
        positions=(above.mT @ motion.positions[..., None])[..., 0],
        ends=(axes.mT @ motion.ends[..., None])[..., 0],
    )


def headed(motion: BvhMotion, yaw: np.ndarray) -> BvhMotion:
    """The same motion in a world that is turned, (3, 3)."""
    rotations, positions = motion.rotations.copy(), motion.positions.copy()
    rotations[:, 0], positions[:, 0] = yaw @ rotations[:, 0], positions[:, 0] @ yaw.T
    return replace(motion, rotations=rotations, positions=positions)


def truth(motion: BvhMotion) -> np.ndarray:
    """Places of the joints in the file, (F, 16, 3)."""
    return joint_positions(motion)[:, [of(joint) for joint in JOINTS]]


UPSIDE_DOWN = {f"{side}_hip": turn(0, 180) for side in "lr"}
FEET_BACK = UPSIDE_DOWN | {f"{side}_ankle": turn(1, 180) for side in "lr"}


def with_toes(motion: BvhMotion) -> BvhMotion:
    """The same with joints where the feet end."""
    assert motion.ends is not None
    ankles = [of(f"{side}_ankle") for side in "lr"]
    feet, frames = motion.ends[ankles], len(motion.rotations)
    still, at = np.tile(np.eye(3), (frames, 2, 1, 1)), np.tile(feet, (frames, 1, 1))
    ends = np.concatenate((motion.ends, 0.2 * feet))
    ends[ankles] = np.nan
    return replace(
        motion,
        names=(*motion.names, "mixamorig:LeftToeBase", "mixamorig:RightToeBase"),
        parents=np.append(motion.parents, ankles),
        offsets=np.concatenate((motion.offsets, feet)),
        rotations=np.concatenate((motion.rotations, still), 1),
        positions=np.concatenate((motion.positions, at), 1),
        ends=ends,
    )


@pytest.mark.parametrize("toes", [True, False])
@pytest.mark.parametrize("degrees", [0, 50, 180])
@pytest.mark.parametrize("axes", [UPSIDE_DOWN, FEET_BACK])
def test_the_world_of_the_file_stays(
    axes: Mapping[str, np.ndarray], degrees: float, toes: bool, tmp_path: Path
) -> None:
    """Whatever the offsets say of left and right, and wherever the person faces."""
    motion = headed(sway_motion(), turn(1, degrees))
    motion = with_toes(motion) if toes else motion
    save_bvh(tmp_path / "a.bvh", with_offsets(motion, axes))
    found = read_moving_rig(tmp_path / "a.bvh")
    assert any("its rest pose is none of a person" in note for note in found.notes)
    np.testing.assert_allclose(found.position, truth(motion), atol=2e-4)


def slashing(raised: slice) -> BvhMotion:
    """A person that stands with bent knees, and straight only while its arms are raised."""
    motion = sway_motion()
    still = np.tile(np.eye(3), (*motion.rotations.shape[:2], 1, 1))
    bent = np.ones(len(still), dtype=np.bool_)
    bent[raised] = False
    for side, sign in (("l", 1), ("r", -1)):
        still[bent, of(f"{side}_knee")] = turn(0, 25)
        still[~bent, of(f"{side}_shoulder")] = turn(2, sign * 110)
    return replace(motion, rotations=still)


@pytest.mark.parametrize("frames", [slice(0, None), slice(0, 5), slice(8, None)])
def test_arms_that_are_raised_are_no_rest_pose(frames: slice, tmp_path: Path) -> None:
    """Another frame of the file serves, be it one that is left out."""
    motion = slashing(slice(0, 8))
    save_bvh(tmp_path / "a.bvh", with_offsets(motion, UPSIDE_DOWN))
    found = read_moving_rig(tmp_path / "a.bvh", frames)
    assert any("frame 8 is taken" in note for note in found.notes)
    np.testing.assert_allclose(found.position, truth(motion)[frames], atol=2e-4)


def test_no_frame_in_which_the_person_stands(tmp_path: Path) -> None:
    motion = slashing(slice(0, None))
    save_bvh(tmp_path / "a.bvh", with_offsets(motion, UPSIDE_DOWN))
    with pytest.raises(InputError, match=r"shoulder is lifted by 1\d\d.* no pose .* frame \d"):
        read_moving_rig(tmp_path / "a.bvh")


def test_long_files_are_looked_at_in_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those frames are spread over the whole file."""
    monkeypatch.setattr("perfcap.io.bvh_standing._LOOKED_AT", 4)
    save_bvh(tmp_path / "a.bvh", with_offsets(slashing(slice(0, 10)), UPSIDE_DOWN))
    found = read_moving_rig(tmp_path / "a.bvh", slice(0, 4))
    assert any("frame 11 is taken" in note for note in found.notes)
    assert len(found.position) == 4


def hopping(stands: slice, height: float = 0.25) -> BvhMotion:
    """A person some metres up with straight legs and toes down, or that stands with bent knees."""
    motion = with_toes(sway_motion())
    still = np.tile(np.eye(3), (*motion.rotations.shape[:2], 1, 1))
    air = np.ones(len(still), dtype=np.bool_)
    air[stands] = False
    positions = motion.positions.copy()
    positions[:, 0] = positions[0, 0] + air[:, None] * np.array([0.0, height, 0.0])
    for side in "lr":
        still[~air, of(f"{side}_hip")] = turn(0, -8)
        still[~air, of(f"{side}_knee")] = turn(0, 16)
        still[~air, of(f"{side}_ankle")] = turn(0, -8)
        still[air, of(f"{side}_ankle")] = turn(0, 50)
    return replace(motion, rotations=still, positions=positions)


def taken(motion: BvhMotion, path: Path) -> int:
    """Number of the frame that is taken for the rest pose."""
    save_bvh(path, with_offsets(motion, UPSIDE_DOWN))
    (note,) = (note for note in read_moving_rig(path).notes if "is taken" in note)
    return int(note.split("frame ")[1].split(" ")[0])


def test_feet_in_the_air_are_no_rest_pose(tmp_path: Path) -> None:
    """Whoever stands with bent knees stands better than whoever jumps with straight ones."""
    assert taken(hopping(slice(5, 10)), tmp_path / "a.bvh") in range(5, 10)


def test_whoever_stands_on_tiptoe_in_few_frames(tmp_path: Path) -> None:
    assert taken(hopping(slice(0, 9), 0.12), tmp_path / "a.bvh") < 9


@pytest.mark.parametrize(
    ("joint", "axis", "degrees", "bent"), [("spine", 1, 60, 13), ("neck", 0, 30, 5)]
)
def test_a_twisted_trunk_or_a_bent_head_is_no_rest_pose(
    joint: str, axis: int, degrees: float, bent: float, tmp_path: Path
) -> None:
    """Knees that are bent by some degrees are better: they come right from any pose."""
    motion = sway_motion()
    still = np.tile(np.eye(3), (*motion.rotations.shape[:2], 1, 1))
    for side in "lr":
        still[6, of(f"{side}_knee")] = turn(0, bent)
    still[np.arange(len(still)) != 6, of(joint)] = turn(axis, degrees)
    assert taken(replace(motion, rotations=still), tmp_path / "a.bvh") == 6


@pytest.mark.parametrize("feet", [None, 0.0, 40.0])
def test_feet_may_begin_at_any_height(feet: float | None, tmp_path: Path) -> None:
    """Skeletons without feet, or with heels, are chosen from by what else stands."""
    motion = slashing(slice(0, 8))
    if feet is None:
        assert motion.ends is not None
        motion.ends[[of(f"{side}_ankle") for side in "lr"]] = np.nan
    else:
        motion = with_toes(motion)
        for side in "lr":
            motion.rotations[:, of(f"{side}_ankle")] = turn(0, feet)
    assert taken(motion, tmp_path / "a.bvh") == 8


def facing(found: MovingRig) -> np.ndarray:
    """Where the person faces by the turns of its pelvis, level, (F, 2): x and z."""
    ahead = found.rotation[:, JOINTS.index("pelvis"), :, 2][:, [0, 2]]
    return np.asarray(ahead / np.linalg.norm(ahead, axis=1, keepdims=True))


@pytest.mark.skipif(not BANDAI.is_dir(), reason="needs shared/data/mocap_bandai_bvh")
@pytest.mark.parametrize("name", ["walk-back", "call", "bow", "dance-short", "kick", "punch"])
def test_recordings_keep_their_world(name: str) -> None:
    """Hips go the way of the file, and the person faces where left and right say."""
    path = BANDAI / f"dataset-1_{name}_normal_001.bvh"
    found, raw = read_moving_rig(path), load_bvh(path)
    places = joint_positions(raw)
    np.testing.assert_allclose(found.position[:, 0], places[:, raw.names.index("Hips")], atol=0.02)
    left, right = (places[:, raw.names.index(f"UpperLeg_{side}")] for side in "LR")
    across = (left - right)[:, [2, 0]] * [-1, 1]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    assert np.median((facing(found) * across).sum(1)) > 0.9


@pytest.mark.skipif(not BANDAI.is_dir(), reason="needs shared/data/mocap_bandai_bvh")
@pytest.mark.parametrize("name", ["dance-short", "punch", "kick"])
def test_recordings_of_one_skeleton_have_one_rest_pose(name: str) -> None:
    """A bow is begun upright; feet of other clips turn as by its frame, within a stance."""
    bow, found = (standing(BANDAI / f"dataset-1_{each}_normal_001.bvh") for each in ("bow", name))
    for joint in ("Foot_L", "Foot_R"):
        turned = bow[joint].T @ found[joint]
        assert np.degrees(np.arccos((np.trace(turned) - 1) / 2)) < 20


def standing(path: Path) -> dict[str, np.ndarray]:
    """Turns of the joints in the frame that is taken, (3, 3) by name."""
    motion = load_bvh(path)
    rest = motion.offsets.copy()
    for joint, parent in enumerate(motion.parents.tolist()):
        rest[joint] += rest[parent] if parent >= 0 else 0.0
    return dict(zip(motion.names, standing_pose(motion, rest, {}).turns, strict=True))


@pytest.mark.skipif(not BANDAI.is_dir(), reason="needs shared/data/mocap_bandai_bvh")
@pytest.mark.parametrize("name", ["slash", "dance-short"])
@pytest.mark.parametrize("frames", [slice(0, None), slice(300, 330), slice(700, 740)])
def test_recordings_with_raised_arms(name: str, frames: slice) -> None:
    path = BANDAI / f"dataset-1_{name}_normal_001.bvh"
    frames = slice(300, 330) if name == "slash" and frames.stop else frames
    assert np.isfinite(read_moving_rig(path, frames).position).all()
