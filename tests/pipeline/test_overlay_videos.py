"""Videos with the captured surface drawn on them: it lies where the cameras see it."""

from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
import torch
from takes import Take, make_take, shrunk, write_video

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import PixelMap
from perfcap.io.clip import Clip
from perfcap.pipeline import CaptureConfig
from perfcap.pipeline.overlay import save_overlay, save_people_overlay, save_textured
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface
from perfcap.render import rasterize

FRAMES, SIZE = 5, (120, 160)


def performance(views: int = 1, moving: bool = False) -> Performance:
    take: Take = make_take(FRAMES, views=views, moving=moving)
    cameras = shrunk(take.cameras, SIZE)
    return Performance(take.actor, cameras, take.detections, take.truth, take.rate, CaptureConfig())


def aside(captured: Performance, offset: float) -> Performance:
    """With a surface of its own: the skinned one, moved along the first camera's x axis."""
    right = captured.cameras.rotation.reshape(-1, 3, 3)[0, 0]
    vertices = SkinnedSurface(captured.actor, captured.motion)[:] + offset * right
    return replace(captured, surface=StoredSurface(vertices.float()))


def clip(folder: Path, views: int = 1, size: tuple[int, int] = SIZE) -> Clip:
    paths = [folder / f"a video {view}.mp4" for view in range(views)]
    for path in paths:
        write_video(path, FRAMES, size, half=60)
    return Clip.open(paths)


def frames(path: Path) -> np.ndarray:
    with av.open(str(path)) as container:
        return np.stack([f.to_ndarray(format="rgb24") for f in container.decode(video=0)])


def silhouette(captured: Performance, frame: int, view: int, cameras: Camera) -> np.ndarray:
    vertices = captured.shown[frame : frame + 1].double()
    local = cameras.frames(slice(frame, frame + 1)).to_camera(vertices)
    pixels = cameras.frames(slice(frame, frame + 1)).project_camera(local)
    faces = torch.tensor(captured.actor.template.faces)
    size = cameras.size[view]
    mask: np.ndarray = rasterize(pixels[0, view], local[0, view, :, 2], faces, size).mask.numpy()
    return mask


def same_pixels(views: int = 1) -> PixelMap:
    return PixelMap(torch.eye(3, dtype=torch.float64).repeat(views, 1, 1))


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("views", [1, 2])
def test_the_character_covers_its_silhouette_and_the_rest_is_dimmed(
    tmp_path: Path, views: int, moving: bool
) -> None:
    captured = aside(performance(views, moving), 0.4)
    path = tmp_path / "textured.mp4"
    told: list[tuple[int, int]] = []
    save_textured(
        path, captured, clip(tmp_path, views), same_pixels(views), lambda *at: told.append(at)
    )
    drawn = frames(path).astype(int)
    assert drawn.shape == (FRAMES, SIZE[0], views * SIZE[1], 3)
    for view in range(views):
        for frame in (0, FRAMES - 1):
            picture = drawn[frame, :, view * SIZE[1] : (view + 1) * SIZE[1]].mean(-1)
            mask = silhouette(captured, frame, view, captured.cameras)
            assert mask.sum() > 200
            assert np.median(picture[mask]) > 100  # light grey on dark grey
            assert abs(np.median(picture[~mask]) - 0.45 * (60 + frame)) < 3
            bright = picture > 70
            assert (bright & mask).sum() / (bright | mask).sum() > 0.8
    assert told == [(FRAMES, FRAMES)]


def test_the_outline_is_that_of_the_surface(tmp_path: Path) -> None:
    captured = performance()
    video, paths = clip(tmp_path), (tmp_path / "a.mp4", tmp_path / "b.mp4")
    save_overlay(paths[0], captured, video, same_pixels())
    save_overlay(paths[1], aside(captured, 0.5), video, same_pixels())
    border = edge(silhouette(aside(captured, 0.5), 2, 0, captured.cameras))
    plain, moved = (np.abs(frames(path)[2].mean(-1) - 62) > 20 for path in paths)
    assert moved[border].mean() > 0.85
    assert plain[border].mean() < 0.3  # the outline of the skinned surface is elsewhere


def edge(mask: np.ndarray) -> np.ndarray:
    """Pixels of a mask next to one outside."""
    inside = mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
    return mask & ~np.pad(inside, 1)


def test_videos_of_another_size_than_the_calibration(tmp_path: Path) -> None:
    captured = performance()
    double = (2 * SIZE[0], 2 * SIZE[1])  # of half the size the person would be its own border
    scale = torch.diag(torch.tensor([0.5, 0.5, 1.0], dtype=torch.float64))
    pixel_map = PixelMap(scale[None])
    save_textured(tmp_path / "t.mp4", captured, clip(tmp_path, size=double), pixel_map)
    picture = frames(tmp_path / "t.mp4")[0].mean(-1)
    mask = silhouette(captured, 0, 0, pixel_map.cameras(captured.cameras, [double]))
    bright = picture > 70
    assert mask.sum() > 800
    assert (bright & mask).sum() / (bright | mask).sum() > 0.85


def test_a_person_out_of_the_picture_leaves_it_dimmed(tmp_path: Path) -> None:
    captured = aside(performance(), 100.0)
    save_textured(tmp_path / "t.mp4", captured, clip(tmp_path), same_pixels())
    assert abs(frames(tmp_path / "t.mp4")[0].mean() - 27) < 2


def test_a_clip_longer_than_the_capture_ends_with_it(tmp_path: Path) -> None:
    captured = performance()
    short = replace(captured, motion=captured.motion[:3])
    save_textured(tmp_path / "t.mp4", short, clip(tmp_path), same_pixels())
    assert len(frames(tmp_path / "t.mp4")) == 3


def test_a_clip_of_other_frames_is_refused(tmp_path: Path) -> None:
    captured = performance()
    write_video(tmp_path / "long.mp4", 40, SIZE, half=60)
    long = Clip.open(tmp_path / "long.mp4")
    part = Clip.open(tmp_path / "long.mp4", frames=slice(10, 12))
    for other in (long, part, clip(tmp_path, views=2)):
        for save in (save_overlay, save_textured):
            with pytest.raises(InputError, match=r"and the capture 5 of 1; expected the clip that"):
                save(tmp_path / "t.mp4", captured, other, same_pixels(other.views))
        with pytest.raises(InputError, match=r"and the capture 5 of 1; expected the clip that"):
            save_people_overlay(tmp_path / "t.mp4", [captured] * 2, other, same_pixels())
    assert not (tmp_path / "t.mp4").exists()
    save_overlay(
        tmp_path / "t.mp4",
        captured,
        Clip.open(tmp_path / "long.mp4", frames=slice(10, 10 + FRAMES)),
        same_pixels(),
    )
    assert len(frames(tmp_path / "t.mp4")) == FRAMES
