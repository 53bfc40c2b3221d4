"""What the settings of a capture are not made for."""

from __future__ import annotations

from collections.abc import Iterator

from perfcap.geometry.camera import Camera
from perfcap.pipeline.config import MONOPERFCAP_POSE
from perfcap.pipeline.presets import CaptureConfig


def preset_doubts(
    config: CaptureConfig,
    views: int,
    looked_at: bool = True,
    *,
    preset: str = "preset",
    default: str = "PRESETS['default']",
) -> Iterator[str]:
    """Sentences about settings that get motion in the way of a preset other than the default one.

    Args:
        config: of the capture, as it is given; with changes of one's own, too.
        views: C.
        looked_at: whether a stage looks at images.
        preset: what the reader calls one, before its name.
        default: what they call the settings that suit all views.
    """
    if not looked_at and (config.contours.enabled or config.frames is not None):
        name = "rhodin2016" if config.contours.enabled else "liu2013"
        yield (
            f"{preset} {name}: is what is done with images, and no stage looks at any; the motion "
            f"is that of {default}: give images, or leave until out"
        )
        return
    other = _other_way(config)
    if other is None:
        return
    said = f"{preset} {other}"
    if other != "monoperfcap" and views == 1:
        yield (
            f"{said}: is a method of several views, and there is one; {default} sees depth better"
        )
    if other == "monoperfcap" and views > 1:
        yield (
            f"{said}: has the published weights of one view, and there are {views}; {default} is "
            "made for several"
        )
    yield (
        f"{said}: which frames are trusted, and the errors that run.json expects, were learned "
        f"from captures with {default}; those of others may be larger"
    )


def held_cameras(
    config: CaptureConfig, cameras: Camera, people: int, looked_at: bool
) -> Iterator[str]:
    """A sentence where ``refine_cameras`` is asked for, and cameras stay where they are given.

    Args:
        config: of the capture.
        cameras: C views, (C,) or (F, C).
        people: how many are captured together.
        looked_at: whether a stage looks at images.
    """
    if not config.refine_cameras.enabled:
        return
    if cameras.views == 1:
        why = "there is one view, and several show where each stands"
    elif cameras.moving:
        why = "they move"
    elif people > 1:
        why = f"there are {people} people, and it is made for one"
    elif not looked_at:
        why = "no stage looks at images (solve_views refines cameras by joints)"
    elif config.frames is not None or not config.segment:
        why = "these settings find no silhouettes of all frames at once"
    else:
        return
    yield f"refine_cameras: cameras stay as they are given, since {why}"


def _other_way(config: CaptureConfig) -> str | None:
    """The preset whose way from joints to motion settings have; None of the default one.

    Settings are compared where presets differ for good: somebody may have changed others.
    """
    if config.frames is not None:
        return "liu2013"
    if config.pose.paths is not None:
        return "muvs2017"
    published = config.pose.position == MONOPERFCAP_POSE.position
    return "monoperfcap" if published else None
