"""The floor of a motion: the plane that its feet stand on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import turn_to_y

_HIPS = [LANDMARKS.index(name) for name in ("r_hip", "l_hip")]
_NECK = LANDMARKS.index("neck")
_PARTS = (  # ends of the body's parts, and their shares of its mass
    *(("neck", f"{side}_hip", 0.2485) for side in "rl"),
    ("neck", "head_top", 0.081),
    *((f"{side}_hip", f"{side}_knee", 0.100) for side in "rl"),
    *((f"{side}_knee", f"{side}_ankle", 0.0465) for side in "rl"),
    *((f"{side}_ankle", f"{side}_toe", 0.0145) for side in "rl"),
    *((f"{side}_shoulder", f"{side}_elbow", 0.028) for side in "rl"),
    *((f"{side}_elbow", f"{side}_wrist", 0.022) for side in "rl"),
)
_MASSES = [(LANDMARKS.index(a), LANDMARKS.index(b), share) for a, b, share in _PARTS]
_LOWERED, _LOWER = 5, 0.1  # rounds, and m, below which another foot hardly bears weight
_TILT = math.radians(6)  # deviation of the body's mean axis from vertical
_LOOSE, _TIGHT = 0.05, 0.02  # m, deviations of heights below and above the plane
_SPEED = 0.6  # m/s, on top of a clip's own noise, at which a point counts a quarter
_SHARE = 0.05  # s, of every frame as evidence: errors of neighbouring frames are the same
_ROUNDS, _WIDENED, _WIDE = 30, 10, 3.0  # of the fit; with kernels that narrow over the first ones
_LOW = 0.15  # quantile of heights to start from
_RIGID = 1e-4  # rad, deviation from an axis of the world
_AS_WELL = 0.8  # of the support of a free normal, that an axis of the world needs
_CAMERA_WORLD = 1e-3  # entries of a rotation by which the world's axes are not the camera's
_NEAREST = math.cos(math.radians(30))  # of the body's axis to an axis of the world
_NEAR = 0.04  # m, from the plane: a point that it explains
_UNSURE, _NEVER = (
    0.15,
    0.5,
)  # s, of a clip's noise, farther; and m/s, noise of feet that never stand

# in recorded motion with y up, climbing as well, a floor of such support leans by far less
_LEANS, _LIES = 12.0, 60.0  # degrees
_SURE = 0.8  # support of a floor that leans
_WHILE = 1.0  # s, that such a motion lasts
_UNLIKE = 0.85  # of it, that a level one has no more than


@dataclass(frozen=True)
class Floor:
    """The plane ``normal . x = height`` in the world.

    Attributes:
        normal: unit vector that points up, (3,).
        height: metres.
        deviation: expected error of the normal, radians.
        support: share of slow foot points that lie within 4 cm of it, farther where feet of all
            frames tremble, 0 to 1.
    """

    normal: Tensor
    height: Tensor
    deviation: float
    support: float

    def world_to_floor(self) -> Tensor:
        """Rigid transform (4, 4) into a world with the floor at y = 0 and y up.

        Headings stay as they can (``geometry.rotation.turn_to_y``).
        """
        turn = turn_to_y(self.normal)
        moved = torch.eye(4).to(turn)
        moved[:3, :3], moved[1, 3] = turn, -self.height
        return moved

    def report(self) -> dict[str, Any]:
        """As plain values, for run.json."""
        return {
            "normal": self.normal.tolist(),
            "height": float(self.height),
            "deviation_degrees": math.degrees(self.deviation),
            "support": self.support,
            "world_to_floor": self.world_to_floor().tolist(),
        }

    def above(self, points: Tensor) -> Tensor:
        """Heights of points (..., 3) above the floor, (...), metres."""
        return points @ self.normal - self.height


def find_floor(
    landmarks: Tensor,
    soles: Tensor,
    rate: float,
    cameras: Camera | None = None,
    normal: Tensor | None = None,
) -> Floor:
    """A robust plane through points under the feet while they are slow.

    The body's mean axis is a prior for up, heights of slow points are the data; points above the
    plane are let go earlier than points below it, since feet are lifted and do not sink. People
    calibrate with an axis of the world upright: the axis nearest to the body's is taken instead of
    the free normal where a floor square to it explains the points about as well.

    Args:
        landmarks: (F, 16, 3), metres, in the world.
        soles: points under the feet, (F, N, 3).
        rate: frames a second.
        cameras: calibrated ones, whose world may have an upright axis; a world that is a camera's
            own has none.
        normal: of the floor, a unit vector (3,) that points up, where it is known.
    """
    up = body_axis(landmarks, soles) if normal is None else normal
    speed = velocity(soles, rate).norm(dim=-1)
    noise = speed.amin(-1).median()
    slow = (1 + (speed / (_SPEED + noise)).square()).square().reciprocal().flatten()
    points = soles.flatten(0, 1)
    share = slow / (rate * _SHARE * soles.shape[1] * 2 * _TIGHT**2)
    near = _NEAR + _UNSURE * float(noise / (1 + (noise / _NEVER) ** 4))
    if normal is not None:
        return _fit(points, slow, share, normal, _RIGID, near)
    free = _fit(points, slow, share, up, _TILT, near)
    axis = None if cameras is None else _upright_axis(cameras, up)
    if axis is None:
        return free
    square = _fit(points, slow, share, axis, _RIGID, near)
    return square if square.support > _AS_WELL * free.support else free


def lean_doubts(landmarks: Tensor, soles: Tensor, rate: float, level: Floor) -> Iterator[str]:
    """A sentence where feet stand on a plane that leans, and the body with it.

    Who climbs stairs stands upright; in the world of a camera that looks down, both lean. A moment,
    in which one foot stands, shows neither.

    Args:
        landmarks: (F, 16, 3), metres, in a world whose y is said to be up.
        soles: points under the feet, (F, N, 3).
        rate: frames a second.
        level: the floor if y is up.
    """
    if len(landmarks) < _WHILE * rate:
        return
    free = find_floor(landmarks, soles, rate)
    leans = [
        math.degrees(math.acos(min(1.0, float(each @ level.normal))))
        for each in (free.normal, body_axis(landmarks, soles))
    ]
    if free.support < _SURE or level.support > _UNLIKE * free.support:
        return
    if min(leans) > _LEANS and max(leans) < _LIES:
        yield (
            f"feet stand on a floor that leans by {leans[0]:.0f} degrees against y, and the person "
            "leans as well; the source's world looks like that of a camera that looks down or up: "
            "turn it level, and of a capture give the folder, not a file of it"
        )


def _fit(
    points: Tensor, slow: Tensor, share: Tensor, up: Tensor, deviation: float, within: float
) -> Floor:
    """The plane through points (P, 3), its normal near ``up``, by reweighted least squares."""
    centre = points.mean(0)
    points = points - centre
    across = _square_to(up)
    tilt, normal = up.new_zeros(2), up
    low = _quantile(points @ up, slow, _LOW)
    prior = up.new_tensor([deviation**-2, deviation**-2, 1e-9])
    system = torch.diag(prior)
    for step in range(_ROUNDS):
        wide = max(1.0, _WIDE * (1 - step / _WIDENED))
        height = points @ normal - low
        size = wide * torch.where(height > 0, _TIGHT, _LOOSE)
        weight = share / (1 + (height / size).square()).square()
        rows = torch.cat((points @ across, -torch.ones_like(height)[:, None]), -1)
        system = rows.mT @ (weight[:, None] * rows) + torch.diag(prior)
        slope = rows.mT @ (weight * height) + prior * torch.cat((tilt, tilt.new_zeros(1)))
        change = -torch.linalg.solve(system, slope)
        tilt, low = tilt + change[:2], low + change[2]
        normal = up + across @ tilt
        normal = normal / normal.norm()
    near = (points @ normal - low).abs() < within
    support = float((slow * near).sum() / slow.sum().clamp(min=1e-9))
    spread = torch.linalg.inv(system).diagonal()[:2].sum().clamp(min=0).sqrt()
    return Floor(normal, low + centre @ normal, float(spread), support)


def _upright_axis(cameras: Camera, up: Tensor) -> Tensor | None:
    """The signed axis of the world nearest to ``up``, (3,), if it is near and not a camera's."""
    turns = cameras.rotation.reshape(-1, 3, 3).to(up)
    own = (turns.abs() - torch.eye(3).to(turns)).abs().amax((-2, -1)) < _CAMERA_WORLD
    index = int(up.abs().argmax())
    if bool(own.any()) or float(up[index].abs()) < _NEAREST:
        return None
    axis = torch.zeros_like(up)
    axis[index] = up[index].sign()
    return axis


def body_axis(landmarks: Tensor, soles: Tensor) -> Tensor:
    """Mean direction from the feet to the middle of the trunk, a unit vector (3,)."""
    hips = landmarks[:, _HIPS].mean(1)
    return _unit(_mean_direction(0.5 * (hips + landmarks[:, _NECK]) - soles.mean(1)))


def weight_axis(landmarks: Tensor, soles: Tensor) -> tuple[Tensor, float]:
    """Mean direction from what carries a body on level ground to its centre of mass.

    Who stands on one leg has their weight above it: of points under the feet those that are lower
    along the axis count for more.

    Args:
        landmarks: (F, 16, 3).
        soles: points under the feet, (F, N, 3).

    Returns:
        A unit vector (3,), and how alike the frames' directions are: the length of their mean.
    """
    mass = centre_of_mass(landmarks)
    mean = _mean_direction(mass - soles.mean(1))
    for _ in range(_LOWERED):
        share = torch.softmax(-(soles @ _unit(mean)) / _LOWER, -1)
        mean = _mean_direction(mass - (share[..., None] * soles).sum(1))
    return _unit(mean), float(mean.norm())


def centre_of_mass(landmarks: Tensor) -> Tensor:
    """Of bodies of landmarks (F, 16, 3), (F, 3), by Winter's shares of the body's parts (2009)."""
    total = sum(share for _, _, share in _MASSES)
    parts = [0.5 * share * (landmarks[:, a] + landmarks[:, b]) for a, b, share in _MASSES]
    centre: Tensor = torch.stack(parts).sum(0) / total
    return centre


def _mean_direction(vectors: Tensor) -> Tensor:
    """Mean of the directions of vectors (F, 3), (3,); shorter than one where they differ."""
    mean: Tensor = (vectors / vectors.norm(dim=-1, keepdim=True).clamp(min=1e-9)).mean(0)
    return mean


def _unit(vector: Tensor) -> Tensor:
    unit: Tensor = vector / vector.norm().clamp(min=1e-9)
    return unit


def velocity(points: Tensor, rate: float) -> Tensor:
    """Central differences of points (F, ..., 3), m/s; one-sided at the ends."""
    if len(points) < 2:
        return torch.zeros_like(points)
    step = points.diff(dim=0) * rate
    inner = 0.5 * (step[1:] + step[:-1])
    return torch.cat((step[:1], inner, step[-1:]))


def _square_to(axis: Tensor) -> Tensor:
    """Two unit vectors square to a third one and to each other, as columns (3, 2)."""
    other = torch.eye(3).to(axis)[int(axis.abs().argmin())]
    first = torch.linalg.cross(axis, other)
    first = first / first.norm()
    return torch.stack((first, torch.linalg.cross(axis, first)), -1)


def _quantile(values: Tensor, weights: Tensor, level: float) -> Tensor:
    order = values.argsort()
    share = weights[order].cumsum(0)
    return values[order][int((share < level * share[-1]).sum())]
