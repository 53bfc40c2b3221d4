"""A surface drawn onto silhouettes: known shifts, kept shapes, loose parts, nothing to see."""

from collections.abc import Sequence

import numpy as np
import pytest
import torch
from crowds import circle
from numpy.typing import NDArray
from takes import marked_template

from perfcap.pipeline.laplacian_surface import LaplacianConfig, LaplacianSurface
from perfcap.pipeline.sight import Sight
from perfcap.segment import Contour, Matches, extract_contour

Floats = NDArray[np.float64]

TEMPLATE = marked_template()
REST = TEMPLATE.vertices.copy()
CAMERAS = circle(5, 300)
SIGHT = Sight(CAMERAS, torch.from_numpy(TEMPLATE.faces.copy()), TEMPLATE.weld()[0])
HEIGHTS = [160.0] * 5


def drawn(surface: Floats) -> list[NDArray[np.bool_]]:
    (views,) = SIGHT.look(torch.from_numpy(surface)[None], slice(0, 1))
    return [view.mask for view in views]


def overlap(surface: Floats, masks: Sequence[NDArray[np.bool_]]) -> float:
    pairs = zip(drawn(surface), masks, strict=True)
    return float(np.mean([(own & mask).sum() / (own | mask).sum() for own, mask in pairs]))


def refined(start: Floats, contours: Sequence[Contour], config: LaplacianConfig) -> Floats:
    def pairs(surface: Floats) -> list[Matches]:
        (views,) = SIGHT.look(torch.from_numpy(surface)[None], slice(0, 1))
        return SIGHT.correspond(views, contours, config.contour, HEIGHTS)

    return LaplacianSurface(TEMPLATE, config).refine(start, pairs, CAMERAS, HEIGHTS)


@pytest.mark.parametrize("slides", [True, False])
def test_meets_silhouettes_and_keeps_shape(slides: bool) -> None:
    truth = REST * [1.08, 1.0, 1.08]  # a wider person
    contours = [extract_contour(mask) for mask in drawn(truth)]
    config = LaplacianConfig(slides=slides)
    found = refined(REST, contours, config)
    before, after = (overlap(each, drawn(truth)) for each in (REST, found))
    assert after > 0.5 + 0.5 * before
    edges = TEMPLATE.faces[:, :2]
    lengths = [np.linalg.norm(np.diff(each[edges], axis=1), axis=-1) for each in (REST, found)]
    assert np.abs(lengths[1] - lengths[0]).max() < 0.25 * lengths[0].max()


def test_the_paper_has_a_round_a_search() -> None:
    asked: list[int] = []

    def none(surface: Floats) -> list[Matches]:
        asked.append(len(surface))
        return SIGHT.correspond(
            SIGHT.look(torch.from_numpy(surface)[None], slice(0, 1))[0],
            [extract_contour(np.zeros((300, 300), np.bool_))] * 5,
            LaplacianConfig().contour, HEIGHTS,
        )  # fmt: skip

    found = LaplacianSurface(TEMPLATE, LaplacianConfig()).refine(REST, none, CAMERAS, HEIGHTS)
    assert len(asked) == 8
    np.testing.assert_array_equal(found, REST)  # nothing seen, nothing changed


def test_nothing_flies_away() -> None:
    """Only a few points are seen, of parts that hang on nothing."""
    truth = REST + np.array([0.01, 0.0, 0.0])
    contours = [extract_contour(mask) for mask in drawn(truth)]
    few = [contour[:20] for contour in contours]
    found = refined(REST, few, LaplacianConfig())
    assert np.abs(found - REST).max() < 0.05


@pytest.mark.long
def test_solve_is_that_of_the_normal_equations() -> None:
    """Against a dense solve of Eq. 10 of the first round."""
    truth = REST * [1.05, 1.0, 1.05]
    contours = [extract_contour(mask) for mask in drawn(truth)]
    config = LaplacianConfig(rounds=1, slides=False)
    found = refined(REST, contours, config)
    one = LaplacianSurface(TEMPLATE, config)
    (views,) = SIGHT.look(torch.from_numpy(REST)[None], slice(0, 1))
    pairs = SIGHT.correspond(views, contours, config.contour, HEIGHTS)
    size = int(one.weld.max()) + 1
    count = sum(map(len, pairs))
    whole = np.kron(one.bending.toarray(), np.eye(3))
    whole += np.kron(np.diag(0.5 * count / config.reach**2 * one.area), np.eye(3))
    right = np.zeros(3 * size)
    for c, each in enumerate(pairs):
        points = torch.from_numpy(np.einsum("ps,psk->pk", each.weights, REST[each.vertices]))
        camera = CAMERAS.select([c])
        for p, point in enumerate(points):
            slope = torch.autograd.functional.jacobian(
                lambda x, camera=camera: camera.project(x[None, None])[0, 0, 0], point
            ).numpy()
            missing = each.target[p] - camera.project(point[None, None])[0, 0, 0].numpy()
            row = np.zeros((2, 3 * size))
            for vertex, share in zip(one.weld[each.vertices[p]], each.weights[p], strict=True):
                row[:, 3 * vertex : 3 * vertex + 3] += share * slope
            weight = 0.5 / (0.002 * 160) ** 2 * each.confidence[p]
            whole += weight * row.T @ row
            right += weight * row.T @ missing
    exact = np.linalg.solve(whole, right).reshape(-1, 3)[one.weld]
    assert np.abs(exact).max() > 0.005
    np.testing.assert_allclose(found - REST, exact, atol=2e-4)
