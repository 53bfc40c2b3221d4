"""Camera paths: what they see, where they begin, and cameras of files."""

import math
from dataclasses import replace

import pytest
import torch
from synthetic import actor
from synthetic import cameras as circle
from takes import handheld, sway
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline.camera_path import CameraPath, calibrated, orbit
from perfcap.pipeline.surface import SkinnedSurface
from perfcap.pipeline.surroundings import Surroundings

PERSON = actor()
MOTION = sway(PERSON, 40)
JOINTS = PERSON.joints(MOTION)
SCENE = Surroundings.around(JOINTS, SkinnedSurface(PERSON, MOTION))
F64 = torch.float64


def seen(path: CameraPath, index: int, points: Tensor) -> Tensor:
    return path.camera(index).project(points)[0]


@pytest.mark.parametrize("size", [(300, 200), (200, 300), (64, 64)])
@pytest.mark.parametrize("scale", [1.0, 20.0])
def test_the_whole_person_is_seen_in_every_picture(size: tuple[int, int], scale: float) -> None:
    joints = scale * JOINTS
    scene = replace(SCENE, ground=scale * SCENE.ground)
    path = orbit(joints, scene, range(40), size, 30.0)
    assert len(path) == 40
    surface = scale * SkinnedSurface(PERSON, MOTION)[:]
    for index in range(0, 40, 7):
        pixels = seen(path, index, surface[index])
        assert (pixels >= -0.5).all()
        assert (pixels <= torch.tensor([size[1], size[0]]) - 0.5).all()
        assert float(pixels[:, 1].max() - pixels[:, 1].min()) > 0.4 * min(size)


def test_it_begins_in_front_and_goes_to_the_left() -> None:
    path = orbit(JOINTS, SCENE, [5] * 8, (100, 100), 30.0)
    eyes = path.cameras.centre[:, 0] - JOINTS[5].mean(0)
    assert float(eyes[0] @ SCENE.ahead) > 0.9 * float(eyes[0].norm())
    left = torch.linalg.cross(SCENE.up, SCENE.ahead)
    assert float(eyes[2] @ left) > 0.9 * float(eyes[2].norm())
    assert float(eyes[4] @ SCENE.ahead) < -0.9 * float(eyes[4].norm())
    assert (eyes @ SCENE.up > 0).all()
    torch.testing.assert_close(
        eyes.norm(dim=-1), eyes.norm(dim=-1)[:1].expand(8), rtol=0.05, atol=0
    )


def test_up_is_up_and_a_full_turn_closes() -> None:
    path = orbit(JOINTS, SCENE, [0] * 36, (100, 100), 30.0)
    for index in (0, 9, 30):
        foot, head = seen(path, index, JOINTS[0].mean(0) + torch.stack([-SCENE.up, SCENE.up]))
        assert head[1] < foot[1] - 20 and abs(float(head[0] - foot[0])) < 1e-6
    eyes = path.cameras.centre[:, 0]
    steps = (torch.cat([eyes, eyes[:1]]).diff(dim=0)).norm(dim=-1)
    torch.testing.assert_close(steps, steps[:1].expand(36))


def test_no_turn_is_a_steady_camera() -> None:
    path = orbit(JOINTS, SCENE, range(40), (100, 100), 30.0, 0.0)
    torch.testing.assert_close(path.cameras.rotation, path.cameras.rotation[:1].expand(40, 1, 3, 3))
    jump = path.cameras.centre[:, 0].diff(n=2, dim=0).norm(dim=-1)
    body = JOINTS.mean(1).diff(n=2, dim=0).norm(dim=-1)
    assert jump.max() < body.max()


@pytest.mark.parametrize("frames", [[3], [3, 4]])
def test_a_picture_or_two(frames: list[int]) -> None:
    path = orbit(JOINTS, SCENE, frames, (100, 100), 30.0)
    assert torch.isfinite(path.cameras.translation).all()
    assert path.frames.tolist() == frames


def test_a_fixed_camera_of_a_file_stays() -> None:
    camera = circle(2).select([1])
    path = calibrated(camera, [4, 5, 6], [14, 15, 16])
    for index in range(3):
        torch.testing.assert_close(seen(path, index, JOINTS[4]), camera.project(JOINTS[4])[0])
        assert path.camera(index).size == camera.size


def test_a_moving_camera_counts_as_its_video() -> None:
    camera = handheld(circle(1), 20)
    lens = torch.zeros(20, 1, 5, dtype=F64)
    lens[..., 0] = 0.01
    camera = replace(camera, distortion=lens)
    path = calibrated(camera, [0, 1], [12, 13])
    for index, number in ((0, 12), (1, 13)):
        expected = camera.frames(slice(number, number + 1)).project(JOINTS[:1])[0, 0]
        torch.testing.assert_close(seen(path, index, JOINTS[0]), expected)
    with pytest.raises(InputError, match="has 20 frames, expected one for frame 20"):
        calibrated(camera, [0, 1], [19, 20])


@pytest.mark.parametrize("size", [(800, 800), (200, 600), (600, 200)])
def test_another_size_shows_the_same_in_its_middle(size: tuple[int, int]) -> None:
    camera = circle(1, size=400)
    path = calibrated(camera, [0], [0], size)
    scale = min(size) / 400
    corners = torch.tensor([[-0.5, -0.5], [399.5, 399.5]], dtype=F64)
    rays = torch.nn.functional.pad(camera.to_plane(corners[None]), (0, 1), value=1.0)[0]
    world = (5 * rays - camera.translation[0]) @ camera.rotation[0]
    found = seen(path, 0, world)
    low = torch.tensor([(size[1] - 400 * scale) / 2, (size[0] - 400 * scale) / 2]) - 0.5
    torch.testing.assert_close(found[0], low.to(F64))
    torch.testing.assert_close(found[1], low.to(F64) + 400 * scale)
    assert path.camera(0).size == (size,)


def test_bad_numbers_are_refused_in_one_line() -> None:
    for size in ((15, 100), (100, 5000), (0, 0)):
        with pytest.raises(InputError, match="--size"):
            orbit(JOINTS, SCENE, [0], size, 30.0)
        with pytest.raises(InputError, match="--size"):
            calibrated(circle(1), [0], [0], size)
    for degrees in (float("nan"), float("inf")):
        with pytest.raises(InputError, match="--orbit"):
            orbit(JOINTS, SCENE, [0], (100, 100), 30.0, degrees)


def test_cameras_and_frames_must_fit() -> None:
    camera: Camera = handheld(circle(1), 3)
    with pytest.raises(ValueError, match="a camera of one view for each"):
        CameraPath(torch.arange(2), camera)


@pytest.mark.parametrize("frames", [[], [len(JOINTS)], [-len(JOINTS) - 1]])
def test_rows_that_are_not_there(frames: list[int]) -> None:
    with pytest.raises(InputError, match="frames are"):
        orbit(JOINTS, SCENE, frames, (100, 100), 30.0)


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan])
def test_rates_that_are_none(rate: float) -> None:
    with pytest.raises(InputError, match="rate is"):
        orbit(JOINTS, SCENE, [0], (100, 100), rate)
