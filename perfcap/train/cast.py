"""Who is drawn: people of random shape in random clothes, in recorded poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.body_model import BodyModel
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.train.body_parts import face_parts, skirt_parts
from perfcap.train.config import SceneData
from perfcap.train.figure import (
    Figure,
    Skirt,
    actor_figure,
    hang,
    pose_figure,
    random_skirt,
    rest_turns,
    skirt_ahead,
    skirt_mesh,
)
from perfcap.train.motion_library import MotionLibrary
from perfcap.train.wardrobe import Wardrobe, random_outfit

_UPPER = [
    i
    for i, name in enumerate(JOINTS)
    if name.split("_")[-1] in {"spine", "neck", "head", "shoulder", "elbow", "wrist"}
]
_HEAD = [JOINTS.index("neck"), JOINTS.index("head")]
_HEAD_LOOSENED = np.array([8.0, 22.0, 6.0])  # degrees: nodding, looking aside, leaning
_CHAINS = [  # joints that are turned together at random, and what they hang on
    [JOINTS.index(f"{s}_{j}") for j in chain]
    for s in "lr"
    for chain in (("shoulder", "elbow", "wrist"), ("elbow", "wrist"), ("hip", "knee", "ankle"),
                  ("knee", "ankle"), ("ankle",))
]  # fmt: skip
_ARM_CHAINS = np.array([JOINTS[chain[0]].endswith(("shoulder", "elbow")) for chain in _CHAINS])


@dataclass(frozen=True, eq=False)
class Person:
    """Somebody dressed, ready to pose."""

    figure: Figure
    rest: Tensor
    parts: Tensor
    skirt: Skirt | None


@dataclass(frozen=True, eq=False)
class Posed:
    """Somebody in a pose: mesh, parts of the body, landmarks; metres, y up."""

    vertices: Tensor
    faces: Tensor
    parts: Tensor  # of the faces, (T,) uint8
    landmarks: Tensor


class Cast:
    """Random people in recorded poses.

    Args:
        body: shapes; its coefficients are standard deviations of a population.
        actors: people with clothes of their own; may be empty.
        library: of motion.
        data: settings.
    """

    def __init__(
        self,
        body: BodyModel,
        actors: tuple[Actor, ...],
        library: MotionLibrary,
        data: SceneData,
    ) -> None:
        if not library.recordings:
            raise InputError("motion library: has no clip; expected recorded motion")
        self._data, self._body = data, body
        mean = body.actor(torch.zeros(0, dtype=torch.float64))
        self._first = mean.template.weld()[1]
        self._wardrobe = Wardrobe.of(actor_figure(mean, data.texture))
        self._actors = [actor_figure(actor, data.texture) for actor in actors]
        self._turns = torch.cat([r.turns for r in library.recordings])
        lengths = np.array([len(r.turns) for r in library.recordings])
        # people count alike, and long clips repeat themselves
        whose = np.array([r.subject for r in library.recordings])
        same = whose[:, None] == whose
        weight = np.sqrt(lengths) / (same * np.sqrt(lengths)).sum(1)
        share = np.repeat(weight / lengths, lengths).cumsum()
        self._reach = share / share[-1]
        self._skirt = skirt_mesh()

    def person(self, rng: np.random.Generator) -> Person:
        """Somebody new."""
        if self._actors and rng.random() < self._data.actors:
            own = self._actors[int(rng.integers(len(self._actors)))]
            figure = replace(own, texture=_recolored(own.texture, rng))
        else:
            outfit = random_outfit(rng)
            figure = self._wardrobe.dress(self._shaped(rng), outfit, rng)
        parts = face_parts(figure.vertices, figure.faces, figure.owner)
        if rng.random() >= self._data.skirts:
            return Person(figure, rest_turns(figure), parts, None)
        paint = random_outfit(rng).paints[int(rng.integers(3, 5))]
        side = figure.texture.shape[1]
        around = np.abs(np.mgrid[:64, :side]).reshape(2, -1).T / np.array([64, side])
        places = np.concatenate([around[:, 1:] * 0.8, around[:, :1] * 0.7, 0 * around[:, :1]], 1)
        cloth = paint.at(places.astype(np.float32), rng).reshape(64, side, 3)
        texture = np.concatenate([figure.texture, cloth.clip(0, 255).astype(np.uint8)])
        worn = replace(figure, texture=texture)
        parts = torch.cat((parts, skirt_parts(skirt_ahead())))
        return Person(worn, rest_turns(worn), parts, random_skirt(rng))

    def pose(self, person: Person, rng: np.random.Generator) -> Posed:
        """Somebody in a random pose."""
        return self.posed(person, self._random_turns(rng))

    def posed(self, person: Person, turns: Tensor) -> Posed:
        """Somebody with joints turned so in the world against a T-pose, (16, 3, 3)."""
        figure = person.figure
        surface, marks = pose_figure(figure, figure.vertices, turns, person.rest)
        if person.skirt is None:
            return Posed(surface, figure.faces, person.parts, marks)
        hips = marks[[LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]].mean(0)
        cloth = hang(person.skirt, figure, surface, hips, turns[0])
        faces = torch.cat((figure.faces, self._skirt[0] + len(surface)))
        return Posed(torch.cat((surface, cloth)), faces, person.parts, marks)

    def texture_places(self, person: Person) -> tuple[Tensor, Tensor]:
        """Corners of the texture (N, 2) and those of each face (T, 3)."""
        figure = person.figure
        if person.skirt is None:
            return figure.uv, figure.faces_uv
        height = figure.texture.shape[0]
        body = figure.uv * torch.tensor([1.0, (height - 64) / height])
        low, high = (height - 62) / height, (height - 2) / height
        cloth = self._skirt[1] * torch.tensor([1.0, high - low]) + torch.tensor([0.0, low])
        return torch.cat((body, cloth)), torch.cat((figure.faces_uv, self._skirt[0] + len(body)))

    def _shaped(self, rng: np.random.Generator) -> Figure:
        """Somebody of random shape in this wardrobe's topology."""
        count = min(12, self._body.components)
        shape = torch.from_numpy(rng.normal(size=count).clip(-2.5, 2.5))
        template = self._body.template(shape)
        rest = template.bone_rest[:, :3, 3]
        points = dict(zip(template.bone_names, rest, strict=True))
        points |= {name: place for name, (_, place) in template.landmarks.items()}
        return replace(
            self._wardrobe.figure,
            vertices=torch.tensor(template.vertices[self._first]).float(),
            joints=torch.tensor(np.stack([points[name] for name in JOINTS])).float(),
            landmarks=torch.tensor(np.stack([points[name] for name in LANDMARKS])).float(),
        )

    def vary(self, turns: Tensor, other: Tensor, rng: np.random.Generator) -> None:
        """Give poses (..., 16, 3, 3) perhaps the upper body of others; hold limbs otherwise.

        All of them alike, in place, by the settings of scenes.
        """
        if rng.random() < self._data.recombined:
            hips = turns[..., :1, :, :] @ other[..., :1, :, :].mT
            turns[..., _UPPER, :, :] = hips @ other[..., _UPPER, :, :]
        freedom = np.where(_ARM_CHAINS, self._data.swung, 1.0) * self._data.loosened
        loosened = _random_turns(rng, np.repeat(freedom[:, None], 3, 1))
        pelvis = turns[..., :1, :, :].clone()
        for chain, turn in zip(_CHAINS, loosened, strict=True):
            local = pelvis @ turn @ pelvis.mT
            turns[..., chain, :, :] = local @ turns[..., chain, :, :]

    def _random_turns(self, rng: np.random.Generator) -> Tensor:
        """A recorded pose, perhaps of two frames, loosened, facing anywhere, (16, 3, 3)."""
        data = self._data
        frame, other = np.searchsorted(self._reach, rng.random(2))
        turns = self._turns[frame].clone()
        self.vary(turns, self._turns[other], rng)
        if rng.random() < 0.5:
            turns = _mirrored(turns)
        lean = np.full(3, 90.0) if rng.random() < data.tilted else np.array([5.0, 0.0, 5.0])
        head, whole = _random_turns(rng, np.stack([_HEAD_LOOSENED, lean]))
        turns[_HEAD] = head @ turns[_HEAD]
        away = rng.uniform(-np.pi, np.pi) * (0.5 if rng.random() < data.facing else 1.0)
        heading = float(torch.atan2(turns[0, 0, 2], turns[0, 2, 2]))
        around = torch.tensor([0.0, float(away) - heading, 0.0])
        facing: Tensor = whole @ rotvec_to_matrix(around) @ turns
        return facing


def _random_turns(rng: np.random.Generator, degrees: NDArray[np.float64]) -> Tensor:
    """Rotations (N, 3, 3) about axes of normal lengths, deviations (N, 3) degrees."""
    vectors = np.radians(rng.normal(size=degrees.shape) * degrees)
    return rotvec_to_matrix(torch.from_numpy(vectors.astype(np.float32)))


_SIDES = [
    JOINTS.index({"l_": "r_", "r_": "l_"}.get(n[:2], n[:2]) + n[2:]) if n[1] == "_" else i
    for i, n in enumerate(JOINTS)
]


def _mirrored(turns: Tensor) -> Tensor:
    """The mirror image of a pose, (16, 3, 3): the T-pose is its own."""
    sign = torch.tensor([-1.0, 1.0, 1.0])
    return turns[_SIDES] * sign[:, None] * sign


def _recolored(texture: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """A texture of other hues and brightness."""
    hsv = cv2.cvtColor(texture, cv2.COLOR_RGB2HSV).astype(np.int32)
    hue = int(rng.normal(0, 12) if rng.random() < 0.6 else rng.integers(180))
    hsv[..., 0] = (hsv[..., 0] + hue) % 180
    hsv[..., 1] = (hsv[..., 1] * rng.uniform(0.4, 1.3)).clip(0, 255)
    hsv[..., 2] = (hsv[..., 2] * rng.uniform(0.6, 1.25)).clip(0, 255)
    return np.asarray(cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2RGB), np.uint8)
