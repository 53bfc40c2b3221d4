"""Free views: the person where the camera sees them, the same every time."""

from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
import torch
from synthetic import actor
from takes import sway

from perfcap.pipeline import free_view as module
from perfcap.pipeline.camera_path import CameraPath, orbit
from perfcap.pipeline.free_view import Studio, draw_free_view, save_free_view
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface
from perfcap.pipeline.surroundings import Surroundings
from perfcap.render import ProjectedMesh

PERSON = actor()
MOTION = sway(PERSON, 20)
JOINTS = PERSON.joints(MOTION)
SURFACE = SkinnedSurface(PERSON, MOTION)
SCENE = Surroundings.around(JOINTS, SURFACE)
SIZE = (90, 120)


def path(frames: list[int], degrees: float = 360.0) -> CameraPath:
    return orbit(JOINTS, SCENE, frames, SIZE, 30.0, degrees)


def pictures(frames: list[int]) -> np.ndarray:
    return np.stack(list(draw_free_view(PERSON.template, SURFACE, SCENE, path(frames))))


def test_the_person_is_where_the_camera_sees_them() -> None:
    frames = list(range(0, 20, 6))
    drawn = pictures(frames)
    assert drawn.shape == (4, *SIZE, 3) and drawn.dtype == np.uint8
    studio = Studio.of(PERSON.template, SCENE, JOINTS[0].mean(0))
    for index, frame in enumerate(frames):
        camera = path(frames).camera(index)
        faces = torch.tensor(PERSON.template.faces)
        mesh = ProjectedMesh.seen_by(camera, SURFACE[frame : frame + 1][0], faces)
        mask = mesh.rasterize().mask.numpy()
        empty, below = (each.numpy() for each in studio.backdrop.seen_by(camera))
        apart = np.abs(drawn[index].astype(int) - empty).max(-1)
        assert mask.sum() > 300
        assert (apart[mask] > 12).mean() > 0.8
        assert apart[~below & ~mask].max() < 60  # rims of the person only
        assert np.median(apart[~mask]) < 3


def test_a_shadow_lies_at_the_feet() -> None:
    studio = Studio.of(PERSON.template, SCENE, JOINTS[0].mean(0))
    camera = path([0]).camera(0)
    drawn = studio.at(SURFACE[0:1][0]).seen_by(camera).astype(int)
    empty, below = (each.numpy() for each in studio.backdrop.seen_by(camera))
    high = replace(SCENE, ground=SCENE.ground - 50.0)  # the ground falls away, shadow and all
    far = Studio(studio.appearance, high, studio.backdrop)
    lit = far.at(SURFACE[0:1][0]).seen_by(camera).astype(int)
    assert (empty - drawn)[below].max() > 25
    assert (lit - drawn)[below].sum() > 1000


def test_pictures_do_not_depend_on_threads_or_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    first = pictures([0, 7, 7, 13])
    np.testing.assert_array_equal(pictures([0, 7, 7, 13]), first)
    monkeypatch.setattr(module, "ordered_map", map)
    np.testing.assert_array_equal(pictures([0, 7, 7, 13]), first)


def test_a_frozen_frame_is_read_and_lit_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    kept = StoredSurface(SURFACE[:].float())

    class Counting:
        frames = 20

        def __getitem__(self, span: slice) -> torch.Tensor:
            calls.append(span)
            return kept[span]

    monkeypatch.setattr(module, "ordered_map", map)
    lit = []
    monkeypatch.setattr(
        module, "visibility", lambda *a, real=module.visibility: lit.append(0) or real(*a)
    )
    list(draw_free_view(PERSON.template, Counting(), SCENE, path([9] * 5)))
    assert len(lit) == 1 and len(calls) == 2


@pytest.mark.long
def test_long_captures_are_read_in_blocks() -> None:
    spans = []

    class Long:
        frames = 200

        def __getitem__(self, span: slice) -> torch.Tensor:
            spans.append(range(*span.indices(200)))
            return SURFACE[0:1].expand(len(spans[-1]), -1, -1)

    joints = JOINTS[:1].expand(200, -1, -1)
    seen = orbit(joints, SCENE, range(50, 90), (16, 16), 30.0)
    assert len(list(draw_free_view(PERSON.template, Long(), SCENE, seen))) == 40
    assert max(len(span) for span in spans) <= 16 and len(spans) <= 4


@pytest.mark.parametrize("away", [0.0, 1e4])
def test_cameras_in_or_far_from_the_person_are_harmless(away: float) -> None:
    here = path([0])
    eye = JOINTS[0].mean(0) + torch.tensor([0.0, 0.0, away], dtype=torch.float64)
    shift = -(here.cameras.rotation @ eye[:, None]).squeeze(-1)
    inside = CameraPath(here.frames, replace(here.cameras, translation=shift))
    (picture,) = draw_free_view(PERSON.template, SURFACE, SCENE, inside)
    assert picture.shape == (*SIZE, 3)


def test_the_video_holds_every_picture(tmp_path: Path) -> None:
    file = tmp_path / "a view.mp4"
    told: list[tuple[int, int]] = []
    seen = path([0, 5, 10])
    drawn = draw_free_view(PERSON.template, SURFACE, SCENE, seen)
    save_free_view(file, drawn, 3, 25.0, lambda *at: told.append(at))
    with av.open(str(file)) as container:
        stream = container.streams.video[0]
        assert stream.average_rate == 25 and stream.codec_context.name == "h264"
        frames = [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]
    assert told == [(1, 3), (2, 3), (3, 3)] and len(frames) == 3
    apart = np.abs(np.stack(frames).astype(int) - pictures([0, 5, 10]))
    assert apart.mean() < 4
