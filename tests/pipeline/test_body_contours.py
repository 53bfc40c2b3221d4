"""A body found by the edges of images: girths, what is said of it, and images without edges."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace

import numpy as np
import pytest
import synthetic
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import measure
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shape_space import ShapeSpace
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.body_model import load_body_model
from perfcap.pipeline.body_contours import BodyContours
from perfcap.pipeline.images import Images
from perfcap.render.projected_mesh import ProjectedMesh
from perfcap.rigging import BodyFit, PersonMasks, ViewFitSettings, fit_body

QUICK = ViewFitSettings(steps=(12,), edge_heights=(120.0, 200.0), edge_steps=(8, 6))


@dataclass(frozen=True)
class Shown:
    """Pictures of somebody, grey levels of body and background."""

    masks: Tensor  # F C H W
    levels: tuple[int, int] = (200, 40)

    def __len__(self) -> int:
        return len(self.masks)

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        body, behind = self.levels
        grey = torch.where(self.masks[start:stop, view], body, behind)
        return grey[..., None].expand(-1, -1, -1, 3).numpy().astype(np.uint8)


@dataclass(frozen=True)
class Scene:
    """Somebody broad who turns before two cameras."""

    model: BodyModel
    cameras: Camera
    truth: Motion
    detections: Detections
    masks: Tensor

    def fitted(self, levels: tuple[int, int] | None) -> BodyFit:
        """By edges, or by joints alone where there are no pictures."""
        start = replace(self.truth, translation=self.truth.translation + 0.02, shared={})
        images = Images(Shown(self.masks, levels or (0, 0)), self.cameras)
        heights = torch.full((2,), 250.0, dtype=torch.float64)
        edges = None if levels is None else BodyContours(images, heights)
        arguments = self.model, self.cameras, self.detections, start
        with torch.no_grad():
            return fit_body(*arguments, settings=QUICK, contours=edges)

    def girths(self) -> NDArray[np.float64]:
        shape = self.truth.shared[BODY]
        return np.array(astuple(measure(self.model.template(shape))))


@pytest.fixture(scope="module")
def scene() -> Scene:
    whole = load_body_model()
    spaces = (ShapeSpace(x.mean, x.basis[:4]) for x in (whole.surface, whole.bones))
    model = BodyModel(*spaces, whole.rig)
    actor = model.actor(torch.zeros(0))
    rest = actor.skeleton.rest_motion(3)
    turn = torch.zeros(3, 3, dtype=torch.float64)
    turn[:, 1] = torch.tensor([0.0, 0.8, 1.6])
    shape = torch.tensor([-0.6, -1.2, 0.4, 1.0], dtype=torch.float64)
    truth = Motion(torch.zeros(3, 3).double(), turn, rest.angles, {BODY: shape})
    cameras = synthetic.cameras(4, size=400, distance=4.0).select([0, 1])
    pixels = cameras.project(ShapedPoints.of_landmarks(model, actor)(truth)[:, :16])
    draw = torch.Generator().manual_seed(0)
    pixels = pixels + 5 * torch.randn(pixels.shape, generator=draw).to(pixels)
    detections = Detections.from_joints(pixels, torch.ones(pixels.shape[:-1]).to(pixels))
    faces, masks = torch.from_numpy(model.rig.faces), []
    for vertices in ShapedPoints.of_surface(model, actor)(truth):
        seen = (ProjectedMesh.seen_by(cameras.select([v]), vertices, faces) for v in range(2))
        masks.append(torch.stack([mesh.rasterize().mask for mesh in seen]))
    return Scene(model, cameras, truth, detections, torch.stack(masks))


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:body fit. the height is known to:UserWarning")
def test_girths_are_recovered_from_edges(scene: Scene) -> None:
    found, alone = scene.fitted((200, 40)), scene.fitted(None)
    true = scene.girths()
    error = np.abs(np.array(astuple(found.measurements)) - true)
    assert error.max() < 0.03
    assert (
        error[1:4].mean() < 0.5 * np.abs(np.array(astuple(alone.measurements)) - true)[1:4].mean()
    )
    assert (error < 3 * np.array(astuple(found.deviations))).all()
    assert found.support is not None and found.support > 0.6
    assert alone.support is None


def test_contours_stand_alone(scene: Scene) -> None:
    start = replace(scene.truth, shared={})
    edges = BodyContours(Images(Shown(scene.masks), scene.cameras), torch.full((2,), 250.0))
    arguments = scene.model, scene.cameras, scene.detections, start
    masks = PersonMasks(scene.cameras, scene.masks)
    with pytest.raises(InputError, match="in place of masks"):
        fit_body(*arguments, masks, contours=edges)
    with pytest.raises(InputError, match="one shape of all frames"):
        median = replace(QUICK, consensus="median")
        fit_body(*arguments, settings=median, contours=edges)
    with pytest.raises(InputError, match="edge_heights are 2 and edge_steps 1"):
        replace(QUICK, edge_steps=(3,))


@pytest.mark.parametrize("heights", [[250.0], [1.8, 1.8], [250.0, float("nan")]])
def test_heights_are_those_of_every_view_in_pixels(scene: Scene, heights: list[float]) -> None:
    with pytest.raises(InputError, match="of the person in 2 views"):
        BodyContours(Images(Shown(scene.masks), scene.cameras), torch.tensor(heights))


@pytest.mark.long
def test_images_are_those_of_the_frames(scene: Scene) -> None:
    images = Images(Shown(scene.masks[:2]), scene.cameras)
    edges = BodyContours(images, torch.full((2,), 250.0, dtype=torch.float64))
    arguments = scene.model, scene.cameras, scene.detections, replace(scene.truth, shared={})
    with pytest.raises(InputError, match="2 frames but the motion 3"):
        fit_body(*arguments, settings=QUICK, contours=edges)
    with pytest.raises(InputError, match="expected Images and a tensor"):
        BodyContours(images, 250.0)  # type: ignore[arg-type]


@pytest.mark.long
def test_polarity_does_not_matter(scene: Scene) -> None:
    light, dark = scene.fitted((200, 40)), scene.fitted((40, 200))
    torch.testing.assert_close(light.shape, dark.shape, atol=0.02, rtol=0)


@pytest.mark.long
def test_images_without_edges_say_so(scene: Scene) -> None:
    with pytest.warns(UserWarning, match="body fit: edges of the images explain"):
        found = scene.fitted((90, 90))
    assert found.support is not None and found.support < 0.05
