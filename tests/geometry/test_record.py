"""Records: what is done to every tensor of one, and what transforms make of them."""

from dataclasses import dataclass, field, replace

import pytest
import torch
from synthetic import actor, cameras, random_motion
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.geometry.camera import Camera
from perfcap.geometry.record import Record

ACTOR = actor()


@dataclass(frozen=True)
class Thing(Record):
    value: Tensor
    maybe: Tensor | None = None
    blocks: dict[str, Tensor] = field(default_factory=dict)
    label: str = "plain"


def test_map_reaches_every_tensor_and_nothing_else() -> None:
    thing = Thing(torch.ones(2), None, {"a": torch.zeros(3)}, "kept")
    found = thing.map(lambda each: each + 1)
    assert found.value.tolist() == [2, 2] and found.maybe is None and found.label == "kept"
    assert found.blocks["a"].tolist() == [1, 1, 1]


def test_where_takes_whole_elements() -> None:
    one, other = Thing(torch.ones(2, 3)), Thing(torch.zeros(2, 3))
    assert one.where(torch.tensor([True, False]), other).value.tolist() == [[1] * 3, [0] * 3]


def test_stack_and_cat_are_undone_by_indexing() -> None:
    both = [random_motion(ACTOR.skeleton, 3, bones=True, seed=seed) for seed in (0, 1)]
    stacked = Motion.stack(both)
    assert stacked.angles.shape[:2] == (2, 3)
    again = stacked.map(lambda each: each[1])
    assert torch.equal(again.angles, both[1].angles)
    assert torch.equal(again.shared["bones"], both[1].shared["bones"])
    poses = [replace(motion, shared={}) for motion in both]
    assert torch.equal(Motion.cat(poses)[3:].rotation, both[1].rotation)


def test_records_of_other_parts_do_not_mix() -> None:
    plain, full = Thing(torch.ones(2)), Thing(torch.ones(2), torch.ones(2))
    with pytest.raises(ValueError, match="only some of the records have maybe"):
        Thing.stack([plain, full])
    named = replace(plain, blocks={"a": torch.ones(1)})
    with pytest.raises(ValueError, match="differ in the blocks of blocks"):
        Thing.stack([plain, named])


def test_transforms_take_and_return_records() -> None:
    """``vmap`` over clips is a batch, and ``jacrev`` gives a derivative as a record."""
    motion = random_motion(ACTOR.skeleton, 3, (2,), bones=True)
    each = torch.func.vmap(lambda one: ACTOR.landmarks(one))(motion)
    assert torch.allclose(each, ACTOR.landmarks(motion), atol=1e-12)
    slope = torch.func.grad(lambda one: ACTOR.landmarks(one).sum())(motion)
    assert isinstance(slope, Motion)
    # every landmark moves with the root
    assert torch.allclose(slope.translation, torch.full_like(slope.translation, 16.0))
    rigs = Camera.stack([cameras(2), cameras(2, distance=7.0)])
    seen = torch.func.vmap(lambda one: one.map(lambda part: 2 * part))(rigs)
    assert torch.equal(seen.translation, 2 * rigs.translation) and seen.size == rigs.size
