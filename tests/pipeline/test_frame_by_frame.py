"""People followed from frame to frame: painted footage, and the rules that decide."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from crowds import RATE, make_crowd
from painted_crowd import PaintedCrowd
from synthetic import actor

import perfcap
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import LimbPoints
from perfcap.detect.association import associate
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.pipeline.autoregression import predict
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.followed_person import Moved, _Before
from perfcap.pipeline.frame_view import FrameView
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.local_global import FrameSolver
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.pose_search import (
    GlobalConfig,
    PoseSearch,
    released_joints,
    released_unknowns,
)
from perfcap.pipeline.presets import LIU
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.stage import Stage
from perfcap.segment import extract_contour
from perfcap.solve.particles import ParticleSettings

FRAMES = 5
CROWD = make_crowd(3, frames=FRAMES, views=5, size=200, noise=4.0)
PAINTED = PaintedCrowd(CROWD)
assert LIU.frames is not None
QUICK = replace(LIU.frames, search=GlobalConfig(particles=ParticleSettings(4, 10, 80)))
RIG = actor().skeleton.rig


def cast(people: int = 2) -> list[perfcap.Person]:
    """Everybody, whom detections show in the first frame alone."""
    found = associate(CROWD.cameras, CROWD.candidates, RATE)
    owners, _ = CROWD.matched(found.slots)
    pairs = sorted(zip(owners, found.people, strict=True), key=lambda pair: pair[0])[:people]
    late = torch.arange(FRAMES)[:, None, None] > 0
    return [
        perfcap.Person(
            CROWD.actors[k],
            replace(seen, confidence2d=seen.confidence2d.masked_fill(late, 0)),
        )
        for k, seen in pairs
    ]


def followed(
    checkpoint: Checkpoint = NO_CHECKPOINT, workers: int = 1, until: Stage = Stage.REFINE_SURFACE
) -> tuple[Performance, ...]:
    scene = perfcap.Scene(CROWD.cameras, tuple(cast()), RATE, Images(PAINTED, CROWD.cameras))
    config = replace(LIU, frames=QUICK)
    return perfcap.capture(
        scene, config=config, checkpoint=checkpoint, workers=workers, until=until
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def found(folder: Path) -> tuple[Performance, ...]:
    return followed(Checkpoint(folder))


def errors(performance: Performance, person: int) -> torch.Tensor:
    """Mean distance of joints in every frame, mm."""
    apart = performance.joints() - CROWD.joints[person]
    return 1000 * apart.norm(dim=-1).mean(-1)


@pytest.mark.long
def test_silhouettes_alone_carry_the_pose(found: tuple[Performance, ...]) -> None:
    for k, each in enumerate(found):
        still = 1000 * (CROWD.joints[k] - CROWD.joints[k][:1]).norm(dim=-1).mean(-1)
        assert still[-1] > 150  # a pose that stays where it began is far off
        assert errors(each, k).max() < 45


@pytest.mark.long
def test_surfaces_stay_with_their_silhouettes(found: tuple[Performance, ...]) -> None:
    for each in found:
        assert each.refinement is not None and each.refinement.surface is not None
        surface = each.refinement.surface
        # the template is the truth here: there is nothing to gain but what labels have wrong
        assert surface.after.mean() > surface.before.mean() - 0.01
        assert surface.after.min() > 0.7
        report = each.refinement.report()["tracking"]
        assert len(report["worst_limb_mm"]) == len(report["released_share"]) == FRAMES


def same(one: tuple[Performance, ...], other: tuple[Performance, ...]) -> bool:
    pairs = zip(one, other, strict=True)
    return all(
        torch.equal(a.motion.angles, b.motion.angles)
        and torch.equal(a.shown[0:FRAMES], b.shown[0:FRAMES])
        and a.refinement.evidence.silhouettes == b.refinement.evidence.silhouettes
        for a, b in pairs
        if a.refinement and b.refinement
    )


@pytest.mark.long
def test_same_bits_with_two_threads(found: tuple[Performance, ...]) -> None:
    assert same(found, followed(workers=2))


@pytest.mark.long
def test_same_bits_after_a_kill(
    found: tuple[Performance, ...], folder: Path, tmp_path: Path
) -> None:
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    journal = tmp_path / "follow_frames.log"
    whole = journal.read_bytes()
    journal.write_bytes(whole[: int(0.55 * len(whole))])  # in the midst of a frame
    assert same(found, followed(Checkpoint(tmp_path)))
    assert journal.read_bytes() == whole


class Known:
    """Silhouettes that somebody has, but for the first frames."""

    def __init__(self, labels: np.ndarray) -> None:
        self.labels = labels

    def knows(self, view: int, frame: int) -> bool:
        return frame > 2

    def mask(self, view: int, frame: int) -> np.ndarray | None:
        return self.labels[view][frame] > 0 if self.knows(view, frame) else None


@pytest.mark.long
def test_one_person_without_surface() -> None:
    (person,) = cast(1)
    alone = replace(CROWD, actors=CROWD.actors[:1], motions=CROWD.motions[:1])
    painted = PaintedCrowd(alone)
    images = Images(painted, CROWD.cameras, masks=Known(painted.labels))
    found = perfcap.capture(
        *(person.actor, CROWD.cameras, person.detections, RATE, replace(LIU, frames=QUICK)),
        images=images, until=Stage.REFINE_POSE, workers=1,
    )  # fmt: skip
    assert errors(found, 0).max() < 45
    assert found.refinement is not None and found.refinement.surface is None
    given = [np.array(found.refinement.evidence.masks(f)) == (painted.labels[:, f] > 0)
             for f in range(FRAMES)]  # fmt: skip
    assert not all(frame.all() for frame in given[:3])
    assert all(frame.all() for frame in given[3:])


class GoesBlank(PaintedCrowd):
    """Images that show nothing from the fourth frame on."""

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        found = super().read_view(view, start, stop).copy()
        found[max(0, 3 - start) :] = 127
        return found


@pytest.mark.long
def test_who_is_not_seen_stays() -> None:
    scene = perfcap.Scene(
        CROWD.cameras, tuple(cast()), RATE, Images(GoesBlank(CROWD), CROWD.cameras)
    )
    config = replace(LIU, frames=QUICK)
    for each in perfcap.capture(scene, config=config, until=Stage.REFINE_POSE, workers=1):
        assert not torch.equal(each.motion.angles[1], each.motion.angles[2])
        for frame in (3, 4):
            assert torch.equal(each.motion.angles[frame], each.motion.angles[2])
            assert torch.equal(each.motion.translation[frame], each.motion.translation[2])


# --- What the last frame says of the next one -----------------------------------------------------

BODY = CROWD.actors[0]
SIGHT = Sight(CROWD.cameras, torch.from_numpy(BODY.template.faces.copy()), BODY.template.weld()[0])
POSES = CROWD.motions[0]


def solver() -> FrameSolver:
    return FrameSolver(BODY, SIGHT, [110.0] * 5, QUICK.local, QUICK.search)


def before(others: float = 0.0) -> _Before:
    """The first frame, of which the left share of the person in view 0 is somebody else's."""
    surface = BODY.surface(POSES[:1])
    (drawn,) = SIGHT.look(surface, slice(0, 1))
    labels = [each.mask.astype(np.uint8) for each in drawn]
    columns = np.flatnonzero(labels[0].any(0))
    hidden = columns[: round(others * len(columns))]
    labels[0][:, hidden] *= 2
    return _Before(POSES[:1], surface[0], drawn, labels, 1)


@pytest.mark.parametrize("others", [0.0, 1.0])
def test_hidden_limbs_are_those_behind_somebody(others: float) -> None:
    one = solver()
    seen = before(others).visible(one.limbs, len(RIG.joints), 0.5)
    drawn = before().drawn[0].labels.label(one.limbs, -1)
    shown = np.isin(np.arange(len(RIG.joints)), drawn.numpy())
    np.testing.assert_array_equal(seen[0], ~shown | (others == 0))
    assert seen[1:].all()
    half = before(0.5).visible(one.limbs, len(RIG.joints), 0.5)[0]
    assert 0 < half.sum() < len(half)


def test_texture_moves_with_its_limb() -> None:
    one, last, view = solver(), before(), 2
    rows, columns = np.nonzero(last.drawn[view].outline.seen)
    corner = last.drawn[view].labels.corner
    chosen = np.random.default_rng(0).permutation(len(rows))[:40]
    pixels = np.stack([columns[chosen] + corner[1], rows[chosen] + corner[0]], 1).astype(float)
    nowhere = np.zeros((1, 2))  # not on the person
    places = np.concatenate([pixels, nowhere])
    moved: list[Moved | None] = [None] * 5
    moved[view] = Moved(places, places)
    texture = last.texture(one, moved)
    assert texture is not None and len(texture) == len(pixels)
    cameras = CROWD.cameras.every_frame(FRAMES)
    # where they were seen, they are
    assert texture.misses(BODY, cameras.frames(slice(0, 1)), POSES[:1]).max() < 0.02
    later = cameras.frames(slice(3, 4))
    assert texture.misses(BODY, later, POSES[3:4]).median() > 2
    # and lines are those of the pixels
    lines = texture.lines(cameras.frames(slice(0, 1)))
    points = LimbPoints(BODY, texture.places, texture.joints)(POSES[:1])[0]
    apart = torch.linalg.cross(points, lines[:, :3]) - lines[:, 3:]
    assert apart.norm(dim=-1).max() < 1e-3


def test_nothing_moved() -> None:
    assert before().texture(solver(), [None] * 5) is None


@pytest.mark.long
def test_search_finds_an_arm_by_silhouettes() -> None:
    surface = BODY.surface(POSES[:1])
    masks = [each.mask for each in SIGHT.look(surface, slice(0, 1))[0]]
    cameras = CROWD.cameras.every_frame(1)
    none = extract_contour(np.zeros((200, 200), np.bool_))
    seen = FrameView(cameras, [none] * 5, masks, None, np.ones((5, len(RIG.joints)), np.bool_))
    joints = np.array([name in ("l_shoulder", "l_elbow") for name in RIG.joints])
    off = torch.tensor([0.7 * (hinge.joint == "l_shoulder") for hinge in RIG.hinges])
    start = replace(POSES[:1], angles=POSES[:1].angles + off)
    wider = PoseSearch(BODY, [110.0] * 5, GlobalConfig())
    found = wider.search(BODY, seen, (start, start), joints, seed=0)
    chosen = released_unknowns(RIG, joints)
    wrist = LANDMARKS.index("l_wrist")
    truth = BODY.joints(POSES[:1])[0, wrist]
    before, after = ((BODY.joints(m)[0, wrist] - truth).norm() for m in (start, found))
    assert before > 0.2 and after < 0.3 * before
    others = [i for i in range(len(RIG.hinges)) if i + 6 not in chosen]
    assert torch.equal(found.angles[:, others], start.angles[:, others])
    assert torch.equal(found.translation, start.translation)


# --- What is released -----------------------------------------------------------------------------


def released(*names: str, share: float = 0.5) -> set[str]:
    misaligned = np.array([name in names for name in RIG.joints])
    joints = released_joints(RIG, misaligned, share)
    return {name for name, chosen in zip(RIG.joints, joints, strict=True) if chosen}


def test_what_is_before_a_joint_of_few_angles_is_released_too() -> None:
    assert released() == set()
    assert released("l_shoulder") == {"l_shoulder"}
    assert released("l_elbow") == {"l_elbow", "l_shoulder"}
    assert released("r_wrist") == {"r_wrist", "r_elbow", "r_shoulder"}
    assert released("r_ankle", "l_hip") == {"r_ankle", "r_knee", "r_hip", "l_hip"}
    assert released("pelvis") == {"pelvis"}


def test_above_half_of_the_joints_all_are() -> None:
    six = ("l_elbow", "r_elbow", "l_knee")
    assert len(released(*six)) == 6
    assert released(*six, "r_knee") == set(RIG.joints)
    assert released(*six, "r_knee", share=0.9) != set(RIG.joints)


def test_unknowns_of_joints() -> None:
    joints = np.array([name in ("pelvis", "l_knee") for name in RIG.joints])
    chosen = released_unknowns(RIG, joints)
    names = [hinge.name for hinge in RIG.hinges]
    assert chosen.tolist() == [0, 1, 2, 3, 4, 5, 6 + names.index("l_knee_flexion")]
    joints[0] = False
    assert released_unknowns(RIG, joints).tolist() == [6 + names.index("l_knee_flexion")]


# --- What is predicted ----------------------------------------------------------------------------


def walk(values: torch.Tensor) -> list[Motion]:
    """Poses whose unknowns, but for the root's rotation, are one number after the other."""
    size = len(RIG.hinges)
    return [
        Motion(v.expand(1, 3), torch.zeros(1, 3, dtype=v.dtype), v.expand(1, size)) for v in values
    ]


def test_steady_motion_goes_on() -> None:
    values = torch.arange(5, dtype=torch.float64) * 0.1
    next_ = predict(walk(values), memory=0.5)
    torch.testing.assert_close(next_.angles, torch.full_like(next_.angles, 0.5))
    torch.testing.assert_close(next_.translation, torch.full_like(next_.translation, 0.5))


def test_one_pose_stays() -> None:
    (only,) = walk(torch.tensor([0.3], dtype=torch.float64))
    assert torch.equal(predict([only], 0.5).angles, only.angles)


def test_a_swing_is_learnt() -> None:
    time = torch.arange(28, dtype=torch.float64)
    values = 0.4 * torch.sin(2 * math.pi * time / 12)
    error = {
        memory: abs(float(predict(walk(values[:27]), memory).angles[0, 0] - values[27]))
        for memory in (1e-6, 10.0)
    }
    assert error[10.0] < 0.02 * error[1e-6]


def test_a_word_that_nobody_reads() -> None:
    with pytest.raises(InputError, match="never, misaligned or always"):
        GlobalConfig(search="sometimes")  # type: ignore[arg-type]
