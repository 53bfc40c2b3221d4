"""Sample the animation of any glTF file: nodes in the world at even times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from perfcap.io.gltf_document import Document, Object
from perfcap.io.gltf_scene import NodeTree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_WIDTHS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3"}
_USUAL = 30.0  # a second, of clips whose keys are too few to tell
_SLOWEST, _FASTEST = 15.0, 240.0  # keys a second that are taken for the rate
_MOST = 1 << 22  # transforms: twelve minutes of a hundred bones at 60 a second
_FARTHEST = 1e12  # units
_SAME = 1e-6  # s, below which two keys are one


@dataclass(frozen=True, eq=False)
class NodeClip:
    """Some nodes of a file in motion.

    Attributes:
        world: node-to-world transforms, (F, N, 4, 4).
        rate: frames a second.
        notes: what a user should know.
    """

    world: Floats
    rate: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Track:
    """One channel: times (K,) in seconds, and values (K, n) or, cubic, (K, 3, n)."""

    node: int
    path: str
    times: Floats
    values: Floats
    how: str


def sample_clip(document: Document, tree: NodeTree, nodes: Integers) -> NodeClip:
    """The first animation of a file, at the rate of its keys.

    Args:
        document: an open file.
        tree: its nodes.
        nodes: those that are asked for, (N,).

    Raises:
        InputError: there is no animation, or it is damaged or too long.
    """
    chain = _with_ancestors(tree, nodes)
    tracks = list(_tracks(document, set(chain)))
    if not tracks:
        raise document.error("holds no animation of its bones; expected a character that moves")
    start = min(float(track.times[0]) for track in tracks)
    end = max(float(track.times[-1]) for track in tracks)
    rate = _rate(tracks)
    if (end - start) * rate * len(chain) >= _MOST:
        raise document.error(f"its animation lasts {end - start:.6g} s, more than is read; cut it")
    times = start + np.arange(int((end - start) * rate + 1e-3) + 1) / rate
    moved: dict[int, dict[str, Floats]] = {}
    for track in tracks:
        moved.setdefault(track.node, {})[track.path] = _sampled(track, times)
    world: dict[int, Floats] = {}
    for node in chain:
        parent, local = int(tree.parents[node]), _local(document, node, moved.get(node, {}))
        world[node] = local if parent < 0 else world[parent] @ local
    shape = (len(times), 4, 4)
    result = np.stack([np.broadcast_to(world[int(node)], shape) for node in nodes], 1)
    if not np.abs(result).max() < _FARTHEST:
        raise document.error("its animation leads beyond all bounds; the file is damaged")
    return NodeClip(result, rate, tuple(_others(document)))


def _others(document: Document) -> Iterator[str]:
    """That there are animations which are not taken."""
    names = [repr(each.get("name", ""))[:40] for each in document.items("animations")]
    if len(names) > 1:
        rest = ", ".join(names[1:6]) + (", ..." if len(names) > 6 else "")
        yield f"its first animation, {names[0]}, is taken; {rest} are not: delete others to choose"


def _tracks(document: Document, wanted: set[int]) -> Iterator[_Track]:
    """Channels of some nodes; of several that move the same, the first one."""
    nodes, known = len(document.items("nodes")), set()
    for animation in document.items("animations")[:1]:
        samplers = _list(document, animation.get("samplers"))
        for channel in _list(document, animation.get("channels")):
            target = channel.get("target")
            path = target.get("path") if isinstance(target, dict) else None
            if not isinstance(target, dict) or not isinstance(path, str) or path not in _WIDTHS:
                continue
            if "node" not in target:
                continue  # an extension's
            node = document.integer(target["node"], "target.node", 0, nodes - 1)
            if node not in wanted or (node, path) in known:
                continue
            known.add((node, path))
            number = document.integer(channel.get("sampler"), "sampler", 0, len(samplers) - 1)
            yield _track(document, samplers[number], node, path)


def _track(document: Document, sampler: Object, node: int, path: str) -> _Track:
    times = document.accessor(sampler.get("input"), "SCALAR")[:, 0].astype(np.float64)
    values = document.accessor(sampler.get("output"), _WIDTHS[path]).astype(np.float64)
    how = sampler.get("interpolation", "LINEAR")
    if how not in ("LINEAR", "STEP", "CUBICSPLINE"):
        raise document.error(f"damaged file, an animation is interpolated by {how!r:.40}")
    cubic = how == "CUBICSPLINE"
    if len(values) != (3 if cubic else 1) * len(times):
        raise document.error(f"damaged file, {len(times)} keys have {len(values)} values")
    good = np.isfinite(times).all() and np.isfinite(values).all() and np.all(np.diff(times) >= 0)
    if not good or np.abs(values).max() > _FARTHEST:
        raise document.error("damaged file, an animation holds wild numbers, or keys out of order")
    values = values.reshape(len(times), 3, -1) if cubic else values
    kept = np.append(np.diff(times) > _SAME, True)  # of equal times the last counts
    return _Track(node, path, times[kept], values[kept], str(how))


def _rate(tracks: list[_Track]) -> float:
    """Of the channel with most keys."""
    busiest = max(tracks, key=lambda track: len(track.times)).times
    if len(busiest) < 2:
        return _USUAL
    found = float(1 / np.median(np.diff(busiest)))
    if found < _SLOWEST:
        return _USUAL
    nearest = round(found)
    return min(_FASTEST, float(nearest) if abs(found - nearest) < 1e-3 * nearest else found)


def _sampled(track: _Track, times: Floats) -> Floats:
    """Values at some times, (F, n); before the first key and after the last they stay."""
    inside = np.clip(times, track.times[0], track.times[-1])
    # times of frames are computed, keys are read in float32: a key is meant where they nearly meet
    after = np.searchsorted(track.times, inside + 1e-5, side="right")
    before = np.clip(after - 1, 0, len(track.times) - 1)
    if track.how == "STEP" or len(track.times) == 1:
        plain = track.values[:, 1] if track.how == "CUBICSPLINE" else track.values
        return np.asarray(plain[before])
    if track.how == "CUBICSPLINE":
        return _hermite(track, inside, np.minimum(before, len(track.times) - 2))
    if track.path == "rotation":
        return np.asarray(
            Slerp(track.times, Rotation.from_quat(_unit(track.values)))(inside).as_quat()
        )
    columns = [np.interp(inside, track.times, column) for column in track.values.T]
    return np.stack(columns, -1)


def _hermite(track: _Track, times: Floats, before: Integers) -> Floats:
    start, end = track.times[before], track.times[before + 1]
    step = (end - start)[:, None]
    t = (times - start)[:, None] / step
    one, two = track.values[before], track.values[before + 1]
    return np.asarray(
        (2 * t**3 - 3 * t**2 + 1) * one[:, 1]
        + step * (t**3 - 2 * t**2 + t) * one[:, 2]
        + (3 * t**2 - 2 * t**3) * two[:, 1]
        + step * (t**3 - t**2) * two[:, 0]
    )


def _unit(quaternions: Floats) -> Floats:
    """Quaternions that are all zero say nothing: no turn."""
    nothing = np.linalg.norm(quaternions, axis=-1) < 1e-6
    return np.where(nothing[:, None], [0.0, 0.0, 0.0, 1.0], quaternions)


def _with_ancestors(tree: NodeTree, nodes: Integers) -> list[int]:
    """Nodes and all above them, parents first."""
    needed: set[int] = set()
    for node in nodes.tolist():
        while node >= 0 and node not in needed:
            needed.add(node)
            node = int(tree.parents[node])
    return [node for node in tree.order if node in needed]


def _local(document: Document, node: int, moved: dict[str, Floats]) -> Floats:
    """Node-to-parent transforms, (F, 4, 4), or (4, 4) of a node that stays."""
    entry = document.items("nodes")[node]
    if "matrix" in entry:
        return document.numbers(entry["matrix"], 16, "node.matrix").reshape(4, 4).T
    place = _part(document, entry, moved, "translation", [0.0, 0, 0])
    turn = Rotation.from_quat(_unit(_part(document, entry, moved, "rotation", [0.0, 0, 0, 1])))
    size = _part(document, entry, moved, "scale", [1.0, 1, 1])
    frames = max(len(place), len(turn), len(size))
    local = np.tile(np.eye(4), (frames, 1, 1))
    local[:, :3, :3] = turn.as_matrix() * size[:, None, :]
    local[:, :3, 3] = place
    return local if frames > 1 else local[0]


def _part(
    document: Document, entry: Object, moved: dict[str, Floats], name: str, usual: list[float]
) -> Floats:
    if name in moved:
        return moved[name]
    return document.numbers(entry.get(name, usual), len(usual), f"node.{name}")[None]


def _list(document: Document, value: Any) -> list[Object]:
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise document.error("damaged file, an animation has no channels or samplers")
    return value
