"""What ``perfcap doctor`` knows, inside ``perfcap capture``: refused, or told, before any solve."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace

from perfcap.app.inputs import Inputs
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import (
    Finding,
    Severity,
    examine_agreement,
    examine_cameras,
    examine_detections,
    examine_places,
)
from perfcap.io.doctor.fields import examine_fields
from perfcap.io.doctor.finding import doubting
from perfcap.io.doctor.footage import examine_blank
from perfcap.io.doctor.halts import examine_halts
from perfcap.io.doctor.inputs import examine_take, examine_ways
from perfcap.pipeline.bone_lengths import shows_bone_lengths
from perfcap.pipeline.performance import Performance

_LOG = logging.getLogger(__name__)
_OTHERS = (
    "; where several people are seen, networks may follow another one in each view: --people 1 "
    "follows the same one in all"
)
_WHOLE = ("cameras", "detections")  # subjects of mistakes that spoil every view


def examined(
    inputs: Inputs,
    *,
    needs_images: bool,
    detected: bool,
    people: bool | None = None,
    given: bool = True,
    everybody: Detections | None = None,
) -> Inputs:
    """The inputs with all there is to say of them, which is said before any work is done.

    Args:
        inputs: of the capture.
        needs_images: whether a stage looks at the images.
        detected: whether the joints were found in these very images.
        people: whether ``--people`` is given; None where there is no such option to advise.
        given: whether the cameras are, not found in these very images.
        everybody: as of ``examine_take``.

    Raises:
        InputError: see ``refuse_wrong`` and ``doubts``.
    """
    refuse_wrong(inputs, detected and people is False)
    found = doubts(
        inputs, needs_images=needs_images, detected=detected, people=people, everybody=everybody
    )
    found += way_doubts(inputs) if given else []
    if detected and people is False and inputs.clip.views > 1:
        found = _advised(found)
    inputs.clip.keep(())  # that was the last look at them
    for line in inputs.warnings:
        _LOG.warning("%s", line)
    inputs = replace(inputs, detections=doubting(inputs.detections, found))
    return told(inputs, sentences(found))


def _advised(findings: Sequence[Finding]) -> list[Finding]:
    """The same; the first that doubts all of a view says that it may show another person.

    Whoever else walks there looks like this person at another time, or from another side.
    """
    found = list(findings)
    for place, each in enumerate(found):
        doubted = each.views and not each.frames and each.severity is not Severity.INFO
        if doubted and "--people" not in each.remedy:
            found[place] = replace(each, remedy=f"{each.remedy}{_OTHERS}")
            break
    return found


def told(inputs: Inputs, lines: Sequence[str]) -> Inputs:
    """The inputs with more sentences about them, which are said at once."""
    for line in lines:
        _LOG.warning("%s", line)
    return replace(inputs, warnings=(*inputs.warnings, *lines))


def refuse_wrong(inputs: Inputs, apart: bool = False) -> None:
    """Refuse what would be captured wrongly everywhere: units, axes, pixels.

    Args:
        inputs: of the capture.
        apart: whether networks followed one person in each view, who may be another in the next,
            and ``--people`` would have been better.

    Raises:
        InputError: the inputs are such.
    """
    refuse_wrong_cameras(inputs.rig)
    found = examine_detections(inputs.rig, inputs.detections)
    agreement = examine_agreement(inputs.rig, inputs.detections)
    also = _OTHERS if apart else ""
    found += [
        replace(each, remedy=f"{each.remedy}{also}") for each in agreement if each.subject in _WHOLE
    ]
    _refuse(found)


def refuse_wrong_cameras(rig: CameraRig) -> None:
    """The same of cameras alone: people are told apart by them before anything else.

    Raises:
        InputError: they are such.
    """
    _refuse(examine_cameras(rig))


def _refuse(found: Sequence[Finding]) -> None:
    for finding in found:
        if finding.severity is Severity.ERROR:
            raise InputError(_words(finding))


def doubts(
    inputs: Inputs,
    *,
    needs_images: bool,
    detected: bool,
    alone: bool = True,
    people: bool | None = None,
    everybody: Detections | None = None,
) -> list[Finding]:
    """Findings of ``perfcap doctor`` about inputs that are read.

    They are no refusal: robust energies get along with much, and nobody but the user knows what
    was recorded. Images that show nothing are one where a stage looks at them.

    Args:
        inputs: of the capture.
        needs_images: whether a stage looks at the images.
        detected: whether the joints were found in these very images.
        alone: whether nobody else is captured; of several people see ``places``.
        people: as of ``examined``.
        everybody: as of ``examine_take``.

    Raises:
        InputError: most images of a view are of one color, and a stage needs them.
    """
    findings = examine_blank(inputs.clip, inputs.rig.names, inputs.clip.start)
    for finding in findings:
        if needs_images and finding.severity is Severity.ERROR:
            raise InputError(f"{finding.subject}: {finding.what}; {finding.remedy}")
    findings += examine_halts(inputs.clip, inputs.rig.names, inputs.clip.start)
    findings += examine_fields(inputs.clip, inputs.rig.names)
    findings += examine_cameras(inputs.rig, first=inputs.clip.start)
    fitting = detected or not alone
    findings += examine_detections(
        inputs.rig, inputs.detections, coverage=False, detected=fitting, alone=not people
    )
    take = inputs.rig, inputs.detections, inputs.clip, inputs.pixel_map
    findings += examine_take(
        *take,
        detected=detected,
        alone=people is False,
        rests=inputs.rests,
        everybody=everybody,
    )
    return findings


def way_doubts(inputs: Inputs) -> list[Finding]:
    """Whether videos show the ways of their cameras, where these are given and move.

    Args:
        inputs: of the capture, with joints of everybody who is known, (*P, F, C, 16).
    """
    take = inputs.rig, inputs.detections, inputs.clip, inputs.pixel_map
    return examine_ways(*take)


def places(inputs: Inputs) -> list[Finding]:
    """Whether joints of everybody, (P, F, C, 16), lie in the images: one person may not.

    Args:
        inputs: of the capture.
    """
    return examine_places(inputs.rig, inputs.detections)


def sentences(findings: Sequence[Finding]) -> tuple[str, ...]:
    """One for each finding that matters."""
    return tuple(
        f"{found.subject}: {found.what}; {found.remedy}"
        for found in findings
        if found.severity is not Severity.INFO
    )


def wants_bones(choice: str, generic: bool, detections: Detections) -> bool:
    """Whether to solve bone lengths; ``auto``: of nobody in particular, where views show them."""
    return choice == "solve" or (choice == "auto" and generic and shows_bone_lengths(detections))


def made_up(performance: Performance, first: int) -> Iterator[str]:
    """Frames without a capture, for a person; ``first`` is the number of the first frame."""
    for start, stop in performance.gaps:
        which, they = _spanned(first + start, first + stop)
        yield f"{which}: no person is detected; {they} interpolated"
    if performance.lost:
        start, stop = first + performance.frames, first + performance.frames + performance.lost
        which, they = _spanned(start, stop)
        yield f"{which}: {they} missing in the video or its detections"


def _spanned(start: int, stop: int) -> tuple[str, str]:
    """Frames in words, the last one of which is ``stop - 1``, and the pronoun and verb for them."""
    if stop - start == 1:
        return f"frame {start}", "it is"
    return f"frames {start} to {stop - 1}", "they are"


def _words(finding: Finding) -> str:
    remedy = f"; {finding.remedy}" if finding.remedy else ""
    return f"{finding.subject}: {finding.what}{remedy}"
