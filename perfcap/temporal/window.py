"""Cut a clip into overlapping windows, and blend what was solved in each back into one clip.

Xu et al. 2018 solve windows of 50 frames that overlap by 10 and blend the overlaps linearly. In an
overlap, window k fades in over the frames it shares with the windows before it,

    a_k(f) = (f - start_k + 1) / (stop_(k-1) - start_k + 1),  clipped to one,

and weighs ``a_k * prod_(j > k) (1 - a_j)``. The weights are linear where two windows meet, sum to
one however many do, and those of a frame are known once the next window starts after it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.rotation import rotation_mean
from perfcap.setting_checks import require_count

# Weighted mean over covering windows: values (F, M, ...) and weights (F, M) to (F, ...). The
# window of largest weight comes first.
Mean = Callable[[Tensor, Tensor], Tensor]
_SQUARE = 1e-4  # that products of rows of a rotation matrix may be off


@dataclass(frozen=True)
class Window:
    """Frames ``start <= f < stop`` of a clip."""

    start: int
    stop: int

    def __post_init__(self) -> None:
        require_count(self.start, "start of a window", least=0)
        require_count(self.stop, "stop of a window")
        if not 0 <= self.start < self.stop:
            raise InputError(
                f"window [{self.start}, {self.stop}) holds no frames of a clip; give "
                "0 <= start < stop"
            )

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def index(self) -> slice:
        """The frames as an index into anything whose axis is the clip's frames."""
        return slice(self.start, self.stop)


def partition(frames: int, length: int = 50, overlap: int = 10) -> list[Window]:
    """Windows of equal length that cover a clip, each sharing ``overlap`` frames with the next.

    The last window is shifted back to end with the clip, so it may share more frames with its
    neighbours; a clip shorter than ``length`` is one window of its own length.

    Args:
        frames: frames of the clip, at least 1.
        length: frames of a window, at least 1.
        overlap: frames shared by neighbours, less than ``length``.

    Raises:
        InputError: there are no such frames, or windows would not come forward.
    """
    require_count(frames, "frames of the clip")
    require_count(length, "length")
    require_count(overlap, "overlap", least=0)
    if overlap >= length:
        raise InputError(f"overlap is {overlap} with length {length}; give 0 <= overlap < length")
    length = min(length, frames)
    last = frames - length
    starts = range(0, last, length - overlap) if last else ()
    return [Window(start, start + length) for start in (*starts, last)]


def blend_weights(
    windows: Sequence[Window], frames: int, dtype: torch.dtype | None = None
) -> Tensor:
    """Weight of each window in each of its own frames, (N, L); one at every frame in all.

    Args:
        windows: in order, of equal length L, covering the clip without gaps.
        frames: frames of the clip.
        dtype: of the result; torch's default if None.
    """
    _check_cover(windows, frames)
    rows = []
    for n, window in enumerate(windows):
        beyond = (m for m in range(n + 1, len(windows)) if windows[m].start >= window.stop)
        near = windows[max(n - 1, 0) : next(beyond, len(windows))]
        rows.append(_weights(near, range(window.start, window.stop))[min(n, 1)])
    return torch.stack(rows).to(dtype or torch.get_default_dtype())


def blend_vectors(windows: Sequence[Window], values: Tensor) -> Tensor:
    """One clip (F, ...) from the values of windows (N, L, ...), for anything that may be averaged.

    Exact where one window covers a frame and where all that cover it agree.
    """
    return _blend(windows, values, mean_vectors)


def blend_rotations(windows: Sequence[Window], rotations: Tensor) -> Tensor:
    """One clip of rotation vectors (F, ..., 3) from those of windows (N, L, ..., 3), radians.

    The mean is of rotations, not of their vectors: half and full turns make no difference.

    Raises:
        InputError: rotation matrices, or windows that do not cover the clip.
    """
    require_vectors(rotations)
    return _blend(windows, rotations, mean_rotations)


def mean_vectors(values: Tensor, weights: Tensor) -> Tensor:
    """Weighted mean (F, ...) of values (F, M, ...) with weights (F, M) that sum to one."""
    weights = weights.to(values.dtype).reshape(weights.shape + (1,) * (values.dim() - 2))
    # around the first value, so that equal values return themselves to the last bit
    return values[:, 0] + (weights * (values - values[:, :1])).sum(1)


def mean_rotations(rotvecs: Tensor, weights: Tensor) -> Tensor:
    """Weighted mean (F, ..., 3) of rotation vectors (F, M, ..., 3) with weights (F, M).

    Spherical interpolation where two windows meet; see ``rotation_mean``.
    """
    last = rotvecs.movedim(1, -2)  # F ... M 3
    weights = weights.reshape(len(weights), *(1,) * (last.dim() - 3), -1)
    return rotation_mean(last, weights)


def require_vectors(rotations: Tensor) -> None:
    """Refuse what is no rotation vector (..., 3), such as the rows of a rotation matrix.

    Raises:
        InputError: it is something else.
    """
    shape = tuple(rotations.shape)
    if shape[-1:] != (3,):
        raise InputError(f"rotations have shape {shape}, expected rotation vectors (..., 3)")
    if shape[-2:] != (3, 3) or 0 in shape:
        return
    one = rotations.detach() @ rotations.detach().mT
    if bool(((one - torch.eye(3).to(one)).abs() < _SQUARE).all()):
        raise InputError(
            f"rotations {shape} are rotation matrices, expected rotation vectors (..., 3), "
            "radians; perfcap.geometry.matrix_to_rotvec makes them"
        )


def require_floats(values: Tensor) -> None:
    """Refuse whole numbers, in which means are cut off.

    Raises:
        InputError: values are such.
    """
    if not values.is_floating_point():
        raise InputError(f"values are {values.dtype}; give floating-point numbers: means are some")


class Blender:
    """Blends windows one after another and hands out frames as soon as they are final.

    Holds only the windows that the next one may still overlap, so a clip of any length streams
    in constant memory::

        blender = Blender(mean_vectors)
        for window, values in solved:
            write(blender.push(window, values))
        write(blender.finish())

    Args:
        mean: ``mean_vectors``, ``mean_rotations`` or another weighted mean.
    """

    def __init__(self, mean: Mean) -> None:
        self._mean = mean
        self._held: list[tuple[Window, Tensor]] = []
        self._emitted = 0

    def push(self, window: Window, values: Tensor) -> Tensor:
        """Take the values (L, ...) of the next window; return the frames now final, (f, ...)."""
        reached = self._held[-1][0].stop if self._held else 0
        earliest = self._held[-1][0].start if self._held else 0
        if not earliest <= window.start <= reached or window.stop < reached:
            raise InputError(
                f"window [{window.start}, {window.stop}) follows one of [{earliest}, {reached}); "
                "push windows in order and without gaps"
            )
        require_floats(values)
        if values.shape[0] != len(window):
            raise InputError(
                f"values have {values.shape[0]} frames but window [{window.start}, {window.stop}) "
                f"has {len(window)}; give one value a frame"
            )
        finished = self._emit(window.start) if self._held else values[:0]
        self._held.append((window, values))
        return finished

    def finish(self) -> Tensor:
        """The remaining frames, (f, ...); the blender is empty afterwards."""
        if not self._held:
            raise InputError("no window was given; push at least one before finishing")
        finished = self._emit(self._held[-1][0].stop)
        self._held, self._emitted = [], 0
        return finished

    def _emit(self, stop: int) -> Tensor:
        windows = [window for window, _ in self._held]
        values = [value for _, value in self._held]
        finished = _blend_span(windows, values, range(self._emitted, stop), self._mean)
        # the newest stays even when it is spent: it is what the next window fades in over
        self._held = [held for held in self._held[:-1] if held[0].stop > stop] + self._held[-1:]
        self._emitted = stop
        return finished


def _blend(windows: Sequence[Window], values: Tensor, mean: Mean) -> Tensor:
    frames = max(window.stop for window in windows) if windows else 0
    _check_cover(windows, frames)
    if values.shape[:2] != (len(windows), len(windows[0])):
        raise InputError(
            f"values have shape {tuple(values.shape)} but there are {len(windows)} windows of "
            f"{len(windows[0])} frames; give (windows, frames, ...)"
        )
    blender = Blender(mean)
    parts = [blender.push(window, value) for window, value in zip(windows, values, strict=True)]
    return torch.cat([*parts, blender.finish()])


def _blend_span(
    windows: Sequence[Window], values: Sequence[Tensor], span: range, mean: Mean
) -> Tensor:
    """Blend the frames of a span, run by run of frames covered by the same windows."""
    cuts = {span.start, span.stop}
    cuts.update(edge for w in windows for edge in (w.start, w.stop) if edge in span)
    edges = sorted(cuts)
    parts = [
        _blend_run(windows, values, Window(start, stop), mean)
        for start, stop in itertools.pairwise(edges)
    ]
    return torch.cat(parts) if parts else values[0][:0]


def _blend_run(
    windows: Sequence[Window], values: Sequence[Tensor], run: Window, mean: Mean
) -> Tensor:
    cover = [n for n, w in enumerate(windows) if w.start <= run.start and run.stop <= w.stop]
    inside = [values[n][run.start - windows[n].start : run.stop - windows[n].start] for n in cover]
    if len(cover) == 1:
        return inside[0]
    weights = _weights([windows[n] for n in cover], range(run.start, run.stop))
    weights = weights.mT.to(inside[0].device)  # F M
    order = weights.argsort(dim=1, descending=True, stable=True)
    stacked = torch.stack(inside, 1)
    rows = torch.arange(len(run), device=stacked.device)[:, None]
    return mean(stacked[rows, order], weights.gather(1, order))


def _weights(windows: Sequence[Window], frames: range) -> Tensor:
    """Weight of each window at each frame, (N, F), float64, if no earlier window reaches them."""
    steps = torch.arange(frames.start, frames.stop, dtype=torch.float64)
    weights = [torch.ones_like(steps)]
    for before, window in itertools.pairwise(windows):
        ramp = (steps - window.start + 1) / max(before.stop - window.start + 1, 1)
        fade = ramp.clamp(0, 1)
        weights = [weight * (1 - fade) for weight in weights] + [fade]
    return torch.stack(weights)


def _check_cover(windows: Sequence[Window], frames: int) -> None:
    lengths = {len(window) for window in windows}
    if len(lengths) != 1:
        raise InputError(f"windows have lengths {sorted(lengths)}; give windows of one length")
    edges = [0, *(window.stop for window in windows)]
    gaps = any(window.start > edge for window, edge in zip(windows, edges, strict=False))
    ordered = all(a.start <= b.start for a, b in itertools.pairwise(windows))
    if gaps or not ordered or edges[-1] != frames:
        raise InputError(
            f"windows do not cover the {frames} frames of the clip in order and without gaps; "
            "make them with partition()"
        )
