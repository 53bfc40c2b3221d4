"""What images did not show of a capture, in words."""

from __future__ import annotations

from collections.abc import Iterator

from perfcap.pipeline.evidence import AGREES, Evidence
from perfcap.pipeline.look import Looked

_ELSEWHERE = 0.5  # usual overlap with a network that finds as much wrongly as rightly


def doubts(looked: Looked) -> Iterator[str]:
    """What the images did not show, or showed against the model."""
    refinement = looked.refinement
    if looked.contours is not None and looked.contours.doubtful.any():
        yield (
            f"in {int(looked.contours.doubtful.sum())} frames hardly any edge of the images lies "
            "along the body's outline: little light, blur, clothes like the background, or an "
            "actor of another size; there the motion is about that of the joints alone"
        )
    if refinement is None:
        return
    yield from _of_frames(refinement.evidence)
    yield from mask_doubts(refinement.evidence)
    parts = (("motion", refinement.pose), ("surface", refinement.surface))
    for name, part in parts:
        if part is not None and not part.kept.all():
            yield (
                f"in {int((~part.kept).sum())} frames silhouettes did not improve the {name}; it "
                "is kept, or filled in from frames around them"
            )


def _of_frames(evidence: Evidence) -> Iterator[str]:
    """What the images themselves do not show."""
    report = evidence.report()
    if report["scene_cuts"]:
        yield f"the scene changes at frames {report['scene_cuts']}; nothing is carried across"
    if report["nobody_in_view"]:
        yield (
            f"in {len(report['nobody_in_view'])} frames the person is outside every image; "
            "nothing refines them"
        )
    if report["cropped"]:
        yield (
            f"in {len(report['cropped'])} frames the border of an image cuts the person off; what "
            "lies outside follows as it can"
        )
    if report["no_contour"]:
        yield (
            f"in {len(report['no_contour'])} frames the masks are empty or fill the image; nothing "
            "refines them"
        )
    if report["blank_images"]:
        yield (
            f"in {len(report['blank_images'])} frames an image is of one color around the person; "
            "it shows nothing, and its mask is empty (blank_images in run.json)"
        )


def mask_doubts(evidence: Evidence) -> Iterator[str]:
    """What a network says against the masks."""
    usual, doubtful = evidence.usual_agreement, evidence.doubtful
    if usual < _ELSEWHERE:
        yield (
            f"the network of the segmenter overlaps the masks by {usual:.0%} only, and counts for "
            "little; does output.person of its manifest name the class of a person, and do its "
            "size and colors fit?"
        )
    elif usual < AGREES:
        yield (
            f"a network and the masks overlap by {usual:.0%} in most frames, they may be wrong "
            "throughout: people, a mirror or colors like the person's behind? Look at masks"
        )
    if len(doubtful):
        yield (
            f"in {len(doubtful)} frames masks may be wrong: a network contradicts "
            "them; run.json names them (doubtful_masks)"
        )
