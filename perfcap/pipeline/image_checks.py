"""Whether images show the person whose joints are given, where nobody has looked yet."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.finding import Severity
from perfcap.io.doctor.footage import examine_blank, examine_footage
from perfcap.pipeline.images import Images

_REMEDY = "give the frames that were detected in, or end at Stage.TRACK_MOTION"


def examine_images(images: Images, cameras: Camera, detections: Detections) -> tuple[str, ...]:
    """Sentences about images that show little, or something else.

    Args:
        images: as they are given to a capture.
        cameras: C views in pixels of the detections.
        detections: (F, C), of the same frames.

    Raises:
        InputError: most images of a view are of one color.
    """
    images = images.checked()
    names = [f"images of view {view}" for view in range(detections.views)]
    plain = torch.zeros((), dtype=torch.float64)
    detections = detections.map(Tensor.detach).to(plain)
    found = examine_blank(images.reader, names)
    for finding in found:
        if finding.severity is Severity.ERROR:
            raise InputError(f"{finding.subject}: {finding.what}; {_REMEDY}")
    if not (cameras.moving or images.cameras.moving):
        given, shown = (each.map(Tensor.detach).to(plain) for each in (cameras, images.cameras))
        rays = torch.nn.functional.pad(given.to_plane(detections.joints2d), (0, 1), value=1.0)
        pixels = shown.project_camera(rays)
        found += examine_footage(images.reader, shown.size, detections, pixels)
    return tuple(f"{each.subject}: {each.what}; {each.remedy}" for each in found)
