"""``perfcap capture --masks``: silhouettes that somebody has are used as they are."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from runs import Command
from takes import TakeFiles, silhouettes, write_take
from written_files import report

GIVEN = (2, 3, 7)
FRAMES = 10


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> TakeFiles:
    return write_take(tmp_path_factory.mktemp("take"), FRAMES)


def write_masks(folder: Path, masks: dict[int, np.ndarray]) -> Path:
    folder.mkdir()
    for frame, mask in masks.items():
        cv2.imwrite(str(folder / f"{frame:06d}.png"), 255 * mask.astype(np.uint8))
    return folder


@pytest.mark.long
def test_given_masks_come_out_as_they_went_in(
    small: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    truth = silhouettes(small.take)
    folder = write_masks(tmp_path / "masks", {f: truth[f] for f in GIVEN})
    call = ("--until", "refine_pose", "--segmenter", "none", "--no-overlay")
    done = perfcap(small.command(tmp_path / "out", *call, "--masks", str(folder)))
    assert done.code in (0, 3), done
    assert any("are given for 3 of 10 frames, 2 to 7" in note for note in done.notes), done.notes
    written = [
        cv2.imread(str(tmp_path / "out" / "masks" / f"{f:06d}.png"), cv2.IMREAD_GRAYSCALE) > 0
        for f in range(FRAMES)
    ]
    same = [bool(np.array_equal(found, mask)) for found, mask in zip(written, truth, strict=True)]
    assert [f for f in range(FRAMES) if same[f]] == list(GIVEN)
    assert report(tmp_path / "out")["refinement"]["given_masks"] == list(GIVEN)


@pytest.mark.long
def test_masks_of_something_else_in_some_frames_are_named_and_not_used(
    small: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    truth = silhouettes(small.take)
    given = {f: ~truth[f] if f == 7 else truth[f] for f in range(FRAMES)}
    folder = write_masks(tmp_path / "masks", given)
    call = ("--until", "refine_pose", "--no-overlay", "--masks", str(folder))
    done = perfcap(small.command(tmp_path / "out", *call))
    assert done.code in (0, 3), done
    assert any("in 1 frame given masks lie beside" in note for note in done.notes)
    found = report(tmp_path / "out")["refinement"]
    assert found["doubtful_masks"] == [7]
    assert found["mask_confidence"][7] == 0 and min(found["mask_confidence"][:7]) == 1


@pytest.mark.long
def test_masks_of_all_frames_leave_nothing_to_find(
    small: TakeFiles, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unwanted(*_: object) -> None:
        raise AssertionError("nobody should look for a person")

    monkeypatch.setattr("perfcap.segment.sequence.segment", unwanted)
    monkeypatch.setattr("perfcap.pipeline.extract_silhouettes.survey", unwanted)
    folder = write_masks(tmp_path / "masks", dict(enumerate(silhouettes(small.take))))
    call = ("--until", "refine_pose", "--no-overlay", "--masks", str(folder))
    done = perfcap(small.command(tmp_path / "out", *call))
    assert done.code in (0, 3), done
    assert not [note for note in done.notes if "are given for" in note]


@pytest.mark.long
def test_numbers_that_begin_with_1_are_told(
    small: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    truth = silhouettes(small.take)
    late = {frame + 1: mask for frame, mask in enumerate(truth[:5])}
    some = {frame: truth[frame] for frame in range(2, 5)}
    for name, masks, expected in (("late", late, True), ("some", some, False)):
        folder = write_masks(tmp_path / name, masks)
        call = ("--until", "refine_pose", "--segmenter", "none", "--no-overlay", "--frames", "0:5")
        done = perfcap(small.command(tmp_path / f"of {name}", *call, "--masks", str(folder)))
        assert any("begin with 1" in note for note in done.notes) == expected, done.notes


@pytest.mark.long
def test_masks_without_legs_are_told(small: TakeFiles, tmp_path: Path, perfcap: Command) -> None:
    for name, share in (("whole", 1.0), ("half", 0.6)):
        masks = {}
        for frame, mask in enumerate(silhouettes(small.take)[:5]):
            top, *_, bottom = np.flatnonzero(mask.any(1))
            masks[frame] = mask.copy()
            masks[frame][int(top + share * (bottom - top)) + 1 :] = False
        folder = write_masks(tmp_path / name, masks)
        call = ("--until", "refine_pose", "--segmenter", "none", "--no-overlay", "--frames", "0:5")
        done = perfcap(small.command(tmp_path / f"of {name}", *call, "--masks", str(folder)))
        told = [note for note in done.notes if "leave out" in note]
        assert bool(told) == (name == "half"), done.notes
        assert not told or ("l_ankle" in told[0] and "r_ankle" in told[0])


@pytest.mark.long
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda mask: ~mask, "of the detected joints of the views"),
        (lambda mask: np.roll(mask, 60, 1), "of the detected joints of the views"),
    ],
    ids=["inverted", "aside"],
)
def test_masks_of_nobody_are_refused_before_any_solve(
    small: TakeFiles, tmp_path: Path, perfcap: Command, spoil, words: str
) -> None:
    folder = write_masks(tmp_path / "m", {f: spoil(silhouettes(small.take)[f]) for f in GIVEN})
    call = ("--until", "refine_pose", "--no-overlay", "--masks", str(folder))
    assert words in perfcap(small.command(tmp_path / "out", *call)).refused()


@pytest.mark.long
def test_masks_that_stay_while_the_person_moves_are_told(
    small: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    truth = silhouettes(small.take)
    folder = write_masks(tmp_path / "held", {f: truth[min(f, 2)] for f in range(FRAMES)})
    call = ("--until", "refine_pose", "--no-overlay", "--masks", str(folder))
    done = perfcap(small.command(tmp_path / "out", *call))
    assert any("masks are the same in frames 2-9" in note for note in done.notes), done.notes
