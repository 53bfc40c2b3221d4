"""What images did not show of a capture, in words."""

from __future__ import annotations

from collections.abc import Iterator

from perfcap.pipeline.look import Looked


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
    report = refinement.evidence.report()
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
    if report["doubtful_masks"]:
        yield (
            f"in {len(report['doubtful_masks'])} frames masks may be wrong: a network contradicts "
            "them; run.json names them (doubtful_masks)"
        )
    parts = (("motion", refinement.pose), ("surface", refinement.surface))
    for name, part in parts:
        if part is not None and not part.kept.all():
            yield (
                f"in {int((~part.kept).sum())} frames silhouettes did not improve the {name}; it "
                "is kept, or filled in from frames around them"
            )
