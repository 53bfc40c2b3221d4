"""What the capture of one person begins with: cameras and clocks that are settled, and masks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from perfcap.app.capture_checks import examined, told
from perfcap.app.capture_request import named_doubts, uses_masks
from perfcap.app.inputs import Inputs
from perfcap.app.masked_frames import given_doubts, missing_masks, order_doubts
from perfcap.app.true_views import settled
from perfcap.commands.capture import AUTO, Capture
from perfcap.detect.detections import Detections
from perfcap.io.mask_files import MaskFolders
from perfcap.pipeline.stage import Stage


@dataclass(frozen=True, eq=False)
class Ready:
    """All that a capture looks at.

    Attributes:
        inputs: with what is to be said of them, which was said.
        views: clocks and places of views that were found, for the report.
        masks: those that are given.
    """

    inputs: Inputs
    views: dict[str, Any]
    masks: MaskFolders | None


def made_ready(request: Capture, given: Inputs, everybody: Detections | None) -> Ready:
    """Settle, examine and say what there is to say, before any work is done.

    Args:
        request: of one person.
        given: as they were read.
        everybody: of whom the person is one, where ``--people`` was asked for.

    Raises:
        InputError: they would be captured wrongly everywhere.
    """
    alone, held = request.cameras is None, request.camera_motion == "auto"
    inputs, views = settled(
        given, request.sync == "auto", request.refine_cameras, assumed=alone, held=held
    )
    inputs = examined(
        inputs,
        needs_images=Stage[request.until.upper()].needs_images,
        detected=bool(request.detectors),
        people=request.everybody,
        given=not alone,
        everybody=everybody if inputs.detections is given.detections else None,  # frames moved
    )
    inputs = told(inputs, [*named_doubts(request, inputs.clip.views)])
    masks = MaskFolders.open(request.masks, inputs.clip) if uses_masks(request) else None
    if masks is not None:
        more = [*missing_masks(inputs, masks), *order_doubts(inputs, masks)]
        if request.actor != (AUTO,):  # a body says the same of its own
            more += given_doubts(inputs, masks)
        inputs = told(inputs, more)
    return Ready(inputs, views, masks)
