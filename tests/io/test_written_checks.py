"""Writers of motions and surfaces name other units, frames and transforms than they expect."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import actor
from takes import sway

from perfcap.errors import InputError
from perfcap.io.bvh_read import BvhMotion, bvh_motion
from perfcap.io.bvh_write import save_bvh
from perfcap.io.gltf_write import save_animation
from perfcap.io.surface_file import open_surface, save_surface

PERSON = actor()
TEMPLATE = PERSON.template
MOTION = sway(PERSON, 12, 24.0)
TRANSFORMS = PERSON.bone_transforms(MOTION).numpy()
SURFACE = PERSON.surface(MOTION).numpy()
APART = r"joints apart, by up to \d+% of the skeleton"


def scaled(transforms: np.ndarray) -> np.ndarray:
    """The same in millimetres."""
    found = transforms.copy()
    found[..., :3, 3] *= 1000
    return found


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(TRANSFORMS @ TEMPLATE.bone_rest, id="to the world"),
        pytest.param(TRANSFORMS @ np.linalg.inv(TEMPLATE.bone_rest), id="rest pose taken twice"),
        pytest.param(np.linalg.inv(TRANSFORMS), id="inverse"),
        pytest.param(scaled(TRANSFORMS), id="mm"),
    ],
)
def test_transforms_under_which_bones_come_apart(wrong: np.ndarray, tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match=APART):
        save_animation(tmp_path / "a.glb", TEMPLATE, wrong, 24.0)


def test_transforms_of_another_skeleton(tmp_path: Path) -> None:
    """Of one that is a fifth larger."""
    rest = TEMPLATE.bone_rest.copy()
    rest[:, :3, 3] *= 1.2
    larger = replace(TEMPLATE, bone_rest=rest)
    with pytest.warns(UserWarning, match=APART):
        save_animation(tmp_path / "a.glb", larger, TRANSFORMS, 24.0)


def test_a_root_that_stays_behind_is_no_mistake(tmp_path: Path) -> None:
    """As in game engines, whose pelvis moves against a root on the floor."""
    still = TRANSFORMS.copy()
    still[:, 0] = np.eye(4)
    assert save_animation(tmp_path / "a.glb", TEMPLATE, still, 24.0)


def test_a_surface_of_other_frames_or_units(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    assert save_animation(path, TEMPLATE, TRANSFORMS, 24.0, [SURFACE])
    turned = SURFACE @ np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    with pytest.warns(UserWarning, match="surface is not that of the motion: 12 of 12 frames"):
        save_animation(path, TEMPLATE, TRANSFORMS, 24.0, [turned])
    with pytest.raises(InputError, match=r"surface spans .* expected metres"):
        save_animation(path, TEMPLATE, TRANSFORMS, 24.0, [1000 * SURFACE])


def test_seconds_of_a_frame(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="if a frame takes"):
        save_animation(tmp_path / "a.glb", TEMPLATE, TRANSFORMS, 1 / 24)
    with pytest.warns(UserWarning, match="if a frame takes"):
        save_surface(
            tmp_path / "surface.npz", [SURFACE], TEMPLATE.faces, np.arange(12), rate=1 / 24
        )
    with pytest.warns(UserWarning, match="rate is 0.0417 frames a second|if a frame takes"):
        save_bvh(tmp_path / "a.bvh", replace(motion(), frame_time=24.0))


def motion() -> BvhMotion:
    return bvh_motion(TEMPLATE, TRANSFORMS, 24.0)


def test_frames_and_units_of_surfaces(tmp_path: Path) -> None:
    path, numbers = tmp_path / "surface.npz", np.arange(12)
    for wrong in (numbers + 0.5, numbers[::-1], 0 * numbers, numbers > 3):
        with pytest.raises(InputError, match="expected the number of each frame in the video"):
            save_surface(path, [SURFACE], TEMPLATE.faces, wrong, 24.0)
    with pytest.raises(InputError, match=r"surface spans .* expected metres"):
        save_surface(path, [1000 * SURFACE], TEMPLATE.faces, numbers, 24.0)
    assert not path.exists()
    save_surface(path, [SURFACE], TEMPLATE.faces, numbers + 5.0, 24.0)
    assert open_surface(path).frames.tolist() == list(range(5, 17))


def test_places_of_joints_in_the_world(tmp_path: Path) -> None:
    right, path = motion(), tmp_path / "a.bvh"
    save_bvh(path, right)
    places = (TRANSFORMS @ TEMPLATE.bone_rest)[..., :3, 3]
    with pytest.warns(UserWarning, match="expected those in the parent's frame"):
        save_bvh(path, replace(right, positions=places))


def test_units_of_joints(tmp_path: Path) -> None:
    right, path = motion(), tmp_path / "a.bvh"
    with pytest.raises(InputError, match="expected metres; convert offsets and positions"):
        larger = replace(right, offsets=1000 * right.offsets, positions=1000 * right.positions)
        save_bvh(path, larger)
    root = right.positions.copy()
    root[:, 0] *= 1000
    with pytest.warns(UserWarning, match="the root moves at"):
        save_bvh(path, replace(right, positions=root))
