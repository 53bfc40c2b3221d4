"""The rigged, textured mesh of one person as plain data, before any tensor is made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.bone_space import BoneSpace
from perfcap.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_Scalar = TypeVar("_Scalar", bound=np.generic)

INFLUENCES = 4  # bones per vertex; what glTF viewers and game engines read
_WEIGHT_SUM_TOLERANCE = 1e-3
_RIGID_TOLERANCE = 1e-3
# Multiples of 2^-23 up to one are exact in float32, and so are their sums in any order.
_WEIGHT_UNIT = 2.0**-23


@dataclass(frozen=True, eq=False)
class Template:
    """A skinned mesh in its rest pose: metres, y up, facing +z; every array is read-only.

    Vertices are those of the file, split at texture seams; ``weld`` undoes the split. Weights may
    be given with any number of influences and are kept as the best four, rows summing to one.

    Attributes:
        vertices: rest positions, (V, 3) m.
        faces: vertex indices of triangles, counter-clockwise seen from outside, (T, 3).
        bone_names: unique names, (B,).
        bone_parents: index of the parent, -1 for a root, parents before children, (B,).
        bone_rest: rigid bone-to-world rest transforms, (B, 4, 4) m.
        weight_bones: bones that move each vertex, heaviest first, bone 0 where unused, (V, 4).
        weights: their shares, (V, 4).
        uv: texture coordinates with the origin at the top left, (V, 2), or None.
        texture: an encoded JPEG or PNG, or None.
        texture_mime: ``image/jpeg`` or ``image/png`` when there is a texture.
        name: what to call the actor.
        landmarks: named points (bone, rest position (3,) m) that ride rigidly on a bone.
        joint_bones: the bone of each joint of the skeleton; bones are called like their joints
            where it is empty.
        space: how the file that the bones come from measures them; animations are written in it,
            so that they play on the file's own bones. Metres in the world where None.
    """

    vertices: Floats
    faces: Integers
    bone_names: tuple[str, ...]
    bone_parents: Integers
    bone_rest: Floats
    weight_bones: Integers
    weights: Floats
    uv: Floats | None = None
    texture: bytes | None = None
    texture_mime: str | None = None
    name: str = "actor"
    landmarks: Mapping[str, tuple[int, Floats]] = field(default_factory=dict)
    joint_bones: Mapping[str, int] = field(default_factory=dict)
    space: BoneSpace | None = None

    def __post_init__(self) -> None:
        bones = len(self.bone_names)
        self._set("bone_names", tuple(self.bone_names))
        self._set_floats("vertices", (-1, 3))
        self._set_integers("faces", (-1, 3), low=0, high=len(self.vertices))
        self._set_integers("bone_parents", (bones,), low=-1, high=bones)
        self._set_floats("bone_rest", (bones, 4, 4))
        self._set_floats("weights", (len(self.vertices), -1))
        self._set_integers("weight_bones", self.weights.shape, low=0, high=bones)
        if self.uv is not None:
            self._set_floats("uv", (len(self.vertices), 2))
        if not len(self.vertices) or not len(self.faces):
            raise self._bad("vertices", "an empty mesh", "at least one triangle")
        self._check_bones()
        self._check_joints()
        self._check_texture()
        self._normalize_weights()
        self._check_landmarks()

    def dense_weights(self) -> Floats:
        """Skinning weights of every bone, (V, B); rows sum to one."""
        dense = np.zeros((len(self.vertices), len(self.bone_names)))
        # Unused slots name bone 0 with weight 0, so they must be added, not assigned.
        np.add.at(dense, (np.arange(len(dense))[:, None], self.weight_bones), self.weights)
        return dense

    def rounded(self) -> Self:
        """The template as files hold it: saved and read again, it is the same bit for bit.

        Coordinates become multiples of float32's steps, weights multiples of 2^-23.
        """
        return replace(
            self,
            vertices=self.vertices.astype(np.float32),
            uv=None if self.uv is None else self.uv.astype(np.float32),
            weights=exact_weights(self.weights),
        )

    def bone_frames(self) -> Floats:
        """Rest transforms of the bones as the file has them, with their units, (B, 4, 4)."""
        return self.bone_rest if self.space is None else self.space.scaled(self.bone_rest)

    def weld(self) -> tuple[Integers, Integers]:
        """Merge vertices that a texture seam split: same position, same skinning.

        Returns:
            ``unique_index`` (V,), the welded vertex of each vertex, and ``representative`` (U,),
            one vertex of each welded vertex: ``vertices[representative][unique_index]`` equals
            ``vertices``. Welded vertices keep the order of their first appearance.
        """
        order = np.argsort(self.weight_bones, axis=1, kind="stable")
        key = np.concatenate(
            [
                self.vertices + 0.0,  # -0.0 and 0.0 are the same place
                np.take_along_axis(self.weight_bones, order, 1),
                np.round(np.take_along_axis(self.weights, order, 1), 4),
            ],
            axis=1,
        )
        _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
        by_appearance = np.argsort(first)
        rank = np.empty_like(by_appearance)
        rank[by_appearance] = np.arange(len(first))
        return rank[inverse.reshape(-1)], first[by_appearance]

    def bone(self, name: str) -> int:
        """Index of a bone by name."""
        try:
            return self.bone_names.index(name)
        except ValueError:
            known = ", ".join(self.bone_names)
            raise InputError(f"actor {self.name!r} has no bone {name!r}; it has {known}") from None

    def _check_bones(self) -> None:
        if not self.bone_names or len(set(self.bone_names)) != len(self.bone_names):
            raise self._bad("bone_names", f"{self.bone_names}", "one or more unique names")
        if np.any(self.bone_parents >= np.arange(len(self.bone_names))):
            raise self._bad("bone_parents", "a bone before its parent", "parents first, no cycles")
        rotation = self.bone_rest[:, :3, :3]
        deviation = np.abs(rotation @ rotation.mT - np.eye(3)).max()
        is_affine = np.allclose(self.bone_rest[:, 3], (0, 0, 0, 1))
        if deviation > _RIGID_TOLERANCE or not is_affine or np.any(np.linalg.det(rotation) < 0):
            raise self._bad("bone_rest", "scale, shear or mirroring", "rigid 4x4 matrices")

    def _check_joints(self) -> None:
        bones = len(self.bone_names)
        self._set("joint_bones", dict(self.joint_bones))
        wrong = [n for n, bone in self.joint_bones.items() if not 0 <= bone < bones]
        if wrong:
            raise self._bad("joint_bones", f"no bone for {', '.join(wrong)}", f"0 to {bones - 1}")
        if self.space is not None and len(self.space.units) != bones:
            raise self._bad("space", f"{len(self.space.units)} units", f"one for {bones} bones")

    def _check_texture(self) -> None:
        if self.texture is None:
            return
        found = image_mime(self.texture)
        if found is None or self.texture_mime not in (None, found):
            raise self._bad("texture", f"{found} declared {self.texture_mime}", "a JPEG or a PNG")
        self._set("texture_mime", found)

    def _normalize_weights(self) -> None:
        sums = self.weights.sum(1)
        if np.any(self.weights < 0) or np.any(np.abs(sums - 1) > _WEIGHT_SUM_TOLERANCE):
            found = f"sums {sums.min():.4g} to {sums.max():.4g}, least {self.weights.min():.4g}"
            raise self._bad("weights", found, "non-negative rows that sum to 1")
        bones, weights = strongest_influences(self.weight_bones, self.weights)
        self._set("weight_bones", _frozen(bones))
        self._set("weights", _frozen(weights))

    def _check_landmarks(self) -> None:
        checked = {}
        for name, (bone, position) in self.landmarks.items():
            place = _frozen(np.array(position, dtype=np.float64))
            if not 0 <= bone < len(self.bone_names) or place.shape != (3,):
                raise self._bad(f"landmarks[{name!r}]", f"{bone}, {position}", "a bone and (3,)")
            checked[name] = (int(bone), place)
        self._set("landmarks", checked)

    def _set_floats(self, name: str, shape: tuple[int, ...]) -> None:
        array = np.array(getattr(self, name), dtype=np.float64)
        self._check_shape(name, array.shape, shape)
        if not np.isfinite(array).all():
            raise self._bad(name, "NaN or infinity", "finite numbers")
        self._set(name, _frozen(array))

    def _set_integers(self, name: str, shape: tuple[int, ...], low: int, high: int) -> None:
        array = np.array(getattr(self, name))
        self._check_shape(name, array.shape, shape)
        if array.dtype.kind not in "iu":
            raise self._bad(name, f"dtype {array.dtype}", "integers")
        if array.size and (array.min() < low or array.max() >= high):
            found = f"indices {array.min()} to {array.max()}"
            raise self._bad(name, found, f"indices {low} to {high - 1}")
        self._set(name, _frozen(array.astype(np.int64)))

    def _check_shape(self, name: str, found: tuple[int, ...], expected: tuple[int, ...]) -> None:
        fits = len(found) == len(expected) and all(
            want in (-1, have) for have, want in zip(found, expected, strict=True)
        )
        if not fits:
            wanted = ", ".join("any" if size < 0 else str(size) for size in expected)
            raise self._bad(name, f"shape {found}", f"({wanted})")

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _bad(self, name: str, found: str, expected: str) -> InputError:
        return InputError(f"actor {self.name!r}: {name} has {found}; expected {expected}")


def strongest_influences(bones: Integers, weights: Floats) -> tuple[Integers, Floats]:
    """Merge repeated bones, keep the four heaviest per vertex and renormalise.

    Args:
        bones: bone indices, (V, K).
        weights: non-negative weights with a positive sum in every row, (V, K).

    Returns:
        ``(bones, weights)``, both (V, 4), heaviest first; unused slots hold bone 0, weight 0.
    """
    missing = max(INFLUENCES - bones.shape[1], 0)
    bones = np.pad(bones, ((0, 0), (0, missing)))
    weights = np.pad(weights, ((0, 0), (0, missing)))
    for late in range(1, bones.shape[1]):
        for early in range(late):
            repeated = np.where(bones[:, early] == bones[:, late], weights[:, late], 0.0)
            weights[:, early] += repeated
            weights[:, late] -= repeated
    order = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    weights = np.take_along_axis(weights, order, 1)
    bones = np.where(weights > 0, np.take_along_axis(bones, order, 1), 0)
    return bones, weights / weights.sum(1, keepdims=True)


def exact_weights(weights: Floats) -> Floats:
    """Nearest weights whose float32 sum is exactly one, (V, 4); heaviest first stays so."""
    units = np.round(weights / _WEIGHT_UNIT)
    units[:, 0] += 1 / _WEIGHT_UNIT - units.sum(1)
    return np.asarray(units * _WEIGHT_UNIT)


def image_mime(data: bytes) -> str | None:
    """Media type of an encoded image by its signature, None unless JPEG or PNG."""
    if data.startswith(b"\xff\xd8\xff"):
        return "image/jpeg"
    return "image/png" if data.startswith(b"\x89PNG\r\n\x1a\n") else None


def _frozen(array: NDArray[_Scalar]) -> NDArray[_Scalar]:
    array.flags.writeable = False
    return array
