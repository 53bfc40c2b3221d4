"""What lies beside the character in 3D: the input videos, and what is drawn over them."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import av
import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.clip import Clip
from perfcap.io.result import Result
from perfcap.io.result_folder import OVERLAY, own_file
from perfcap.report.outlines import Outlines, mask_outlines, shown_cameras, surface_outlines
from perfcap.report.sources import Sources

# --- Input videos made small enough to lie inside a page ------------------------------------------

LONGEST_SIDE = 640  # px of a shown video
BUDGET = 12_000_000  # bytes of all videos of a page, for long clips
_MOST = 100_000_000  # bits a second, more than any quality needs; the encoder counts to 2^31
_BATCH = 8  # frames in memory at once
_FAR = 1_000_000  # frames, more than any view is late by
_QUALITY = {"crf": "25", "preset": "medium", "profile": "baseline"}
# Key frames close together and no frames that are shown in another order: scrubbing is quick,
# and frame i is shown at its own time.
_SEEKABLE = {"g": "12", "bf": "0"}

Image = NDArray[np.uint8]


def shown_size(size: tuple[int, int]) -> tuple[int, int]:
    """Height and width of a shown video, even as H.264 needs them; never enlarged."""
    scale = min(1.0, LONGEST_SIDE / max(size))
    height, width = (max(2, 2 * round(side * scale / 2)) for side in size)
    return height, width


def encode_view(
    clip: Clip, view: int, rate: float, progress: Callable[[int, int], None] | None = None
) -> bytes:
    """A view of a clip as an H.264 file that browsers decode (baseline profile, yuv420p).

    Args:
        clip: the frames.
        view: which.
        rate: frames a second.
        progress: called with (frames done, frames).

    Raises:
        InputError: a frame can no longer be read.
    """
    height, width = shown_size(clip.sizes[view])
    most = min(int(8 * BUDGET * rate / (len(clip) * clip.views)), _MOST)  # bits a second
    options = {**_QUALITY, **_SEEKABLE, "maxrate": str(most), "bufsize": str(2 * most)}
    sink = io.BytesIO()
    with av.open(sink, "w", format="mp4") as container:
        stream = container.add_stream(
            "libx264", Fraction(rate).limit_denominator(1001), options=options
        )
        stream.height, stream.width, stream.pix_fmt = height, width, "yuv420p"
        for done, image in enumerate(_images(clip, view), 1):
            small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(small, format="rgb24")))
            if progress is not None:
                progress(done, len(clip))
        container.mux(stream.encode())
    return sink.getvalue()


def _images(clip: Clip, view: int) -> Iterator[Image]:
    for start in range(0, len(clip), _BATCH):
        yield from clip.read_view(view, start, min(start + _BATCH, len(clip)))


# --- What lies beside the character in 3D: the input videos, and what is drawn over them ----------

MOST = 8  # views with a video in a page

Progress = Callable[[str, int, int], None]
Size = tuple[int, int]


@dataclass
class Views:
    """Views of a page.

    Attributes:
        plain: name, size, and what there is of each view, for JSON.
        arrays: outlines, joints and cameras, by name and number of the view.
        videos: encoded videos by name.
        notes: what is missing, and why.
    """

    plain: list[dict[str, Any]] = field(default_factory=list)
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    videos: dict[str, bytes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def build_views(
    result: Result, rows: slice, sources: Sources, tell: Progress, videos: bool = True
) -> Views:
    """Encode the videos and trace what is drawn over them.

    Without the input videos, ``overlay.mp4`` of the result is shown; without that, outlines on a
    plain background where there are cameras. Without ``videos``, which others show already, there
    is what is drawn over them alone.
    """
    views = Views()
    if videos and sources.clip is None and own_file(result.folder, OVERLAY) is not None:
        _add_overlay(views, result, rows, tell)
        if views.plain:
            return views
    sizes = _sizes(sources)
    if not sizes:
        return views
    if len(sizes) > MOST:
        views.notes.append(f"The first {MOST} of {len(sizes)} views are shown.")
    for view, size in enumerate(sizes[:MOST]):
        views.plain.append({"name": sources.names[view], "height": size[0], "width": size[1]})
        if videos and sources.clip is not None:
            _add_video(views, sources.clip, view, result.rate, tell)
    _add_masks(views, result, rows, sources, sizes[:MOST])
    if sources.cameras is not None:
        _add_projections(views, result, rows, sources, sources.cameras, sizes[:MOST])
    return views


def _sizes(sources: Sources) -> list[Size]:
    if sources.clip is not None:
        return [shown_size(size) for size in sources.clip.sizes]
    return [] if sources.cameras is None else [shown_size(size) for size in sources.cameras.size]


def _add_video(views: Views, clip: Clip, view: int, rate: float, tell: Progress) -> None:
    name = f"video-{view}"

    def told(done: int, total: int) -> None:
        tell(f"video {view + 1}", done, total)

    try:
        views.videos[name] = encode_view(clip, view, rate, told)
        views.plain[view]["video"] = name
    except InputError as error:
        views.notes.append(f"A video is not shown: {error}.")


def _add_overlay(views: Views, result: Result, rows: slice, tell: Progress) -> None:
    """The video of the result itself, in which outlines are painted already."""
    try:
        clip = Clip.open(result.folder / OVERLAY, frames=rows)
        size = shown_size(clip.sizes[0])
        views.plain.append({"name": OVERLAY, "height": size[0], "width": size[1]})
        _add_video(views, clip, 0, result.rate, tell)
        views.notes.append("overlay.mp4 of the capture is shown instead of the input.")
    except InputError as error:
        views.notes.append(f"overlay.mp4 is not shown: {error}.")


def _add_masks(
    views: Views, result: Result, rows: slice, sources: Sources, sizes: list[Size]
) -> None:
    for view, size in enumerate(sizes):
        numbers = (result.frame_numbers[rows] + _late(result, sources.names[view])).tolist()
        found = mask_outlines(result.folder, sources.names, view, numbers, size)
        if found is not None:
            _put(views, view, "mask", found)


def _late(result: Result, name: str) -> int:
    """Frames by which a view's masks are numbered later; older results number all alike."""
    late = result.report.get("late_frames")
    step = late.get(name) if isinstance(late, dict) else None
    return step if isinstance(step, int) and abs(step) < _FAR else 0


def _add_projections(
    views: Views,
    result: Result,
    rows: slice,
    sources: Sources,
    cameras: Camera,
    sizes: list[Size],
) -> None:
    """Outlines of the surface, joints and detections in the images, and the cameras themselves."""
    chosen = list(range(len(sizes)))
    full = cameras.select(chosen)
    small = shown_cameras(full, sizes)
    for view, found in enumerate(surface_outlines(result, rows, small, sizes)):
        _put(views, view, "outline", found)
    joints = small.project(torch.from_numpy(result.joints[rows]).to(small.intrinsics))
    for view in chosen:
        # drawings count from the corner of the image
        views.arrays[f"joints2d-{view}"] = _single(joints[:, view] + 0.5)
        _put_camera(views, view, small)
    if sources.detections is not None:
        _add_detections(views, sources.detections, full.size, sizes)


def _add_detections(
    views: Views, seen: Detections, full: Sequence[Size], sizes: Sequence[Size]
) -> None:
    """Detected joints, in pixels of the shown videos."""
    for view, (small, large) in enumerate(zip(sizes, full, strict=True)):
        scale = seen.joints2d.new_tensor((small[1] / large[1], small[0] / large[0]))
        views.arrays[f"detected-{view}"] = _single((seen.joints2d[:, view] + 0.5) * scale)
        views.arrays[f"confidence-{view}"] = _single(seen.confidence2d[:, view])


def _put(views: Views, view: int, kind: str, outlines: Outlines) -> None:
    views.plain[view][kind] = True
    views.arrays[f"{kind}-rings-{view}"] = outlines.rings
    views.arrays[f"{kind}-lengths-{view}"] = outlines.lengths
    views.arrays[f"{kind}-points-{view}"] = outlines.points


def _put_camera(views: Views, view: int, cameras: Camera) -> None:
    """Intrinsics, rotation and translation, (F or 1, 3, 7), side by side."""
    one = cameras.select([view])
    parts = (one.intrinsics, one.rotation, one.translation[..., None])
    table = torch.cat(parts, -1).reshape(-1, 3, 7)
    views.arrays[f"camera-{view}"] = _single(table)


def _single(values: Tensor) -> NDArray[np.float32]:
    numbers: NDArray[np.float32] = values.detach().cpu().float().numpy()
    return numbers
