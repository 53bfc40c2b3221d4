"""Gaussians that fill a body: placed inside its mesh, then fitted to its silhouettes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.volume import GAUSSIANS, Volume
from perfcap.errors import InputError
from perfcap.render.density import Splats, background
from perfcap.render.label_map import rasterize
from perfcap.setting_checks import require_size

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_SPACING = 0.015  # m, between points inside
_FEWEST = 20  # points of a joint's part that is worth a Gaussian
_POWER = 0.25  # of a part's points: what is thin shows as much outline as what is thick
_ROUNDS = 25  # of the clustering
_FAR = 100.0  # m, of a parallel camera
_BLUR = 0.5  # px: coverage of a pixel is a mean over it


@dataclass(frozen=True)
class VolumeFit:
    """How Gaussians are fitted to silhouettes of a body, at rest and in other poses.

    Attributes:
        height: of the body in the images, px.
        views: directions about the vertical in each pose.
        poses: beside the rest pose.
        bend: of the other poses' angles, as a share of what their limits leave, normal deviation.
        steps: of Adam.
        rates: step sizes of centres, m; of the logarithms of deviations and densities.
        stay: pull of a centre towards where it was placed, per m^2.
        thinnest: least deviation, m.
    """

    height: float = 260.0
    views: int = 6
    poses: int = 4
    bend: float = 0.25
    steps: int = 600
    rates: tuple[float, float] = (0.003, 0.06)
    stay: float = 0.05
    thinnest: float = 0.005


def fit_volume(
    actor: Actor, count: int = GAUSSIANS, settings: VolumeFit | None = None, seed: int = 0
) -> Volume:
    """A volume whose silhouettes are the actor's.

    Points inside the mesh are clustered joint by joint; centres, deviations and densities of the
    clusters then minimise the squared difference of ``1 - B`` and silhouettes.

    Args:
        actor: with a mesh.
        count: Gaussians, at least two for each joint with a part of the mesh.
        settings: of the fit.
        seed: of the clustering and the poses.

    Raises:
        InputError: the actor has no mesh with an inside, or too few Gaussians are asked for.
    """
    rng = np.random.default_rng(seed)
    placed = place_gaussians(actor, count, rng)
    return Silhouettes(actor, settings or VolumeFit(), rng).fitted(placed)


def place_gaussians(actor: Actor, count: int, rng: np.random.Generator) -> Volume:
    """Clusters of the points inside a body, joint by joint, as dense as they look solid."""
    points = interior(actor)
    owner = _owners(actor, points)
    wanted = _shares(np.bincount(owner, minlength=len(actor.skeleton.rig.joints)), count)
    centres, deviations, joints = [], [], []
    for joint, number in enumerate(wanted):
        if not number:
            continue
        own = points[owner == joint]
        middle, label = _clusters(own, number, rng)
        for cluster, centre in enumerate(middle):
            rest = own[label == cluster] - centre
            spread = math.sqrt((rest**2).sum(1).mean() / 3) if len(rest) else 0.0
            centres.append(centre)
            deviations.append(spread + 0.1 * _SPACING)
            joints.append(joint)
    like = actor.skeleton.rest_positions
    width = torch.tensor(np.array(deviations))
    return Volume(
        centres=torch.tensor(np.array(centres)).to(like),
        deviations=width.to(like),
        densities=(math.e / (math.sqrt(2 * math.pi) * width)).to(like),
        joints=torch.tensor(joints, device=like.device),
    )


def interior(actor: Actor, spacing: float = _SPACING) -> Floats:
    """Points of a grid inside the mesh of an actor at rest, (N, 3) m.

    Raises:
        InputError: there are too few, as the mesh encloses nothing; spacing is no size.
    """
    from perfcap.actor import _interior_numba

    require_size(spacing, "spacing", finite=True)
    vertices = actor.vertices.double().numpy(force=True)
    faces = np.ascontiguousarray(actor.template.faces, dtype=np.int64)
    low, high = vertices.min(0), vertices.max(0)
    low = low + 0.381966 * spacing  # columns off vertices and edges, which lie on round numbers
    shape = tuple(int(n) + 1 for n in np.floor((high - low)[:2] / spacing))
    z, sense, count = _interior_numba.crossings(vertices, faces, low[:2], spacing, shape)
    points = []
    for i, j in np.argwhere(count):
        some = count[i, j]
        order = np.argsort(z[i, j, :some])
        depth, level = z[i, j, order], np.cumsum(sense[i, j, order])
        for start, stop, inside in zip(depth[:-1], depth[1:], level[:-1], strict=True):
            if inside > 0:
                first = math.ceil((start - low[2]) / spacing)
                last = math.floor((stop - low[2]) / spacing)
                points += [(i, j, k) for k in range(first, last + 1)]
    if len(points) < 10 * _FEWEST:
        raise InputError(
            f"actor {actor.template.name!r}: its mesh encloses {len(points)} points "
            f"{1000 * spacing:.0f} mm apart; a volume needs a closed mesh with its outside outside"
        )
    found: Floats = low + spacing * np.array(points, dtype=np.float64)
    return found


def _owners(actor: Actor, points: Floats) -> Integers:
    """The joint that moves each point: that of most weight among the vertices nearest to it."""
    template = actor.template
    dense = np.zeros((len(template.vertices), len(actor.skeleton.rig.joints)))
    joints = np.array(actor.bone_joints)[template.weight_bones]
    np.add.at(dense, (np.arange(len(dense))[:, None], joints), template.weights)
    near = cKDTree(actor.vertices.double().numpy(force=True)).query(points, k=8)[1]
    owners: Integers = dense[near].mean(1).argmax(1)
    return owners


def _shares(counts: Integers, total: int) -> Integers:
    """Gaussians of each joint's part: two at least, the rest by the power of its points."""
    there = counts > _FEWEST
    if 2 * there.sum() > total:
        raise InputError(
            f"{total} Gaussians are asked for, but {int(there.sum())} joints carry parts of the "
            f"mesh; expected at least {2 * int(there.sum())}"
        )
    size = np.where(there, counts, 0) ** _POWER
    wanted: Integers = np.maximum(2 * there, np.floor(total * size / size.sum()).astype(np.int64))
    while wanted.sum() < total:
        wanted[np.argmax(size / np.maximum(wanted, 1))] += 1
    while wanted.sum() > total:
        wanted[np.argmin(np.where(wanted > 2, size / np.maximum(wanted, 1), np.inf))] -= 1
    return wanted


def _clusters(points: Floats, count: int, rng: np.random.Generator) -> tuple[Floats, Integers]:
    """k-means: centres (K, 3), and the cluster of each point."""
    centres = points[rng.choice(len(points), count, replace=False)]
    for _ in range(_ROUNDS):
        label = cKDTree(centres).query(points)[1]
        number = np.bincount(label, minlength=count)
        sums = np.stack([np.bincount(label, points[:, k], count) for k in range(3)], 1)
        centres = np.where(number[:, None] > 0, sums / np.maximum(number, 1)[:, None], centres)
    label = cKDTree(centres).query(points)[1]
    return centres, label


class Silhouettes:
    """Silhouettes of an actor in parallel projection, in several poses.

    Args:
        actor: with a mesh.
        settings: views, poses and the size of the images.
        rng: of the poses.
    """

    def __init__(self, actor: Actor, settings: VolumeFit, rng: np.random.Generator) -> None:
        self.settings = settings
        motion = _poses(actor, settings, rng)
        with torch.no_grad():
            rotation, shift = actor.joint_transforms(motion)
            surface = actor.surface(motion).double().cpu()
        self.rotation, self.shift = rotation.double().cpu(), shift.double().cpu()
        size = float(np.ptp(actor.vertices.double().numpy(force=True)[:, 1]))
        self.scale = settings.height / size
        faces = torch.tensor(actor.template.faces)
        self.looks: list[tuple[int, _Look]] = []
        self.masks: list[Tensor] = []
        for pose, vertices in enumerate(surface):
            for view in range(settings.views):
                angle = math.pi * (view + 0.5 * (pose % 2)) / settings.views
                look = _Look.at(vertices, angle, self.scale)
                pixels, depth = look.project(vertices)
                self.looks.append((pose, look))
                drawn = rasterize(pixels, depth + _FAR, faces, look.size).mask
                self.masks.append(drawn.double())

    def fitted(self, volume: Volume) -> Volume:
        """Centres, deviations and densities that minimise the squared error."""
        settings, start = self.settings, volume.centres.double().cpu()
        free = [
            torch.zeros_like(start).requires_grad_(),
            volume.deviations.double().cpu().log().requires_grad_(),
            torch.ones(len(start), dtype=torch.float64).requires_grad_(),
        ]
        joints, order = volume.joints.cpu(), np.random.default_rng(0)
        rates = [settings.rates[0], settings.rates[1]]
        groups = [{"params": free[:1], "lr": rates[0]}, {"params": free[1:], "lr": rates[1]}]
        adam = torch.optim.Adam(groups)
        fall = torch.optim.lr_scheduler.OneCycleLR(adam, rates, settings.steps)
        with torch.enable_grad():
            for step in range(settings.steps):
                if step % len(self.looks) == 0:
                    turn = order.permutation(len(self.looks))
                which = int(turn[step % len(self.looks)])
                moved, width, thickness = free[0], free[1].exp() + settings.thinnest, free[2].exp()
                left = self._left(which, start + moved, width, thickness, joints)
                wrong = ((1 - left) - self.masks[which]).square().sum() / self.masks[which].sum()
                loss = wrong + settings.stay * moved.square().sum(-1).mean()
                adam.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                adam.step()
                fall.step()
        like, (moved, width, thick) = volume.centres, (each.detach() for each in free)
        width = width.exp() + settings.thinnest
        return Volume(
            (start + moved).to(like),
            width.to(like),
            (thick.exp() / (math.sqrt(2 * math.pi) * width)).to(like),
            volume.joints,
        )

    def _left(
        self, which: int, centres: Tensor, deviations: Tensor, thickness: Tensor, joints: Tensor
    ) -> Tensor:
        """The background that is left, (H, W)."""
        pose, look = self.looks[which]
        turned = (self.rotation[pose, joints] @ centres[..., None]).squeeze(-1)
        pixels, _ = look.project(turned + self.shift[pose, joints])
        inverse = 1 / ((self.scale * deviations).square() + _BLUR**2)
        form = torch.stack((inverse, torch.zeros_like(inverse), inverse), -1)
        return background(Splats(pixels, form, thickness), look.size)[0]

    def overlap(self, volume: Volume) -> list[float]:
        """Intersection over union of ``B < 1/2`` with each silhouette."""
        found = []
        centres, width = volume.centres.double().cpu(), volume.deviations.double().cpu()
        thick = math.sqrt(2 * math.pi) * width * volume.densities.double().cpu()
        for which, mask in enumerate(self.masks):
            inside = self._left(which, centres, width, thick, volume.joints.cpu()) < 0.5
            both = (inside & (mask > 0)).sum() / (inside | (mask > 0)).sum()
            found.append(float(both))
        return found


@dataclass(frozen=True)
class _Look:
    """A parallel projection that shows all of a pose."""

    axes: Tensor  # right, down, ahead, (3, 3)
    corner: Tensor  # (2,) m, what pixel (0, 0) sees
    scale: float  # px / m
    size: tuple[int, int]

    @classmethod
    def at(cls, vertices: Tensor, angle: float, scale: float) -> _Look:
        sine, cosine = math.sin(angle), math.cos(angle)
        axes = vertices.new_tensor([[cosine, 0, sine], [0, -1, 0], [-sine, 0, cosine]])
        flat = (vertices @ axes.mT)[:, :2]
        margin = 0.05
        corner, far = flat.amin(0) - margin, flat.amax(0) + margin
        width, height = (int(side) + 1 for side in (far - corner) * scale)
        return cls(axes, corner, scale, (height, width))

    def project(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Pixels (N, 2) and depth (N,) of points (N, 3)."""
        local = points @ self.axes.mT
        return (local[:, :2] - self.corner) * self.scale, local[:, 2]


def _poses(actor: Actor, settings: VolumeFit, rng: np.random.Generator) -> Motion:
    """The rest pose, and others about it within the limits, (1 + poses,)."""
    skeleton = actor.skeleton
    rest = skeleton.rest_motion(1 + settings.poses)
    lower, upper = (each.double().cpu() for each in (skeleton.lower, skeleton.upper))
    middle = skeleton.rest_angles.double().cpu().clamp(lower, upper)
    draw = torch.from_numpy(rng.normal(size=(settings.poses, len(middle)))) * settings.bend
    room = torch.where(draw > 0, upper - middle, middle - lower)
    angles = torch.cat((middle[None], middle + (draw.clamp(-1, 1) * room)))
    return Motion(rest.translation, rest.rotation, angles.to(rest.angles))
