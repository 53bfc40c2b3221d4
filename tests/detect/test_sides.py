"""Left and right of a person followed through a video."""

import itertools
import math

import pytest
import torch

from perfcap.detect.candidates import Candidates
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.sides import Track, _choose, _placed, settle_sides

ORDER = list(LANDMARKS16.mirrored())
FRAMES, SIZE = 40, 200.0
# how far each joint is to a person's left, and how high, in heights
WIDE = {"shoulder": 0.12, "elbow": 0.2, "wrist": 0.25, "hip": 0.08, "knee": 0.1, "ankle": 0.1}
HIGH = {"head_top": 1.0, "neck": 0.85, "shoulder": 0.82, "elbow": 0.65, "wrist": 0.5, "hip": 0.5,
        "knee": 0.27, "ankle": 0.05}  # fmt: skip


def person(turn: float = 0.0, speed: float = 0.0, frames: int = FRAMES) -> torch.Tensor:
    """Joints (F, 16, 2) of somebody who swings arms and legs, turns and runs."""
    rows = []
    for frame in range(frames):
        facing = math.radians(turn * frame)
        row = []
        for name in LANDMARKS:
            bare = name.split("_", 1)[1] if name[1] == "_" else name
            side = {"l": 1.0, "r": -1.0}.get(name[0], 0.0) if name[1] == "_" else 0.0
            bare = {"toe": "ankle"}.get(bare, bare)
            swing = 0.04 * side * math.sin(0.3 * frame) * (1.0 - HIGH[bare])
            ahead = swing + (0.06 if name.endswith("toe") else 0.0)
            x = side * WIDE.get(bare, 0.0) * math.cos(facing) + ahead * math.sin(facing)
            row.append([x + speed * frame, -HIGH[bare] + 0.3 * ahead])
        rows.append(row)
    return 0.7 * SIZE * torch.tensor(rows) + torch.tensor([300.0, 400.0])


def track(points: torch.Tensor, confidence: float = 0.9, *, candidates: bool = True) -> Track:
    """What a network says that sees both of each pair, and is sure of the sides it gives."""
    count = len(points)
    trust = torch.full((count, 16), confidence)
    trust[:, [name[0] == "l" for name in LANDMARKS]] -= 0.1  # so that exchanges show
    places = torch.stack((points, points[:, ORDER]), 2)
    # in the middle of the body a joint is its own counterpart
    own = torch.tensor([joint == other for joint, other in enumerate(ORDER)])
    second = torch.where(own, trust, 0.1 * trust)
    found = Candidates(places, torch.stack((trust, second), 2)) if candidates else None
    return Track(points, trust, found, torch.full((count,), SIZE))


def exchanged(points: torch.Tensor, frames: slice) -> torch.Tensor:
    wrong = points.clone()
    wrong[frames] = points[frames][:, ORDER]
    return wrong


@pytest.mark.parametrize("turn", [0.0, 3.0, 9.0, 15.0, 25.0])
@pytest.mark.parametrize("candidates", [True, False])
def test_sides_that_are_right_stay(turn: float, candidates: bool) -> None:
    points = person(turn)
    given = track(points, candidates=candidates)
    settled, turned = settle_sides(given, ORDER)
    assert not turned.any()
    torch.testing.assert_close(settled.points, points)
    assert torch.equal(settled.confidence, given.confidence)


@pytest.mark.parametrize("candidates", [True, False])
@pytest.mark.parametrize(
    "frames", [slice(12, 13), slice(20, 32), slice(30, FRAMES), slice(0, 9)], ids=str
)
def test_nobody_turns_round_at_once(frames: slice, candidates: bool) -> None:
    points = person()
    given = track(exchanged(points, frames), candidates=candidates)
    settled, turned = settle_sides(given, ORDER)
    assert torch.equal(settled.confidence[frames], given.confidence[frames][:, ORDER])
    assert turned[frames].all() and turned.sum() == len(points[frames])
    torch.testing.assert_close(settled.points, points)


def test_most_frames_are_right() -> None:
    """Which of two stretches is the wrong one, the greater number says, or the surer."""
    points = person()
    wrong = exchanged(points, slice(24, FRAMES))
    assert settle_sides(track(wrong), ORDER)[1].tolist() == [f >= 24 for f in range(FRAMES)]
    assert settle_sides(track(points.flip(0)), ORDER)[1].any().item() is False
    doubtful = track(wrong)
    assert doubtful.candidates is not None
    early = torch.arange(FRAMES)[:, None, None] < 24
    support = torch.where(early, doubtful.candidates.support.mean(-1, keepdim=True), 1.0)
    support = torch.where(early, support, doubtful.candidates.support)
    unsure = Track(
        wrong, doubtful.confidence, Candidates(doubtful.candidates.places, support), doubtful.size
    )
    assert settle_sides(unsure, ORDER)[1].tolist() == [f < 24 for f in range(FRAMES)]


def test_legs_a_frame_after_arms() -> None:
    """The frame between, whose sides are mixed, does not hide the turn."""
    points = person()
    wrong = exchanged(points, slice(26, FRAMES))
    legs = [n for n, name in enumerate(LANDMARKS) if name[2:] in ("hip", "knee", "ankle", "toe")]
    wrong[26:28, legs] = points[26:28, legs]
    settled, turned = settle_sides(track(wrong), ORDER)
    assert turned[28:].all() and not turned[:26].any()
    torch.testing.assert_close(settled.points, points)


def test_both_sides_on_one_limb() -> None:
    points = person(turn=2.0)
    left, right = LANDMARKS.index("l_knee"), LANDMARKS.index("r_knee")
    given = track(points)
    assert given.candidates is not None
    places, support = given.candidates.places.clone(), given.candidates.support.clone()
    seen = points.clone()
    for frame in (7, 8, 9, 25):  # the map of the left knee peaks on the right one
        seen[frame, left] = points[frame, right]
        places[frame, left] = torch.stack((points[frame, right], points[frame, left]))
        support[frame, left] = torch.tensor([0.6, 0.35])
    wrong = Track(seen, given.confidence, Candidates(places, support), given.size)
    settled, turned = settle_sides(wrong, ORDER)
    assert not turned.any()
    torch.testing.assert_close(settled.points, points)
    assert settled.confidence[8, left] == pytest.approx(0.35)
    assert settled.confidence[8, right] == given.confidence[8, right]
    assert torch.equal(settled.confidence[10], given.confidence[10])


def test_somebody_who_runs() -> None:
    """The way of the whole body costs nothing: 6 % of the crop a frame here."""
    points = person(speed=0.09)
    left, right = LANDMARKS.index("l_wrist"), LANDMARKS.index("r_wrist")
    given = track(points)
    assert given.candidates is not None
    support = given.candidates.support.clone()
    support[:, [left, right], 1] = 0.6
    found = Candidates(given.candidates.places, support)
    settled, turned = settle_sides(Track(points, given.confidence, found, given.size), ORDER)
    assert not turned.any()
    torch.testing.assert_close(settled.points, points)


def test_one_frame_nobody_paired_and_nonsense() -> None:
    points = person(frames=1)
    settled, turned = settle_sides(track(points), ORDER)
    assert torch.equal(settled.points, points) and turned.tolist() == [False]
    settled, turned = settle_sides(track(person()), list(range(16)))
    assert torch.equal(settled.points, person()) and not turned.any()
    crown = person()
    crown[10, 0] = float("nan")
    settled, _ = settle_sides(track(crown), ORDER)
    torch.testing.assert_close(settled.points, crown, equal_nan=True)
    broken = person()
    broken[5] = float("nan")
    settled, turned = settle_sides(track(broken, candidates=False), ORDER)
    assert not turned.any()
    torch.testing.assert_close(settled.points, broken, equal_nan=True)
    lost = track(broken)
    assert lost.candidates is not None
    found = Candidates(lost.candidates.places, lost.candidates.support.clone())
    found.support[5] = 0.0
    settled, _ = settle_sides(Track(broken, lost.confidence, found, lost.size), ORDER)
    keep = [f for f in range(FRAMES) if f != 5]
    torch.testing.assert_close(settled.points[keep], broken[keep])


def test_many_joints_in_the_middle_say_nothing_of_sides() -> None:
    points = person(frames=300)
    wrong = exchanged(points, slice(100, 200))
    face = points[:, :1].expand(-1, 60, -1)
    whole, order = torch.cat((wrong, face), 1), [*ORDER, *range(16, 76)]
    given = Track(whole, torch.full(whole.shape[:2], 0.9), None, torch.full((300,), SIZE))
    settled, turned = settle_sides(given, order)
    assert turned[100:200].all() and turned.sum() == 100
    torch.testing.assert_close(settled.points[:, :16], points)


def _alone(places: torch.Tensor, support: torch.Tensor, pair: tuple[int, int]) -> float:
    """What a frame says for a pair of candidates, nats."""
    a, b = pair
    apart = float((places[0, a] - places[1, b]).norm())
    return math.log(support[0, a] + 1e-3) + math.log(support[1, b] + 1e-3) - 0.6 * (apart < 0.03)


def test_pairs_are_chosen_as_by_trying_everything() -> None:
    """Four frames of one pair with three candidates each: 6561 ways."""
    generator = torch.Generator().manual_seed(3)
    for _ in range(5):
        places = 0.12 * torch.randn(4, 2, 3, 2, generator=generator)
        support = torch.rand(4, 2, 3, generator=generator)
        points = places[:, :, 0].clone()
        trust = support[:, :, 0].clone()
        given = Track(points, trust, Candidates(places, support), torch.ones(4))
        settled = _choose(given, [(0, 1)])
        middle = points.median(1).values
        line = torch.stack((torch.ones(4), torch.arange(4.0)), 1)
        relative = places - (line @ torch.linalg.pinv(line) @ middle)[:, None, None]
        pairs = list(itertools.product(range(3), repeat=2))
        own = [{pair: _alone(places[f], support[f], pair) for pair in pairs} for f in range(4)]
        step = (relative[1:, :, :, None] - relative[:-1, :, None]) / 0.03  # frame side now then xy
        moved = (0.5 * step.square().sum(-1)).clamp(max=8.0).tolist()
        best, way = -math.inf, None
        for chosen in itertools.product(pairs, repeat=4):
            total = sum(own[frame][pair] for frame, pair in enumerate(chosen))
            for frame, (before, now) in enumerate(itertools.pairwise(chosen)):
                total -= sum(moved[frame][side][now[side]][before[side]] for side in range(2))
            if total > best:
                best, way = total, chosen
        assert way is not None
        for frame, pair in enumerate(way):
            for side, index in enumerate(pair):
                place = places[frame, side, index]
                if (place - points[frame, side]).norm() < 0.03:
                    place = points[frame, side]
                assert torch.equal(settled.points[frame, side], place)


def test_frames_without_a_person_do_not_drag_their_neighbours() -> None:
    """Their middle was the image's corner, and a line through it the middle of frames beside."""
    points = person(speed=0.05)
    gap = slice(18, 22)
    hidden = points.clone()
    hidden[gap] = math.nan
    whole = _placed(track(points), points[:, :, None])
    found = _placed(track(hidden), points[:, :, None])
    kept = torch.ones(FRAMES, dtype=torch.bool)
    kept[gap] = False
    assert (found - whole)[kept].norm(dim=-1).max() < 0.02  # of the person's size
    nothing = _placed(track(torch.full_like(points, math.nan)), points[:, :, None])
    assert nothing.isfinite().all()
