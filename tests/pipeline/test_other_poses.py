"""Cameras that are given twice, for joints and for images or masks, have the same poses."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch
from takes import Take, make_take

from perfcap.geometry.camera import Camera
from perfcap.io.doctor.same_poses import pose_doubts
from perfcap.pipeline.images import Images
from perfcap.pipeline.input_doubts import scene_doubts, warn_of_other_poses
from perfcap.pipeline.people import Person, Scene

FRAMES = 24
NAMES = ["left", "right"]


class Blank:
    """A dark room."""

    def __len__(self) -> int:
        return FRAMES

    def read_view(self, view: int, start: int, stop: int) -> np.ndarray:
        return np.zeros((stop - start, 600, 600, 3), np.uint8)


@pytest.fixture(scope="module")
def rest() -> Take:
    return make_take(FRAMES, views=2)


@pytest.fixture(scope="module")
def moving() -> Take:
    return make_take(FRAMES + 10, views=2, moving=True)


def said(cameras: Camera, others: Camera) -> list[str]:
    return [line.split(": are")[0] for line in pose_doubts(NAMES, cameras, others, "the images")]


def test_the_same_poses_with_other_lenses(rest: Take, moving: Take) -> None:
    for cameras in (rest.cameras, moving.cameras):
        half = replace(cameras, intrinsics=0.5 * cameras.intrinsics, size=((300, 300),) * 2)
        refined = replace(cameras, translation=cameras.translation + 0.01)
        assert said(cameras, cameras) == said(cameras, half) == said(cameras, refined) == []


def test_poses_of_something_else_are_named(rest: Take, moving: Take) -> None:
    fixed = rest.cameras
    assert len(said(fixed, fixed.select([1, 0]))) == 2
    turned = replace(fixed, rotation=_aside(fixed))
    assert said(fixed, turned) == ["cameras of the images of right"]
    one = replace(fixed, translation=fixed.translation + torch.tensor([[0.0], [0.1]]))
    assert said(fixed, one) == ["cameras of the images of right"]
    early, late = (moving.cameras.frames(slice(k, k + FRAMES)) for k in (0, 10))
    assert said(early, late) and said(early, moving.cameras.map(lambda each: each[0]))


def test_captures_and_joint_refinements_say_so(rest: Take) -> None:
    """Images were believed to be where their own cameras said: surfaces went elsewhere."""
    person = Person(rest.actor, rest.detections)
    other = rest.cameras.select([1, 0])
    for cameras, wrong in ((rest.cameras, False), (other, True)):
        scene = Scene(rest.cameras, (person,), rest.rate, Images(Blank(), cameras))
        told = scene_doubts(scene, person, looked_at=False).sentences
        assert any("cameras of the images of view 0" in line for line in told) == wrong
    with pytest.warns(UserWarning, match="cameras of masks of view 1: are up to"):
        warn_of_other_poses(rest.cameras, replace(rest.cameras, rotation=_aside(rest.cameras)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_other_poses(rest.cameras, rest.cameras)
        learned = replace(other, translation=other.translation.clone().requires_grad_())
        warn_of_other_poses(rest.cameras, learned)


def _aside(cameras: Camera) -> torch.Tensor:
    """Rotations of which that of the second view is the first one's."""
    return cameras.rotation[[0, 0]]
