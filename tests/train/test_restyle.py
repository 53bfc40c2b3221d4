"""Motion held otherwise, and with limbs of other clips."""

from dataclasses import replace

import pytest
import torch
from torch import Generator, Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.train.config import LiftingData
from perfcap.train.lifting_data import Track, restyled

TRACKS, FRAMES = 400, 3
LEGS = [i for i, name in enumerate(LANDMARKS) if name[2:] in {"hip", "knee", "ankle", "toe"}]
ARMS = [i for i, name in enumerate(LANDMARKS) if name[2:] in {"shoulder", "elbow", "wrist"}]
TRUNK = [LANDMARKS.index("head_top"), LANDMARKS.index("neck")]
STILL = replace(LiftingData(), recombined=0.0, loosened=0.0)


def track(seed: int) -> Track:
    generator = Generator().manual_seed(seed)
    bones = torch.randn(TRACKS, FRAMES, 16, 3, generator=generator)
    turns = rotvec_to_matrix(torch.randn(2, TRACKS, FRAMES, 3, generator=generator))
    return Track(bones, *turns)


def restyle(data: LiftingData, seed: int = 0) -> Tensor:
    return restyled(track(1), track(2), data, Generator().manual_seed(seed))


def test_nothing_asked_for_is_nothing_done() -> None:
    torch.testing.assert_close(restyle(STILL), track(1).bones)


def test_the_same_seed_gives_the_same_motion() -> None:
    data = LiftingData()
    assert torch.equal(restyle(data, 3), restyle(data, 3))
    assert not torch.equal(restyle(data, 3), restyle(data, 4))


@pytest.mark.parametrize("share", [1.0, 0.4])
def test_legs_stay_and_limbs_are_those_of_others_in_the_axes_of_the_trunk(share: float) -> None:
    own, other = track(1), track(2)
    bones = restyle(replace(STILL, recombined=share))
    torch.testing.assert_close(bones[:, :, LEGS], own.bones[:, :, LEGS])

    def alike(a: Tensor, b: Tensor) -> Tensor:
        return (a - b).abs().amax((1, 2, 3)) < 1e-4

    arms = alike(bones[:, :, ARMS] @ own.spine, other.bones[:, :, ARMS] @ other.spine)
    above = ARMS + TRUNK
    upper = alike(bones[:, :, above] @ own.pelvis, other.bones[:, :, above] @ other.pelvis)
    as_before = alike(bones, own.bones)
    trunk_as_before = alike(bones[:, :, TRUNK], own.bones[:, :, TRUNK])
    assert (trunk_as_before == (arms | as_before)).all()
    assert (arms.int() + upper.int() + as_before.int() == 1).all()
    for kind, expected in ((arms, share / 2), (upper, share / 2), (as_before, 1 - share)):
        assert kind.float().mean() == pytest.approx(expected, abs=0.08)


def test_limbs_are_turned_by_as_much_all_the_while_and_keep_their_lengths() -> None:
    own = track(1)
    still = Track(own.bones[:, :1].expand(-1, FRAMES, -1, -1), own.pelvis[:, :1], own.spine)
    bones = restyled(still, track(2), replace(STILL, loosened=5.0), Generator().manual_seed(0))
    torch.testing.assert_close(bones.norm(dim=-1), still.bones.norm(dim=-1))
    torch.testing.assert_close(bones[:, 1:], bones[:, :1].expand(-1, FRAMES - 1, -1, -1))
    cosine = torch.cosine_similarity(bones[:, 0], still.bones[:, 0], dim=-1)
    degrees = cosine.clamp(-1, 1).acos().rad2deg().mean(0)
    turned = {LANDMARKS[i] for i in range(16) if degrees[i] > 0.1}
    assert turned == {f"{s}_{p}" for s in "lr" for p in ("elbow", "wrist", "knee", "ankle", "toe")}
    arm, knee = (degrees[LANDMARKS.index(name)] for name in ("l_elbow", "l_knee"))
    assert float(arm) == pytest.approx(2.5 * float(knee), rel=0.2)
