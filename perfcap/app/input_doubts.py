"""What a capture says of its inputs before it starts: whether they belong together."""

from __future__ import annotations

from perfcap.app.inputs import Inputs
from perfcap.errors import InputError
from perfcap.io.doctor.detections import examine_detections
from perfcap.io.doctor.finding import Severity
from perfcap.io.doctor.footage import examine_blank
from perfcap.io.doctor.inputs import examine_take


def doubts(inputs: Inputs, *, needs_images: bool, detected: bool) -> tuple[str, ...]:
    """Findings of ``perfcap doctor`` about inputs that are read, one sentence each.

    They are no refusal: robust energies get along with much, and nobody but the user knows what
    was recorded. Images that show nothing are one where a stage looks at them.

    Args:
        inputs: of the capture.
        needs_images: whether a stage looks at the images.
        detected: whether the joints were found in these very images.

    Raises:
        InputError: most images of a view are of one color, and a stage needs them.
    """
    findings = examine_blank(inputs.clip, inputs.rig.names)
    for finding in findings:
        if needs_images and finding.severity is Severity.ERROR:
            raise InputError(f"{finding.subject}: {finding.what}; {finding.remedy}")
    findings += examine_detections(inputs.rig, inputs.detections, coverage=False)
    clip, pixel_map = (None, None) if detected else (inputs.clip, inputs.pixel_map)
    findings += examine_take(inputs.rig, inputs.detections, clip, pixel_map)
    return tuple(
        f"{found.subject}: {found.what}; {found.remedy}"
        for found in findings
        if found.severity is not Severity.INFO
    )
