"""Corners of a floor and a wall, seen by a camera that is moved."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.matchmove import Sightings

Array = NDArray[np.float64]

FOCAL, SIDE, RATE = 700.0, 640, 30.0
MIDDLE = 0.5 * (SIDE - 1)


@dataclass(frozen=True)
class Filmed:
    """A way and what is seen on it."""

    rotation: Array
    translation: Array
    sightings: Sightings

    @property
    def frames(self) -> int:
        """F."""
        return len(self.rotation)


def filmed(
    frames: int = 60,
    *,
    turn: float = 12.0,
    walk: float = 0.0,
    ahead: float = 0.0,
    zoom: float = 1.0,
    noise: float = 0.2,
    wild: float = 0.0,
    points: int = 160,
    seed: int = 0,
) -> Filmed:
    """Sightings of points that come and go.

    Args:
        frames: F.
        turn: degrees to the side, in all.
        walk: metres to the side, in all.
        ahead: metres to the front, in all.
        zoom: the last focal length by the first.
        noise: of sightings, px.
        wild: share of the points that walk about.
        points: on the floor, and on the wall.
        seed: of all that is drawn.
    """
    rng = np.random.default_rng(seed)
    share = np.linspace(0, 1, frames)
    bend = 0.15 * np.sin(9 * share)
    turned = np.radians(turn) * np.stack((bend, share, 0.3 * bend), -1)
    rotation = Rotation.from_rotvec(turned).as_matrix()
    rotation = rotation @ rotation[0].T
    centre = walk * np.stack((share, 0.1 * bend, 0.2 * bend), -1)
    centre[:, 2] += ahead * share
    translation = -np.einsum("fij,fj->fi", rotation, centre - centre[0])
    floor = np.stack(
        (rng.uniform(-5, 5, points), np.full(points, 1.4), rng.uniform(3, 9, points)), -1
    )
    wall = np.stack(
        (rng.uniform(-6, 6, points), rng.uniform(-2, 1.4, points), np.full(points, 9.0)), -1
    )
    place = np.concatenate((floor, wall))
    astray = rng.uniform(size=len(place)) < wild
    steps = rng.normal(0, 0.05, (frames, len(place), 3)).cumsum(0) * astray[:, None]
    local = np.einsum("fij,fpj->fpi", rotation, place + steps) + translation[:, None]
    focal = FOCAL * zoom ** share[:, None, None]
    pixels = focal * local[..., :2] / local[..., 2:] + MIDDLE
    pixels += rng.normal(0, noise, pixels.shape)
    begin = rng.integers(-20, frames, len(place))
    length = rng.integers(10, 40, len(place))
    now = np.arange(frames)[:, None]
    seen = (now >= begin) & (now < begin + length) & (local[..., 2] > 0.1)
    seen &= ((pixels > 0) & (pixels < SIDE)).all(-1)
    frame, point = np.nonzero(seen)
    return Filmed(rotation, translation, Sightings(frame, point, pixels[seen], 1.0))
