"""Translations of a camera that turns which do not change, as where it stands was written in t."""

from __future__ import annotations

import math
from collections.abc import Iterator

from perfcap.geometry.rotation import matrix_to_rotvec
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.ways import given_ways

_EXACT = 1e-6  # of its length: a copy
_TURNS = math.radians(1)  # at least
_MOVES = 0.05  # m, of the camera's centre; less is no matter
_CENTRED = 0.02  # tangent of the angle from the optical axis, of what a camera goes round


def examine_translations(rig: CameraRig) -> Iterator[Finding]:
    """Views that turn while their translation stays, so that they go round the world's origin.

    A camera on a tripod has one place C and t = -R C, which changes with R. One that does go round
    the origin, as in renderings and before turntables, looks at it.

    Args:
        rig: C views.
    """
    for way in given_ways(rig):
        shift = way.translation[0]
        if float((way.translation - shift).norm(dim=-1).max()) > _EXACT * float(shift.norm()):
            continue
        centred = float(shift[:2].norm()) < _CENTRED * float(shift[2].abs())
        turned = float(matrix_to_rotvec(way.rotation[0].mT @ way.rotation).norm(dim=-1).max())
        moved = float((way.centre - way.centre[0]).norm(dim=-1).max())
        if centred or turned < _TURNS or moved < _MOVES:
            continue
        what = (
            f"its translation is the same in every frame while it turns by "
            f"{math.degrees(turned):.1f} degrees, so that it goes round the world's origin, "
            f"{float(shift.norm()):.3g} m away, by {moved:.2g} m"
        )
        remedy = (
            "if it stands on a tripod at C, give t = -R C with the R of each frame; t is neither C "
            "nor that of the first frame"
        )
        yield Finding(Severity.WARNING, way.name, what, remedy)
