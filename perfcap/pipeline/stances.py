"""Which foot points stand in which frames; stances, stretches of them, and where they are."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import torch
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import spsolve
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.pipeline.floor import Floor, velocity
from perfcap.solve.energy import Energy

_STANDS = 0.5  # probability from which a point belongs to a stance
_SHORTEST = 0.1  # s, of a stance
_ROUNDS = 4  # of reweighting
_KERNEL = 4.0  # deviations from which a point does not stand after all
_ON_FLOOR = 0.01  # m, deviation of places from the floor
_DRIFT = 0.02  # m a frame, by which errors of a motion's place change
_ANYWHERE = 10.0  # m, within which a motion is in place

# --- Contact, frame by frame ----------------------------------------------------------------------

# Logistic regression on 28 captures of 14 clips of the CMU library (one view with 3D joints and
# four views), labels from the recorded motion: a point stands below 4.5 cm and 0.4 m/s. Features:
# height (m), log of horizontal speed in the clip's noise, log of vertical speed (m/s), height
# above the lowest point (m), ten times height squared (m^2), one.
_LOG_ODDS = (-8.16, -1.40, -1.38, -4.71, -8.50, -0.88)
_CORRELATED = 0.5  # of the evidence of a frame that is not in its neighbours' already
_SWITCHES = 4.0  # times a second that a point lands or leaves, at most
_FLOORED, _RAISED = -0.1, 0.3  # m, between which heights count


def contact_probability(soles: Tensor, floor: Floor, rate: float) -> Tensor:
    """Probability that each point stands in each frame, (F, N).

    A hidden Markov model of two states a point, standing and moving: their log odds in a frame come
    from height and speed, and changing the state has its price, so that a point that stands keeps
    standing through a doubtful frame (hysteresis). Forward-backward gives the probabilities.

    Args:
        soles: points under the feet, (F, N, 3), metres.
        floor: that they stand on.
        rate: frames a second.
    """
    height = floor.above(soles)
    speed = velocity(soles, rate)
    vertical = speed @ floor.normal
    level = (speed - vertical[..., None] * floor.normal).norm(dim=-1)
    noise = speed.norm(dim=-1).amin(-1).median()
    near = height.clamp(_FLOORED, _RAISED)
    features = (
        near,
        ((level + 0.05) / (noise + 0.1)).log().clamp(-2, 4),
        (vertical.abs() + 0.05).log(),
        (height - height.amin(-1, keepdim=True)).clamp(max=_RAISED),
        10 * near.square(),
        torch.ones_like(near),
    )
    odds = sum(w * x for w, x in zip(_LOG_ODDS, features, strict=True))
    assert isinstance(odds, Tensor)
    return _two_states(_CORRELATED * odds, min(0.5, _SWITCHES / rate))


def _two_states(odds: Tensor, switch: float) -> Tensor:
    """Posterior of the first of two states, (F, N), from log odds a frame and a rate of change."""
    frames = len(odds)
    emit = torch.stack(
        (torch.nn.functional.logsigmoid(odds), torch.nn.functional.logsigmoid(-odds))
    )
    stay, leave = math.log1p(-switch), math.log(switch)

    def moved(state: Tensor) -> Tensor:
        return torch.stack(
            (
                torch.logaddexp(state[0] + stay, state[1] + leave),
                torch.logaddexp(state[0] + leave, state[1] + stay),
            )
        )

    forward, backward = [emit[:, 0]], [torch.zeros_like(emit[:, 0])]
    for frame in range(1, frames):
        forward.append(moved(forward[-1]) + emit[:, frame])
        backward.append(moved(backward[-1] + emit[:, frames - frame]))
    both = torch.stack(forward, 1) + torch.stack(backward[::-1], 1)
    return torch.sigmoid(both[0] - both[1])


# --- Stances: stretches in which a point stands, and where ----------------------------------------


@dataclass(frozen=True)
class Stances:
    """Who stands when.

    Attributes:
        probability: that each point stands, 0 outside stances, (F, N).
        label: number of the stance of each point, -1 outside stances, (F, N).
        count: of stances.
    """

    probability: Tensor
    label: Tensor
    count: int


@dataclass(frozen=True)
class Settled:
    """Where points stand, and what makes a motion agree with it.

    Attributes:
        place: (F, N, 3), metres; the points themselves outside stances.
        probability: that each point stands there, (F, N).
        shift: of each frame's place, (F, 3), metres.
    """

    place: Tensor
    probability: Tensor
    shift: Tensor


def find_stances(sure: Tensor, rate: float) -> Stances:
    """Stretches of at least a tenth of a second in which a point rather stands than not.

    Args:
        sure: probabilities, (F, N).
        rate: frames a second.
    """
    label = _runs((sure > _STANDS).long() - 1, shortest(rate))
    return Stances(torch.where(label >= 0, sure, 0), label, int(label.amax()) + 1)


def split_stances(stances: Stances, settled: Settled, rate: float) -> Stances:
    """Stances whose point moved on while it stood, split where it did.

    A small step or a turn on the spot can look like one long stance. Frames that do not agree with
    the place of their stance become stances of their own, where they last.

    Args:
        stances: as found.
        settled: their places.
        rate: frames a second.
    """
    agrees = settled.probability > _STANDS * stances.probability
    parts = torch.where(stances.label < 0, -1, 2 * stances.label + agrees.long())
    label = _runs(parts, shortest(rate))
    return Stances(torch.where(label >= 0, stances.probability, 0), label, int(label.amax()) + 1)


def shortest(rate: float) -> int:
    """Frames of the shortest stance."""
    return max(2, round(_SHORTEST * rate))


def _runs(parts: Tensor, least: int) -> Tensor:
    """Numbers of runs of equal values (F, N) along time, -1 for negative values and short runs."""
    label = torch.full_like(parts, -1)
    count = 0
    for point in range(parts.shape[1]):
        values, lengths = torch.unique_consecutive(parts[:, point], return_counts=True)
        stop = 0
        for value, length in zip(values.tolist(), lengths.tolist(), strict=True):
            start, stop = stop, stop + length
            if value >= 0 and length >= least:
                label[start:stop, point] = count
                count += 1
    return label


def settled_places(
    soles: Tensor, stances: Stances, floor: Floor, precision: Tensor, deviation: float
) -> Settled:
    """Where each point stands: one place a stance, on the floor.

    A mean over a stance would keep the drift of the motion it is taken from (one view hardly shows
    depth), and feet that are tied to places too far apart pull legs out of shape. So places a_s and
    a correction d_f of each frame's place are found together, in one linear system:
    ``sum p |x + d - a|^2 / deviation^2 + d' precision d + |d_f - d_(f-1)|^2 / drift^2``.

    Args:
        soles: points under the feet, (F, N, 3).
        stances: of the points.
        floor: that they stand on.
        precision: of each frame's place, (F, 3, 3), 1 / m^2.
        deviation: of a point from its place, metres.

    """
    if not stances.count:
        return Settled(soles, stances.probability, soles.new_zeros(len(soles), 3))
    frame, point = (stances.label >= 0).nonzero(as_tuple=True)
    stance, sure = stances.label[frame, point], stances.probability[frame, point]
    seen, weight = soles[frame, point], sure
    shift, place = soles.new_zeros(len(soles), 3), soles
    for _ in range(_ROUNDS):
        tied = _Tied(frame, stance, seen, weight / deviation**2, stances.count)
        system, right = _system(tied, precision, floor), _right(tied, floor, len(soles))
        found = seen.new_tensor(spsolve(system, right.double().numpy(force=True)))
        shift, place = (
            found[: 3 * len(soles)].reshape(-1, 3),
            found[3 * len(soles) :].reshape(-1, 3),
        )
        off = (seen + shift[frame] - place[stance]).square().sum(-1) / deviation**2
        weight = sure / (1 + off / _KERNEL**2).square()
    places, probability = soles.clone(), torch.zeros_like(stances.probability)
    places[frame, point], probability[frame, point] = place[stance], weight
    return Settled(places, probability, shift)


@dataclass(frozen=True)
class _Tied:
    """Points that stand: their frames, stances and places (P, ...), weights in 1 / m^2."""

    frame: Tensor
    stance: Tensor
    seen: Tensor
    weight: Tensor
    count: int


def _system(tied: _Tied, precision: Tensor, floor: Floor) -> csc_array:
    """Normal matrix of d (F, 3) and a (S, 3)."""
    frames, eye = len(precision), torch.eye(3).to(precision)
    every, place = torch.arange(frames), torch.arange(tied.count) + frames
    upright = torch.outer(floor.normal, floor.normal) / _ON_FLOOR**2
    chain = (eye / _DRIFT**2).expand(frames - 1, 3, 3)
    ties = tied.weight[:, None, None] * eye
    parts = [
        (every, every, precision + eye / _ANYWHERE**2),
        (place, place, upright.expand(tied.count, 3, 3)),
        *_differences(every[1:], every[:-1], chain),
        *_differences(tied.frame.cpu(), tied.stance.cpu() + frames, ties),
    ]
    axis, size = torch.arange(3), 3 * (frames + tied.count)
    rows, columns, values = [], [], []
    for row, column, block in parts:
        rows.append((3 * row[:, None, None] + axis[:, None]).expand(block.shape).flatten())
        columns.append((3 * column[:, None, None] + axis).expand(block.shape).flatten())
        values.append(block.double().cpu().flatten())
    entries, at = torch.cat(values).numpy(), (torch.cat(rows).numpy(), torch.cat(columns).numpy())
    return csc_array(coo_array((entries, at), (size, size)))


def _differences(
    first: Tensor, second: Tensor, block: Tensor
) -> list[tuple[Tensor, Tensor, Tensor]]:
    """Normal blocks of ``|x_first - x_second|^2`` under weights (P, 3, 3)."""
    return [
        (first, first, block),
        (second, second, block),
        (first, second, -block),
        (second, first, -block),
    ]


def _right(tied: _Tied, floor: Floor, frames: int) -> Tensor:
    """Right side of the normal equations, (3 (F + S),)."""
    pull = tied.weight[:, None] * tied.seen
    of_frames = pull.new_zeros(frames, 3).index_add(0, tied.frame, -pull)
    of_places = pull.new_zeros(tied.count, 3).index_add(0, tied.stance, pull)
    of_places = of_places + floor.height * floor.normal / _ON_FLOOR**2
    return torch.cat((of_frames, of_places)).flatten()


@torch.no_grad()
def translation_precision(energies: Iterable[Energy[Motion]], motion: Motion) -> Tensor:
    """Curvature of energies in the place of each frame, (F, 3, 3), 1 / m^2.

    Args:
        energies: of single frames.
        motion: (F,).
    """
    total = motion.translation.new_zeros(motion.frames, 3, 3)
    for energy in energies:
        linear = energy.linearize(motion)
        rows = linear.frame[..., :3]  # F G d 3
        slope = energy.kernel.slope(linear.residual.squared_norm())
        if linear.residual.confidence is not None:
            slope = slope * linear.residual.confidence
        weight = energy.weight.to(slope) * slope
        total = total + torch.einsum("fg,fgdi,fgdj->fij", weight, rows, rows)
    return total
