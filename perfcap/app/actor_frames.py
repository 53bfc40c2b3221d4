"""``perfcap actor frames``: stills and masks of a video around a person, for photogrammetry."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.app.console import PlainConsole, progress_bars
from perfcap.app.inputs import parse_frames
from perfcap.commands.actor import ActorFrames
from perfcap.errors import InputError
from perfcap.io.atomic import unwritable, writing
from perfcap.io.clip import Clip
from perfcap.io.doctor.finding import ranges
from perfcap.segment.central_person import MIDDLE, Area, central_person, cut_off
from perfcap.segment.still_frames import Stills, blurred, choose_stills, look_over

Image = NDArray[np.uint8]

PREVIEW = "preview.jpg"
_CHUNK = 8  # frames decoded at once
_NARROW = 0.04  # of the picture: what is narrower shows no person
_APART = 0.02  # of the picture: motion to the pictures that a mask is found with
_QUALITY, _PREVIEW_QUALITY = 97, 85
# of an edge of the box, at which masks end in the mean of the stills: those of orbits around whole
# people 0.06 at most, around people who go beyond the box 0.17 to 0.36
_CUT = 0.12
_SMALL, _LARGE = 0.3, 2.3  # times the usual area of a mask; sound ones of orbits have 0.37 to 1.9
_SHOWN, _TALL = 12, 220  # pictures of the preview, and their height, px

_LOG = logging.getLogger(__name__)


def run_frames(request: ActorFrames) -> int:
    """Write ``images/`` and ``masks/``; returns the exit code.

    Raises:
        InputError: bad input, in one line; nothing has been written then.
    """
    if not 3 <= request.count <= 1000:
        raise InputError(f"--count: is {request.count}; expected 3 to 1000 stills")
    if request.out.exists() and (not request.out.is_dir() or any(request.out.iterdir())):
        raise InputError(f"--out {request.out}: is not an empty folder; choose another")
    if request.box and request.masks == "none":
        raise InputError("--box: is for masks, and --masks none wants none; leave one of them out")
    clip = Clip.open(request.video, frames=parse_frames(request.frames))
    box = _box(request.box, clip.sizes[0])
    with progress_bars() as tell:
        stills = look_over(_all(clip, lambda done: tell("look", done, len(clip))))
        if float(stills.travel[-1]) < _APART:
            raise InputError(
                f"{request.video}: shows hardly any motion; expected a camera that goes around the "
                "person, or a person on a turntable"
            )
        chosen = choose_stills(stills, request.count)
        shown: list[Image] = []
        areas: dict[int, float] = {}
        cuts: list[Mapping[str, float]] = []
        for done, frame in enumerate(chosen, 1):
            mask = _save(request, clip, stills, frame, box)
            if mask is not None:
                areas[clip.start + frame] = float(mask.mean())
                cuts.append(cut_off(mask, box))
            if len(shown) * len(chosen) < done * _SHOWN:
                shown.append(_outlined(clip.read_view(0, frame, frame + 1)[0], mask))
            tell("write", done, len(chosen))
    _save_picture(request.out / PREVIEW, np.concatenate(shown, 1), ".jpg", _PREVIEW_QUALITY)
    about = (*_doubts(request, stills, chosen), *mask_doubts(areas, cuts))
    for line in (*clip.warnings, *about):
        _LOG.warning("%s", line)
    PlainConsole().print(
        f"{len(chosen)} of {len(clip)} frames in {request.out}; look at {request.out / PREVIEW}",
        soft_wrap=True,
        markup=False,
    )
    return 0


def _all(clip: Clip, tell: Callable[[int], None]) -> Iterator[Image]:
    for start in range(0, len(clip), _CHUNK):
        yield from clip.read_view(0, start, min(start + _CHUNK, len(clip)))
        tell(start)


def _box(numbers: tuple[float, ...], size: tuple[int, int]) -> Area:
    """Where the person stays, in shares of the picture."""
    if not numbers:
        return MIDDLE
    if len(numbers) != 4 or not (numbers[0] < numbers[2] and numbers[1] < numbers[3]):
        raise InputError("--box: expected LEFT TOP RIGHT BOTTOM in pixels, left < right")
    height, width = size
    left, top, right, bottom = numbers
    box = left / width, top / height, right / width, bottom / height
    for low, high in (box[::2], box[1::2]):
        if not (0 < (low + high) / 2 < 1 and _NARROW < high - low <= 1):
            raise InputError(
                f"--box: {left:g} {top:g} {right:g} {bottom:g} holds nobody in a picture of "
                f"{width}x{height}; expected a box in it, in pixels"
            )
    return box


def _save(
    request: ActorFrames, clip: Clip, stills: Stills, frame: int, box: Area
) -> NDArray[np.bool_] | None:
    """Write one still, and its mask if wanted; returns the mask."""
    picture = clip.read_view(0, frame, frame + 1)[0]
    name = f"{clip.start + frame:06d}"
    _save_picture(request.out / "images" / f"{name}.jpg", picture, ".jpg", _QUALITY)
    if request.masks == "none":
        return None
    around = [clip.read_view(0, f, f + 1)[0] for f in neighbours(stills, frame)]
    mask = central_person(picture, around, box)
    file = f"{name}.jpg.png" if request.masks == "colmap" else f"{name}.png"
    _save_picture(request.out / "masks" / file, 255 * mask.astype(np.uint8), ".png")
    return mask


def neighbours(stills: Stills, frame: int) -> list[int]:
    """The nearest frames before and after between which the picture has moved enough to tell."""
    away = stills.travel - stills.travel[frame]
    before, after = np.nonzero(away <= -_APART)[0], np.nonzero(away >= _APART)[0]
    return [*before[-1:].tolist(), *after[:1].tolist()]


def _save_picture(path: Path, picture: Image, kind: str, quality: int | None = None) -> None:
    stored = picture[..., ::-1] if picture.ndim == 3 else picture
    options = [] if quality is None else [cv2.IMWRITE_JPEG_QUALITY, quality]
    data = cv2.imencode(kind, stored, options)[1].tobytes()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path.parent, error) from None
    with writing(path) as file:
        file.write(data)


def _outlined(picture: Image, mask: NDArray[np.bool_] | None) -> Image:
    scale = _TALL / picture.shape[0]
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    if mask is None:
        return np.asarray(small, np.uint8)
    there = cv2.resize(mask.astype(np.uint8), small.shape[1::-1], interpolation=cv2.INTER_AREA)
    dimmed: Image = np.where(there[..., None] > 0, small, small // 4).astype(np.uint8)
    return dimmed


def _doubts(request: ActorFrames, stills: Stills, chosen: list[int]) -> Iterator[str]:
    if len(chosen) < request.count:
        yield f"only {len(chosen)} frames could be chosen; film more slowly"
    dull = blurred(stills, chosen)
    if dull:
        yield (
            f"{len(dull)} of the {len(chosen)} stills are blurred; film more slowly, or in more "
            "light"
        )


def mask_doubts(areas: Mapping[int, float], cuts: Sequence[Mapping[str, float]]) -> Iterator[str]:
    """Sentences about masks that cannot be of one whole person, who hardly grows or shrinks.

    Args:
        areas: share of the picture that each mask holds, by the number of its still.
        cuts: of the masks, ``cut_off``.
    """
    box = "--box LEFT TOP RIGHT BOTTOM says where the person stays, all of them in every still"
    usual = float(np.median(list(areas.values()))) if areas else 0.0
    odd = [n for n, area in areas.items() if not _SMALL * usual < area < _LARGE * usual]
    if odd:
        least, most = min(areas.values()), max(areas.values())
        yield (
            f"some masks are not of the person alone (stills {ranges(odd)}): masks hold "
            f"{least:.1%} to {most:.1%} of the picture, half of them less than {usual:.1%}; look "
            f"at {PREVIEW}, and leave these masks out; {box}"
        )
    at = [side for side in (cuts[0] if cuts else ()) if np.mean([c[side] for c in cuts]) > _CUT]
    if at:
        yield (
            f"masks end at the {', '.join(at)} of the box in which the person is looked for, as if "
            f"cut off; look at {PREVIEW}: {box}"
        )
