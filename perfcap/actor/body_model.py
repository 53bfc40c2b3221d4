"""Bodies of many people as one module: coefficients of shape in, rigged template out.

Any body model that is linear in its coefficients fits: the one that is shipped, or files of SMPL
type that a user holds a licence for. It is given as plain arrays under these names:

==================== =============== ============================================================
``vertices``         (V, 3)          mean surface in the rest pose; metres, y up, facing +z
``faces``            (T, 3)          triangles, counter-clockwise from outside
``shape_basis``      (S, V, 3)       displacement by each coefficient, metres
``shape_deviation``  (S,)            optional: scale of each coefficient's basis; 1
``bone_names``       (B,)            those that act as joints of the skeleton carry its names
``bone_parents``     (B,)            -1 for the root; parents before children
``bone_positions``   (B, 3)          rest positions of the mean body, with
``bone_basis``       (S, B, 3)       their displacement by each coefficient; or, in place of both,
``joint_regressor``  (B, V)          rows that sum vertices to rest positions
``weights``          (V, B)          skinning weights; or (V, K) with
``weight_bones``     (V, K)          the bone of each
``uv``, ``faces_uv`` (N, 2), (T, 3)  optional: texture corners, origin at the top left
``landmark_names``   (L,)            optional: points that are no bones (``head_top``, ``l_toe``,
                                     ``r_toe``), with
``landmark_bones``   (L,)            the bone each rides on, and
``landmark_vertices`` (L, K)         the vertices whose mean it is
``attribute_names``  (A,)            optional: what people are asked for (gender, age), with
``attribute_mean``   (A,)            its values for the mean body, and
``attribute_basis``  (S, A)          how they change with each coefficient (of deviation 1)
``name``, ``licence``, ``source``    optional texts
==================== =============== ============================================================

The joints of the skeleton are pelvis, spine, neck, head and, for each side, ``l_shoulder``,
``l_elbow``, ``l_wrist``, ``l_hip``, ``l_knee``, ``l_ankle``. Other bones keep any name: they ride
on the nearest ancestor that is a joint. SMPL's ``shapedirs`` (V, 3, S) become ``shape_basis`` by
moving the last axis to the front; its pose correctives are not used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.shape_space import ShapeSpace
from perfcap.actor.template import Template
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

REQUIRED = ("vertices", "faces", "shape_basis", "bone_names", "bone_parents", "weights")
ARRAYS = (
    *REQUIRED,
    *("shape_deviation", "bone_positions", "bone_basis", "joint_regressor", "weight_bones"),
    *("uv", "faces_uv", "landmark_names", "landmark_bones", "landmark_vertices"),
    *("attribute_names", "attribute_mean", "attribute_basis"),
    *("name", "licence", "source"),
)
MAX_COMPONENTS = 512


@dataclass(frozen=True, eq=False)
class BodyRig:
    """What all bodies of a model share: triangles, bones, weights, texture.

    Attributes:
        faces: (T, 3).
        bone_names, bone_parents: (B,).
        weight_bones, weights: (V, K).
        landmarks: bone and vertices of each named point that is no bone.
        uv, faces_uv: texture corners (N, 2) and those of each triangle (T, 3), or None.
        texture: an encoded JPEG or PNG, or None.
        name, licence, source: texts.
        attributes: value for the mean body and slopes (S,) by name; empty if not known.
    """

    faces: Integers
    bone_names: tuple[str, ...]
    bone_parents: Integers
    weight_bones: Integers
    weights: Floats
    landmarks: Mapping[str, tuple[int, Integers]]
    uv: Floats | None = None
    faces_uv: Integers | None = None
    texture: bytes | None = None
    name: str = "body"
    licence: str = ""
    source: str = ""
    attributes: Mapping[str, tuple[float, Floats]] = field(default_factory=dict)


class BodyModel(nn.Module):
    """Surface and rest joints as linear functions of shape, with what is needed to pose them.

    Args:
        surface: the vertices.
        bones: rest positions of the bones, of as many components.
        rig: what does not depend on shape.
    """

    def __init__(self, surface: ShapeSpace, bones: ShapeSpace, rig: BodyRig) -> None:
        super().__init__()
        if bones.components != surface.components or len(bones.mean) != len(rig.bone_names):
            raise InputError(
                f"body model {rig.name!r} has {surface.components} components of the surface, "
                f"{bones.components} of {len(bones.mean)} bones and {len(rig.bone_names)} bone "
                "names; give the same number of each"
            )
        _require_fit(rig, len(surface.mean))
        self.surface, self.bones, self.rig = surface, bones, rig
        self._corners = _split(rig, len(surface.mean))
        self.template(torch.zeros(0, dtype=torch.float64))  # refuses what is no rigged mesh

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, NDArray[Any]], name: str = "body", texture: bytes | None = None
    ) -> Self:
        """A model of the arrays that this module's description names.

        Raises:
            InputError: one is missing, does not fit the others, or holds what it may not.
        """
        missing = [key for key in REQUIRED if key not in arrays]
        if missing:
            raise InputError(
                f"body model {name!r} lacks {', '.join(missing)}; expected at least "
                f"{', '.join(REQUIRED)} and bone_positions with bone_basis, or joint_regressor"
            )
        try:
            surface = _surface(arrays, name)
            return cls(surface, _bones(arrays, surface, name), _rig(arrays, name, texture))
        except InputError:
            raise
        except (LookupError, TypeError, ValueError, RuntimeError) as error:
            raise InputError(
                f"body model {name!r}: its arrays do not fit one another ({error}); write it again"
            ) from error

    @property
    def components(self) -> int:
        """S."""
        return self.surface.components

    def vertices(self, shape: Tensor) -> Tensor:
        """Rest surface (*b, V, 3), metres, of coefficients (*b, up to S); differentiable."""
        vertices: Tensor = self.surface(shape)
        return vertices

    def joints(self, shape: Tensor) -> Tensor:
        """Rest positions of the bones (*b, B, 3), metres; differentiable."""
        joints: Tensor = self.bones(shape)
        return joints

    def template(self, shape: Tensor) -> Template:
        """The rigged mesh of one person, coefficients (up to S,), standing on the floor."""
        with torch.no_grad():
            vertices = self.vertices(shape.to(self.surface.mean)).double().numpy(force=True)
            joints = self.joints(shape.to(self.bones.mean)).double().numpy(force=True)
        lift = np.array([0.0, vertices[:, 1].min(), 0.0])
        vertices, joints = vertices - lift, joints - lift
        rig, rest = self.rig, np.tile(np.eye(4), (len(joints), 1, 1))
        rest[:, :3, 3] = joints
        corner, faces, uv = self._corners
        marks = {n: (bone, vertices[points].mean(0)) for n, (bone, points) in rig.landmarks.items()}
        for bone, name in enumerate(rig.bone_names):
            if name in LANDMARKS and name not in JOINTS and name not in marks:
                marks[name] = max(int(rig.bone_parents[bone]), 0), joints[bone]
        return Template(
            vertices=vertices[corner],
            faces=faces,
            bone_names=rig.bone_names,
            bone_parents=rig.bone_parents,
            bone_rest=rest,
            weight_bones=rig.weight_bones[corner],
            weights=rig.weights[corner],
            uv=uv,
            texture=rig.texture if uv is not None else None,
            name=rig.name,
            landmarks=marks,
        )

    def actor(self, shape: Tensor) -> Actor:
        """One person, ready to move."""
        return Actor(self.template(shape))


def _require_fit(rig: BodyRig, vertices: int) -> None:
    """Refuse weights and triangles of another surface than that of the model."""
    if len(rig.weights) != vertices or rig.weights.shape != rig.weight_bones.shape:
        raise InputError(
            f"body model {rig.name!r}: weights have shape {rig.weights.shape} and weight_bones "
            f"{rig.weight_bones.shape}; expected a row for each of {vertices} vertices"
        )
    if rig.faces.ndim != 2 or rig.faces.shape[1:] != (3,) or not rig.faces.size:
        raise InputError(f"body model {rig.name!r}: faces have shape {rig.faces.shape}, not (T, 3)")
    if not _within(rig.faces, vertices):
        raise InputError(f"body model {rig.name!r}: faces name vertices that are not there")


def _split(rig: BodyRig, vertices: int) -> tuple[Integers, Integers, Floats | None]:
    """Vertex of each corner where the texture is cut, triangles of corners, their places in it."""
    if rig.uv is None or rig.faces_uv is None:
        return np.arange(vertices), rig.faces, None
    pairs = np.stack((rig.faces, rig.faces_uv), -1).reshape(-1, 2)
    unique, faces = np.unique(pairs, axis=0, return_inverse=True)
    loose = np.setdiff1d(np.arange(vertices), unique[:, 0])  # vertices of no triangle stay as well
    corner = np.concatenate((unique[:, 0], loose))
    uv = np.concatenate((rig.uv[unique[:, 1]], np.zeros((len(loose), 2))))
    return corner, faces.reshape(-1, 3).astype(np.int64), uv


def _surface(arrays: Mapping[str, NDArray[Any]], name: str) -> ShapeSpace:
    vertices, basis = _numbers(arrays, "vertices", name), _numbers(arrays, "shape_basis", name)
    if len(basis) > MAX_COMPONENTS or basis.ndim != 3:
        raise InputError(
            f"body model {name!r}: shape_basis has shape {tuple(basis.shape)}; expected (S, V, 3) "
            f"with at most {MAX_COMPONENTS} components"
        )
    return ShapeSpace(vertices, basis, _deviation(arrays, name))


def _bones(arrays: Mapping[str, NDArray[Any]], surface: ShapeSpace, name: str) -> ShapeSpace:
    if "joint_regressor" in arrays:
        rows = _numbers(arrays, "joint_regressor", name)
        if rows.ndim != 2 or rows.shape[1] != len(surface.mean):
            raise InputError(
                f"body model {name!r}: joint_regressor has shape {tuple(rows.shape)}; expected "
                f"(B, {len(surface.mean)})"
            )
        return ShapeSpace(rows @ surface.mean, rows @ surface.basis)
    if "bone_positions" not in arrays or "bone_basis" not in arrays:
        raise InputError(
            f"body model {name!r} has no joint_regressor and no bone_positions with bone_basis; "
            "give one of the two"
        )
    positions, basis = (_numbers(arrays, f"bone_{part}", name) for part in ("positions", "basis"))
    return ShapeSpace(positions, basis, _deviation(arrays, name))


def _deviation(arrays: Mapping[str, NDArray[Any]], name: str) -> Tensor | None:
    return _numbers(arrays, "shape_deviation", name) if "shape_deviation" in arrays else None


def _rig(arrays: Mapping[str, NDArray[Any]], name: str, texture: bytes | None) -> BodyRig:
    bones = _texts(arrays, "bone_names", name)
    weights = _numbers(arrays, "weights", name).numpy()
    if "weight_bones" in arrays:
        index = _integers(arrays, "weight_bones", name)
    else:
        index = np.tile(np.arange(weights.shape[-1]), (len(weights), 1))
    has_uv = "uv" in arrays and "faces_uv" in arrays
    uv = _numbers(arrays, "uv", name).numpy() if has_uv else None
    faces, corners = _integers(arrays, "faces", name), None
    if uv is not None:
        corners = _integers(arrays, "faces_uv", name)
        if corners.shape != faces.shape or not _within(corners, len(uv)):
            raise InputError(f"body model {name!r}: faces_uv does not fit faces and uv")
    return BodyRig(
        faces=faces,
        bone_names=bones,
        bone_parents=_integers(arrays, "bone_parents", name),
        weight_bones=index,
        weights=weights,
        landmarks=_landmarks(arrays, len(bones), len(arrays["vertices"]), name),
        uv=uv,
        faces_uv=corners,
        texture=texture,
        **{key: str(arrays[key]) for key in ("licence", "source") if key in arrays},
        name=str(arrays.get("name", name)),
        attributes=_attributes(arrays, name),
    )


def _attributes(arrays: Mapping[str, NDArray[Any]], name: str) -> dict[str, tuple[float, Floats]]:
    keys = ("attribute_names", "attribute_mean", "attribute_basis")
    if not all(key in arrays for key in keys):
        return {}
    names = _texts(arrays, keys[0], name)
    mean, basis = (_numbers(arrays, key, name).numpy() for key in keys[1:])
    count = len(arrays["shape_basis"])
    if mean.shape != (len(names),) or basis.shape != (count, len(names)):
        raise InputError(
            f"body model {name!r}: attribute_mean and attribute_basis have shapes {mean.shape} "
            f"and {basis.shape}; expected {(len(names),)} and {(count, len(names))}"
        )
    return {n: (float(m), b) for n, m, b in zip(names, mean, basis.T, strict=True)}


def _landmarks(
    arrays: Mapping[str, NDArray[Any]], bones: int, vertices: int, name: str
) -> dict[str, tuple[int, Integers]]:
    if "landmark_names" not in arrays:
        return {}
    names = _texts(arrays, "landmark_names", name)
    owners, points = (
        _integers(arrays, k, name) if k in arrays else np.empty(0, np.int64)
        for k in ("landmark_bones", "landmark_vertices")
    )
    points = points.reshape(len(points), -1)
    fits = len(owners) == len(points) == len(names) and points.size > 0
    if not fits or not _within(owners, bones) or not _within(points, vertices):
        raise InputError(
            f"body model {name!r}: landmark_bones and landmark_vertices do not fit "
            f"{len(names)} landmark_names, {bones} bones and {vertices} vertices"
        )
    return {n: (int(o), p) for n, o, p in zip(names, owners, points, strict=True)}


def _within(index: Integers, count: int) -> bool:
    return bool(index.min() >= 0 and index.max() < count)


def _numbers(arrays: Mapping[str, NDArray[Any]], key: str, name: str) -> Tensor:
    array = np.asarray(arrays[key])
    if array.dtype.kind not in "fiu":
        raise InputError(f"body model {name!r}: {key} holds {array.dtype}; expected numbers")
    values = array.astype(np.float64)
    if not np.isfinite(values).all():
        raise InputError(f"body model {name!r}: {key} has NaN or infinity; expected finite numbers")
    return torch.from_numpy(values)


def _integers(arrays: Mapping[str, NDArray[Any]], key: str, name: str) -> Integers:
    array = np.asarray(arrays[key])
    if array.dtype.kind not in "iu":
        raise InputError(f"body model {name!r}: {key} holds {array.dtype}; expected integers")
    return array.astype(np.int64)


def _texts(arrays: Mapping[str, NDArray[Any]], key: str, name: str) -> tuple[str, ...]:
    array = np.asarray(arrays[key])
    if array.dtype.kind != "U" or array.ndim != 1:
        raise InputError(
            f"body model {name!r}: {key} holds {array.dtype} of shape {array.shape}; expected a "
            "list of texts"
        )
    return tuple(str(text) for text in array)
