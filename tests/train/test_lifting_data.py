"""Simulated tracks: reproducible, consistent, and as wrong as they say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from motion_files import write_library

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.lifting import lifting_features
from perfcap.detect.retarget import bone_vectors, mid_hip
from perfcap.errors import InputError
from perfcap.train.config import DetectorNoise, LiftingData
from perfcap.train.detector_noise import corrupt
from perfcap.train.lifting_data import LiftingSamples, look_at, observe
from perfcap.train.motion_library import MotionLibrary

EXACT = DetectorNoise(*([0.0] * 14))
PLAIN = LiftingData(frames=24, size=0.0, bone=0.0, noise=EXACT)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> MotionLibrary:
    return MotionLibrary.read(write_library(tmp_path_factory.mktemp("motion")))


# --- the library ----------------------------------------------------------------------------------


@pytest.mark.long
def test_library_reads_people_and_leaves_glitches(library: MotionLibrary) -> None:
    assert library.subjects == ("01", "02", "03") and len(library.recordings) == 6
    assert library.of(["02"]).subjects == ("02",)
    assert library.without(["02"]).subjects == ("01", "03")
    points = library.recordings[0].landmarks
    assert points.shape == (240, 16, 3) and points.dtype == torch.float32
    lengths = bone_vectors(points).norm(dim=-1)
    knee = LANDMARKS.index("r_knee")
    assert lengths[:, knee].std() < 1e-3  # bones are rigid
    assert (points[:, 0, 1] > points[:, 1, 1]).float().mean() > 0.95  # the crown is up


@pytest.mark.parametrize("people", [["04"], []])
def test_unknown_people_are_named(library: MotionLibrary, people: list[str]) -> None:
    with pytest.raises(InputError, match="expected some of 01, 02, 03"):
        library.of(people)


def test_damaged_libraries(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        MotionLibrary.read(tmp_path)
    folder = write_library(tmp_path)
    arrays = dict(np.load(folder / "clips.npz"))
    broken = arrays | {"01_01/root_m": np.full_like(arrays["01_01/root_m"], np.nan)}
    np.savez(folder / "clips.npz", **broken)
    with pytest.raises(InputError, match="01_01 is not finite"):
        MotionLibrary.read(folder)
    del arrays["02_01/offsets_m"]
    np.savez(folder / "clips.npz", **arrays)
    with pytest.raises(InputError, match="lacks clip 02_01"):
        MotionLibrary.read(folder)


# --- tracks ---------------------------------------------------------------------------------------


def test_the_same_number_gives_the_same_batch(library: MotionLibrary) -> None:
    first, again = (LiftingSamples(library, LiftingData(), 5) for _ in range(2))
    first.batch(0, 4)
    for a, b in ((first.batch(7, 4), again.batch(7, 4)),):
        assert torch.equal(a.features, b.features) and torch.equal(a.joints, b.joints)
    assert not torch.equal(first.batch(7, 4).joints, first.batch(8, 4).joints)
    other = LiftingSamples(library, LiftingData(), 6)
    assert not torch.equal(first.batch(7, 4).joints, other.batch(7, 4).joints)


def test_exact_tracks_are_projections_of_their_poses(library: MotionLibrary) -> None:
    """A pose at the depth that its features' extent implies projects onto the features."""
    batch = LiftingSamples(library, PLAIN, 0).batch(0, 6)
    assert batch.features.isfinite().all()
    places = batch.features[..., :32].unflatten(-1, (16, 2)) * batch.features[..., 48:, None].exp()
    joints = batch.joints
    torch.testing.assert_close(mid_hip(joints), torch.zeros(6, 24, 3), atol=1e-5, rtol=0)
    # x (Z + t_z) = X + t_x: linear in the translation
    rows = torch.stack(
        (torch.cat((torch.ones(6, 24, 16), torch.zeros(6, 24, 16)), -1),
         torch.cat((torch.zeros(6, 24, 16), torch.ones(6, 24, 16)), -1),
         -torch.cat((places[..., 0], places[..., 1]), -1)), -1)  # fmt: skip
    right = torch.cat([places[..., k] * joints[..., 2] - joints[..., k] for k in range(2)], -1)
    shift = torch.linalg.lstsq(rows.double(), right.double()[..., None]).solution[..., 0]
    moved = joints.double() + shift[..., None, :]
    assert (shift[..., 2] > 0.5).all()
    error = moved[..., :2] / moved[..., 2:] - places
    assert error.abs().max() < 1e-4


def test_cameras_see_everybody_upright_and_in_front() -> None:
    world = torch.randn(200, 5, 16, 3) * torch.tensor([0.3, 0.5, 0.3])
    generator = torch.Generator().manual_seed(0)
    local = look_at(world, PLAIN, generator)
    assert (local[..., 2] > 0.5).all()
    torch.testing.assert_close(
        (local[:, 0, 0] - local[:, 0, 1]).norm(dim=-1),
        (world[:, 0, 0] - world[:, 0, 1]).norm(dim=-1),
    )
    up = local[:, 0, 0] - local[:, 0, 1]
    height = world[:, 0, 0, 1] - world[:, 0, 1, 1]
    assert torch.corrcoef(torch.stack((-up[:, 1], height)))[0, 1] > 0.8  # y is down


def test_other_people_have_other_bones(library: MotionLibrary) -> None:
    sizes = []
    for data in (PLAIN, replace(PLAIN, size=0.1, bone=0.05)):
        joints = LiftingSamples(library.of(["01"]), data, 0).batch(0, 64).joints
        bones = bone_vectors(joints).norm(dim=-1)
        left, right = (LANDMARKS.index(f"{s}_knee") for s in "lr")
        torch.testing.assert_close(bones[..., left], bones[..., right], atol=2e-3, rtol=0)
        sizes.append(bones[:, 0, left].std())
    assert sizes[0] < 0.002 < 0.02 < sizes[1]


def test_a_track_longer_than_its_clip_holds_its_end(library: MotionLibrary) -> None:
    batch = LiftingSamples(library, replace(PLAIN, frames=200), 0).batch(0, 2)
    assert batch.features.isfinite().all() and batch.joints.shape == (2, 200, 16, 3)


# --- noise ----------------------------------------------------------------------------------------


def still(tracks: int = 40, frames: int = 300) -> tuple[torch.Tensor, torch.Tensor]:
    plane = torch.rand(16, 2, generator=torch.Generator().manual_seed(1)) * 0.5
    return plane.expand(tracks, frames, 16, 2).clone(), torch.full((tracks, frames), 0.005)


def apply(noise: DetectorNoise) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    plane, unit = still()
    found, confidence = corrupt(plane, unit, noise, torch.Generator().manual_seed(0))
    return (found - plane) / 0.005, confidence, plane


def test_without_noise_nothing_changes() -> None:
    error, confidence, _ = apply(EXACT)
    assert error.abs().max() < 1e-4 and (confidence > 0.3).all()


def test_offsets_stay_and_jitter_does_not() -> None:
    stays = apply(replace(EXACT, offset=2.0))[0]
    assert stays.std(1).max() < 1e-3 and 1.5 < stays.std() < 3
    jitters = apply(replace(EXACT, jitter=2.0))[0]
    assert jitters.mean(1).abs().max() < 1 and 1.5 < jitters.std() < 3
    drift = apply(replace(EXACT, drift=1.0, keep=0.8))[0]
    a, b = drift[:, 1:].flatten(), drift[:, :-1].flatten()
    assert torch.corrcoef(torch.stack((a, b)))[0, 1] == pytest.approx(0.8, abs=0.02)


def test_rates_of_outliers_gaps_swaps_and_absent_joints() -> None:
    error, confidence, _ = apply(replace(EXACT, outliers=0.05))
    wild = error.norm(dim=-1) > 0.1
    assert wild.float().mean() == pytest.approx(0.05, abs=0.01)
    assert confidence[wild].mean() < 0.6 * confidence[~wild].mean()
    assert (apply(replace(EXACT, gaps=0.01))[1] == 0).float().mean() == pytest.approx(
        0.06, abs=0.02
    )
    absent = apply(replace(EXACT, absent=1.0))[1] == 0
    names = {LANDMARKS[j] for j in range(16) if absent[..., j].all()}
    assert names == {"head_top", "l_toe", "r_toe"}
    swapped, _, plane = apply(replace(EXACT, swaps=0.01))
    left, right = LANDMARKS.index("l_knee"), LANDMARKS.index("r_knee")
    moved = swapped[:, :, left] * 0.005 + plane[:, :, left]
    is_other = (moved - plane[:, :, right]).norm(dim=-1) < 1e-5
    assert 0.02 < is_other.float().mean() < 0.15


def test_limbs_lie_elsewhere_for_a_while_and_the_detector_is_too_sure_of_it() -> None:
    stays = [LANDMARKS.index(name) for name in ("neck", "l_hip", "r_shoulder")]
    error, sure, _ = apply(replace(EXACT, slips=0.003, slide=12.0))
    far = error.norm(dim=-1) > 10
    assert not error[..., stays, :].any() and 0.03 < far.float().mean() < 0.15
    ankle = far[..., LANDMARKS.index("l_ankle")].float()
    lasting = (ankle[:, 1:] * ankle[:, :-1]).sum() / ankle[:, 1:].sum()
    assert lasting > 0.85  # an error of one frame is a glitch that the network would see
    off, confidence, _ = apply(replace(EXACT, outliers=0.05))
    wild = (off.norm(dim=-1) > 10) & (off.norm(dim=-1) < 20)
    slid = far & (error.norm(dim=-1) < 20)
    assert sure[slid].mean() > 1.3 * confidence[wild].mean()


def test_a_slipped_limb_may_be_the_other_one() -> None:
    error, _, plane = apply(replace(EXACT, slips=0.01, slide=12.0, doubled=1.0))
    left, right = (LANDMARKS.index(f"{side}_ankle") for side in "lr")
    seen = error * 0.005 + plane
    moved = error[:, :, left].norm(dim=-1) > 1
    across = (seen[:, :, left] - plane[:, :, right]).norm(dim=-1) < 1e-5
    assert moved.any() and (across | ~moved).all()


def test_observed_tracks_with_everything_are_finite(library: MotionLibrary) -> None:
    hard = DetectorNoise(5, 5, 0.9, 3, 1, 0.1, 0.1, 0.1, 30, 0.5, 0.1, 0.1, 0.9, 0.9)
    camera = look_at(library.recordings[0].landmarks[None, :60], PLAIN, torch.Generator())
    batch = observe(camera, hard, torch.Generator())
    assert batch.features.isfinite().all() and batch.features.abs().max() < 50
    assert (
        lifting_features(camera[..., :2] / camera[..., 2:], torch.ones(1, 60, 16))[0]
        .isfinite()
        .all()
    )
