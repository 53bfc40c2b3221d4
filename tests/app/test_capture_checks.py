"""Mistakes in units, axes and pixels that a capture names before it solves anything."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from runs import Command
from synthetic import cameras as circle
from takes import TakeFiles, make_take, write_detections, write_video

from perfcap.app.capture_checks import examined, refuse_wrong
from perfcap.app.capture_request import named_doubts
from perfcap.app.inputs import Inputs
from perfcap.commands.capture import Capture
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.io.calibration import CameraRig
from perfcap.io.clip import Clip


def normalised(given: Detections) -> Detections:
    return replace(given, joints2d=given.joints2d / 160)


def in_millimetres(given: Detections) -> Detections:
    assert given.joints3d is not None
    return replace(given, joints3d=1000 * given.joints3d)


def mirrored(given: Detections) -> Detections:
    assert given.joints3d is not None
    return replace(given, joints3d=given.joints3d * torch.tensor([1.0, -1.0, 1.0]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (normalised, "normalised"),
        (in_millimetres, "expected a person in millimetres"),
        (mirrored, "runs against the image's y"),
    ],
)
def test_detections_that_would_spoil_everything_are_refused(
    take: TakeFiles, tmp_path: Path, perfcap: Command, change: object, words: str
) -> None:
    assert callable(change)
    path = tmp_path / "changed.npz"
    write_detections(path, change(take.take.detections))
    line = perfcap(take.command(tmp_path / "out", detections=path)).refused()
    assert words in line


def inputs_of(detections: Detections, count: int = 3) -> Inputs:
    cameras = circle(count, size=600)
    rig = CameraRig(tuple(f"view{v}" for v in range(count)), cameras)
    return Inputs(None, rig, detections, None, ())  # type: ignore[arg-type]


def test_good_views_are_not_spoken_of(caplog: pytest.LogCaptureFixture) -> None:
    take = make_take(20, views=3)
    refuse_wrong(inputs_of(take.detections))
    assert not caplog.records


def test_views_of_different_people_are_refused() -> None:
    first, other = make_take(20, views=3), make_take(20, views=3, turns=2.0)
    pixels = first.detections.joints2d.clone()
    pixels[:, 1] = other.detections.joints2d[:, 1].flip(0) + 90
    pixels[:, 2] = other.detections.joints2d[:, 2] - 120
    mixed = replace(first.detections, joints2d=pixels, joints3d=None)
    with pytest.raises(InputError, match="disagree on the person"):
        refuse_wrong(inputs_of(mixed))


@pytest.mark.long
def test_networks_may_follow_different_people() -> None:
    """Cameras that are right were said to be transposed, and nothing else."""
    first, other = make_take(20, views=3), make_take(20, views=3, turns=2.0)
    pixels = first.detections.joints2d.clone()
    pixels[:, 1] = other.detections.joints2d[:, 1].flip(0) + 90
    pixels[:, 2] = other.detections.joints2d[:, 2] - 120
    mixed = inputs_of(replace(first.detections, joints2d=pixels, joints3d=None))
    with pytest.raises(InputError, match=r"--people 1 follows the same one in all$"):
        refuse_wrong(mixed, apart=True)
    with pytest.raises(InputError) as refused:
        refuse_wrong(mixed)
    assert "--people" not in str(refused.value)


def test_presets_have_the_names_of_the_command() -> None:
    for floor in ("auto", "none"):  # which changes settings of the preset
        request = Capture(
            videos=(Path("a.mp4"),),
            actor=("average",),
            cameras=Path("cameras.json"),
            preset="monoperfcap",
            floor=floor,
        )
        first, second = named_doubts(request, 3)
        assert first.startswith("--preset monoperfcap: has the published weights of one view")
        assert "--preset default is made for several" in first and "run.json expects" in second


@pytest.mark.long
@pytest.mark.parametrize(("people", "advised"), [(False, True), (True, False), (None, False)])
def test_people_are_advised_where_there_is_such_an_option(
    tmp_path: Path, people: bool | None, advised: bool
) -> None:
    """It was beside --people 1 as well, and by ``actor fit``, which does not know it."""
    take = make_take(20, views=4)
    paths = [tmp_path / f"view{view}.mp4" for view in range(4)]
    for path in paths:
        write_video(path, 20, (64, 64))
    pixels = take.detections.joints2d.clone()
    pixels[:, 1] = 0.9 * pixels[:, 1].flip(0) + 40
    off = inputs_of(replace(take.detections, joints2d=pixels, joints3d=None), 4)
    off = replace(off, rig=replace(off.rig, cameras=take.cameras), clip=Clip.open(paths))
    found = examined(off, needs_images=False, detected=True, people=people)
    lines = [line for line in found.warnings if "sees the person" in line]
    assert len(lines) == 1 and ("--people" in lines[0]) == advised


@pytest.mark.long
@pytest.mark.parametrize(("people", "advised"), [(False, True), (True, False), (None, False)])
def test_a_view_that_looks_late_may_show_somebody_else(
    tmp_path: Path, people: bool | None, advised: bool
) -> None:
    """Networks that follow whom each view sees best: to synchronise the videos was all advice."""
    take = make_take(40, views=4)
    paths = [tmp_path / f"view{view}.mp4" for view in range(4)]
    for path in paths:
        write_video(path, 40, (64, 64))
    pixels = take.detections.joints2d.clone()
    pixels[:-9, 1] = pixels[9:, 1]
    late = inputs_of(replace(take.detections, joints2d=pixels, joints3d=None), 4)
    late = replace(late, rig=replace(late.rig, cameras=take.cameras), clip=Clip.open(paths))
    found = examined(late, needs_images=False, detected=True, people=people)
    lines = [line for line in found.warnings if "synchronise" in line]
    assert len(lines) == 1 and ("--people 1 follows the same one" in lines[0]) == advised
