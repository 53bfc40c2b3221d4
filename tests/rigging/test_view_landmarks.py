"""Landmarks from pictures of a mesh: a detector that knows them, one that errs, one that fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.actor.bare_mesh import BareMesh
from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import BODY
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.look import Box
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.body_model import load_body_model
from perfcap.rigging.auto_rig import auto_rig
from perfcap.rigging.fit_surface import BodyFitter, FitSettings
from perfcap.rigging.view_landmarks import (
    ViewSettings,
    agreed_points,
    see_landmarks,
    surrounding_cameras,
)

QUICK = FitSettings(screened=1, first=2, rounds=7, samples=(250, 350), arms=(40.0,))
SMALL = ViewSettings(side=64)
SIDES = [LANDMARKS.index({"r": "l_", "l": "r_"}.get(n[0], n[0]) + n[2:])
         if n[:2] in ("r_", "l_") else i for i, n in enumerate(LANDMARKS)]  # fmt: skip


class Knowing:
    """A detector that is told where joints are in space, and errs by a number of pixels."""

    def __init__(self, places: Tensor, noise: float = 0.0, sureness: float = 1.0) -> None:
        self.places, self.noise, self.sureness = places, noise, sureness
        self.random = torch.Generator().manual_seed(5)
        self.images, self.boxes = torch.empty(0), list[Box]()

    def __call__(
        self,
        images: Tensor,
        boxes: Sequence[Box | None] | None = None,
        cameras: Camera | None = None,
    ) -> Detections:
        assert boxes is not None and cameras is not None
        self.images, self.boxes = images, [box for box in boxes if box is not None]
        seen = cameras.project(self.places[None])
        seen = seen + self.noise * torch.randn(seen.shape, generator=self.random).to(seen)
        return Detections.from_joints(seen.float(), torch.full(seen.shape[:-1], self.sureness))


@pytest.fixture(scope="module")
def model() -> BodyModel:
    return load_body_model()


@pytest.fixture(scope="module")
def person(model: BodyModel) -> tuple[BareMesh, Tensor]:
    """Somebody with lowered arms, as ``stand_up`` leaves them, and the landmarks."""
    fitter = BodyFitter(model, QUICK)
    start = fitter.starts()[0]
    shape = torch.zeros(model.components, dtype=torch.float64)
    shape[:6] = torch.tensor([0.8, -0.6, 0.5, 0.4, -0.7, 0.6])
    motion = replace(start, shared={BODY: shape})
    surface = fitter.surface(motion)[0]
    shift = -torch.stack([surface[:, 0].median(), surface[:, 1].min(), surface[:, 2].median()])
    mesh = BareMesh((surface + shift).numpy(), model.rig.faces, name="scan")
    return mesh, fitter.marks(motion)[0, : len(LANDMARKS)] + shift


def plane_of(cameras: Camera, places: Tensor) -> Tensor:
    return cameras.to_plane(cameras.project(places[None])[0])


def test_most_views_win_over_those_that_swap_the_sides(person: tuple[BareMesh, Tensor]) -> None:
    mesh, places = person
    cameras = surrounding_cameras(mesh, SMALL)
    plane = plane_of(cameras, places)
    plane[[3, 4]] = plane[[3, 4]][:, SIDES]  # sides are confused from behind
    sure = torch.ones(plane.shape[:-1]).to(plane)
    found, trust = agreed_points(cameras, plane, sure, 0.01, 3)
    torch.testing.assert_close(found, places, atol=1e-6, rtol=0)
    assert (trust[2:] == 6 / 8).all()  # crown and neck are the same to both


def test_what_views_do_not_agree_on_is_not_found(person: tuple[BareMesh, Tensor]) -> None:
    mesh, places = person
    cameras = surrounding_cameras(mesh, SMALL)
    plane = plane_of(cameras, places)
    sure = torch.ones(plane.shape[:-1]).to(plane)
    sure[2:, 0] = 0  # two views see it
    plane[:, 1] += 0.2 * torch.randn(8, 2, generator=torch.Generator().manual_seed(1)).to(plane)
    sure[:, 2] = 0  # nobody does
    found, trust = agreed_points(cameras, plane, sure, 0.01, 3)
    assert trust[:3].tolist() == [0, 0, 0] and (found[:3] == 0).all()
    assert (trust[3:] == 1).all()
    torch.testing.assert_close(found[3:], places[3:], atol=1e-6, rtol=0)


def test_pictures_show_the_whole_person_from_all_sides(person: tuple[BareMesh, Tensor]) -> None:
    mesh, places = person
    detector = Knowing(places)
    seen = see_landmarks(mesh, detector, SMALL)
    torch.testing.assert_close(seen.places, places, atol=1e-4, rtol=0)
    assert (seen.found, seen.views) == (16, (8, 8))
    assert detector.images.shape == (1, 8, 3, 64, 64)
    wall = detector.images[0, :, :, 0, 0]
    shown = (detector.images[0] != wall[..., None, None]).any(1)  # 8 64 64
    for picture, (left, top, right, bottom) in zip(shown, detector.boxes, strict=True):
        rows, columns = (picture.any(axis).nonzero() for axis in (1, 0))
        for first, last, low, high in (
            (*rows[[0, -1]], top, bottom),
            (*columns[[0, -1]], left, right),
        ):
            assert abs(float(first) - low) < 1.5 and abs(float(last) - high) < 1.5
        assert 0 < left < right < 63 and 0 < top < bottom < 63 and bottom - top > 30


def test_a_texture_that_cannot_be_read_is_told(person: tuple[BareMesh, Tensor]) -> None:
    mesh, places = person
    spoiled = replace(mesh, uv=np.zeros((len(mesh.vertices), 2)), texture=b"no picture")
    with pytest.raises(InputError, match="mesh 'scan': its texture cannot be decoded"):
        see_landmarks(spoiled, Knowing(places), SMALL)


@pytest.mark.long
def test_bodies_follow_what_the_detector_sees(
    model: BodyModel, person: tuple[BareMesh, Tensor]
) -> None:
    mesh, places = person
    errors = {}
    for name, detector in (("none", None), ("seen", Knowing(places, noise=1.0))):
        template, report = auto_rig(mesh, model, settings=QUICK, detector=detector)
        found = [template.bone_rest[template.bone(name), :3, 3] for name in LANDMARKS]
        errors[name] = float(np.linalg.norm(np.stack(found) - places.numpy(), axis=1).mean())
        assert (report.seen is None) == (detector is None)
    assert errors["seen"] < min(0.015, 0.7 * errors["none"])


def test_a_detector_that_finds_nobody_is_told(
    model: BodyModel, person: tuple[BareMesh, Tensor]
) -> None:
    mesh, places = person
    with pytest.raises(InputError, match="'scan': the detector finds 0 of 16 landmarks alike in 8"):
        auto_rig(mesh, model, settings=QUICK, detector=Knowing(places, sureness=0.0))
