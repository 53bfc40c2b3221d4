"""Several people in images: who is where, what is hidden, and what it does to their poses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from crowds import RATE, make_crowd
from painted_crowd import PaintedCrowd

import perfcap
from perfcap.detect.association import associate
from perfcap.metrics import mask_overlap
from perfcap.pipeline import CaptureConfig
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.evidence import Evidence, MaskRecord
from perfcap.pipeline.extract_people import PeopleSource, Seen, extract_people
from perfcap.pipeline.images import Images
from perfcap.pipeline.overlap import frame_overlaps
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.sight import Sight, View
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surface import StoredSurface
from perfcap.pipeline.surface_config import RefineSurfaceConfig, SilhouetteConfig
from perfcap.render import LabelMap
from perfcap.segment import FrameReport
from perfcap.segment.silhouettes import encode_labels
from perfcap.segment.trimap import bounds

pytestmark = pytest.mark.long  # all of them look at one capture, which takes seconds

CROWD = make_crowd(3, frames=10, views=3, size=200, noise=9.0)
PAINTED = PaintedCrowd(CROWD)
CONFIG = CaptureConfig(refine_surface=RefineSurfaceConfig(nodes=100))


def scene() -> perfcap.Scene:
    found = associate(CROWD.cameras, CROWD.candidates, RATE)
    owners, _ = CROWD.matched(found.slots)
    people = sorted(zip(owners, found.people, strict=True), key=lambda pair: pair[0])
    cast = tuple(perfcap.Person(CROWD.actors[k], seen) for k, seen in people)
    return perfcap.Scene(CROWD.cameras, cast, RATE, Images(PAINTED, CROWD.cameras))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def found(folder: Path) -> tuple[Performance, ...]:
    return perfcap.capture(scene(), config=CONFIG, checkpoint=Checkpoint(folder), workers=1)


def labels_of(performance: Performance) -> np.ndarray:
    assert performance.refinement is not None
    silhouettes = replace(performance.refinement.evidence.silhouettes, person=None)
    frames, views = range(len(silhouettes)), range(silhouettes.views)
    return np.array([[silhouettes.labels(f, v) for f in frames] for v in views])


def test_pixels_come_to_whom_they_show(found: tuple[Performance, ...]) -> None:
    labels, truth = labels_of(found[0]), PAINTED.labels
    there = truth > 0
    assert (truth == 1).sum() > 1000 < (truth == 2).sum()
    assert (labels == truth)[there].mean() > 0.95
    given = there & (labels > 0)
    assert (labels == truth)[given].mean() > 0.985
    assert (labels > 0)[~there].mean() < 0.02


def sight_of(performance: Performance) -> Sight:
    template = performance.actor.template
    return Sight(CROWD.cameras, torch.as_tensor(template.faces.copy()), template.weld()[0])


def test_where_people_meet_they_are_looked_for_from_refined_surfaces(
    found: tuple[Performance, ...],
) -> None:
    once = replace(CONFIG, silhouettes=SilhouetteConfig(closer=0))
    before = perfcap.capture(scene(), config=once, workers=1)
    names = [[stage.name for stage in each[0].stages] for each in (before, found)]
    more = ["extract_silhouettes_3", "refine_surface_2", "extract_silhouettes_4"]
    assert names[1] == names[0] + more
    # people are told from each other anew, not from the background
    one, other = labels_of(before[0]), labels_of(found[0])
    np.testing.assert_array_equal(one > 0, other > 0)
    assert (one != other).any()
    there = (other > 0) & (PAINTED.labels > 0)
    assert (other != PAINTED.labels)[there].mean() < 0.001


def test_a_refined_surface_is_drawn_and_believed_more(found: tuple[Performance, ...]) -> None:
    each = found[0]
    moved = StoredSurface(each.actor.surface(each.motion) + torch.tensor([0.0, 0.1, 0.0]))
    given = each.actor, sight_of(each), each.motion, torch.full((10, 16), 0.02), torch.ones(3)
    layers, models = [], []
    for seen in (Seen(*given), Seen(*given, moved)):
        source = PeopleSource([seen], PAINTED, SilhouetteConfig().again)
        layers += source.layers(1, 5)
        models.append(source.models(1, 5, layers[-1:]))
    np.testing.assert_array_equal(*models)  # of the foreground, whatever the surface
    assert layers[0].box != layers[1].box
    np.testing.assert_allclose(layers[1].spread, layers[0].spread / 2, rtol=0.02)
    assert layers[1].doubt == layers[0].doubt / 2


def test_what_is_known_stays_where_nobody_meets(found: tuple[Performance, ...]) -> None:
    """Nothing is looked at there: no frame is read."""
    apart, people = [], []
    for k, each in enumerate(found, 1):
        assert each.refinement is not None
        labels = np.zeros((200, 200), np.uint8)
        labels[50:150, 40:60], labels[50:150, 140:160] = 1, 2
        known = MaskRecord(encode_labels(labels), np.full(7, k, np.uint8), FrameReport(True))
        heights = each.refinement.evidence.pixel_unit * 100
        apart.append(Evidence.collect([[known] * 10] * 3, heights, k))
        given = each.motion, torch.full((10, 16), 0.01), heights, each.surface
        people.append(Seen(each.actor, sight_of(each), *given))

    class Unread:
        def __len__(self) -> int:
            return 10

        def read_view(self, view: int, start: int, stop: int) -> np.ndarray:
            raise AssertionError("a frame is read")

    settings = SilhouetteConfig().again
    again = extract_people(people, Unread(), settings, 1, before=apart)
    for one, other in zip(apart, again, strict=True):
        assert one.silhouettes == other.silhouettes and one.reports == other.reports
        np.testing.assert_array_equal(one.confidence, other.confidence)
    with pytest.raises(AssertionError, match="a frame is read"):
        extract_people(people, Unread(), settings, 1)


def test_silhouettes_of_one_leave_out_the_other(found: tuple[Performance, ...]) -> None:
    labels = labels_of(found[0])
    for k, each in enumerate(found, 1):
        assert each.refinement is not None
        evidence = each.refinement.evidence
        for frame in (0, 5):
            unknown = evidence.unknown(frame)
            assert unknown is not None
            for view, (mask, other) in enumerate(zip(evidence.masks(frame), unknown, strict=True)):
                np.testing.assert_array_equal(mask, labels[view, frame] == k)
                np.testing.assert_array_equal(other, labels[view, frame] == 3 - k)


def test_images_bring_joints_nearer_to_the_truth(found: tuple[Performance, ...]) -> None:
    before = perfcap.capture(replace(scene(), images=None), config=CONFIG)
    for k, (one, other) in enumerate(zip(before, found, strict=True)):
        errors = [(each.joints() - CROWD.joints[k]).norm(dim=-1).mean() for each in (one, other)]
        assert errors[1] < 0.95 * errors[0]


def test_surfaces_meet_their_silhouettes(found: tuple[Performance, ...]) -> None:
    for each in found:
        assert each.refinement is not None and each.refinement.surface is not None
        surface = each.refinement.surface
        assert surface.after.mean() >= surface.before.mean() > 0.8
        assert each.surface is not None and each.surface.frames == 10


def test_a_border_is_an_outline_of_the_nearer_alone(found: tuple[Performance, ...]) -> None:
    labels = labels_of(found[0])
    center = CROWD.cameras.to_camera(CROWD.joints.mean(2, keepdim=True).flatten(0, 1))
    far = center[..., 0, 2].reshape(2, 10, 3)  # K F C
    trusted: dict[bool, list[float]] = {True: [], False: []}
    for k, each in enumerate(found):
        assert each.refinement is not None
        for frame, view in np.ndindex(10, 3):
            line = each.refinement.evidence.contours(frame)[view]
            column, row = np.rint(line.points + 2 * line.normals).astype(int).T.clip(0, 199)
            beside = labels[view, frame][row, column] == 2 - k
            nearer = bool(far[k, frame, view] < far[1 - k, frame, view])
            if abs(far[k, frame, view] - far[1 - k, frame, view]) > 0.3:
                trusted[nearer] += line.confidence[beside].tolist()
    assert len(trusted[True]) > 100 < len(trusted[False])
    assert np.mean(trusted[False]) < 0.05 and np.mean(trusted[True]) > 0.3


def test_what_is_hidden_counts_for_nothing(found: tuple[Performance, ...]) -> None:
    """A surface that is right overlaps by as much, whether or not somebody stands before it."""
    (one, _) = found
    assert one.refinement is not None
    evidence = one.refinement.evidence
    hidden = np.array([PAINTED.labels[v, f] == 2 for f in range(10) for v in range(3)])
    assert hidden.any((1, 2)).all()

    def drawn_as(mask: np.ndarray) -> View:
        part = bounds(mask, 2)
        triangle = torch.from_numpy(mask[part].astype(np.int32) - 1)
        depth = torch.where(triangle < 0, torch.inf, 1.0)
        corner = part[0].start, part[1].start
        view = View(np.zeros((0, 2)), np.zeros(0), LabelMap(depth, triangle, corner), mask.shape)
        np.testing.assert_array_equal(view.mask, mask)
        return view

    frame = 5
    known = [drawn_as(m) for m in evidence.masks(frame)]
    unknown = evidence.unknown(frame)
    assert unknown is not None
    through = [drawn_as(d.mask | u) for d, u in zip(known, unknown, strict=True)]
    for drawn in (known, through):
        assert frame_overlaps([[d.outline for d in drawn]], evidence, range(frame, frame + 1)) == [
            1.0
        ]
    masks = evidence.masks(frame)
    half = [drawn_as(m & (np.arange(m.shape[1]) < np.nonzero(m)[1].mean())) for m in masks]
    expected = np.mean([mask_overlap(h.mask, m).iou for h, m in zip(half, masks, strict=True)])
    assert 0.2 < expected < 0.8
    assert frame_overlaps([[h.outline for h in half]], evidence, range(frame, frame + 1)) == [
        expected
    ]


def test_what_was_done_is_not_done_again(folder: Path, found: tuple[Performance, ...]) -> None:
    told: list[str] = []
    again = perfcap.capture(
        scene(), config=CONFIG, checkpoint=Checkpoint(folder), workers=2,
        progress=lambda stage, *_: told.append(stage),
    )  # fmt: skip
    for one, other in zip(found, again, strict=True):
        assert torch.equal(one.motion.angles, other.motion.angles)
        assert one.surface is not None and other.surface is not None
        assert torch.equal(one.surface[0:10], other.surface[0:10])
    np.testing.assert_array_equal(labels_of(found[0]), labels_of(again[1]))
    assert "extract_silhouettes" in told and "person 2: refine_surface" in told
    names = {path.name for path in folder.iterdir()}
    assert "extract_silhouettes_0.log" in names and "person1_refine_pose.log" in names


def test_stages_share_the_time_of_what_they_share(found: tuple[Performance, ...]) -> None:
    one, other = ({s.name: s.cpu for s in each.stages} for each in found)
    assert list(one) == list(other)
    assert one["extract_silhouettes"] == other["extract_silhouettes"]
    assert one["refine_pose"] != other["refine_pose"]


def test_one_person_of_a_scene_with_images_has_the_same_bits() -> None:
    whole = scene()
    person, images = whole.people[0], whole.images
    options = {"config": CONFIG, "until": Stage.REFINE_POSE, "workers": 1}
    (inside,) = perfcap.capture(replace(whole, people=(person,)), **options)
    alone = perfcap.capture(
        person.actor, CROWD.cameras, person.detections, RATE, images=images, **options
    )
    assert torch.equal(inside.motion.angles, alone.motion.angles)
    assert inside.refinement is not None and alone.refinement is not None
    for frame in range(10):
        pair = inside.refinement.evidence, alone.refinement.evidence
        masks = [each.masks(frame) for each in pair]
        np.testing.assert_array_equal(*masks)
        assert all(each.unknown(frame) is None for each in pair)
