"""Lit, textured samples on the CPU: one pass over the samples of a picture that see the mesh.

The plain-torch twin is ``shading.shade`` with a sum over the samples of each pixel; tests hold the
two equal.
"""

import math

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

Floats = NDArray[np.float32]
Mesh = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], Floats, Floats]
Skin = tuple[Floats, NDArray[np.int64], Floats, Floats, NDArray[np.int64]]


@kernel()
def gather(
    triangle: NDArray[np.int32],
    step: int,
    mesh: Mesh,
    skin: Skin,
    lights: Floats,
    reached: Floats,
    light: Floats,
    coverage: Floats,
) -> None:
    """Mean light of each pixel's samples, and the share of them that see the mesh.

    Args:
        triangle: face each sample sees, (step H, step W), -1 for none.
        step: samples along a side of a pixel.
        mesh: pixels (V, 2) and depth (V,) of the samples' image, faces (T, 3), unit normals (V, 3)
            and sign of the faces' area in the image (T,).
        skin: uv (N, 2), faces (T, 3) that index it, pyramid level (T,), texels of all levels
            (S, 3), and for each level its first texel, height and width (L, 3).
        lights: ambient, sky, sun, direction to the sun, up, (5, 3).
        reached: share of sun and sky that reaches a vertex, (V, 2).
        light: (H, W, 3), preset to zero, written.
        coverage: (H, W), preset to zero, written.
    """
    pixels, depth, faces, normals, facing = mesh
    uv, uv_faces, level, texels, shapes = skin
    share = np.float32(1.0 / (step * step))
    for row in range(triangle.shape[0]):
        for column in range(triangle.shape[1]):
            face = triangle[row, column]
            if face < 0:
                continue
            corners = (faces[face, 0], faces[face, 1], faces[face, 2])
            weights = _barycentric(pixels, depth, corners, column, row)
            # a positive area in the image is a face seen from behind: cloth is lit on both sides
            side = -1.0 if facing[face] > 0 else 1.0
            to_sun, to_sky = _facing(normals, lights, corners, weights, side)
            to_sun *= _blend(reached, corners, 0, weights)
            to_sky *= _blend(reached, corners, 1, weights)
            places = (uv_faces[face, 0], uv_faces[face, 1], uv_faces[face, 2])
            u, v = _blend(uv, places, 0, weights), _blend(uv, places, 1, weights)
            color = _sample(texels, shapes, u, v, level[face])
            here, line = row // step, column // step
            for axis in range(3):
                arriving = lights[0, axis] + to_sky * lights[1, axis] + to_sun * lights[2, axis]
                light[here, line, axis] += share * color[axis] * arriving
            coverage[here, line] += share


@inner()
def _blend(values, rows, column, weights):  # type: ignore[no-untyped-def]
    return (
        weights[0] * values[rows[0], column]
        + weights[1] * values[rows[1], column]
        + weights[2] * values[rows[2], column]
    )


@inner()
def _facing(normals, lights, corners, weights, side):  # type: ignore[no-untyped-def]
    """How much a point of a face looks at the sun, in [0, 1], and how much of the sky it sees."""
    x = _blend(normals, corners, 0, weights)
    y = _blend(normals, corners, 1, weights)
    z = _blend(normals, corners, 2, weights)
    scale = side / max(math.sqrt(x * x + y * y + z * z), 1e-12)
    to_sun = scale * (x * lights[3, 0] + y * lights[3, 1] + z * lights[3, 2])
    to_sky = scale * (x * lights[4, 0] + y * lights[4, 1] + z * lights[4, 2])
    return max(to_sun, 0.0), 0.5 + 0.5 * to_sky


@inner()
def _barycentric(pixels, depth, corners, x, y):  # type: ignore[no-untyped-def]
    """Perspective-correct weights of a triangle's corners at a point."""
    a, b, c = corners
    ax, ay = pixels[a, 0] - x, pixels[a, 1] - y
    bx, by = pixels[b, 0] - x, pixels[b, 1] - y
    cx, cy = pixels[c, 0] - x, pixels[c, 1] - y
    of_a, of_b, of_c = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
    total = of_a + of_b + of_c
    if total == 0:
        of_a, of_b, of_c, total = 1.0, 1.0, 1.0, 3.0
    of_a = max(of_a / total, 0.0) / depth[a]
    of_b = max(of_b / total, 0.0) / depth[b]
    of_c = max(of_c / total, 0.0) / depth[c]
    norm = 1 / (of_a + of_b + of_c)
    return norm * of_a, norm * of_b, norm * of_c


@inner()
def _sample(texels, shapes, u, v, level):  # type: ignore[no-untyped-def]
    """Trilinear look-up of linear RGB."""
    level = min(max(level, 0.0), len(shapes) - 1.0)
    fine = int(level)
    share = level - fine
    red, green, blue = _bilinear(texels, shapes[fine], u, v)
    if share > 0:
        r, g, b = _bilinear(texels, shapes[fine + 1], u, v)
        red += share * (r - red)
        green += share * (g - green)
        blue += share * (b - blue)
    return red, green, blue


@inner()
def _bilinear(texels, shape, u, v):  # type: ignore[no-untyped-def]
    """Bilinear look-up in a level that repeats; texels end at integers."""
    first, height, width = shape
    x, y = u * width - 0.5, v * height - 0.5
    left, top = math.floor(x), math.floor(y)
    across, down = np.float32(x - left), np.float32(y - top)
    left, top = left % width, top % height
    right = left + 1 if left + 1 < width else 0
    bottom = top + 1 if top + 1 < height else 0
    upper, lower = first + top * width, first + bottom * width
    a, b, c, d = upper + left, upper + right, lower + left, lower + right
    one = np.float32(1)
    share_a, share_b = (one - across) * (one - down), across * (one - down)
    share_c, share_d = (one - across) * down, across * down
    red = share_a * texels[a, 0] + share_b * texels[b, 0]
    green = share_a * texels[a, 1] + share_b * texels[b, 1]
    blue = share_a * texels[a, 2] + share_b * texels[b, 2]
    red += share_c * texels[c, 0] + share_d * texels[d, 0]
    green += share_c * texels[c, 1] + share_d * texels[d, 1]
    blue += share_c * texels[c, 2] + share_d * texels[d, 2]
    return red, green, blue
