"""Known masks of some frames: are they of the person, and do they end where the person does?"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial

from perfcap.app.body_doubts import outline_doubts, require_person
from perfcap.app.fit_views import ChosenFrames, choose_frames, read_masks
from perfcap.app.inputs import Inputs
from perfcap.io.doctor.masks import examine_masks
from perfcap.io.mask_files import MaskFolders
from perfcap.rigging import PersonMasks
from perfcap.rigging.mask_checks import LEAST_INSIDE, joints_inside, limb_doubts

_LOOKED_AT = 12  # frames
_FROM_ONE = "; if their numbers begin with 1, each is a frame late: begin with 0"


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


def partly_masked(inputs: Inputs, masks: MaskFolders) -> Iterator[str]:
    """Views of which some frames alone have masks, a sentence each."""
    clip = inputs.clip
    for view, (name, files) in enumerate(zip(clip.names, masks.files, strict=True)):
        rows = clip.file_frames(view).tolist()
        there = {row for row in rows if row >= 0}  # a view that is late has no image of some
        given = sorted(there & {rows[frame] for frame in files})
        if given and len(given) < len(there):
            yield (
                f"masks of {name}: are given for {len(given)} of {len(there)} frames, {given[0]} "
                f"to {given[-1]} (counted from 0); those of the others are found in the images"
                f"{_FROM_ONE if _counts_from_one(given, there) else ''}"
            )


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


def _counts_from_one(given: Collection[int], there: Collection[int]) -> bool:
    """Whether masks of all frames but the first are there: their numbers may begin with 1."""
    return 0 in there and set(given) == set(there) - {0}


def given_doubts(inputs: Inputs, masks: MaskFolders) -> Iterator[str]:
    """What a user should know of masks that a capture uses as they are, a sentence each.

    Raises:
        InputError: they show somebody else, or nobody.
    """
    if not masks.complete():
        return
    clip = inputs.clip
    chosen, found = masked_frames(inputs, _LOOKED_AT, masks)
    shares = joints_inside(chosen.detections, found).tolist()
    yield from limb_doubts(clip.names, chosen.detections, found)
    for name, share in zip(clip.names, shares, strict=True):
        if share < LEAST_INSIDE:
            yield (
                f"masks of {name}: hold {100 * share:.0f} % of the detected joints; expected those "
                "of the person, numbered as the frames of the video"
            )
    yield from outline_doubts(chosen, found, girths=False)
