"""Images that are given in Python show the way of the cameras that come with them."""

import pytest
import torch
from filmed_room import FRAMES, RATE, Room
from synthetic import actor

from perfcap.detect.detections import Detections
from perfcap.pipeline.images import Images
from perfcap.pipeline.input_doubts import scene_doubts
from perfcap.pipeline.people import Person, Scene


@pytest.mark.long
def test_poses_in_reverse_are_named() -> None:
    room = Room()
    places, sure = (torch.from_numpy(part) for part in room.seen)
    person = Person(actor(), Detections.from_joints(places, sure, None))
    backwards = room.camera.frames(torch.arange(FRAMES).flip(0))
    for cameras, named in ((room.camera, False), (backwards, True)):
        scene = Scene(cameras, (person,), RATE, Images(room, cameras))
        told = scene_doubts(scene, person, looked_at=True).sentences
        assert any("as the poses do in reverse" in line for line in told) == named
