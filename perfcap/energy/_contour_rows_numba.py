"""The contour energy of an image of Gaussians, row by row, with all its derivatives.

The same as to draw the optical depth, to price pixels and to go back to every Gaussian, which the
plain-torch twins ``_density_torch.py`` and ``_contour_torch.py`` do; tests hold them equal. A row's
images stay in the nearest cache, and a Gaussian is evaluated once: from a row to the next its
columns are multiplied by ``exp(-yy (dy + 1/2))``, alike for all of them, and by ``exp(-xy dx)``,
alike in all rows.

Most loops are a single line over whole blocks of pixels: compilers do eight at once of those.
"""

import math

import numpy as np
from numpy.typing import NDArray

from perfcap.energy._fading_numba import fading
from perfcap.kernels import inner, kernel
from perfcap.render._density_numba import reach, steps

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Places = NDArray[np.int64]
Splats = tuple[Floats, Floats, Floats]  # centres, forms and thicknesses, as of ``draw``
Room = tuple[Floats, Floats, Floats, Floats]  # reaches; of rows: values, their lean, those inside

_FAINT = 1e-12  # optical depth of pixels that show the background alone
_TILTED = 0.9  # correlation of x and y, beyond which the corners of a box may be too faint to store
_BLOCK = 32  # pixels
_IMAGES, _SUMS = 9, 14
_FIRST, _LAST, _LEFT, _RIGHT, _AT, _START, _STOP = range(7)  # where a Gaussian lies


@kernel()
def look(
    splats: Splats,
    least: float,
    edges: Singles,
    flat: Singles,
    bend: float,
    derivatives: bool,
    of_splats: Splats,
    curved: Floats,
) -> float:
    """Energy of an image, ``sum |grad B| (flat - edges . (cos, sin) of twice its direction)``.

    Args:
        splats: centres (Q, 2) px, entries xx, xy, yy of inverse covariances (Q, 3) px^-2, and
            optical depths through the middle (Q,).
        least: optical depth below which a Gaussian is left out of a pixel.
        edges: cosine and sine of twice the direction of image gradients, times their strength,
            (2, H, W).
        flat: price of a unit of contour, (H, W).
        bend: curvature of a unit of strength, px^-2.
        derivatives: whether the two following are written.
        of_splats: derivatives in the splats.
        curved: entries xx, xy, yy of the curvature for a shift of each Gaussian, (Q, 3).
    """
    height, width = flat.shape
    count = len(splats[2])
    boxes, sums = np.empty((count, 7), np.int64), np.zeros((count, _SUMS))
    far = np.empty(count)
    for q in range(count):
        far[q] = reach(splats[2][q], least)
    size = _boxes(splats, far, height, width, boxes)
    room = far, np.zeros(size), np.empty(size), np.empty(size)
    images = np.zeros((_IMAGES, width + _BLOCK))
    order, live = np.argsort(boxes[:, _FIRST]), np.empty(count, np.int64)
    here, behind, total = 0, 0, 0.0
    for row in range(height):
        here, behind = _alive(row, boxes, order, live, here, behind)
        low, high = _draw(splats, least, row, live[:here], boxes, room, images)
        if low < high:
            c, s, f = edges[0, row, low:high], edges[1, row, low:high], flat[row, low:high]
            total += _price(images, low, c, s, f)
            if derivatives:
                _derive(images, low, c, s, f)
                _bend(images, low, c, s, f, bend)
                _collect(splats, least, row, live[:here], boxes, room[3], images, sums)
    if derivatives:
        _finish(splats, sums, of_splats, curved)
    return total


@inner(fastmath=False)
def _boxes(splats: Splats, reaches: Floats, height: int, width: int, boxes: Places) -> int:
    """Rows and columns that each Gaussian touches, and its first place in a ``Room``; its size."""
    centre, form, _ = splats
    size = 0
    boxes[:] = 0
    for q in range(len(reaches)):
        boxes[q, _AT] = size
        determinant = form[q, 0] * form[q, 2] - form[q, 1] * form[q, 1]
        if not (0 < reaches[q] < math.inf and form[q, 0] > 0 and determinant > 0):
            continue  # too faint, no ellipse, or not a number
        far = reaches[q] / determinant
        wide, tall = math.sqrt(far * form[q, 2]), math.sqrt(far * form[q, 0])
        first, last = steps(centre[q, 1] - tall, centre[q, 1] + tall, height)
        left, right = steps(centre[q, 0] - wide, centre[q, 0] + wide, width)
        if right == left:  # an image beside all of a Gaussian has none of it
            continue
        boxes[q, _FIRST], boxes[q, _LAST] = first, last
        boxes[q, _LEFT], boxes[q, _RIGHT] = left, right
        size += boxes[q, _RIGHT] - boxes[q, _LEFT] + _BLOCK
    return size


@inner()
def _alive(
    row: int, boxes: Places, order: Places, live: Places, here: int, behind: int
) -> tuple[int, int]:
    """Lists those that touch a row; how many do, and how many of ``order`` began before the next.

    Args:
        row: one after the other, from 0 on.
        boxes: (Q, 7).
        order: Gaussians by their first row.
        live: those of the row before, (Q,); overwritten.
        here: how many they were.
        behind: how many of ``order`` had begun.
    """
    kept = 0
    for k in range(here):
        live[kept] = live[k]
        kept += row < boxes[live[kept], _LAST]
    while behind < len(order) and boxes[order[behind], _FIRST] <= row:
        live[kept] = order[behind]
        kept += row < boxes[live[kept], _LAST]
        behind += 1
    return kept, behind


@inner()
def _begin(
    centre: Floats, form: Floats, row: int, box: Places, values: Floats, lean: Floats
) -> None:
    """Values of a Gaussian in a row, and by how much more than others columns change to the next.

    In all columns of its box, or where it is much tilted in those that it touches.
    """
    xx, xy, yy, dy = form[0], form[1], form[2], row - centre[1]
    start, stop = 0, len(values)
    if xy * xy > _TILTED * _TILTED * xx * yy:
        start, stop = box[_START] - box[_LEFT], box[_STOP] - box[_LEFT]
    dx = box[_LEFT] + start - centre[0]
    t = math.exp(-0.5 * (xx * dx * dx + 2 * xy * dx * dy + yy * dy * dy))
    r, ratio = math.exp(-xx * (dx + 0.5) - xy * dy), math.exp(-xx)
    k, more = math.exp(-xy * dx), math.exp(-xy)
    for i in range(start, stop):
        values[i], lean[i] = t, k
        t *= r
        r *= ratio
        k *= more


@inner(fastmath=True)
def _draw(
    splats: Splats,
    least: float,
    row: int,
    live: Places,
    boxes: Places,
    room: Room,
    images: Floats,
) -> tuple[int, int]:
    """Optical depth of a row and its descent, the first three of its images.

    Returns:
        The first column that is touched, and the one behind the last.
    """
    low, high = images.shape[1], 0
    centre, form, thickness = splats
    far, values, lean, inside = room
    images[:3] = 0.0
    for q in live:
        xx, xy, yy, a = form[q, 0], form[q, 1], form[q, 2], thickness[q]
        dy, left, right, at = row - centre[q, 1], boxes[q, _LEFT], boxes[q, _RIGHT], boxes[q, _AT]
        share = 1 / xx
        rest = far[q] - (yy - xy * xy * share) * dy * dy
        half, middle = math.sqrt(max(rest, 0.0) * share), centre[q, 0] - xy * dy * share
        start, stop = steps(middle - half, middle + half, right)
        start = max(left, start)
        stop = max(start, stop)
        boxes[q, _START], boxes[q, _STOP] = start, stop
        own, lean_q = values[at : at + right - left], lean[at : at + right - left]
        if row > boxes[q, _FIRST] and xy * xy <= _TILTED * _TILTED * xx * yy:
            factor = math.exp(-yy * (dy - 0.5))
            for i in range(len(own)):
                own[i] *= factor * lean_q[i]
        else:
            _begin(centre[q], form[q], row, boxes[q], own, lean_q)
        dx, count, whole = start - centre[q, 0], stop - start, _whole(stop - start)
        end = start + whole
        ours, t = values[at + start - left : at + end - left], inside[at : at + whole]
        for i in range(whole):
            t[i] = a * ours[i] if i < count else 0.0  # of no pixel behind the last
        depth, across, down = images[0, start:end], images[1, start:end], images[2, start:end]
        x, y = xx * dx + xy * dy, xy * dx + yy * dy
        for i in range(whole):
            u, v, kept = x + xx * i, y + xy * i, max(t[i] - least, 0.0)
            depth[i] += kept - 0.5 * least * max(far[q] - u * (dx + i) - v * dy, 0.0)
            across[i] += kept * u
            down[i] += kept * v
        low, high = min(low, start), max(high, stop)
    return low, high


@inner()
def _whole(count: int) -> int:
    """Whole blocks of so many pixels."""
    return (count + _BLOCK - 1) // _BLOCK * _BLOCK


@inner(fastmath=True)
def _price(images: Floats, low: int, c: Singles, s: Singles, flat: Singles) -> float:
    """Energy of a row, from column ``low`` on.

    To optical depth and descent, images 3 to 7 add ``B``, ``|grad B|``, ``edges . u2`` and the
    direction ``u`` of ``grad B``; zero, but for B, where there is no contour.
    """
    high, total = low + len(flat), 0.0
    thick, across, down = images[0, low:high], images[1, low:high], images[2, low:high]
    left, size, alike = images[3, low:high], images[4, low:high], images[5, low:high]
    x, y = images[6, low:high], images[7, low:high]
    fading(thick, left)
    for i in range(len(flat)):
        squared = across[i] * across[i] + down[i] * down[i]
        there = thick[i] >= _FAINT and squared >= 1e-24
        size[i] = 1 / math.sqrt(squared) if there else 0.0
    for i in range(len(flat)):
        x[i] = across[i] * size[i]
    for i in range(len(flat)):
        y[i] = down[i] * size[i]
    for i in range(len(flat)):
        size[i] = left[i] * (across[i] * x[i] + down[i] * y[i])
    for i in range(len(flat)):
        alike[i] = c[i] * (x[i] * x[i] - y[i] * y[i]) + 2 * s[i] * x[i] * y[i]
    for i in range(len(flat)):
        total += size[i] * (flat[i] - alike[i])
    return total


@inner(fastmath=True)
def _derive(images: Floats, low: int, c: Singles, s: Singles, flat: Singles) -> None:
    """Make a row's first three images the energy's derivatives in them, for ``_bend`` one more."""
    high = low + len(flat)
    thick, across, down = images[0, low:high], images[1, low:high], images[2, low:high]
    left, size, alike = images[3, low:high], images[4, low:high], images[5, low:high]
    x, y, part = images[6, low:high], images[7, low:high], images[8, low:high]
    for i in range(len(flat)):
        across[i] = (flat[i] + alike[i]) * x[i] - 2 * (c[i] * x[i] + s[i] * y[i])
    for i in range(len(flat)):
        across[i] *= left[i]
    for i in range(len(flat)):
        down[i] = (flat[i] + alike[i]) * y[i] - 2 * (s[i] * x[i] - c[i] * y[i])
    for i in range(len(flat)):
        down[i] *= left[i]
    for i in range(len(flat)):
        part[i] = size[i] / max(thick[i], _FAINT)  # of the contour in a unit of optical depth
    for i in range(len(flat)):
        thick[i] = size[i] * (alike[i] - flat[i])


@inner(fastmath=True)
def _bend(images: Floats, low: int, c: Singles, s: Singles, flat: Singles, bend: float) -> None:
    """Make images 3 to 5 the entries xx, xy, yy of curvature for a shift, over optical depth."""
    high = low + len(flat)
    xx, xy, yy = images[3, low:high], images[4, low:high], images[5, low:high]
    x, y, stiff = images[6, low:high], images[7, low:high], images[8, low:high]
    for i in range(len(flat)):
        cosine, sine = np.float64(c[i]), np.float64(s[i])
        stiff[i] *= bend * (math.sqrt(cosine * cosine + sine * sine) + abs(flat[i]))
    for i in range(len(flat)):
        xx[i] = stiff[i] * x[i] * x[i]
    for i in range(len(flat)):
        xy[i] = stiff[i] * x[i] * y[i]
    for i in range(len(flat)):
        yy[i] = stiff[i] * y[i] * y[i]


@inner(fastmath=True)
def _collect(
    splats: Splats,
    least: float,
    row: int,
    live: Places,
    boxes: Places,
    inside: Floats,
    images: Floats,
    sums: Floats,
) -> None:
    """Add what a row says of each Gaussian to its moments, (Q, 14)."""
    for q in live:
        start, at, whole = (
            boxes[q, _START],
            boxes[q, _AT],
            _whole(boxes[q, _STOP] - boxes[q, _START]),
        )
        dy, offset, stop = row - splats[0][q, 1], start - splats[0][q, 0], start + whole
        xx, xy, yy = splats[1][q, 0], splats[1][q, 1], splats[1][q, 2]
        own, line = inside[at : at + whole], images[0, start:stop]
        across, down = images[1, start:stop], images[2, start:stop]
        bxx, bxy, byy = images[3, start:stop], images[4, start:stop], images[5, start:stop]
        n = nx = nxx = ux = uy = uxx = uxy = cxx = cxy = cyy = 0.0  # the row's share
        for i in range(whole):
            dx, t = offset + i, own[i]
            u, v, kept = across[i], down[i], max(t - least, 0.0)
            pull = kept * line[i] + t * (u * (xx * dx + xy * dy) + v * (xy * dx + yy * dy))
            u, v = kept * u, kept * v
            n += pull
            nx += pull * dx
            nxx += pull * dx * dx
            ux += u
            uy += v
            uxx += u * dx
            uxy += v * dx
            cxx += t * bxx[i]
            cxy += t * bxy[i]
            cyy += t * byy[i]
        # of the pull on t, of that on the slope, and of curvature
        of_t = n, nx, n * dy, nxx, nx * dy, n * dy * dy
        of_slope = ux, uy, uxx, ux * dy + uxy, uy * dy
        for k in range(6):
            sums[q, k] += of_t[k]
        for k in range(5):
            sums[q, 6 + k] += of_slope[k]
        sums[q, 11] += cxx
        sums[q, 12] += cxy
        sums[q, 13] += cyy


@inner()
def _finish(splats: Splats, sums: Floats, of_splats: Splats, curved: Floats) -> None:
    """Derivatives in the splats from their moments."""
    _, form, thickness = splats
    of_centre, of_form, of_thickness = of_splats
    for q in range(len(thickness)):
        m, w = sums[q, :6], sums[q, 6:11]  # 1, x, y, xx, xy, yy of t; x, y, xx, xy, yy of the slope
        of_thickness[q] = m[0] / thickness[q] if thickness[q] > 0 else 0.0
        x, y = m[1] - w[0], m[2] - w[1]
        of_centre[q, 0] = form[q, 0] * x + form[q, 1] * y
        of_centre[q, 1] = form[q, 1] * x + form[q, 2] * y
        of_form[q, 0] = w[2] - 0.5 * m[3]
        of_form[q, 1] = w[3] - m[4]
        of_form[q, 2] = w[4] - 0.5 * m[5]
        curved[q] = sums[q, 11:]
