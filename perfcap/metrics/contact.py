"""Feet on the floor: how they slide, and how deep they sink; and how near two people come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.signed_gap import Mesh, signed_gap
from perfcap.metrics.missing import PERSON, check_heights, check_metres, frame_mean
from perfcap.rates import frame_rate
from perfcap.setting_checks import require_number

CONTACT_HEIGHT = 0.05  # m above a point's rest height on the floor
CONTACT_SPEED = 0.3  # m/s

_MILLIMETRES = 1000.0
_STEEP = 10.0  # times the way of a foot that its height changes: of a slope, less
_UNIT = 1e-3  # that the length of a direction may be off


@dataclass(frozen=True)
class Penetration:
    """How deep a person sinks into the floor, each (*b).

    Attributes:
        depth: mean over frames of how far the lowest point is below the floor, mm.
        worst: the deepest of all, mm.
        share: frames in which any point is deeper than the tolerance, percent.
    """

    depth: Tensor
    worst: Tensor
    share: Tensor


def floor_contact(
    feet: Tensor,
    height: Tensor,
    fps: float,
    rise: float = CONTACT_HEIGHT,
    speed: float = CONTACT_SPEED,
) -> Tensor:
    """Which feet stand, from the truth: low and slow over a step of one frame, (*b, F - 1, K).

    Args:
        feet: true positions of K foot joints, (*b, F, K, 3), metres.
        height: of the same joints above the floor, (*b, F, K), metres.
        fps: frames a second.
        rise: a joint stands while it is at most this much above its own lowest height, metres: an
            ankle never touches the floor.
        speed: and no faster than this, m/s.

    Raises:
        InputError: shapes that do not belong together, feet or heights in another unit, no positive
            frame rate, or limits that are none.
    """
    require_number(rise, "rise", least=0)
    require_number(speed, "speed", least=0)
    if height.shape != feet.shape[:-1] or feet.shape[-1:] != (3,) or feet.dim() < 3:
        raise InputError(
            f"feet have shape {tuple(feet.shape)} and height {tuple(height.shape)}; give "
            "(*b, F, K, 3) and (*b, F, K)"
        )
    check_metres(feet=feet)
    _check_one_unit(feet, height, rise)
    fps = frame_rate(fps, "fps")
    known = torch.where(height.isfinite(), height, torch.inf)
    # where no height of a joint is known its lowest is infinite too, and nothing of it stands
    low = (known <= known.amin(-2, keepdim=True) + rise) & height.isfinite()
    slow = feet.diff(dim=-3).norm(dim=-1) * fps <= speed
    stands: Tensor = low[..., 1:, :] & low[..., :-1, :] & slow
    return stands


def _check_one_unit(feet: Tensor, height: Tensor, rise: float) -> None:
    """Refuse heights (*b, F, K) that change much more in a step than feet (*b, F, K, 3) move."""
    way, change = feet.detach().diff(dim=-3).norm(dim=-1), height.detach().diff(dim=-2).abs()
    valid = (way > 0) & way.isfinite() & change.isfinite() & (change > rise)
    if not bool(valid.any()):
        return
    ratio = float((change[valid] / way[valid]).median())
    if ratio > _STEEP:
        raise InputError(
            f"height changes {ratio:.4g} times as much as feet move, expected metres in both; "
            "convert them"
        )


def foot_skate(feet: Tensor, contact: Tensor, up: Tensor) -> Tensor:
    """How far feet that should stand slide along the floor in a frame, mean, (*b), mm.

    Args:
        feet: estimated positions of K foot joints, (*b, F, K, 3), metres.
        contact: steps over which each stands, (*b, F - 1, K), of the truth: ``floor_contact``.
        up: unit vector, (3,).

    Returns:
        NaN where nothing stands.

    Raises:
        InputError: shapes that do not belong together, feet in another unit, contact that is not
            bool, or an ``up`` of another length than 1.
    """
    if contact.dtype != torch.bool:
        raise InputError(f"contact is {contact.dtype}, expected bool; probabilities are cut at 0.5")
    if not bool((up.norm() - 1).abs() < _UNIT):
        raise InputError(f"up is {up.tolist()}, expected a unit vector (3,); divide by its norm")
    step = feet.diff(dim=-3)
    if contact.shape != step.shape[:-1]:
        raise InputError(
            f"contact has shape {tuple(contact.shape)} for feet {tuple(feet.shape)}; give one a "
            "step and foot, (*b, F - 1, K)"
        )
    check_metres(feet=feet)
    sideways = step - (step * up).sum(-1, keepdim=True) * up
    size = _MILLIMETRES * sideways.norm(dim=-1)
    return frame_mean(size, contact & size.isfinite())


def penetration(height: Tensor, tolerance: float = 0.005) -> Penetration:
    """How deep points are below the floor; frames with a NaN are left out.

    Args:
        height: of points above the floor, (*b, F, N), metres: joints, or vertices of a surface.
        tolerance: a depth up to this is no fault, metres.

    Raises:
        InputError: a tolerance that is none, or heights of no points, no frames or another unit.
    """
    require_number(tolerance, "tolerance", least=0)
    if height.dim() < 2 or 0 in height.shape[-1:]:
        raise InputError(f"height has shape {tuple(height.shape)}, expected (*b, F, N)")
    check_heights(height)
    valid = height.isfinite().all(-1)
    depth = torch.where(valid, -height.amin(-1), 0).clamp(min=0)
    frames = valid.sum(-1)
    return Penetration(
        depth=_MILLIMETRES * depth.sum(-1) / frames,
        worst=torch.where(frames > 0, _MILLIMETRES * depth.amax(-1), torch.nan),
        share=100 * (depth > tolerance).to(depth.dtype).sum(-1) / frames,
    )


# --- How near the skins of two people come, and how deep one is in the other ----------------------


def skin_gap(one: Mesh, other: Mesh) -> float:
    """Smallest distance between two surfaces, m; negative by how deep one is in the other.

    Args:
        one: vertices (V, 3) m and outward unit normals (V, 3).
        other: the same of somebody else.

    Raises:
        InputError: what is no normals, as the faces of a mesh, normals that point into a body, or
            another unit than metres.
    """
    for name, mesh in (("one", one), ("other", other)):
        _require_skin(name, *mesh)
    ways = (one, other), (other, one)
    return min(float(signed_gap(a[0], b)[0].min()) for a, b in ways)


def _require_skin(name: str, vertices: NDArray[Any], normals: NDArray[Any]) -> None:
    """Refuse what is no skin of a person.

    Raises:
        InputError: it is none.
    """
    if normals.shape != vertices.shape or normals.dtype.kind != "f":
        raise InputError(
            f"{name} has vertices {vertices.shape} and normals {normals.shape} of {normals.dtype}; "
            "expected a unit vector a vertex, as perfcap.render.vertex_normals makes them of faces"
        )
    span = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if span > PERSON:
        raise InputError(f"{name} spans {span:.4g} from end to end, expected metres; convert it")
    lengths = np.linalg.norm(normals, axis=-1)
    if len(lengths) and abs(float(np.median(lengths)) - 1) > _UNIT:
        raise InputError(
            f"{name} has normals of length {np.median(lengths):.3g}, expected 1; divide by the norm"
        )
    # of a closed surface three times what is inside, times vertices over area
    away = ((vertices - vertices.mean(0)) * normals).sum(-1)
    if len(away) and float(away.mean()) < 0:
        raise InputError(
            f"{name} has normals that point into the body, expected outward ones; turn faces round"
        )
