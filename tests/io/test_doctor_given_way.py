"""Ways of moving cameras that their videos contradict, and those that they do not."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from doctored_views import one
from filmed_room import FRAMES, RATE, Room
from numpy.typing import NDArray
from takes import camera_entry, write_detections, write_json

from perfcap.app.capture_checks import examined as examined_inputs
from perfcap.app.inputs import read_inputs
from perfcap.commands.views import Views
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.doctor import Severity, examine_inputs
from perfcap.io.doctor.finding import Finding
from perfcap.io.doctor.given_way import examine_way
from perfcap.io.video_writer import VideoWriter

ROOM = Room()


def examined(room: Room, camera: Camera | None = None, first: int = 0) -> list[Finding]:
    return examine_way(room, ["phone"], camera or room.camera, RATE, room.seen, first)


@pytest.mark.long
def test_a_right_file_and_where_nothing_shows_a_wrong_one() -> None:
    assert examined(ROOM) == []
    assert examine_way(ROOM, ["phone"], ROOM.camera, RATE) == []  # nobody is known
    plain = Room(plain=True)
    assert examined(plain, plain.camera.frames(torch.arange(FRAMES).flip(0))) == []
    still = ROOM.camera
    fixed = Camera(still.intrinsics[0], still.rotation[0], still.translation[0], None, still.size)
    assert examined(ROOM, fixed) == []


def drifting(camera: Camera, degrees: float) -> Camera:
    """Turned by so much more every second, from the middle on."""
    late = (torch.arange(FRAMES).double() / RATE - 1.0).clamp(min=0)[:, None, None]
    turn = rotvec_to_matrix(math.radians(degrees) * late * torch.tensor([0.0, 1.0, 0.0]).double())
    moved = (turn @ camera.translation[..., None])[..., 0]
    return replace(camera, rotation=turn @ camera.rotation, translation=moved)


@pytest.mark.long
def test_a_drift_is_named_with_its_frames() -> None:
    found = one(examined(ROOM, drifting(ROOM.camera, 3.0), first=200))
    assert found.severity is Severity.WARNING and found.subject == "phone"
    frames = found.what.split("in frames ")[1]
    assert 215 <= int(frames.split("-")[0]) <= 240 and frames.endswith("274")
    assert "moves otherwise" in found.what and "solve the camera again" in found.remedy


@pytest.mark.long
def test_a_lens_that_zooms() -> None:
    assert "K of every frame" in one(examined(Room(zoom=1.3))).remedy


@pytest.mark.long
def test_a_way_that_runs_backwards() -> None:
    found = one(examined(ROOM, ROOM.camera.frames(torch.arange(FRAMES).flip(0))))
    assert "as the poses do in reverse" in found.what and "first frame's pose" in found.remedy


@pytest.mark.long
@pytest.mark.parametrize(("late", "said"), [(8, "8 frames before"), (-5, "5 frames later")])
def test_poses_of_other_frames_say_which(late: int, said: str) -> None:
    frames = (torch.arange(FRAMES) + late).clamp(0, FRAMES - 1)
    assert f"moves as poses of {said} do" in one(examined(ROOM, ROOM.camera.frames(frames))).what


@dataclass(frozen=True)
class Cut:
    """Some frames of the room."""

    start: int
    count: int

    def __len__(self) -> int:
        return self.count

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        return ROOM.read_view(view, self.start + start, self.start + stop)


@pytest.mark.long
@pytest.mark.parametrize("start", [0, 20, FRAMES - 30])
def test_a_clip_of_a_second_is_looked_at_too(start: int) -> None:
    frames = torch.arange(start, start + 30)
    right = ROOM.camera.frames(frames)
    wrong = {
        "backwards": right.frames(torch.arange(30).flip(0)),
        "late": right.frames((torch.arange(30) - 8).clamp(min=0)),
        "inverse": replace(
            right,
            rotation=right.rotation.mT,
            translation=-(right.rotation.mT @ right.translation[..., None])[..., 0],
        ),
    }
    seen = (ROOM.seen[0][frames.numpy()], ROOM.seen[1][frames.numpy()])
    told = {
        kind: examine_way(Cut(start, 30), ["phone"], camera, RATE, seen, first=start)
        for kind, camera in ({"right": right} | wrong).items()
    }
    assert [kind for kind, found in told.items() if found] == list(wrong)
    for found in told.values():
        assert all("moves otherwise than the camera's poses" in each.what for each in found)


@pytest.mark.long
def test_poses_that_are_held_are_named() -> None:
    """As where a tracker found its place late: the first one it knows, until then."""
    held = ROOM.camera.frames(torch.arange(FRAMES).clamp(min=16))
    found = one(examined(ROOM, held, first=100))
    assert "poses in frames 100-116 are the same" in found.what and found.subject == "phone"
    assert "solve the camera there again" in found.remedy


class Counted:
    """Counts the frames that are read."""

    def __init__(self) -> None:
        self.read: set[int] = set()

    def __len__(self) -> int:
        return FRAMES

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        self.read.update(range(start, stop))
        return ROOM.read_view(view, start, stop)


@pytest.mark.long
def test_a_long_clip_is_looked_at_in_parts() -> None:
    """Three frames a second are a clip of 25 s, one a second of 75."""
    backwards = ROOM.camera.frames(torch.arange(FRAMES).flip(0))
    for rate, most in ((3.0, FRAMES), (1.5, 40)):
        for camera, named in ((ROOM.camera, 0), (backwards, 1)):
            clip = Counted()
            assert len(examine_way(clip, ["phone"], camera, rate, ROOM.seen)) == named
            assert len(clip.read) <= most


@pytest.mark.long
def test_distortion_is_taken_out() -> None:
    bent = Room(distortion=(-0.5, 0.25, 0.0, 0.0, 0.0))
    assert examined(bent) == []
    one(examined(bent, replace(bent.camera, distortion=None)))


@pytest.mark.long
def test_each_of_several_views_is_looked_at() -> None:
    class Both:
        def __len__(self) -> int:
            return FRAMES

        def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
            return ROOM.read_view(view, start, stop)

    right, wrong = ROOM.camera, drifting(ROOM.camera, 3.0)
    cameras = Camera(
        *(torch.cat((getattr(right, part), getattr(wrong, part)), 1)
          for part in ("intrinsics", "rotation", "translation")),
        None, right.size * 2,
    )  # fmt: skip
    seen = tuple(part.repeat(2, 1) for part in ROOM.seen)
    found = one(examine_way(Both(), ["a", "b"], cameras, RATE, (seen[0], seen[1])))
    assert found.subject == "b"


@pytest.mark.long
def test_doctor_and_capture_say_so_with_and_without_joints(tmp_path: Path) -> None:
    video, path, joints = (tmp_path / name for name in ("a.mp4", "camera.json", "a.npz"))
    with VideoWriter(video, RATE) as writer:
        for picture in ROOM.pictures:
            writer.write(picture)
    entry = camera_entry(ROOM.camera)
    write_json(path, entry)
    assert examine_inputs(path, (), [video]) == []
    write_json(path, entry | {key: entry[key][::-1] for key in ("R", "t")})
    assert "in reverse" in one(examine_inputs(path, (), [video])).what
    places, sure = (torch.from_numpy(part) for part in ROOM.seen)
    write_detections(joints, Detections.from_joints(places, sure, None))
    assert any("in reverse" in each.what for each in examine_inputs(path, [joints], [video]))
    inputs = read_inputs(Views(videos=(video,), cameras=path, detections=(joints,)))
    for given in (True, False):
        told = examined_inputs(inputs, needs_images=True, detected=True, given=given).warnings
        assert any("in reverse" in line for line in told) == given
