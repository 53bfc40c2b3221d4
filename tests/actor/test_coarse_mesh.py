"""A mesh of few vertices looks like the whole one, and knows what moves it."""

import numpy as np
import pytest
import torch
from synthetic import actor as person

from perfcap.actor.coarse_mesh import CoarseMesh
from perfcap.actor.skinning import dual_quaternion_blend
from perfcap.errors import InputError
from perfcap.io.actor import load_actor
from perfcap.render import rasterize
from perfcap.render.label_map import Cull

SAM = load_actor("sam")
COARSE = CoarseMesh.of(SAM, 0.03)
JOINTS = SAM.skeleton.rig.joints


def test_few_triangles_that_close() -> None:
    whole = SAM.template.faces
    assert 100 < len(COARSE.faces) < 0.6 * len(whole)
    assert len(np.unique(COARSE.chosen)) == len(COARSE.chosen)
    assert COARSE.faces.max() < len(COARSE.chosen)
    welded = SAM.template.weld()[0][whole]
    assert _open_edges(COARSE.faces) <= _open_edges(welded)


def _open_edges(faces: np.ndarray) -> int:
    """Edges of one triangle alone."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] == 1).sum())


def test_silhouette_is_that_of_the_actor() -> None:
    motion = SAM.skeleton.rest_motion()
    angles = motion.angles + 0.2
    motion = type(motion)(motion.translation, motion.rotation, angles)
    surface = SAM.surface(motion)[0]
    rest = SAM.vertices[torch.from_numpy(COARSE.chosen)]
    few = dual_quaternion_blend(rest, COARSE.skin, *SAM.joint_transforms(motion))[0]
    torch.testing.assert_close(few, surface[torch.from_numpy(COARSE.chosen)])
    masks = []
    for vertices, faces in ((surface, SAM.template.faces), (few, COARSE.faces)):
        pixels = 100 * vertices[:, :2] * torch.tensor([1.0, -1.0]) + 120
        masks.append(
            rasterize(pixels, vertices[:, 2] + 3, torch.from_numpy(faces.copy()), (240, 240)).mask
        )
    both, either = (masks[0] & masks[1]).sum(), (masks[0] | masks[1]).sum()
    assert both / either > 0.93


def test_triangles_seen_from_outside_cover_all() -> None:
    """The two sides of what has become flat are both there."""
    rest = SAM.vertices[torch.from_numpy(COARSE.chosen)]
    faces = torch.from_numpy(COARSE.faces.copy())
    for axis in range(2):
        pixels = 100 * rest[:, [2 * axis, 1]] * torch.tensor([1.0, -1.0]) + 120
        # from the front (+z comes nearer), and from the side
        depth = 3 - rest[:, 2] if axis == 0 else 3 + rest[:, 0]
        drawn = [
            rasterize(pixels, depth, faces, (240, 240), cull).mask
            for cull in (Cull.NONE, Cull.BACK)
        ]
        assert (drawn[0] & ~drawn[1]).sum() <= 0.002 * drawn[0].sum()


def test_triangles_that_a_joint_moves() -> None:
    wrist = np.array([name == "l_wrist" for name in JOINTS])
    moved = COARSE.moved_by(wrist)
    assert 0 < moved.sum() < 0.2 * len(moved)
    places = SAM.vertices.numpy()[COARSE.chosen][COARSE.faces[moved]]
    assert places[..., 0].min() > 0.2  # the left arm is at +x
    assert COARSE.moved_by(np.ones(len(JOINTS), np.bool_)).all()
    assert not COARSE.moved_by(np.zeros(len(JOINTS), np.bool_)).any()


@pytest.mark.parametrize("cell", [0.0, -1.0, float("nan")])
def test_refuses_cells_without_size(cell: float) -> None:
    with pytest.raises(InputError, match="side of cells in metres"):
        CoarseMesh.of(SAM, cell)


def test_open_parts_have_both_sides() -> None:
    """A skirt is seen from below, too: the search draws what is seen from outside alone."""
    doubled = CoarseMesh.of(SAM, 0.03, doubled=True)
    both = {tuple(sorted(face)) for face in COARSE.faces.tolist()}
    assert {tuple(sorted(face)) for face in doubled.faces.tolist()} == both
    turned = {_turned(face) for face in doubled.faces[:, ::-1].tolist()}
    one_sided = [face for face in doubled.faces.tolist() if _turned(face) not in turned]
    weld = SAM.template.weld()[0]
    assert len(COARSE.faces) < len(doubled.faces) < 2 * len(COARSE.faces)
    assert 0 < len(one_sided) < len(COARSE.faces)
    # what clusters fold together is counted once, so that a few edges stay
    assert _border(doubled.faces) < 0.1 * _border(weld[SAM.template.faces])


def test_tubes_are_drawn_from_inside_too() -> None:
    tubes = CoarseMesh.of(person(), 0.03, doubled=True)
    plain = CoarseMesh.of(person(), 0.03)
    assert len(tubes.faces) == 2 * len(plain.faces)


def _turned(face: list[int]) -> tuple[int, ...]:
    """The corners from the smallest on, in their order."""
    first = face.index(min(face))
    return tuple(face[first:] + face[:first])


def _border(faces: np.ndarray) -> int:
    """Edges that are passed one way more often than the other."""
    ways = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges, where = np.unique(np.sort(ways, 1), axis=0, return_inverse=True)
    balance = np.bincount(where.reshape(-1), np.where(ways[:, 0] < ways[:, 1], 1, -1), len(edges))
    return int((balance != 0).sum())
