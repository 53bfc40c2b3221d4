"""Images of Gaussians on the CPU: optical depth and its slope, and the way back to each Gaussian.

The plain-torch twin is ``_density_torch.py``; tests hold the two equal. Along a row a Gaussian is
a product of two geometric progressions, so that a pixel costs two multiplications in place of an
exponential: ``t(x + 1) = t(x) r(x)``, ``r(x + 1) = r(x) q``.

A Gaussian ends at the ellipse where its optical depth t has fallen to ``least``. What it gives is
``t - least (1 - log(least / t))``, with the slope ``(t - least) grad log t``: neither jumps there,
so whatever is made of these images is continuous as bodies move.
"""

import math

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

Floats = NDArray[np.float64]


@kernel(fastmath=False)
def reach(thickness: float, least: float) -> float:
    """Squared Mahalanobis distance at which a Gaussian has thinned out to ``least``, or zero."""
    return 2 * math.log(thickness / least) if thickness > least else 0.0


@inner(fastmath=False)
def touched_rows(centre: Floats, form: Floats, far: float, height: int) -> tuple[int, int]:
    """First row that a Gaussian touches, and the one behind the last."""
    determinant = form[0] * form[2] - form[1] * form[1]
    if not (form[0] > 0 and determinant > 0):  # no ellipse, or not a number
        return 0, 0
    half = math.sqrt(far * form[0] / determinant)
    rows: tuple[int, int] = steps(centre[1] - half, centre[1] + half, height)
    return rows


@kernel(fastmath=False)
def steps(low: float, high: float, side: int) -> tuple[int, int]:
    """Whole numbers of a range within a side: the first, and the one behind the last.

    What is infinite or not a number is no index: only what lies within is rounded. That is why this
    says ``fastmath=False``, without which it takes after the kernel that calls it.
    """
    if not (low < side and high >= 0):
        return 0, 0
    first = math.ceil(low) if low > 0 else 0
    return first, max(first, math.floor(high) + 1 if high < side - 1 else side)


@kernel(fastmath=False)
def fill(centre: Floats, form: Floats, far: float, row: int, values: Floats) -> tuple[int, int]:
    """Values of a Gaussian in a row; its first column, and the one behind the last."""
    dy = row - centre[1]
    middle = -form[1] * dy / form[0]
    left = far - (form[2] - form[1] * form[1] / form[0]) * dy * dy
    half = math.sqrt(max(left, 0.0) / form[0])
    start, stop = steps(centre[0] + middle - half, centre[0] + middle + half, len(values))
    dx = start - centre[0]
    t = math.exp(-0.5 * (form[0] * dx * dx + 2 * form[1] * dx * dy + form[2] * dy * dy))
    r, ratio = math.exp(-form[0] * (dx + 0.5) - form[1] * dy), math.exp(-form[0])
    for i in range(stop - start):
        values[i] = t
        t *= r
        r *= ratio
    return start, stop


@kernel(fastmath=True, error_model="numpy")
def draw(
    centre: Floats, form: Floats, thickness: Floats, least: float, depth: Floats, slope: Floats
) -> None:
    """Add up optical depth and its descent.

    Args:
        centre: of Gaussians in the image, (Q, 2) px.
        form: entries xx, xy, yy of the inverse covariances, (Q, 3) px^-2.
        thickness: optical depth through the middle of each, (Q,).
        least: optical depth below which one is left out.
        depth: (H, W), preset to zero; written.
        slope: minus the derivative of ``depth`` in x and y, (2, H, W), likewise.
    """
    height, width = depth.shape
    values = np.empty(width)
    for q in range(len(thickness)):
        a = thickness[q]
        if reach(a, least) == 0:  # or not a number
            continue
        far = reach(a, least)
        first, last = touched_rows(centre[q], form[q], far, height)
        xx, xy, yy = form[q, 0], form[q, 1], form[q, 2]
        for row in range(first, last):
            start, stop = fill(centre[q], form[q], far, row, values)
            dy = row - centre[q, 1]
            line, down = depth[row, start:stop], slope[1, row, start:stop]
            across, offset = slope[0, row, start:stop], start - centre[q, 0]
            for i in range(len(line)):
                dx, t = offset + i, a * values[i] - least
                u, v = xx * dx + xy * dy, xy * dx + yy * dy
                line[i] += t - 0.5 * least * (far - u * dx - v * dy)
                across[i] += t * u
                down[i] += t * v


@kernel(fastmath=True, error_model="numpy")
def pull_back(
    centre: Floats,
    form: Floats,
    thickness: Floats,
    least: float,
    on_depth: Floats,
    on_slope: Floats,
    of_centre: Floats,
    of_form: Floats,
    of_thickness: Floats,
) -> None:
    """Gradient of a function of ``draw``'s images in the Gaussians.

    Args:
        centre: as of ``draw``, as the next three.
        form: (Q, 3).
        thickness: (Q,).
        least: optical depth.
        on_depth: derivative of the function in ``depth``, (H, W).
        on_slope: likewise in ``slope``, (2, H, W).
        of_centre: (Q, 2), written.
        of_form: in the entries xx, xy, yy, (Q, 3), written.
        of_thickness: (Q,), written.
    """
    height, width = on_depth.shape
    values = np.empty(width)
    for q in range(len(thickness)):
        a = thickness[q]
        if reach(a, least) == 0:  # or not a number
            of_centre[q], of_form[q], of_thickness[q] = 0.0, 0.0, 0.0
            continue
        far, rest = reach(a, least), least / a
        first, last = touched_rows(centre[q], form[q], far, height)
        xx, xy, yy = form[q, 0], form[q, 1], form[q, 2]
        m = mx = my = mxx = mxy = myy = 0.0  # moments of the pull on t
        wx = wy = wxx = wxy = wyy = 0.0  # moments of the pull on the slope
        for row in range(first, last):
            start, stop = fill(centre[q], form[q], far, row, values)
            dy = row - centre[q, 1]
            n = nx = nxx = ux = uy = uxx = uxy = 0.0  # the row's share
            line, down = on_depth[row, start:stop], on_slope[1, row, start:stop]
            across, offset = on_slope[0, row, start:stop], start - centre[q, 0]
            for i in range(len(line)):
                dx, t = offset + i, values[i]
                kept, u, v = t - rest, across[i], down[i]
                pull = kept * line[i] + t * (u * (xx * dx + xy * dy) + v * (xy * dx + yy * dy))
                u, v = kept * u, kept * v
                n += pull
                nx += pull * dx
                nxx += pull * dx * dx
                ux += u
                uy += v
                uxx += u * dx
                uxy += v * dx
            m += n
            mx += nx
            my += n * dy
            mxx += nxx
            mxy += nx * dy
            myy += n * dy * dy
            wx += ux
            wy += uy
            wxx += uxx
            wxy += ux * dy + uxy
            wyy += uy * dy
        of_thickness[q] = m
        of_centre[q, 0] = a * (xx * (mx - wx) + xy * (my - wy))
        of_centre[q, 1] = a * (xy * (mx - wx) + yy * (my - wy))
        of_form[q, 0] = a * (wxx - 0.5 * mxx)
        of_form[q, 1] = a * (wxy - mxy)
        of_form[q, 2] = a * (wyy - 0.5 * myy)
