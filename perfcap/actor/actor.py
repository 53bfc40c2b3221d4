"""The rigged template of a person as a module: motion in, joints and surface out."""

from __future__ import annotations

import copy
import math
import warnings
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from perfcap.actor.anatomy import JOINTS, human_rig
from perfcap.actor.bone_owners import bone_owners, clavicle_bones
from perfcap.actor.fingers import resting_fingers
from perfcap.actor.motion import BONES, Motion
from perfcap.actor.points import Landmarks
from perfcap.actor.rig import Rig, with_still_shoulders
from perfcap.actor.skeleton import Skeleton
from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import dual_quaternion_blend
from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.geometry.plain import is_readable

_LARGER = 20.0  # than itself, of an actor with other vertices
_OTHER = 1e-3  # m, of landmarks at rest: another actor, not another precision
_ELSEWHERE = 0.01  # m, of joints of a rig from their bones: of another person
_FACTOR = 0.8  # logarithms of factors above are the factors themselves, about 1
_TURNS = 4 * math.pi  # angles of joints and roots above are degrees, or count turns


class Actor(nn.Module):
    """Skeleton, template mesh and skinning weights of one person.

    Every bone of the template moves rigidly with one joint of the skeleton: its own, as
    ``template.joint_bones`` or its name says, or that of its nearest ancestor. Extra bones
    (fingers, twists) are thus carried along, and an exported animation plays on the user's own
    bones. Clavicles of imported rigs are joints of the skeleton too, and their fingers are bent as
    at rest: ``vertices`` are those of the template but for the hands.

    Args:
        template: the rigged mesh.
        rig: its skeleton; built from the joints' bones when not given.
        rest_hands: whether fingers rest; else they are as the template has them.
    """

    vertices: Tensor

    def __init__(self, template: Template, rig: Rig | None = None, rest_hands: bool = True) -> None:
        super().__init__()
        self.template = template
        self.rest_hands = rest_hands
        self._bent = resting_fingers(template, template.joint_bones) if rest_hands else None
        self.skeleton = Skeleton(rig if rig is not None else human_rig(_positions(template)))
        self.bone_joints = _bone_joints(template, self.skeleton.rig)
        if rig is not None:
            _warn_of_another(template, rig)
        like = self.skeleton.rest_positions
        self.register_buffer("vertices", _rest_vertices(template, self._bent).to(like))
        # skinning weights of joints rather than bones: bones of one joint move as one
        joints = torch.tensor(self.bone_joints)[torch.tensor(template.weight_bones)]
        self.skin = SkinWeights(torch.tensor(template.weights).to(like), joints.to(like.device))

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *args: Any) -> None:
        """Load, and warn where the state is of another actor: a template is no part of it."""
        own = self.skeleton.rest_landmarks.detach().cpu().double()
        given = state_dict.get(f"{prefix}skeleton.rest_landmarks")
        if isinstance(given, Tensor) and given.shape == own.shape:
            apart = float((given.detach().cpu().double() - own).norm(dim=-1).max())
            if not apart <= _OTHER:
                without = f", or leave out its keys ({prefix}*), with strict=False"
                warnings.warn(
                    f"the state_dict is of another actor than {self.template.name!r}: joints at "
                    f"rest lie up to {apart:.2g} m apart; bones and surface are now the other "
                    "one's, the template, which files are written of, is not. Make the module of "
                    f"that actor first{without if prefix else ''}",
                    stacklevel=2,
                )
        super()._load_from_state_dict(state_dict, prefix, *args)

    @property
    def landmarks(self) -> Landmarks:
        """The 16 landmarks as the points that energies take."""
        return Landmarks(self.skeleton)

    def joints(self, motion: Motion) -> Tensor:
        """Landmarks in the world, (*b, F, 16, 3), metres."""
        _warn_of_degrees(motion)
        landmarks: Tensor = self.skeleton(motion).landmarks
        return landmarks

    def surface(self, motion: Motion, rest: Tensor | None = None) -> Tensor:
        """Vertices in the world, (*b, F, V, 3), metres, by dual quaternion skinning (MPC-4).

        Args:
            motion: (*b, F).
            rest: other vertices at rest, (*b, F, V, 3), metres; the template's if not given.
        """
        _warn_of_degrees(motion)
        rotation, translation = self.joint_transforms(motion)
        vertices = self.vertices if rest is None else rest
        return dual_quaternion_blend(vertices, self.skin, rotation, translation)

    def with_vertices(self, rest: Tensor) -> Self:
        """The actor with other vertices at rest, (V, 3) m; the template stays the same.

        Raises:
            InputError: they are of another number or unit, or no numbers.
        """
        if rest.shape != self.vertices.shape:
            raise InputError(
                f"rest has shape {tuple(rest.shape)}; expected {tuple(self.vertices.shape)}"
            )
        larger = float((_extent(rest) / _extent(self.vertices)).detach())
        if not 1 / _LARGER <= larger <= _LARGER:  # nor is it NaN
            raise InputError(
                f"rest is {larger:.3g} times as large as the actor, expected metres; divide "
                "millimetres by 1000, and leave no vertex NaN"
            )
        other = copy.copy(self)
        other._buffers = {**self._buffers, "vertices": rest.to(self.vertices)}
        return other

    def at_rest(self, motion: Motion, surface: Tensor) -> Tensor:
        """The vertices at rest that a motion poses to a surface, (*b, F, V, 3), metres.

        Args:
            motion: (*b, F).
            surface: vertices in the world, (*b, F, V, 3), metres.
        """
        _warn_of_degrees(motion)
        rotation, translation = self.joint_transforms(motion)
        rest = dual_quaternion_blend(surface, self.skin, rotation, translation, inverse=True)
        _warn_of_unit(rest, self.vertices)
        return rest

    def joint_transforms(self, motion: Motion) -> tuple[Tensor, Tensor]:
        """Rest-to-posed rotation (*b, F, J, 3, 3) and translation (*b, F, J, 3) of the joints."""
        if BONES in motion.shared:
            raise ValueError("motion has unknown bones; resize the actor first: actor.resized()")
        pose = self.skeleton(motion)
        moved = (pose.rotation @ self.skeleton.rest_positions[..., None]).squeeze(-1)
        return pose.rotation, pose.position - moved

    def bone_transforms(self, motion: Motion) -> Tensor:
        """Rest-to-posed world transforms of the template's bones, (*b, F, B, 4, 4)."""
        rotation, translation = self.joint_transforms(motion)
        matrix = torch.cat((rotation, translation[..., None]), -1)
        last = matrix.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(*matrix.shape[:-2], 1, 4)
        bones = torch.cat((matrix, last), -2)[..., list(self.bone_joints), :, :]
        return bones if self._bent is None else bones @ torch.tensor(self._bent).to(bones)

    def with_still_shoulders(self) -> Self:
        """The actor whose clavicles are rigid with its chest; itself where it has none."""
        rig = self.skeleton.rig
        if not rig.clavicles:
            return self
        still = type(self)(self.template, with_still_shoulders(rig), self.rest_hands)
        return still.to(self.vertices)

    def with_modelled_hands(self) -> Self:
        """The actor whose fingers are as its template has them; itself where none were bent."""
        if self._bent is None:
            return self
        return type(self)(self.template, self.skeleton.rig, rest_hands=False).to(self.vertices)

    def resized(self, bones: Tensor) -> Self:
        """The actor with bones of group g longer by ``exp(bones_g)``, (S,); its mesh follows.

        Raises:
            InputError: they require gradients, which a mesh does not carry, or are not one a group,
                or are no logarithms.
        """
        groups = self.skeleton.group_names
        if bones.shape != (len(groups),):
            raise InputError(
                f"resized: bones have shape {tuple(bones.shape)}, expected ({len(groups)},), the "
                f"logarithms of factors of {', '.join(groups)}"
            )
        if bones.requires_grad and torch.is_grad_enabled():
            raise InputError(
                "resized: bones require gradients, which do not reach them through a new mesh; "
                "give bones.detach(), or let actor.skeleton.tree.bone_vectors require gradients"
            )
        usual = float(bones.detach().abs().median())
        if not float(bones.detach().abs().max()) <= math.log(_LARGER):  # nor is it NaN
            raise InputError(
                f"resized: bones are up to {float(bones.abs().max()):.3g}, expected logarithms of "
                "factors of length, 0 for none: give torch.log(factors)"
            )
        if usual > _FACTOR:
            warnings.warn(
                f"resized: bones are {usual:.3g} in the median, which makes them "
                f"{math.exp(usual):.2g} times longer or shorter; expected logarithms of factors, "
                "these look like the factors: give torch.log(factors)",
                stacklevel=2,
            )
        from perfcap.actor.bone_lengths import resize

        template, rig = resize(self.template, self.skeleton, self.bone_joints, bones)
        return type(self)(template, rig, self.rest_hands).to(self.vertices)


def _is_looked_at(values: Tensor) -> bool:
    """Whether numbers are at hand: on a device they would be waited for."""
    return values.device.type == "cpu" and values.numel() > 0 and is_readable(values)


def _warn_of_degrees(motion: Motion) -> None:
    """Warn of angles beyond two turns in most frames."""
    if torch.compiler.is_compiling() or motion.angles.device.type != "cpu" or not motion.frames:
        return
    angles = torch.cat((motion.rotation, motion.angles), -1).detach()
    if not _is_looked_at(angles):
        return
    usual = float(angles.abs().amax(-1).median())
    if usual > _TURNS:
        warnings.warn(
            f"the motion turns joints by {usual:.3g} radians in the median frame; expected "
            "radians, these look like degrees: give torch.deg2rad(angles), and rotation likewise",
            stacklevel=3,
        )


def _warn_of_unit(rest: Tensor, own: Tensor) -> None:
    """Warn where a surface (*b, F, V, 3) brought to rest is of another unit than the actor's."""
    if not _is_looked_at(rest):
        return
    size = rest.detach().amax(-2) - rest.detach().amin(-2)
    larger = float(torch.linalg.vector_norm(size, dim=-1).median() / _extent(own.detach()))
    if not 1 / _LARGER <= larger <= _LARGER:
        warnings.warn(
            f"at_rest: the surface comes to rest {larger:.3g} times as large as the actor; "
            "expected the surface of this motion, in metres: divide millimetres by 1000",
            stacklevel=3,
        )


def _warn_of_another(template: Template, rig: Rig) -> None:
    """Warn of a rig whose joints are not where the bones of the template begin."""
    own = _positions(template)
    far = {
        name: float((place.detach().cpu() - own[name]).norm())
        for name, place in zip(rig.joints, rig.positions, strict=True)
        if name in own
    }
    name = max(far, key=lambda each: far[each], default="")
    if far and far[name] > _ELSEWHERE:
        warnings.warn(
            f"the rig is not that of {template.name!r}: {name} is {far[name]:.2g} m from its bone; "
            "expected the joints of this template, in metres: leave the rig out, and it is built, "
            "or change that of Actor(template)",
            stacklevel=3,
        )


def _extent(vertices: Tensor) -> Tensor:
    """From end to end, metres."""
    extent: Tensor = torch.linalg.vector_norm(vertices.amax(0) - vertices.amin(0))
    return extent


def _rest_vertices(template: Template, bent: NDArray[np.float64] | None) -> Tensor:
    """Vertices (V, 3) with fingers bent by rest-to-rest transforms of the bones, (B, 4, 4)."""
    vertices = torch.tensor(template.vertices)
    if bent is None:
        return vertices
    weights, moved = torch.tensor(template.weights), torch.tensor(bent)
    skin = SkinWeights(weights, torch.tensor(template.weight_bones))
    placed = dual_quaternion_blend(vertices, skin, moved[:, :3, :3], moved[:, :3, 3])
    fingers = (bent != np.eye(4)).any((1, 2))
    touched = torch.tensor(((template.weights > 0) & fingers[template.weight_bones]).any(1))
    return torch.where(touched[:, None], placed, vertices)


def _positions(template: Template) -> dict[str, Tensor]:
    """Rest positions of joints and landmarks by name."""
    rest = torch.tensor(template.bone_rest)[:, :3, 3]
    bones = dict(zip(template.bone_names, range(len(rest)), strict=True))
    positions = {name: rest[bone] for name, bone in (template.joint_bones or bones).items()}
    positions |= {name: rest[bone] for name, bone in _clavicles(template).items()}
    return {**positions, **{n: torch.tensor(p) for n, (_, p) in template.landmarks.items()}}


def _clavicles(template: Template) -> dict[str, int]:
    """Bones of clavicles, of rigs whose bones were mapped; body models are left as they are."""
    return clavicle_bones(
        template.bone_parents.tolist(), template.bone_rest[:, :3, 3], template.joint_bones
    )


def _bone_joints(template: Template, rig: Rig) -> tuple[int, ...]:
    """Index of the joint each bone moves with."""
    named = {name: bone for bone, name in enumerate(template.bone_names)}
    bones = {**(template.joint_bones or named), **_clavicles(template)}
    own = {bones[name]: joint for joint, name in enumerate(rig.joints) if name in bones}
    if len(own) < 2:
        raise InputError(
            f"actor {template.name!r} has no bone of the skeleton; expected {', '.join(JOINTS)}"
        )
    parents = template.bone_parents.tolist()
    return bone_owners(parents, template.bone_rest[:, :3, 3], own, rig.parents)
