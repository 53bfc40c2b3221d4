"""Known masks of some frames: are they of the person, and do they end where the person does?"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from perfcap.app.fit_views import ChosenFrames, choose_frames, read_masks
from perfcap.app.inputs import Inputs
from perfcap.errors import InputError
from perfcap.io.doctor.mask_joints import LEAST_INSIDE, joints_inside
from perfcap.io.doctor.mask_outlines import MaskedFrames, mask_doubts
from perfcap.io.doctor.masks import examine_masks, partly_masked
from perfcap.io.mask_files import MaskFolders
from perfcap.rigging import PersonMasks

_LOOKED_AT = 12  # frames


def masked_frames(
    inputs: Inputs, count: int, masks: MaskFolders
) -> tuple[ChosenFrames, PersonMasks]:
    """Some frames that have masks in every view, spread over them.

    Raises:
        InputError: nobody is detected in these, or the masks show somebody else, or nobody.
    """
    chosen = choose_frames(inputs, count, masks.complete())
    found = read_masks(chosen, masks)
    require_person(chosen, found)
    return chosen, found


def require_person(chosen: ChosenFrames, masks: PersonMasks) -> None:
    """Refuse masks that show the person whose joints are detected in no view.

    Raises:
        InputError: they are empty, inverted, or of somebody else.
    """
    shares = joints_inside(chosen.detections, masks.inside, masks.known)
    if not bool((shares >= LEAST_INSIDE).any()):
        told = ", ".join(f"{100 * share:.0f}" for share in shares.tolist())
        raise InputError(
            f"--masks: hold {told} % of the detected joints of the views; expected images that are "
            "white where the person is, numbered as the frames of the video"
        )


def missing_masks(inputs: Inputs, masks: MaskFolders) -> Iterator[str]:
    """Views of which some frames alone have masks, a sentence each."""
    clip = inputs.clip
    for view, (name, files) in enumerate(zip(clip.names, masks.files, strict=True)):
        rows = clip.file_frames(view).tolist()
        there = {row for row in rows if row >= 0}  # a view that is late has no image of some
        yield from partly_masked(name, sorted(there & {rows[frame] for frame in files}), there)


def order_doubts(inputs: Inputs, masks: MaskFolders) -> Iterator[str]:
    """Views whose masks are of other frames for a while, or stay the same, a sentence each."""
    seen, clip = inputs.detections, inputs.clip
    pixels = inputs.pixel_map.to_video(seen.joints2d)
    for view, name in enumerate(clip.names):
        read = partial(masks.mask, view)
        shown = pixels[:, view].numpy(), seen.confidence2d[:, view].numpy()
        first = clip.start + clip.late(view)
        for found in examine_masks(name, read, *shown, first=first):
            yield f"{found.subject}: {found.what}; {found.remedy}"


def given_doubts(inputs: Inputs, masks: MaskFolders) -> Iterator[str]:
    """What a user should know of masks that a capture uses as they are, a sentence each.

    Raises:
        InputError: they show somebody else, or nobody.
    """
    if not masks.complete():
        return
    yield from mask_doubts(shown(*masked_frames(inputs, _LOOKED_AT, masks)))


def shown(chosen: ChosenFrames, masks: PersonMasks) -> MaskedFrames:
    """Chosen frames with their masks, as checks look at them."""
    seen = chosen.detections
    return MaskedFrames(chosen.clip.names, chosen, seen, masks.inside, masks.known)
