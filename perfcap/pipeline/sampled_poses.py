"""Poses drawn about those of several people, and what a view shows of them (LIU-14)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.coarse_mesh import CoarseMesh
from perfcap.actor.motion import Motion
from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import dual_quaternion_blend
from perfcap.geometry.camera import NEAR, Camera
from perfcap.segment.shape_samples import SampledPeople, ShapeSamples
from perfcap.solve import Step

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PoseSpread:
    """A person whose pose is known but for a Gaussian.

    Attributes:
        actor: with the vertices at rest that the person has.
        center: pose, (1,).
        factor: L of the covariance L L^T of its unknowns, (D, D).
    """

    actor: Actor
    center: Motion
    factor: Tensor

    def draw(self, count: int, generator: torch.Generator) -> Motion:
        """Poses (count,) within the joints' limits, in pairs on both sides of the middle."""
        half, size = (count + 1) // 2, self.center.frame_dim
        noise = torch.randn(half, size, generator=generator, dtype=torch.float64)
        noise = torch.stack([noise, -noise], 1).reshape(2 * half, size)[:count]
        step = noise.to(self.factor) @ self.factor.mT
        many = self.center[torch.zeros(count, dtype=torch.int64)]
        moved = many.retract(Step(step, step.new_zeros(0)))
        lower, upper = self.actor.skeleton.bounds
        angles = moved.angles.clamp(lower[6:], upper[6:])
        return Motion(moved.translation, moved.rotation, angles)


def plain_factor(center: Motion, spread: tuple[float, float, float]) -> Tensor:
    """The factor (D, D) of deviations of the place, m, the rotation and each angle, rad."""
    place, turn, bend = spread
    angles = [bend] * (center.frame_dim - 6)
    return center.angles.new_tensor([*[place] * 3, *[turn] * 3, *angles]).diag()


class PoseSampler:
    """Draws poses of several people and projects them.

    Args:
        actors: of K people; their vertices at rest may be other ones in every frame.
        parts: the body part of each triangle of their meshes, (T,) each.
        settings: how many, and of which mesh.
    """

    def __init__(
        self, actors: Sequence[Actor], parts: Sequence[Tensor], settings: ShapeSamples
    ) -> None:
        self.settings = settings
        pairs = zip(actors, parts, strict=True)
        self.meshes = [_Mesh.of(actor, own.numpy(), settings.cell) for actor, own in pairs]

    @torch.no_grad()
    def sample(
        self, people: Sequence[PoseSpread], camera: Camera, frame: int, outline: float
    ) -> SampledPeople:
        """Everybody in one frame and view; samples of a frame are the same in all of its views.

        Args:
            people: K of them.
            camera: of the view, (1, 1).
            frame: its number.
            outline: deviation of outlines that poses do not explain, m.
        """
        pixels, depth, faces, labels, first = [], [], [], [], 0
        for number, (person, mesh) in enumerate(zip(people, self.meshes, strict=True)):
            seed = (self.settings.seed * 1_000_003 + frame) * 1_000_003 + number
            generator = torch.Generator().manual_seed(seed)
            motion = person.draw(self.settings.count, generator)
            rest = person.actor.vertices[torch.from_numpy(mesh.coarse.chosen)].float()
            rotation, translation = person.actor.joint_transforms(motion)
            transforms = rotation.to(rest), translation.to(rest)
            placed = dual_quaternion_blend(rest, mesh.skin, *transforms)
            points = placed.reshape(1, -1, 3)
            local = camera.to(points).to_camera(points)
            pixels.append(camera.to(points).project_camera(local).reshape(len(placed), -1, 2))
            depth.append(local[..., 2].reshape(len(placed), -1))
            faces.append(torch.from_numpy(mesh.coarse.faces) + first)
            labels.append(mesh.parts + len(JOINTS) * number)
            first += len(rest)
        far = torch.cat(depth, 1)
        focal = torch.linalg.det(camera.intrinsics[..., :2, :2]).abs().sqrt().mean()
        blur = outline * float(focal) / max(float(far.median()), NEAR)
        return SampledPeople(
            torch.cat(pixels, 1).cpu(), far.cpu(), torch.cat(faces),
            np.concatenate(labels).astype(np.int16), np.stack([m.shares for m in self.meshes]),
            blur, self.settings,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Mesh:
    """What is drawn of a person.

    Attributes:
        coarse: mesh.
        skin: its weights, float32.
        parts: body part of its triangles, (T,).
        shares: of the surface that each part is, (P,).
    """

    coarse: CoarseMesh
    skin: SkinWeights
    parts: Integers
    shares: NDArray[np.float64]

    @classmethod
    def of(cls, actor: Actor, parts: Integers, cell: float) -> _Mesh:
        coarse = CoarseMesh.of(actor, cell) if cell > 0 else _whole(actor)
        own = np.array(actor.skeleton.rig.without_clavicles)
        corners = actor.vertices.double().numpy(force=True)[actor.template.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.bincount(parts, np.linalg.norm(normal, axis=1), len(JOINTS))
        joints, weights, _ = coarse.skin.rows()
        device = actor.vertices.device
        skin = SkinWeights(weights.float(), joints).to(device)  # of its own: modules move in place
        return cls(coarse, skin, own[coarse.limbs], area / max(float(area.sum()), 1e-12))


def _whole(actor: Actor) -> CoarseMesh:
    """All of an actor's mesh."""
    faces = actor.template.faces.astype(np.int64)
    owners = actor.skin.rows()[2].numpy(force=True)
    limbs = np.sort(owners[faces], 1)[:, 1]
    return CoarseMesh(np.arange(len(actor.vertices)), faces, actor.skin, limbs)
