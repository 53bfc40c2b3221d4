"""A mesh of few of an actor's vertices, for silhouettes that are drawn thousands of times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from perfcap.actor.actor import Actor
from perfcap.actor.skin_weights import SkinWeights
from perfcap.errors import InputError

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CoarseMesh:
    """Some vertices of an actor, and triangles between them.

    Attributes:
        chosen: indices of the vertices, (U,).
        faces: triangles of these, (T, 3), counter-clockwise seen from outside.
        skin: weights of the vertices.
        limbs: the joint that moves each triangle most, (T,).
    """

    chosen: Integers
    faces: Integers
    skin: SkinWeights
    limbs: Integers

    @classmethod
    def of(cls, actor: Actor, cell: float, *, doubled: bool = False) -> Self:
        """One vertex for all that are in one cell of a grid and follow one joint.

        It is the one nearest to their mean, so that nothing of the surface moves by more than the
        diagonal of a cell. What was closed stays closed.

        Args:
            actor: at rest.
            cell: side of a cell, m.
            doubled: whether parts that are not closed, as skirts, have triangles of both sides, so
                that those seen from outside cover all that the part does.
        """
        if not cell > 0:
            raise InputError(f"cell is {cell}; expected the side of cells in metres, above 0")
        vertices = actor.vertices.double().numpy(force=True)
        joints, weights, pivots = (row.cpu() for row in actor.skin.rows())
        owners = pivots.numpy()
        keys = np.column_stack([np.floor(vertices / cell).astype(np.int64), owners])
        _, cluster = np.unique(keys, axis=0, return_inverse=True)
        chosen = _middles(vertices, cluster.reshape(-1))
        faces = cluster.reshape(-1)[actor.template.faces]
        proper = (faces != np.roll(faces, 1, 1)).all(1)
        faces = faces[proper]
        if doubled:
            faces = np.concatenate([faces, faces[_open(actor)[proper], ::-1]])
        # the two sides of what has become flat stay: each is seen from its own side
        turned = (np.argmin(faces, 1)[:, None] + np.arange(3)) % 3
        _, first = np.unique(np.take_along_axis(faces, turned, 1), axis=0, return_index=True)
        faces = faces[np.sort(first)]
        index = torch.from_numpy(chosen)
        skin = SkinWeights(weights[index], joints[index])
        limbs = np.sort(owners[chosen][faces], 1)[:, 1]
        return cls(chosen, faces, skin, limbs)

    def moved_by(self, joints: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Triangles (T,) that move where some joints (J,) do."""
        index, weights, _ = self.skin.rows()
        follows = ((weights > 0).numpy() & joints[index.numpy()]).any(1)
        moved: NDArray[np.bool_] = follows[self.faces].any(1)
        return moved


def _open(actor: Actor) -> NDArray[np.bool_]:
    """Triangles (T,) of connected parts that have a border, or that are turned inside out."""
    weld, _ = actor.template.weld()
    faces = weld[actor.template.faces]
    ends = np.concatenate([faces, np.roll(faces, -1, 1)], 1).reshape(-1, 2, 3).swapaxes(1, 2)
    start, end = ends.reshape(-1, 2).T
    count = int(faces.max()) + 1
    # of what is closed, each edge is passed as often one way as the other
    passed = coo_array((np.ones(len(start)), (start, end)), (count, count)).tocsr()
    unlike = (passed != passed.T).tocoo().row
    parts, part = connected_components(passed, directed=False)
    is_open = np.zeros(parts, np.bool_)
    is_open[part[unlike]] = True
    places = actor.template.vertices[actor.template.faces].astype(np.float64)
    inside = np.linalg.det(places - places.mean((0, 1)))
    is_open |= np.bincount(part[faces[:, 0]], inside, parts) <= 0
    found: NDArray[np.bool_] = is_open[part[faces[:, 0]]]
    return found


def _middles(vertices: NDArray[np.float64], cluster: Integers) -> Integers:
    """The vertex (U,) of each cluster that is nearest to its mean; the first of equals."""
    count = np.bincount(cluster)
    mean = np.stack([np.bincount(cluster, axis) for axis in vertices.T], 1) / count[:, None]
    distance = np.linalg.norm(vertices - mean[cluster], axis=1)
    order = np.lexsort((distance, cluster))
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    middles: Integers = order[starts]
    return middles
