"""How well a fitted body is known: deviations over its surface, and measurements with bars."""

from __future__ import annotations

from dataclasses import asdict

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.actor.body_model import BodyModel
from perfcap.render import rasterize
from perfcap.rigging import BodyFit

Image = NDArray[np.uint8]

_TURNS = (0.0, np.pi / 2, np.pi)  # front, side, back
_FILLED = 0.86  # of the height of the row, by the body
_FAR = 10.0  # m, of a parallel camera
_PAPER, _INK, _BAR = (255, 255, 255), (40, 40, 40), (60, 110, 200)
_FONT, _TEXT = cv2.FONT_HERSHEY_SIMPLEX, 0.42


@torch.no_grad()
def vertex_deviations(model: BodyModel, fit: BodyFit) -> NDArray[np.float64]:
    """Standard deviation of each vertex of the rest pose, (V,) m, from that of the shape alone.

    Of a displacement of three dimensions: the root of the trace of its covariance.
    """
    basis = model.surface.basis.double()
    root = torch.linalg.cholesky(fit.covariance.double() + 1e-12 * torch.eye(len(fit.covariance)))
    moved = torch.einsum("svk,st->tvk", basis, root)
    found: NDArray[np.float64] = moved.square().sum((0, 2)).sqrt().numpy(force=True)
    return found


def body_map(model: BodyModel, fit: BodyFit, height: int, width: int) -> Image:
    """The rest body from three sides, coloured by deviation, beside its measurements, RGB."""
    picture = np.full((height, width, 3), _PAPER, np.uint8)
    spread = vertex_deviations(model, fit)
    most = max(float(spread.max()), 1e-6)
    vertices = model.vertices(fit.shape).double().numpy(force=True)
    column = min(height // 2, width // 4)
    for place, turn in enumerate(_TURNS):
        _draw_body(picture[:, place * column : (place + 1) * column], model, vertices,
                   spread / most, turn)  # fmt: skip
    _write(picture, (6, height - 8), f"deviation: dark 0, bright {1000 * most:.0f} mm")
    _draw_measures(picture[:, len(_TURNS) * column :], fit)
    return picture


def _draw_body(
    into: Image, model: BodyModel, vertices: NDArray[np.float64], share: NDArray[np.float64],
    turn: float,
) -> None:  # fmt: skip
    height, width = into.shape[:2]
    low, high = vertices.min(0), vertices.max(0)
    scale = min(_FILLED * height / (high - low)[1], _FILLED * width / (high - low)[[0, 2]].max())
    x, y, z = (vertices - 0.5 * (low + high)).T
    across = np.cos(turn) * x - np.sin(turn) * z
    ahead = np.sin(turn) * x + np.cos(turn) * z
    pixels = np.stack((0.5 * width + scale * across, 0.5 * height - scale * y), -1)
    faces = torch.from_numpy(model.rig.faces)
    drawn = rasterize(
        torch.from_numpy(pixels), torch.from_numpy(_FAR - ahead), faces, (height, width)
    )
    seen = drawn.triangle.numpy()
    level = share[model.rig.faces].mean(1)[seen.clip(0)]
    colors = cv2.applyColorMap(np.rint(255 * level).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    there = drawn.mask.numpy()
    into[there] = colors[..., ::-1][there]


def _draw_measures(into: Image, fit: BodyFit) -> None:
    """A line for each measurement, its bar one standard deviation to either side."""
    sizes, spreads = asdict(fit.measurements), asdict(fit.deviations)
    widest = max(max(spreads.values()), 1e-6)
    height, width = into.shape[:2]
    middle, reach = 0.72 * width, 0.24 * width
    for row, (name, size) in enumerate(sizes.items()):
        y = int((row + 1) * height / (len(sizes) + 1))
        spread = spreads[name]
        _write(into, (8, y + 4), f"{name} {100 * size:.1f} +- {100 * spread:.1f} cm")
        half = reach * spread / widest
        left, right = int(middle - half), int(middle + half)
        cv2.line(into, (left, y), (right, y), _BAR, 3, cv2.LINE_AA)
        cv2.circle(into, (int(middle), y), 4, _INK, -1, cv2.LINE_AA)


def _write(into: Image, place: tuple[int, int], words: str) -> None:
    cv2.putText(into, words, place, _FONT, _TEXT, _INK, 1, cv2.LINE_AA)
