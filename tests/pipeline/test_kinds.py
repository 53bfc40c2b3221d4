"""Arguments that are something else than they should be, by name."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from takes import Take, make_take

from perfcap.errors import InputError
from perfcap.io.calibration import CameraRig
from perfcap.pipeline import (
    CaptureConfig,
    Images,
    Person,
    PoseConfig,
    PoseRefiner,
    Scene,
    capture,
    resized,
)


@pytest.fixture(scope="module")
def take() -> Take:
    return make_take(6)


@pytest.mark.parametrize(
    ("position", "wrong", "message"),
    [
        (0, "sam", "actor: got a str, expected Actor: load_actor"),
        (2, (None, []), "detections: got a tuple, expected Detections: read_detections gives"),
        (4, {}, "config: got a dict, expected CaptureConfig"),
        (4, PoseConfig(), "config: got a PoseConfig"),
    ],
)
def test_arguments_by_position(take: Take, position: int, wrong: Any, message: str) -> None:
    """An empty mapping was taken for no settings at all."""
    given: list[Any] = [take.actor, take.cameras, take.detections, take.rate, CaptureConfig()]
    given[position] = wrong
    with pytest.raises(InputError, match=message):
        capture(*given)


@pytest.mark.parametrize(
    ("name", "wrong", "message"),
    [
        ("until", "track_motion", "until: got a str, expected Stage"),
        ("until", 2, "until: got a int"),
        ("images", torch.zeros(6, 1, 4, 4, 3), r"images: got a Tensor, expected Images: Images\("),
        ("checkpoint", "folder", "checkpoint: got a str"),
        ("solve_bones", "no", "solve_bones is 'no', expected True or False"),
        ("level", 1, "level is 1"),
        ("rate", True, "rate is True"),
    ],
)
def test_arguments_by_name(take: Take, name: str, wrong: Any, message: str) -> None:
    given = {"rate": take.rate} | {name: wrong}
    with pytest.raises(InputError, match=message):
        capture(take.actor, take.cameras, take.detections, **given)


def test_a_rig_is_not_its_cameras(take: Take) -> None:
    rig = CameraRig(("front",), take.cameras)
    layer = PoseRefiner(take.actor).eval()
    for call in (
        lambda: capture(take.actor, rig, take.detections, take.rate),  # type: ignore[call-overload]
        lambda: layer(rig, take.detections.joints2d),
    ):
        with pytest.raises(InputError, match="cameras: got a CameraRig, expected Camera"):
            call()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"actor": "sam"}, "actor: got a str"),
        ({"config": CaptureConfig()}, r"config is a CaptureConfig, .* CaptureConfig\(\)\.pose"),
        ({"joint_set": ["l_hip", "r_hip"]}, "joint_set is a list, expected the name"),
    ],
)
def test_settings_of_the_layer(take: Take, settings: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        PoseRefiner(**({"actor": take.actor} | settings))


def test_a_scene_has_its_own(take: Take) -> None:
    scene = Scene(take.cameras, (Person(take.actor, take.detections),), take.rate)
    with pytest.raises(InputError, match="got cameras, detections, rate again"):
        capture(scene, take.cameras, take.detections, 2 * take.rate)  # type: ignore[call-overload]


def test_two_people_are_not_one(take: Take) -> None:
    people = tuple(Person(take.actor, each) for each in (take.detections, take.detections))
    with pytest.raises(InputError, match="people 0 and 1 have the same detections"):
        Scene(take.cameras, people, take.rate)


def test_images_of_another_kind(take: Take) -> None:
    rig = CameraRig(("front",), take.cameras)
    for reader, cameras in ((torch.zeros(6), take.cameras), (rig, rig)):
        with pytest.raises(InputError, match=r"images: reader, cameras and masks are"):
            Images(reader, cameras)  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [(0, 9), (-9, 9), (9.5, 9), (9,)])
def test_sizes_that_are_none(take: Take, size: Any) -> None:
    with pytest.raises(InputError, match="expected whole pixels"):
        resized(take.cameras, size)


def test_estimates_that_are_no_tensors(take: Take) -> None:
    layer, pixels = PoseRefiner(take.actor).eval(), take.detections.joints2d
    for wrong in (pixels.numpy(), [pixels.numpy()], take.detections):
        with pytest.raises(InputError, match=r"joints2d: got .*, expected a tensor, or a list"):
            layer(take.cameras, wrong)


def test_a_word_is_neither_placed_nor_not(take: Take) -> None:
    seen = take.detections
    with pytest.raises(InputError, match="placed is 'no', expected True or False"):
        PoseRefiner(take.actor)(
            take.cameras,
            seen.joints2d,
            joints3d=seen.joints3d,
            placed="no",  # type: ignore[arg-type]
        )


def test_vertices_in_millimetres(take: Take) -> None:
    with pytest.raises(InputError, match="times as large as the actor, expected metres"):
        take.actor.with_vertices(1000 * take.actor.vertices)
