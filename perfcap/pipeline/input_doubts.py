"""What ``perfcap doctor`` would say of cameras and joints that are given in Python."""

from __future__ import annotations

from dataclasses import replace

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import (
    Severity,
    examine_agreement,
    examine_cameras,
    examine_detections,
)


def input_doubts(cameras: Camera, detections: Detections) -> tuple[str, ...]:
    """A sentence for each mistake in units, axes, lenses, views and frames that numbers show.

    Args:
        cameras: C views, (C,) or (F, C); the middle of an image without a size is taken to be
            where its lens looks.
        detections: (F, C).
    """
    known = cameras.map(lambda part: part.detach().double().cpu())
    seen = detections.to(known.intrinsics).map(lambda part: part.detach())
    middles = known.intrinsics[..., :2, 2].reshape(-1, known.views, 2)[0]
    sizes = tuple((round(2 * y) + 1, round(2 * x) + 1) for x, y in middles.tolist())
    names = tuple(f"view {view}" for view in range(known.views))
    rig = CameraRig(names, replace(known, size=known.size or sizes))
    findings = (
        *examine_cameras(rig),
        *examine_detections(rig, seen, coverage=False),
        *examine_agreement(rig, seen),
    )
    return tuple(
        "; ".join(part for part in (f"{found.subject}: {found.what}", found.remedy) if part)
        for found in findings
        if found.severity is not Severity.INFO
    )
