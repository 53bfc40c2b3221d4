"""Frames whose joints a check of the inputs contradicts are trusted as the other joints allow."""

import warnings
from dataclasses import replace

import pytest
import torch
from takes import Take, make_take

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.detect.known_person import OPPOSITE
from perfcap.io import models_folder
from perfcap.io.calibration import read_cameras
from perfcap.io.clip import Clip
from perfcap.io.detections import read_detections
from perfcap.io.doctor import Finding, Severity
from perfcap.io.doctor.finding import doubting
from perfcap.pipeline.images import Images
from perfcap.pipeline.input_doubts import scene_doubts
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.people import Person, Scene
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.trust import THRESHOLD

FRAMES, FROM = 60, 40
MIRRORED = list(LANDMARKS16.mirrored())


def exchanged(take: Take, views: list[int]) -> Detections:
    """Left and right exchanged in some views in the last third."""
    joints = take.detections.joints2d.clone()
    joints[FROM:, views] = joints[FROM:, views][:, :, MIRRORED]
    return replace(take.detections, joints2d=joints)


def captured(take: Take, detections: Detections) -> Performance:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return capture(take.actor, take.cameras, detections, take.rate)


def marked(detections: Detections, views: tuple[int, ...]) -> Detections:
    return doubting(
        detections,
        [
            Finding(Severity.WARNING, "all", "of no view in particular"),
            Finding(Severity.WARNING, "some", "", "", tuple(range(FROM, FRAMES)), views),
        ],
    )


def test_findings_doubt_their_frames_and_views_alone() -> None:
    seen = make_take(FRAMES, views=3).detections
    assert doubting(seen, []) is seen
    doubted = marked(seen, (0, 2)).doubted
    assert doubted is not None
    assert doubted[FROM:, [0, 2]].all() and int(doubted.sum()) == 2 * (FRAMES - FROM)
    twice = marked(marked(seen, (0,)), (2,)).doubted
    assert twice is not None and torch.equal(twice, doubted)
    throughout = doubting(seen, [Finding(Severity.WARNING, "a", "of every frame", views=(1,))])
    assert throughout.doubted is not None
    assert throughout.doubted.all(0).tolist() == [False, True, False]
    assert int(throughout.doubted.sum()) == FRAMES


@pytest.mark.long
def test_joints_that_the_others_bear_out_change_little() -> None:
    """A view too many is doubted: the motion fits the other two, and is not named."""
    take = make_take(FRAMES, views=3)
    plain, doubted = (
        captured(take, each) for each in (take.detections, marked(take.detections, (1,)))
    )
    assert plain.trust is not None and doubted.trust is not None
    assert torch.equal(plain.motion.angles, doubted.motion.angles)  # solves use all joints
    assert torch.equal(plain.trust.value[:FROM], doubted.trust.value[:FROM])
    assert (doubted.trust.value <= plain.trust.value).all() and not doubted.trust.doubtful


@pytest.mark.long
def test_frames_without_a_joint_that_is_not_doubted_are_named() -> None:
    take = make_take(FRAMES, views=2)
    trust = captured(take, marked(take.detections, (0, 1))).trust
    assert trust is not None
    ((start, stop, why),) = trust.doubtful
    assert abs(start - FROM) <= 3 and stop == FRAMES and "a check of the inputs" in why
    assert (trust.error[start + 6 :] > 2 * trust.error[:30].max()).all()


@pytest.mark.long
@pytest.mark.parametrize("views", [2, 3])
def test_what_python_finds_reaches_trust(views: int) -> None:
    take = make_take(FRAMES, views=views)
    found = captured(take, exchanged(take, list(range(views))))
    assert any("in every view" in line for line in found.warnings)
    assert found.trust is not None and found.trust.considerable
    assert (found.trust.value[FROM + 3 :] < THRESHOLD).all()


def spoiled(take: Take, mistake: str) -> Performance:
    """A capture in which the second view is wrong in every frame."""
    joints = take.detections.joints2d.clone()
    if mistake == "aside":
        joints[:, 1] += torch.tensor([60.0, 0.0])
    else:
        joints[:, 1] *= 0.5
    return captured(take, replace(take.detections, joints2d=joints))


@pytest.mark.long
def test_a_view_that_is_wrong_throughout() -> None:
    """The motion is trusted as far as the other views bear it out."""
    take = make_take(40, views=3, lifted=False)
    off = spoiled(take, "aside")
    assert any("from where the other views see them" in line for line in off.warnings)
    error = take.error_mm(off.joints())
    assert float(error.mean()) > 100
    assert off.trust is not None and off.trust.considerable
    assert float((off.trust.value < THRESHOLD).double().mean()) > 0.5
    assert (off.trust.value[error > 100] < THRESHOLD).all()
    assert (off.trust.value[error < 10] > THRESHOLD).all()
    fine = spoiled(take, "half the size")
    assert any("times the calibration's size" in line for line in fine.warnings)
    assert float(take.error_mm(fine.joints()).mean()) < 1
    assert fine.trust is not None and not fine.trust.doubtful


@pytest.mark.long
def test_joints_of_one_view_that_are_held() -> None:
    """As where one who is lost stays where they were last seen: nothing shows the motion then."""
    take = make_take(FRAMES)
    frame = torch.arange(FRAMES)
    held = torch.where((frame >= 20) & (frame < 45), 20, frame)
    trust = captured(take, take.detections.frames(held)).trust
    assert trust is not None
    ((start, stop, why),) = trust.doubtful
    assert (start, stop) == (21, 45) and "a check of the inputs" in why
    third = captured(take, take.detections.frames(frame // 3 * 3)).trust
    assert third is not None and not third.doubtful


@pytest.mark.long
@pytest.mark.parametrize(
    ("late", "other", "words"),
    [(0, False, ""), (8, False, "frames late"), (0, True, "left and right look exchanged")],
)
def test_joints_that_images_contradict_are_doubted(late: int, other: bool, words: str) -> None:
    """Nothing but the images is against them."""
    demo = models_folder() / "demo"
    clip, rig = Clip.open(demo / "video.mp4"), read_cameras(demo / "camera.json")
    seen, _ = read_detections([demo / "detections.npz"], views=rig.names)
    seen = seen.frames((torch.arange(seen.frame_count) - late).clamp(min=0)).without_poses()
    if other:
        sides = seen.joints2d[:, :, OPPOSITE], seen.confidence2d[:, :, OPPOSITE]
        seen = replace(seen, joints2d=sides[0], confidence2d=sides[1])
    person = Person(make_take(1).actor, seen)
    scene = Scene(rig.cameras, (person,), clip.fps, Images(clip, rig.cameras))
    told = scene_doubts(scene, person, looked_at=True)
    unseen = scene_doubts(scene, person, looked_at=False)  # no stage does, but images are there
    assert unseen.sentences == told.sentences and unseen.findings == told.findings
    assert (words in " ".join(told.sentences)) and bool(told.findings) == bool(words)
    doubted = doubting(seen, told.findings).doubted
    assert not words if doubted is None else bool(doubted[late:].all())


@pytest.mark.long
def test_images_that_no_stage_looks_at_say_where_joints_are_wrong() -> None:
    """Nothing was said where no stage looked at them: captures followed joints of other frames."""
    demo = models_folder() / "demo"
    clip, rig = Clip.open(demo / "video.mp4"), read_cameras(demo / "camera.json")
    seen, _ = read_detections([demo / "detections.npz"], views=rig.names)
    late = seen.frames((torch.arange(seen.frame_count) - 8).clamp(min=0)).without_poses()
    shown = Images(clip, rig.cameras)
    given = make_take(1).actor, rig.cameras, late, clip.fps
    found = capture(*given, images=shown, until=Stage.INITIALIZE)
    assert any("frames late" in line for line in found.warnings)


@pytest.mark.long
@pytest.mark.parametrize("hidden", [False, True])
def test_joints_of_several_people_that_images_contradict_are_doubted(hidden: bool) -> None:
    """Upside down they are in the right place; whoever stands before one is no other video."""
    demo = models_folder() / "demo"
    clip, rig = Clip.open(demo / "video.mp4"), read_cameras(demo / "camera.json")
    seen = read_detections([demo / "detections.npz"], views=rig.names)[0].without_poses()
    upside = replace(seen, joints2d=2 * seen.joints2d.mean(-2, keepdim=True) - seen.joints2d)
    other = seen if hidden else replace(upside, joints2d=upside.joints2d + 200)
    people = tuple(Person(make_take(1).actor, each) for each in (upside, other))
    scene = Scene(rig.cameras, people, clip.fps, Images(clip, rig.cameras))
    told = scene_doubts(scene, people[0], looked_at=True).sentences
    assert any("of another video or person" in line for line in told) != hidden
