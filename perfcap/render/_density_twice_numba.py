"""Second derivatives of images of Gaussians on the CPU, for gradients through a solve.

With ``l = log t``, ``u`` and ``v`` minus its slope in x and y, and ``h = least``, a Gaussian gives
d to the optical depth, with ``dd = (t - h) dl``, and ``(t - h) (u, v)`` to its descent. All of l, u
and v are polynomials of its six numbers, but for the logarithm of its thickness.
"""

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import kernel
from perfcap.render._density_numba import fill, reach, touched_rows

Floats = NDArray[np.float64]


@kernel(fastmath=True, error_model="numpy")
def tangents(
    centre: Floats, form: Floats, thickness: Floats, least: float, moves: Floats, found: Floats
) -> None:
    """How the images that ``draw`` makes change with K moves of all Gaussians.

    Args:
        centre: of Gaussians in the image, (Q, 2) px.
        form: entries xx, xy, yy of the inverse covariances, (Q, 3) px^-2.
        thickness: optical depth through the middle of each, (Q,).
        least: optical depth below which one is left out.
        moves: of centre, form and thickness, (Q, 6, K).
        found: of the depth and its descent in x and y, (3, H, W, K), preset to zero; written.
    """
    _, height, width, count = found.shape
    values = np.empty(width)
    for q in range(len(thickness)):
        move, a = moves[q], thickness[q]
        if reach(a, least) == 0:  # or not a number
            continue
        far = reach(a, least)
        first, last = touched_rows(centre[q], form[q], far, height)
        xx, xy, yy = form[q, 0], form[q, 1], form[q, 2]
        for row in range(first, last):
            start, stop = fill(centre[q], form[q], far, row, values)
            dy = row - centre[q, 1]
            for column in range(start, stop):
                dx, t = column - centre[q, 0], a * values[column - start]
                u, v = xx * dx + xy * dy, xy * dx + yy * dy
                kept = t - least
                for k in range(count):
                    log = u * move[0, k] + v * move[1, k] + move[5, k] / a
                    log -= dx * (0.5 * dx * move[2, k] + dy * move[3, k])
                    log -= 0.5 * dy * dy * move[4, k]
                    along = dx * move[2, k] + dy * move[3, k] - xx * move[0, k] - xy * move[1, k]
                    down = dx * move[3, k] + dy * move[4, k] - xy * move[0, k] - yy * move[1, k]
                    found[0, row, column, k] += kept * log
                    found[1, row, column, k] += t * log * u + kept * along
                    found[2, row, column, k] += t * log * v + kept * down


@kernel(fastmath=True, error_model="numpy")
def bend(
    centre: Floats, form: Floats, thickness: Floats, least: float, pull: Floats, bent: Floats
) -> None:
    """Second derivative of ``<pull, images>`` in each Gaussian: images see them one by one.

    Args:
        centre: as of ``tangents``, as the next three.
        form: (Q, 3).
        thickness: (Q,).
        least: optical depth.
        pull: on the depth and its descent in x and y, (3, H, W).
        bent: in centre, form and thickness, (Q, 6, 6), written.
    """
    _, height, width = pull.shape
    values = np.empty(width)
    log, along = np.empty(6), np.empty(6)
    for q in range(len(thickness)):
        block, a = bent[q], thickness[q]
        block[:] = 0.0
        if reach(a, least) == 0:  # or not a number
            continue
        far = reach(a, least)
        first, last = touched_rows(centre[q], form[q], far, height)
        xx, xy, yy = form[q, 0], form[q, 1], form[q, 2]
        for row in range(first, last):
            start, stop = fill(centre[q], form[q], far, row, values)
            dy = row - centre[q, 1]
            for column in range(start, stop):
                dx, t = column - centre[q, 0], a * values[column - start]
                u, v = xx * dx + xy * dy, xy * dx + yy * dy
                on, x, y = pull[0, row, column], pull[1, row, column], pull[2, row, column]
                kept, slant = t - least, t * (x * u + y * v)
                twice, once = t * on + slant, kept * on + slant
                # slopes of log t, and of x u + y v
                log[0], log[1] = u, v
                log[2], log[3], log[4], log[5] = -0.5 * dx * dx, -dx * dy, -0.5 * dy * dy, 1 / a
                along[0], along[1] = -(xx * x + xy * y), -(xy * x + yy * y)
                along[2], along[3], along[4], along[5] = dx * x, dy * x + dx * y, dy * y, 0.0
                for i in range(6):
                    for j in range(i + 1):
                        block[i, j] += twice * log[i] * log[j]
                        block[i, j] += t * (log[i] * along[j] + log[j] * along[i])
                # second slopes of log t, and of x u + y v
                block[0, 0] -= once * xx
                block[1, 0] -= once * xy
                block[1, 1] -= once * yy
                block[2, 0] += once * dx - kept * x
                block[3, 0] += once * dy - kept * y
                block[3, 1] += once * dx - kept * x
                block[4, 1] += once * dy - kept * y
                block[5, 5] -= once / (a * a)
        for i in range(6):
            for j in range(i):
                block[j, i] = block[i, j]
