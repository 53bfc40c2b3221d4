"""Arrays without names whose number of joints is another set's, too."""

from pathlib import Path

import numpy as np
import pytest

from perfcap.detect.joint_set import BODY_25, BODY_25B, COCO17, H36M17, LANDMARKS, JointSet
from perfcap.errors import InputError
from perfcap.io.detections import read_detections

FRAMES = 5
PLACES = {
    **{"hip": (0, 0), "spine": (4, -60), "thorax": (2, -120), "neck": (2, -120)},
    **{"nose": (14, -150), "head_top": (3, -180), "head": (3, -165), "mid_hip": (0, 0)},
    **{"eye": (6, -156), "ear": (12, -152), "shoulder": (30, -112), "elbow": (42, -60)},
    **{"wrist": (60, -10), "hand": (62, 0), "knee": (22, 90), "ankle": (20, 170)},
    **{"big_toe": (30, 180), "small_toe": (34, 180), "heel": (18, 178), "toe": (30, 180)},
}
KINECT = (
    *("mid_hip", "spine", "neck", "head"),
    *(f"{s}_{j}" for s in "lr" for j in ("shoulder", "elbow", "wrist", "hand")),
    *(f"{s}_{j}" for s in "lr" for j in ("hip", "knee", "ankle", "toe")),
    *("thorax", "l_hand", "l_hand", "r_hand", "r_hand"),
)


def standing(names: tuple[str, ...]) -> np.ndarray:
    """A person who walks to the side, (F, J, 3) px and confidence."""
    rows = []
    for name in names:
        side = {"l": 1.0, "r": -1.0}.get(name.split("_")[0], 0.0)
        x, y = PLACES[name[2:] if side else name]
        x = 15 if name.endswith("_hip") and side else x
        rows.append((300 + (side or 1.0) * x, 250 + y, 0.9))
    steps = np.arange(FRAMES)[:, None, None] * np.array([4.0, 0, 0])
    found: np.ndarray = np.array(rows) + steps
    return found


def test_joints_in_the_order_of_human36m_are_taken_by_it(tmp_path: Path) -> None:
    """They were read as COCO's: a nose at the hips."""
    values = standing(H36M17.joints)
    np.save(tmp_path / "a.npy", values)
    found, notes = read_detections(tmp_path / "a.npy")
    for name in ("l_wrist", "r_ankle", "l_hip", "head_top"):
        own = values[:, H36M17.joints.index(name), :2]
        assert np.abs(found.joints2d[:, 0, LANDMARKS.index(name)].numpy() - own).max() < 1e-9
    assert any("H36M" in note for note in notes)


@pytest.mark.parametrize("joint_set", [COCO17, BODY_25, BODY_25B])
def test_other_orders_stay(joint_set: JointSet, tmp_path: Path) -> None:
    values = standing(joint_set.joints)
    np.save(tmp_path / "a.npy", values)
    found, _ = read_detections(tmp_path / "a.npy")
    for name in ("l_wrist", "r_ankle", "l_hip"):
        own = values[:, joint_set.joints.index(name), :2]
        assert np.abs(found.joints2d[:, 0, LANDMARKS.index(name)].numpy() - own).max() < 1e-9


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_joints_in_the_order_of_a_kinect_are_refused(broken: float, tmp_path: Path) -> None:
    values = standing(KINECT)
    values[2, 5:] = broken
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(InputError, match="Kinect"):
        read_detections(tmp_path / "a.npy")
