"""Joints of other images than the calibrated ones: mirrored, upside down, rows before columns."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from doctored_views import NAMES, VIEWS, detections, one, rig
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.io.doctor import examine_agreement
from perfcap.io.doctor.agreement import best_mistake
from perfcap.io.doctor.evidence import Scene

SIZE = 1000  # of both sides


def mirrored(joints: Tensor) -> Tensor:
    """As a detector sees a mirror image, where left is right."""
    x, y = joints[:, list(LANDMARKS16.mirrored())].unbind(-1)
    return torch.stack((SIZE - 1 - x, y), -1)


def upside_down(joints: Tensor) -> Tensor:
    return SIZE - 1 - joints


def rows_first(joints: Tensor) -> Tensor:
    return joints.flip(-1)


def spoiled(views: range, change: Callable[[Tensor], Tensor]) -> Detections:
    good = detections()
    joints = good.joints2d.clone()
    for view in views:
        joints[:, view] = change(joints[:, view])
    return replace(good, joints2d=joints)


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (mirrored, "made in a mirror image"),
        (upside_down, "made in an image that is upside down"),
        (rows_first, "made with x and y exchanged"),
    ],
)
@pytest.mark.parametrize("view", range(VIEWS))
def test_one_view(change: Callable[[Tensor], Tensor], said: str, view: int) -> None:
    finding = one(examine_agreement(rig(), spoiled(range(view, view + 1), change)))
    assert finding.subject == f"cam{view + 1}"
    assert said in finding.what


def test_rows_before_columns_in_all_views() -> None:
    finding = one(examine_agreement(rig(), spoiled(range(VIEWS), rows_first)))
    assert "x and y were exchanged" in finding.what
    assert finding.subject == "detections"


def test_cameras_without_sizes_are_examined_too() -> None:
    bare = rig()
    bare = replace(bare, cameras=replace(bare.cameras, size=()))
    assert examine_agreement(bare, detections()) == []
    assert "sees the person" in one(examine_agreement(bare, spoiled(range(1), mirrored))).what


def test_no_image_is_named_where_views_disagree_still() -> None:
    """Two people who were mixed up fit better in a mirror image, but not well."""
    scene = Scene(rig().cameras, spoiled(range(1), mirrored))
    named, rest = best_mistake(scene, list(NAMES), bad=1000.0)
    assert "mirror" in named.what
    other, _ = best_mistake(scene, list(NAMES), bad=0.5 * rest)
    assert not other.settles
