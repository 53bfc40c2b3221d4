"""Which limb is whose: left and right of a person followed through a video.

A network that sees one frame takes a back for a front now and then, and puts both sides on one
limb. But nobody turns round between two frames: joints move a little and steadily, so what holds of
most frames holds of those between. A stretch of hundreds of wrong frames outvotes that; people who
turn by more than 25 degrees a frame are beyond it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.candidates import Candidates

_WINDOW = 7  # frames in a row that are to move steadily
_AROUND = 6  # frames on both sides that smooth the way of the whole body
_UNSTEADY = 0.12  # of the crop: pairs further from it tell no more
_VOTE = 0.005  # of what one frame says of sides: what misleads it misleads its neighbours too
_DOUBT = 0.02  # support that any place has
_MOVED = 0.03  # of the crop: deviation of a joint from frame to frame
_JUMP = 8.0  # nats, what a jump costs at most
_RARE = 1e-3  # support that any place of a single joint has
_SAME = 0.6  # nats that both sides in one place cost
_CLOSE = 0.03  # of the crop: one place


@dataclass(frozen=True)
class Track:
    """Joints of one person in F frames in a row.

    Attributes:
        points: pixels of the image, (F, J, 2).
        confidence: (F, J).
        candidates: where else they may be; None where the network has no heat maps.
        size: of what the network looked at, pixels of the image, (F,).
    """

    points: Tensor
    confidence: Tensor
    candidates: Candidates | None
    size: Tensor


def settle_sides(track: Track, mirrored: Sequence[int]) -> tuple[Track, Tensor]:
    """Give the joints of a track the sides that its motion allows.

    Each pair's places first, by the Viterbi algorithm among the candidates of both: such that the
    heat maps support, near those of the frames around, and not both the same. Then the whole
    body's, by the same algorithm: the frames in which sides are exchanged, so that joints move
    steadily and most frames keep what they show. In the end each pair's again, from what was
    seen, exchanged where that is nearer to what was found so far. Joints that stay where they were
    seen are left as they are. Two frames say nothing of the whole body; what was not seen in a row
    is settled apart.

    Args:
        track: what the network sees frame by frame.
        mirrored: each joint's counterpart on the other side; itself in the middle.

    Returns:
        The track, and the frames whose sides were exchanged, (F,).
    """
    order = list(mirrored)
    pairs = [(joint, other) for joint, other in enumerate(order) if other > joint]
    if len(track.points) < 2 or not pairs:
        return track, torch.zeros(len(track.points), dtype=torch.bool, device=track.points.device)
    calm = _choose(track, pairs)
    likely = _exchange(calm, _exchanged(calm, order, pairs), order)
    exchanged = _apart(track.points, likely) > _apart(track.points[:, order], likely)
    return _choose(_exchange(track, exchanged, order), pairs), exchanged


def _apart(points: Tensor, track: Track) -> Tensor:
    """How far points are from a track, each joint counting so much at most, (F,)."""
    error = (points - track.points).norm(dim=-1) / track.size[:, None]
    total: Tensor = error.nan_to_num(0.0).clamp(max=_UNSTEADY).sum(-1)
    return total


def _exchanged(track: Track, order: list[int], pairs: list[tuple[int, int]]) -> Tensor:
    """Frames in which the whole body's sides are the other way round, (F,).

    A state of the chain is the choice for several frames in a row, whose joints are to move
    steadily: a single frame of mixed sides does not part those around it, and left and right of
    somebody who turns may cross.
    """
    count = min(_WINDOW, len(track.points))
    # bit d of a state: whether the frame d ago is exchanged
    states = np.arange(2**count)
    bits = (states[:, None] >> np.arange(count)) & 1
    before = np.stack([(states >> 1) | (oldest << (count - 1)) for oldest in (0, 1)])
    costs = _unsteadiness(track, pairs, 1 - 2 * bits)
    votes = (_VOTE * _evidence(track, order)).cpu().double().numpy()
    score = np.zeros(len(states))
    came_from = []
    for vote, cost in zip(votes, costs, strict=True):
        best = score[before].argmax(0)
        came_from.append(before[best, states])
        score = score[before].max(0) - cost - vote * bits[:, 0]
    state = int(score.argmax())
    exchanged = []
    for previous in reversed(came_from):
        exchanged.append(bool(state & 1))
        state = int(previous[state])
    return torch.tensor(exchanged[::-1], device=track.points.device)


def _unsteadiness(
    track: Track, pairs: list[tuple[int, int]], signs: NDArray[np.int64]
) -> NDArray[np.float64]:
    """How far from steady the joints of the last frames move, for each choice of their sides.

    Args:
        track: what is seen.
        pairs: left and right.
        signs: -1 where a frame is exchanged, of the newest frame first, (S, W).

    Returns:
        Nats, (F, S); 0 for the first W - 1 frames.
    """
    left, right = (list(side) for side in zip(*pairs, strict=True))
    apart = (track.points[:, left] - track.points[:, right]) / track.size[:, None, None]
    seen = apart.nan_to_num(0.0).cpu().double().numpy()  # exchanging sides changes its sign alone
    count = signs.shape[1]
    ago = np.arange(count)
    line = np.stack((np.ones(count), ago), 1)
    beside = np.eye(count) - line @ np.linalg.pinv(line)
    costs = np.zeros((len(seen), len(signs)))
    for frame in range(count - 1, len(seen)):
        chosen = signs[:, :, None, None] * seen[frame - ago]  # S W P 2
        error = np.linalg.norm(np.einsum("vw,swpc->spvc", beside, chosen), axis=(-2, -1))
        costs[frame] = (error / _UNSTEADY).clip(max=1.0).sum(-1)
    return costs


def _placed(track: Track, places: Tensor) -> Tensor:
    """Places (F, ..., 2) in sizes of the crop about the median joint, since people run."""
    lead = (-1, *(1,) * (places.dim() - 2))
    middle = _smoothed(_filled(track.points.nanmedian(1).values)).reshape(*lead, 2)
    return ((places - middle) / track.size.reshape(*lead, 1)).nan_to_num(0.0)


def _filled(places: Tensor) -> Tensor:
    """Places (F, 2) with those of frames in which nothing is seen on the line between others."""
    seen = places.isfinite().all(-1).cpu().numpy()
    if seen.all() or not seen.any():
        return places.nan_to_num(0.0)
    frames, known = np.arange(len(seen)), places.detach().cpu().double().numpy()
    between = [np.interp(frames, frames[seen], column[seen]) for column in known.T]
    return torch.from_numpy(np.stack(between, -1)).to(places)


def _smoothed(values: Tensor) -> Tensor:
    """The line through the values (F, 2) of frames around each, there."""
    smooth = torch.empty_like(values)
    for frame in range(len(values)):
        near = values[max(0, frame - _AROUND) : frame + _AROUND + 1]
        offset = np.arange(len(near)) - min(frame, _AROUND)
        weights = np.linalg.pinv(np.stack((np.ones(len(near)), offset), 1))[0]
        smooth[frame] = torch.from_numpy(weights).to(values) @ near
    return smooth


def _evidence(track: Track, order: list[int]) -> Tensor:
    """What each frame says for its sides as they are, nats, (F,)."""
    there = torch.zeros_like(track.confidence)
    if track.candidates is not None:
        places, support = track.candidates.places, track.candidates.support
        apart = (places - track.points[:, order, None]).norm(dim=-1)
        near = apart < _CLOSE * track.size[:, None, None]
        there = torch.where(near, support, 0.0).amax(-1)
    sided = torch.tensor([joint != other for joint, other in enumerate(order)])
    says = ((track.confidence + _DOUBT) / (there + _DOUBT)).log()
    return torch.where(sided.to(says.device), says, 0.0).nan_to_num(0.0).sum(-1)


def _exchange(track: Track, where: Tensor, order: list[int]) -> Track:
    frames, joint = where[:, None], where[:, None, None]
    found = track.candidates
    if found is not None:
        other = found.take(order)
        found = Candidates(
            torch.where(joint[..., None], other.places, found.places),
            torch.where(joint, other.support, found.support),
        )
    return Track(
        torch.where(joint, track.points[:, order], track.points),
        torch.where(frames, track.confidence[:, order], track.confidence),
        found,
        track.size,
    )


def _choose(track: Track, pairs: list[tuple[int, int]]) -> Track:
    """The likeliest places of pairs of joints, by the Viterbi algorithm, all pairs at once."""
    if track.candidates is None:
        return track
    both = [list(side) for side in zip(*pairs, strict=True)]
    relative = _placed(track, track.candidates.places)
    places = [relative[:, side] for side in both]  # 2 x (F, P, C, 2)
    support = [track.candidates.support[:, side] for side in both]
    score = (support[0] + _RARE).log()[..., :, None] + (support[1] + _RARE).log()[..., None, :]
    apart = (places[0][..., :, None, :] - places[1][..., None, :, :]).norm(dim=-1)
    score = score - _SAME * (apart < _CLOSE).to(score)  # F P C C
    jumps = [_jumps(side) for side in places]  # 2 x (F - 1, P, C now, C before)
    best, came_from = score[0], []
    for frame in range(1, len(score)):
        # over the first joint's place before, then over the second's
        reached, first = (best[:, None] - jumps[0][frame - 1][..., None]).max(2)  # P now before
        total, second = (reached[:, :, None] - jumps[1][frame - 1][:, None]).max(3)  # P now now
        came_from.append((first, second))
        best = total + score[frame]
    pair = torch.arange(len(pairs), device=best.device)
    last = best.flatten(1).argmax(1)
    now = last // best.shape[-1], last % best.shape[-1]
    chosen = [now]
    for first, second in reversed(came_from):
        other = second[pair, now[0], now[1]]
        now = first[pair, now[0], other], other
        chosen.append(now)
    points, confidence = track.points.clone(), track.confidence.clone()
    for number, side in enumerate(both):
        index = torch.stack([state[number] for state in reversed(chosen)])[..., None]  # F P 1
        at = index[..., None].expand(*index.shape, 2)
        place = track.candidates.places[:, side].gather(2, at)[:, :, 0]
        moved = (place - points[:, side]).norm(dim=-1) >= _CLOSE * track.size[:, None]
        points[:, side] = torch.where(moved[..., None], place, points[:, side])
        trust = support[number].gather(2, index)[..., 0]
        confidence[:, side] = torch.where(moved, trust, confidence[:, side])
    return Track(points, confidence, track.candidates, track.size)


def _jumps(places: Tensor) -> Tensor:
    """Cost of moves between the candidates of frames in a row, (F - 1, P, C now, C before)."""
    moved = (places[1:, :, :, None] - places[:-1, :, None]).norm(dim=-1) / _MOVED
    cost: Tensor = (0.5 * moved.square()).clamp(max=_JUMP)
    return cost
