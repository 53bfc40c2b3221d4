"""Clothes: which part of a body each covers, how thick it is, what it is painted with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.render.label_map import barycentric_at, rasterize
from perfcap.render.projected_mesh import vertex_normals
from perfcap.train.figure import Figure
from perfcap.train.paint import Paint, cloth_color, hair_color, random_paint, skin_color

Floats = NDArray[np.float32]

SKIN, FACE, HAIR, TOP, BOTTOM, SHOES = range(6)
_ARMS = {"shoulder": 0, "elbow": 1, "wrist": 2}
_DARK = 90  # sRGB; what is darker on a painted head is hair
_SMOOTHINGS = 4  # of the edge of a garment


@dataclass(frozen=True)
class Outfit:
    """What somebody wears.

    Attributes:
        sleeve: where it ends along the arm: 0 shoulder, 1 elbow, 2 wrist.
        waist: height of the top's hem, as a share of stature.
        leg: height at which trousers end, as a share of stature.
        shoe: height of the shoes, as a share of stature.
        collar: whether the neck is covered.
        thickness: of skin, face, hair, top, bottom and shoes, (6,) m.
        paints: of each of them.
        folds: how uneven cloth is, 0 to 1.
    """

    sleeve: float
    waist: float
    leg: float
    shoe: float
    collar: bool
    thickness: tuple[float, ...]
    paints: tuple[Paint, ...]
    folds: float


def random_outfit(rng: np.random.Generator) -> Outfit:
    """Anything between a swimsuit and a winter coat."""
    sleeve = float(rng.choice([0.05, rng.uniform(0.3, 0.8), rng.uniform(0.9, 1.5), 1.95],
                              p=[0.1, 0.4, 0.1, 0.4]))  # fmt: skip
    leg = float(rng.choice([0.05, rng.uniform(0.08, 0.27), rng.uniform(0.27, 0.42)],
                           p=[0.65, 0.1, 0.25]))  # fmt: skip
    skin = Paint(skin_color(rng))
    top, bottom, shoes = (random_paint(rng, cloth_color(rng)) for _ in range(3))
    if rng.random() < 0.1:
        bottom = top
    loose = 0.022 * rng.random(2) ** 1.5
    thickness = (0.0, 0.0, rng.uniform(0.0, 0.02), 0.002 + loose[0], 0.002 + loose[1], 0.006)
    return Outfit(
        sleeve=sleeve,
        waist=float(rng.uniform(0.48, 0.62)),
        leg=leg,
        shoe=float(rng.choice([0.0, 0.045, rng.uniform(0.045, 0.2)], p=[0.15, 0.65, 0.2])),
        collar=bool(rng.random() < 0.15),
        thickness=tuple(float(t) for t in thickness),
        paints=(skin, skin, Paint(hair_color(rng)), top, bottom, shoes),
        folds=float(rng.uniform(0, 0.8)),
    )


@dataclass(frozen=True, eq=False)
class Wardrobe:
    """Dresses figures of one topology and texture layout.

    Attributes:
        figure: any of them, whose own texture shows a face.
        texels: pixels of the texture that the body uses, (N,).
        places: rest positions there, (N, 3) m.
        owners: joints that carry them, (N,).
        arms: how far along an arm, (N,); 0 shoulder, 1 elbow, 2 wrist, -1 off the arms.
        hair: whether the own texture is as dark as hair there, (N,).
        shade: light of the own texture against its median on skin, (N, 3).
    """

    figure: Figure
    texels: NDArray[np.int64]
    places: Floats
    owners: NDArray[np.int64]
    arms: Floats
    hair: NDArray[np.bool_]
    shade: Floats

    @classmethod
    def of(cls, figure: Figure) -> Self:
        """Measure a figure's texture."""
        height, width = figure.texture.shape[:2]
        pixels = figure.uv * torch.tensor([width, height]) - 0.5
        seen = rasterize(
            pixels.double(), torch.ones(len(pixels)).double(), figure.faces_uv, (height, width)
        )
        row, column = torch.nonzero(seen.mask, as_tuple=True)
        face = seen.triangle[row, column].long()
        corners = figure.faces_uv[face]
        points = torch.stack((column, row), -1).double()
        weights = barycentric_at(
            points, pixels.double()[corners], torch.ones(len(face), 3).double()
        ).float()
        vertices = figure.faces[face]
        places = (weights[..., None] * figure.vertices[vertices]).sum(1)
        arms = (weights * torch.from_numpy(_along_arms(figure))[vertices]).sum(1)
        owners = figure.owner[vertices].gather(1, weights.argmax(1, keepdim=True)).squeeze(1)
        own = figure.texture.reshape(-1, 3)[(row * width + column).numpy()].astype(np.float32)
        on_head = owners.numpy() == JOINTS.index("head")
        hair = on_head & (own.mean(-1) < _DARK)
        middle = np.median(own[on_head & ~hair], 0) if (on_head & ~hair).any() else 128.0
        return cls(
            figure,
            (row * width + column).numpy(),
            places.numpy(),
            owners.numpy(),
            arms.numpy(),
            hair,
            (own / middle).clip(0, 1.6).astype(np.float32),
        )

    def dress(self, figure: Figure, outfit: Outfit, rng: np.random.Generator) -> Figure:
        """A figure of this wardrobe's topology in an outfit: thicker and painted anew."""
        stature = float(figure.vertices[:, 1].max())
        measured = float(self.figure.vertices[:, 1].max())
        garment = _garments(outfit, self.owners, self.places[:, 1] / measured, self.arms)
        garment = np.where(self.hair, HAIR, garment)
        texture = self._painted(garment, outfit, rng)
        owner = figure.owner.numpy()
        worn = _garments(outfit, owner, (figure.vertices[:, 1] / stature).numpy(),
                         _along_arms(figure))  # fmt: skip
        worn = np.where((worn == FACE) & self._hairy(), HAIR, worn)
        thick = np.array(outfit.thickness, np.float32)[worn]
        waves = _waves(figure.vertices.numpy(), rng)
        cloth = np.isin(worn, (TOP, BOTTOM))
        thick = thick * np.where(cloth, 1 + outfit.folds * waves, 1.0).astype(np.float32)
        outward = vertex_normals(figure.vertices, figure.faces)
        vertices = figure.vertices + outward * self._smooth(thick)[:, None]
        return replace(figure, vertices=vertices, texture=texture)

    def _painted(
        self, garment: NDArray[np.int64], outfit: Outfit, rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        texture = np.zeros_like(self.figure.texture).reshape(-1, 3)
        color = np.zeros((len(garment), 3), np.float32)
        for part, paint in enumerate(outfit.paints):
            here = garment == part
            color[here] = paint.at(self.places[here], rng)
        face = garment == FACE
        color[face] *= self.shade[face]
        texture[self.texels] = color.clip(0, 255).astype(np.uint8)
        return texture.reshape(self.figure.texture.shape)

    def _hairy(self) -> NDArray[np.bool_]:
        """Vertices whose texture is hair, (V,)."""
        height, width = self.figure.texture.shape[:2]
        dark = np.zeros(height * width, bool)
        dark[self.texels[self.hair]] = True
        corner = (self.figure.uv.numpy() * [width, height]).astype(int)
        index = corner[:, 1].clip(0, height - 1) * width + corner[:, 0].clip(0, width - 1)
        vertices = np.zeros(len(self.figure.vertices), bool)
        vertices[self.figure.faces.numpy().ravel()] = dark[index][
            self.figure.faces_uv.numpy().ravel()
        ]
        return vertices

    def _smooth(self, values: Floats) -> Tensor:
        """Values (V,) blurred along the surface, so that garments end in a slope."""
        faces = self.figure.faces
        ends = faces.flatten()
        count = torch.bincount(ends, minlength=len(values)).clamp(min=1)
        result = torch.from_numpy(values)
        for _ in range(_SMOOTHINGS):
            mean = result[faces].mean(1).repeat_interleave(3)
            result = torch.zeros(len(values)).index_add(0, ends, mean) / count
        return result


def _garments(
    outfit: Outfit, owners: NDArray[np.int64], height: Floats, arms: Floats
) -> NDArray[np.int64]:
    """What covers each of N places, given their joints, heights in statures and arms, (N,)."""

    def owned(*joints: str) -> NDArray[np.bool_]:
        return np.isin(owners, [JOINTS.index(joint) for joint in joints])

    part = np.full(len(owners), SKIN)
    arm = arms >= 0
    legs = owned(*(f"{s}_{j}" for s in "lr" for j in ("hip", "knee", "ankle")))
    trunk = owned("spine", "pelvis")
    part[legs & (height > outfit.leg)] = BOTTOM
    part[trunk] = TOP
    part[(legs | owned("pelvis")) & (height < outfit.waist) & (part != SKIN)] = BOTTOM
    part[legs & (height >= outfit.waist)] = TOP
    part[arm & (arms < outfit.sleeve)] = TOP
    part[owned("l_ankle", "r_ankle") & (height < outfit.shoe)] = SHOES
    part[legs & (height < outfit.shoe)] = SHOES
    part[owned("neck")] = TOP if outfit.collar else SKIN
    part[owned("head")] = FACE
    return part


def _along_arms(figure: Figure) -> Floats:
    """How far along an arm each vertex lies, (V,); -1 off the arms."""
    along = np.full(len(figure.vertices), -1.0, np.float32)
    owner, vertices = figure.owner.numpy(), figure.vertices.numpy()
    at = dict(zip(JOINTS, figure.joints.numpy(), strict=True))
    for side in "lr":
        for name, place in _ARMS.items():
            joint = f"{side}_{name}"
            here = owner == JOINTS.index(joint)
            start = at[joint]
            bone = at[f"{side}_wrist"] - at[f"{side}_elbow"]
            if name != "wrist":
                bone = at[f"{side}_{'elbow' if name == 'shoulder' else 'wrist'}"] - start
            share = (vertices[here] - start) @ bone / max(float(bone @ bone), 1e-9)
            along[here] = place + share.clip(0, 0.999)
    return along


def _waves(places: Floats, rng: np.random.Generator) -> Floats:
    """A few sines in random directions, (V,), about -1 to 1."""
    total = np.zeros(len(places), np.float32)
    for _ in range(4):
        direction = rng.normal(size=3) * rng.uniform(15, 60)
        total += np.sin(places @ direction.astype(np.float32) + rng.uniform(0, 6.3)) / 2
    return total.clip(-1, 1)
