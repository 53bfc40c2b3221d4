"""Poses of the views of a rig whose cameras move, one way each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from torch import Tensor

from perfcap.io.calibration import CameraRig


@dataclass(frozen=True)
class Way:
    """Poses of one view.

    Attributes:
        view: its number.
        name: of it.
        rotation: world to camera, (F, 3, 3).
        translation: the same, (F, 3), metres.
        centre: where it is in the world, (F, 3), metres.
    """

    view: int
    name: str
    rotation: Tensor
    translation: Tensor
    centre: Tensor


def given_ways(rig: CameraRig) -> Iterator[Way]:
    """The ways of all views; none of cameras that rest."""
    cameras = rig.cameras
    if not cameras.moving:
        return
    for view, name in enumerate(rig.names):
        poses = cameras.rotation, cameras.translation, cameras.centre
        yield Way(view, name, *(part[:, view] for part in poses))
