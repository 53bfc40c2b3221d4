"""Fingers at rest: which bend, how far, and that nothing else moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from synthetic import clavicled, random_motion, rest_positions, template

from perfcap.actor.actor import Actor
from perfcap.actor.fingers import REST, resting_fingers
from perfcap.actor.skinning import dual_quaternion_blend
from perfcap.actor.template import Template

T_POSE = rest_positions(arms=90.0, elbows=0.0)
# where fingers begin, metres from the wrist along the arm and forwards; lengths of their bones
KNUCKLES = {"thumb": (0.03, 0.04), "index": (0.09, 0.03), "middle": (0.095, 0.01),
            "ring": (0.09, -0.01), "little": (0.08, -0.03)}  # fmt: skip
BONES = (0.04, 0.03, 0.02)


def handed(fingers: tuple[str, ...] = tuple(KNUCKLES), bend: float = 0.0) -> Template:
    """The person of tubes with palms down and fingers, each joint of which is bent, degrees."""
    plain = clavicled(template(T_POSE))
    names, parents = list(plain.bone_names), plain.bone_parents.tolist()
    places, vertices = [*plain.bone_rest[:, :3, 3]], [*plain.vertices]
    bones, weights, faces = [*plain.weight_bones], [*plain.weights], [*plain.faces.tolist()]
    for side, sign in (("l", 1.0), ("r", -1.0)):
        wrist = names.index(f"{side}_wrist")
        for finger in fingers:
            out, ahead = KNUCKLES[finger]
            at, above, way = places[wrist] + (sign * out, 0, ahead), wrist, 0.0
            for number, length in enumerate(BONES):
                way += np.radians(bend)
                names.append(f"{side}_{finger}{number}")
                parents.append(above)
                places.append(at)
                above = len(names) - 1
                step = length * np.array([sign * np.cos(way), -np.sin(way), 0.0])
                first = len(vertices)
                vertices += [at, at + step, at + step + (0, 0, 0.01)]
                bones += [[above, wrist, 0, 0]] * 3
                weights += [[0.9, 0.1, 0, 0]] * 3
                faces.append([first, first + 1, first + 2])
                at = at + step
    rest = np.tile(np.eye(4), (len(names), 1, 1))
    rest[:, :3, 3] = places
    return replace(
        plain, vertices=np.array(vertices), faces=np.array(faces), bone_names=tuple(names),
        bone_parents=np.array(parents), bone_rest=rest, weight_bones=np.array(bones),
        weights=np.array(weights),
    )  # fmt: skip


def ends(actor: Actor, finger: str) -> np.ndarray:
    """Where the bones of a finger of the left hand begin in the rest pose, and its tip, (4, 3)."""
    rig = actor.template
    moved = actor.bone_transforms(actor.skeleton.rest_motion())[0].numpy()
    rows = [rig.bone_names.index(f"l_{finger}{number}") for number in range(3)]
    places = [moved[b, :3, :3] @ rig.bone_rest[b, :3, 3] + moved[b, :3, 3] for b in rows]
    tip = rig.bone_rest[rows[-1], :3, 3] + (BONES[-1], 0, 0)
    return np.array([*places, moved[rows[-1], :3, :3] @ tip + moved[rows[-1], :3, 3]])


@pytest.mark.parametrize("finger", ["index", "middle", "ring", "little"])
def test_straight_fingers_bend_towards_the_palm_and_keep_their_lengths(finger: str) -> None:
    found = ends(Actor(handed()), finger)
    steps = np.diff(found, axis=0)
    assert np.allclose(np.linalg.norm(steps, axis=1), BONES)
    assert (steps[:, 1] < 0).all()  # palms are down
    cosines = (steps[:-1] * steps[1:]).sum(1) / np.array(BONES[:-1]) / np.array(BONES[1:])
    bends = np.degrees(np.arccos(cosines))
    assert bends[0] == pytest.approx(REST[1], abs=3)
    # the last one is seen by the middle of what it moves, which also is beside it
    assert bends[1] == pytest.approx(REST[2], abs=5)


def test_fists_and_what_is_no_hand_stay() -> None:
    for still in (
        handed(bend=50.0),
        handed(fingers=("thumb", "index", "middle", "ring")),
        handed(fingers=()),
        clavicled(),
        template(),
    ):
        assert resting_fingers(still, still.joint_bones) is None
        actor = Actor(still)
        assert torch.equal(actor.vertices, torch.tensor(still.vertices).to(actor.vertices))
        assert actor.with_modelled_hands() is actor
    rig = handed()
    assert resting_fingers(rig, {}) is None


def test_thumbs_and_the_rest_of_the_body_stay() -> None:
    rig = handed()
    actor = Actor(rig)
    shift = (actor.vertices - torch.tensor(rig.vertices)).norm(dim=-1)
    fingers = [b for b, name in enumerate(rig.bone_names) if name[2:-1] in KNUCKLES]
    thumbs = [b for b in fingers if "thumb" in rig.bone_names[b]]
    of_fingers = np.isin(rig.weight_bones[:, 0], list(set(fingers) - set(thumbs)))
    assert float(shift[~of_fingers].max()) == 0 and float(shift[of_fingers].max()) > 0.005
    motion = random_motion(actor.skeleton, 4)
    modelled = actor.with_modelled_hands()
    assert torch.equal(actor.joints(motion), modelled.joints(motion))
    assert torch.equal(modelled.vertices, torch.tensor(rig.vertices))
    left, right = (actor.vertices[rig.weight_bones[:, 0] == rig.bone_names.index(f"{s}_index2")]
                   for s in "lr")  # fmt: skip
    # triangles of both sides have their third corner ahead: all but that is mirrored
    assert torch.allclose(left[:2], right[:2] * torch.tensor([-1.0, 1.0, 1.0]), atol=1e-3)


def test_bones_and_surface_say_the_same() -> None:
    """Files hold the template and its bones; the solver has vertices and joints."""
    actor = Actor(handed())
    rig, motion = actor.template, random_motion(actor.skeleton, 5)
    moved = actor.bone_transforms(motion)
    skinned = dual_quaternion_blend(
        torch.tensor(rig.vertices),
        torch.tensor(rig.weights),
        moved[..., :3, :3],
        moved[..., :3, 3],
        torch.tensor(rig.weight_bones),
    )
    assert torch.allclose(skinned, actor.surface(motion), atol=1e-9)


def test_others_of_an_actor_keep_its_hands() -> None:
    modelled = Actor(handed(), rest_hands=False)
    bones = torch.full((len(modelled.skeleton.group_names),), 0.1, dtype=torch.float64)
    for other in (modelled.resized(bones), modelled.with_still_shoulders()):
        assert torch.equal(other.vertices, torch.tensor(other.template.vertices))
    grown = Actor(handed()).resized(bones)
    assert not torch.equal(grown.vertices, torch.tensor(grown.template.vertices))
