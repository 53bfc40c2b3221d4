"""Centred filters over frames: the last step of surface refinement (Xu 2018, Sec. 5.3; MPC-31).

A filter of width 2n + 1 has taps ``c_0`` at the frame itself and ``c_k`` at the frames k before and
after, so nothing lags. Its gain at f cycles per frame is ``c_0 + 2 sum_k c_k cos(2 pi f k)``:

    f (at 30 fps)    1/30 (1 Hz)  1/10 (3 Hz)  1/5 (6 Hz)  3/10 (9 Hz)  1/2 (15 Hz)   white noise
    box(5)               0.957        0.647        0          -0.247        0.2          0.447
    binomial(5)          0.978        0.818        0.428       0.119        0            0.523

The box lets a fifth of frame-to-frame flicker through and turns the phase of what lies between
its zeros. The binomial's gain falls from 1 to 0 without either, and takes half as much from slow
motion; it is the default. Either moves a point that accelerates by a: the box by ``a dt^2``, the
binomial by half of that, inwards. So smooth what is small beside a smooth motion (node warps,
displacements of a skinned surface), not fast limbs in the world.

Frames before and after are weighed alike, each pair as the worse of the two: near the ends of a
clip the window shrinks on both sides, and where a frame could not be measured its counterpart is
left out as well. A motion at constant velocity therefore passes unchanged, everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.setting_checks import require_count
from perfcap.temporal.turns import require_no_turns
from perfcap.temporal.window import (
    Mean,
    mean_rotations,
    mean_vectors,
    require_floats,
    require_vectors,
)

WIDTH = 5  # frames, Xu 2018
CHUNK = 8  # frames at once, so that memory does not grow with them
_LEAST = 1e-6  # of a confidence: where nothing was measured all frames count alike

Taps = tuple[float, ...]  # c_0 ... c_n
_Believed = tuple[Tensor, int]  # values (1, ...) of a frame before others, and where it is: -1, ...


def box(width: int = WIDTH) -> Taps:
    """Equal taps over ``width`` frames, an odd number."""
    reach = _reach(width)
    return (1 / width,) * (reach + 1)


def binomial(width: int = WIDTH) -> Taps:
    """Taps of Pascal's triangle over ``width`` frames, an odd number: 6, 4, 1 sixteenths for 5."""
    reach = _reach(width)
    return tuple(math.comb(2 * reach, reach + k) / 4**reach for k in range(reach + 1))


def gain(taps: Sequence[float], frequency: float) -> float:
    """What a filter leaves of an oscillation of ``frequency`` cycles per frame."""
    around = (c * math.cos(2 * math.pi * frequency * k) for k, c in enumerate(taps) if k)
    return taps[0] + 2 * sum(around)


def smooth_vectors(
    values: Tensor, taps: Sequence[float] | None = None, confidence: Tensor | None = None
) -> Tensor:
    """Smooth anything that may be averaged, (F, ...), over its frames.

    Args:
        values: (F, ...).
        taps: c_0 to c_n, not negative; ``binomial()`` if None.
        confidence: how far each frame is to be believed, (F,), 0 to 1; a frame of none takes
            its value from those around it, and may hold NaN.

    Raises:
        InputError: taps or confidence that are none, whole numbers, NaN in other frames, or
            rotation vectors and angles that pass half a turn, or quaternions that change sign.
    """
    return _smooth(values, mean_vectors, taps, confidence)


def smooth_rotations(
    rotations: Tensor, taps: Sequence[float] | None = None, confidence: Tensor | None = None
) -> Tensor:
    """Smooth rotation vectors (F, ..., 3), radians, over frames by means of rotations.

    Arguments are those of ``smooth_vectors``; vectors that differ by full turns are one rotation.

    Raises:
        InputError: as of ``smooth_vectors``, or rotation matrices.
    """
    require_vectors(rotations)
    return _smooth(rotations, mean_rotations, taps, confidence)


class Smoother:
    """Smooths a clip piece by piece and hands out frames as soon as they are final.

    Holds no more frames than the filter is wide, so a clip of any length streams in constant
    memory, and frames that are no numbers until one that is believed follows; the pieces together
    are what smoothing the clip at once gives::

        smoother = Smoother(mean_vectors)
        for values in pieces:
            write(smoother.push(values))
        write(smoother.finish())

    Args:
        mean: ``mean_vectors``, ``mean_rotations`` or another weighted mean.
        taps: c_0 to c_n, not negative; ``binomial()`` if None.
    """

    def __init__(self, mean: Mean, taps: Sequence[float] | None = None) -> None:
        self._mean = mean
        self._taps = _checked(binomial() if taps is None else taps)
        self._held: tuple[Tensor, Tensor] | None = None  # values (f, ...), confidence (f,)
        self._next = 0  # of the held frames, the first that is still to be handed out
        self._before: _Believed | None = None

    def push(self, values: Tensor, confidence: Tensor | None = None) -> Tensor:
        """Take the next frames (f, ...) and their confidence (f,); return those now final.

        Raises:
            InputError: as of ``smooth_vectors``.
        """
        require_floats(values)
        confidence = _confidence(values, confidence)
        if self._held is not None:
            values = torch.cat((self._held[0], values))
            confidence = torch.cat((self._held[1], confidence))
        known = _known(values, confidence)
        if known:
            filled = _filled(values[:known], confidence[:known], self._before)
            values = torch.cat((filled, values[known:]))
        return self._emit(values, confidence, known - self._reach)

    def finish(self) -> Tensor:
        """The remaining frames, (f, ...); the smoother is empty afterwards."""
        if self._held is None:
            raise InputError("no frame was given; push at least one before finishing")
        values, confidence = self._held
        finished = self._emit(_filled(values, confidence, self._before), confidence, len(values))
        self._held, self._next, self._before = None, 0, None
        return finished

    @property
    def _reach(self) -> int:
        return len(self._taps) - 1

    def _emit(self, values: Tensor, confidence: Tensor, stop: int) -> Tensor:
        """Smooth frames up to ``stop`` and hold those that later frames still look back to."""
        stop = max(stop, self._next)
        finished = _filter(values, confidence, range(self._next, stop), self._taps, self._mean)
        kept = max(stop - self._reach, 0)
        self._before = _last_believed(values[:kept], confidence[:kept], self._before)
        # a copy, as a view would keep every frame before it alive
        self._held = (values[kept:].clone(), confidence[kept:].clone())
        self._next = stop - kept
        return finished


def _smooth(
    values: Tensor, mean: Mean, taps: Sequence[float] | None, confidence: Tensor | None
) -> Tensor:
    checked = _checked(binomial() if taps is None else taps)
    believed = _confidence(values, confidence)
    values = _filled(values, believed)
    return _filter(values, believed, range(len(values)), checked, mean)


def _known(values: Tensor, confidence: Tensor) -> int:
    """The number of frames whose values do not hang on frames that are still to come.

    Raises:
        InputError: believed frames that are no numbers.
    """
    finite = _finite(values)
    _require_believed(finite, confidence)
    waits = ~finite
    believed = (finite & (confidence > 0)).nonzero().squeeze(1)
    if len(believed):
        waits[: int(believed[-1])] = False
    first = waits.nonzero().squeeze(1)
    return int(first[0]) if len(first) else len(values)


def _finite(values: Tensor) -> Tensor:
    """Which frames are all numbers, (F,)."""
    return values.detach().isfinite().unsqueeze(-1).flatten(1).all(1)


def _last_believed(
    values: Tensor, confidence: Tensor, before: _Believed | None
) -> _Believed | None:
    """The last frame that is believed, counted from behind these frames, which are left behind."""
    finite = _finite(values)
    believed = (finite & (confidence > 0)).nonzero().squeeze(1).tolist()
    if believed:
        last = believed[-1]
        return values[last : last + 1].clone(), last - len(values)
    return None if before is None else (before[0], before[1] - len(values))


def _require_believed(finite: Tensor, confidence: Tensor) -> None:
    """Refuse believed frames (F,) that are no numbers."""
    lost = (~finite & (confidence > 0)).nonzero().squeeze(1).tolist()
    if lost:
        raise InputError(
            f"values of frames {lost[:5]} are not finite; give those frames a confidence of 0, and "
            "at least one frame more"
        )


def _filled(values: Tensor, confidence: Tensor, before: _Believed | None = None) -> Tensor:
    """Values of whose frames without confidence, what is no number is as in the nearest believed.

    The one ``before`` the others is one of these.

    Raises:
        InputError: whole numbers, in which no mean is; or believed frames that are no numbers.
    """
    require_floats(values)
    finite = _finite(values)
    if bool(finite.all()):
        return values
    _require_believed(finite, confidence)
    believed = (finite & (confidence > 0)).nonzero().squeeze(1)
    if not len(believed) and before is None:
        raise InputError(
            "values of all frames are not finite or not believed; expected one frame that is both"
        )
    frame = torch.arange(len(values), device=values.device)
    place = believed if before is None else torch.cat((believed.new_tensor([before[1]]), believed))
    nearest = place[(frame[:, None] - place).abs().argmin(1)]
    found = torch.where(finite, frame, nearest)
    if before is None:
        return values[found]
    return torch.cat((before[0], values))[(found + 1).clamp(min=0)]


def _filter(values: Tensor, confidence: Tensor, frames: range, taps: Taps, mean: Mean) -> Tensor:
    """Filtered values of some frames, (f, ...), in chunks; all others are there to look at."""
    if mean is mean_vectors:
        require_no_turns(values)
    parts = [values[:0]]
    for start in range(frames.start, frames.stop, CHUNK):
        chunk = torch.arange(start, min(start + CHUNK, frames.stop), device=values.device)
        index, weights = _window(chunk, confidence, taps)
        parts.append(mean(values[index], weights.to(values.dtype)))
    return torch.cat(parts)


def _window(frames: Tensor, confidence: Tensor, taps: Taps) -> tuple[Tensor, Tensor]:
    """Frames (f, 2n + 1) that make up each of some frames, and weights that sum to one.

    The frame of largest weight comes first, as means of rotations start from it.
    """
    steps = torch.arange(len(taps), device=frames.device)
    pairs = torch.stack((frames[:, None] - steps, frames[:, None] + steps))  # 2 f n+1
    inside = ((pairs >= 0) & (pairs < len(confidence))).all(0)
    pairs = pairs.clamp(0, len(confidence) - 1)
    worse = confidence[pairs].clamp_min(_LEAST).amin(0)
    # the frame itself is a pair of one
    shares = torch.tensor([taps[0] / 2, *taps[1:]], dtype=torch.float64, device=frames.device)
    weights = torch.where(inside, worse * shares, 0).repeat(1, 2)
    weights = weights / weights.sum(1, keepdim=True)
    order = weights.argsort(dim=1, descending=True, stable=True)
    return torch.cat(tuple(pairs), 1).gather(1, order), weights.gather(1, order)


def _confidence(values: Tensor, confidence: Tensor | None) -> Tensor:
    """Confidence of each frame, (F,) float64."""
    if confidence is None:
        return torch.ones(len(values), dtype=torch.float64, device=values.device)
    if confidence.shape != values.shape[:1]:
        raise InputError(
            f"confidence has shape {tuple(confidence.shape)} but there are {len(values)} frames; "
            "give one number a frame"
        )
    if not bool((confidence.isfinite() & (confidence >= 0)).all()):
        raise InputError("confidence holds negative or infinite numbers; give 0 to 1 a frame")
    return confidence.to(values.device, torch.float64)


def _checked(taps: Sequence[float]) -> Taps:
    if not taps or min(taps) < 0 or taps[0] <= 0 or not math.isfinite(sum(taps)):
        raise InputError(
            f"taps are {tuple(taps)}; give c_0 > 0 and others that are not negative, as box() and "
            "binomial() do"
        )
    if max(taps) > taps[0]:
        raise InputError(
            f"taps are {tuple(taps)}, which weigh other frames more than the frame itself; give "
            "c_0 of the frame first, then c_1 of both beside it, ...: the latter half of a kernel"
        )
    return tuple(taps)


def _reach(width: int) -> int:
    require_count(width, "width")
    if width % 2 == 0:
        raise InputError(f"width is {width}; a centred filter spans an odd number of frames")
    return width // 2
