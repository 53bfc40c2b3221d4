"""The plain place around a person."""

import math

import pytest
import torch
from torch import Tensor

from perfcap.geometry.camera import Camera
from perfcap.render import look_at
from perfcap.render.backdrop import Backdrop

F64 = torch.float64
UP = torch.tensor([0.0, 1.0, 0.0], dtype=F64)


def camera(eye: tuple[float, float, float], size: tuple[int, int] = (60, 81)) -> Camera:
    place = torch.tensor(eye, dtype=F64)
    rotation, translation = look_at(place, torch.tensor([0.0, 1.0, 0.0], dtype=F64), UP)
    middle = ((size[1] - 1) / 2, (size[0] - 1) / 2)
    matrix = torch.tensor([[70, 0, middle[0]], [0, 70, middle[1]], [0, 0, 1]], dtype=F64)
    return Camera(matrix[None], rotation[None], translation[None], None, (size,))


def place(**changes: object) -> Backdrop:
    return Backdrop(UP, torch.zeros(3, dtype=F64), **changes)  # type: ignore[arg-type]


def test_ground_is_where_rays_go_down() -> None:
    view = camera((0.0, 2.0, 5.0))
    picture, below = place().seen_by(view)
    assert picture.shape == (60, 81, 3) and picture.dtype == torch.uint8
    assert below.shape == (60, 81) and below.dtype == torch.bool
    horizon = 29.5 - 70 * math.tan(math.asin(1 / math.hypot(1, 5)))  # looks down by this angle
    rows = below.any(1).nonzero().min()
    assert below[rows:].all() and abs(float(rows) - horizon) <= 2  # computed at half the size


def test_there_is_no_line_at_the_horizon() -> None:
    picture, below = place().seen_by(camera((0.0, 1.6, 5.0), (300, 300)))
    row = int(below.any(1).nonzero().min())
    step = (picture[row + 2].int() - picture[row - 2].int()).abs().max()
    assert step <= 4


def test_ground_fades_with_distance_and_carries_a_board() -> None:
    view = camera((0.0, 2.0, 5.0), (300, 300))
    marked, below = place().seen_by(view)
    plain, _ = place(contrast=0.0).seen_by(view)
    apart = (marked.int() - plain.int()).abs().amax(-1)
    assert apart[-40:].median() >= 4 and apart[~below].max() == 0
    assert plain[-1].float().mean() < plain[160].float().mean()  # darker than the horizon


@pytest.mark.parametrize("eye", [(0.0, -3.0, 5.0), (0.0, 0.0, 5.0)])
def test_from_below_there_is_sky_only(eye: tuple[float, float, float]) -> None:
    _, below = place().seen_by(camera(eye))
    assert not below.any()


def test_it_turns_with_the_world() -> None:
    """Another axis up, the same picture."""
    turn = torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=F64)  # y to z
    view = camera((0.0, 2.0, 5.0))
    turned = Camera(view.intrinsics, view.rotation @ turn.T, view.translation, None, view.size)
    other = Backdrop(turn @ UP, torch.zeros(3, dtype=F64), contrast=0.0)
    assert same(other.seen_by(turned)[0], place(contrast=0.0).seen_by(view)[0])


def test_lenses_bend_it() -> None:
    view = camera((0.0, 2.0, 5.0))
    lens = torch.tensor([[-0.3, 0.1, 0.0, 0.0, 0.0]], dtype=F64)
    bent = Camera(view.intrinsics, view.rotation, view.translation, lens, view.size)
    straight, curved = (place().seen_by(each)[1] for each in (view, bent))
    assert len(straight.int().argmax(0).unique()) == 1
    assert len(curved.int().argmax(0).unique()) > 1


def same(a: Tensor, b: Tensor) -> bool:
    return bool((a.int() - b.int()).abs().max() <= 1)
