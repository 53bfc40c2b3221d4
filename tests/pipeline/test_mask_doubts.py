"""Frames whose masks a network contradicts are named."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from perfcap.pipeline.evidence import RECORDS, Evidence, MaskRecord
from perfcap.pipeline.extract_silhouettes import given_record
from perfcap.pipeline.result_doubts import _of_frames, overlap_doubts
from perfcap.pipeline.result_doubts import mask_doubts as told_of
from perfcap.segment import FrameReport
from perfcap.segment.silhouettes import encode_labels

MASK = encode_labels(np.ones((4, 5), np.bool_))
NAN = float("nan")


def evidence(*views: list[float]) -> Evidence:
    """Of frames whose masks agree with a network as far as the numbers say."""
    records = [
        [MaskRecord(MASK, np.full(3, 200, np.uint8), FrameReport(True, agreement=a)) for a in view]
        for view in views
    ]
    return Evidence.collect(records, torch.ones(len(views)))


def test_a_frame_that_is_contradicted_is_named() -> None:
    found = evidence([0.94, 0.95, 0.6, 0.93, 0.95])
    assert found.doubtful.tolist() == [2]
    report = found.report(first_frame=10)
    assert report["doubtful_masks"] == [12]
    assert report["mask_agreement"] == [0.94, 0.95, 0.6, 0.93, 0.95]


def test_the_worst_view_decides_and_unseen_ones_do_not() -> None:
    found = evidence([0.94, NAN, 0.95, NAN], [0.95, 0.93, 0.5, NAN])
    np.testing.assert_array_equal(found.agreement, [0.94, 0.93, 0.5, NAN])
    assert found.doubtful.tolist() == [2]
    assert found.report()["mask_agreement"][3] is None


def test_a_network_that_is_always_wrong_names_nothing() -> None:
    assert not len(evidence([0.61, 0.6, 0.62, 0.59, 0.63]).doubtful)


def test_what_is_usual_leaves_out_frames_without_an_answer() -> None:
    assert evidence([0.1, 0.2, NAN, 0.15, 0.93]).usual_agreement == 0.175
    assert np.isnan(evidence([NAN, NAN]).usual_agreement)


@pytest.mark.parametrize(
    ("agreement", "told"),
    [(0.1, "output.person"), (0.49, "output.person"), (0.6, "a mirror"), (0.85, "a mirror")],
)
def test_masks_that_a_network_contradicts_throughout_are_told(agreement: float, told: str) -> None:
    (line,) = told_of(evidence([agreement] * 5), 0)
    assert told in line and f"{agreement:.0%}" in line


def test_of_sound_masks_and_without_a_network_nothing_is_told() -> None:
    assert not list(told_of(evidence([0.9, 0.95, 0.93]), 0))
    assert not list(told_of(evidence([NAN, NAN]), 0))


def test_without_a_network_nothing_is_said() -> None:
    found = evidence([NAN, NAN])
    assert not len(found.doubtful)
    assert "mask_agreement" not in found.report()
    assert found.report()["doubtful_masks"] == []


def surely(*views: list[int], given: int | None = None) -> Evidence:
    """Of frames whose contours have these confidences, in bytes."""
    records = [
        [
            MaskRecord(MASK, np.full(3, sure, np.uint8), FrameReport(True, given=frame == given))
            for frame, sure in enumerate(view)
        ]
        for view in views
    ]
    return Evidence.collect(records, torch.ones(len(views)))


def test_masks_that_are_less_sure_and_less_like_the_body_are_named() -> None:
    sure, overlap = [200] * 12, np.full(12, 0.95)
    assert not len(surely(sure).odd(overlap))
    overlap[4] = 0.85
    assert surely(sure).odd(overlap).tolist() == [4]
    sure[7] = 120
    assert surely(sure).odd(overlap).tolist() == [4, 7]
    # of several views the least sure one counts, and what is usual is usual in its own
    assert surely([60] * 12, sure).odd(overlap).tolist() == [4, 7]
    assert surely(sure, given=7).odd(overlap).tolist() == [4]
    assert len(list(told_of(surely(sure), 2))) == 1


def test_a_few_frames_do_not_say_what_is_usual() -> None:
    assert not len(surely([200, 200, 200, 10]).odd(np.array([0.95, 0.95, 0.95, 0.1])))


def test_agreement_survives_a_checkpoint() -> None:
    records = [MaskRecord(MASK, np.zeros(2, np.uint8), FrameReport(True, agreement=0.75))]
    (again,) = RECORDS.unpack(RECORDS.pack(records))
    assert again.report.agreement == 0.75


@pytest.mark.parametrize(("overlap", "told"), [(0.01, True), (0.5, True), (0.8, False)])
def test_masks_of_somebody_else_are_told(overlap: float, told: bool) -> None:
    """Inverted ones, mirrored ones, boxes; a few bad frames are named elsewhere."""
    lines = list(overlap_doubts(np.array([overlap] * 6 + [0.0, 0.9])))
    assert bool(lines) == told
    assert not told or f"by {overlap:.0%} only" in lines[0]


def square(left: int) -> np.ndarray:
    found = np.zeros((20, 40), np.bool_)
    found[4:16, left : left + 12] = True
    return found


def test_a_given_mask_beside_the_model_does_not_count() -> None:
    models = square(3), np.zeros((20, 40), np.bool_)
    kept, other, of_nobody = (
        given_record(mask, model)
        for mask, model in ((square(6), models[0]), (square(22), models[0]), (square(3), models[1]))
    )
    assert [r.report.beside for r in (kept, other, of_nobody)] == [False, True, False]
    assert kept.confidence.all() and of_nobody.confidence.all()
    assert len(other.confidence) and not other.confidence.any()
    found = Evidence.collect([[kept, other], [kept, kept]], torch.ones(2))
    assert found.beside.tolist() == [1]


def test_given_masks_that_are_empty_are_said_to_be_empty() -> None:
    """Nobody knows whether the person is outside the image."""
    nothing = given_record(np.zeros((4, 5), np.bool_))
    found = Evidence.collect([[nothing, nothing]], torch.ones(1))
    assert found.report()["nobody_in_view"] == []
    assert found.report()["no_contour"] == [0, 1]
    assert any("the masks are empty" in line for line in _of_frames(found))
