"""What is wrong with an installation or with inputs, found before any solve."""

from perfcap.io.doctor.agreement import examine_agreement
from perfcap.io.doctor.cameras import examine_cameras
from perfcap.io.doctor.detections import examine_detections, examine_places
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.inputs import examine_inputs
from perfcap.io.doctor.installation import examine_installation

__all__ = [
    "Finding",
    "Severity",
    "examine_agreement",
    "examine_cameras",
    "examine_detections",
    "examine_inputs",
    "examine_installation",
    "examine_places",
]
