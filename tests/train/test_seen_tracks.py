"""Tracks of videos with their truth: read, checked, turned and mirrored as they should be."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from motion_files import write_library
from numpy.typing import NDArray
from takes import make_take

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.retarget import mid_hip
from perfcap.errors import InputError
from perfcap.train.config import DetectorNoise, LiftingData
from perfcap.train.lifting_data import LiftingSamples
from perfcap.train.motion_library import MotionLibrary
from perfcap.train.seen_tracks import MixedSamples, SeenTracks

EXACT = LiftingData(frames=12, noise=DetectorNoise(*([0.0] * 14)))
MIRRORED = list(LANDMARKS16.mirrored())
Reading = Callable[[NDArray[np.float32]], NDArray[np.float32]]
LENS = np.array([[500.0, 0.0, 310.0], [0.0, 520.0, 250.0], [0.0, 0.0, 1.0]])


def arrays(tracks: int = 5, frames: int = 20) -> dict[str, Any]:
    """Exact tracks of points that wander, each asymmetric."""
    rng = np.random.default_rng(3)
    truth = rng.normal(0, 0.4, (tracks, 1, 16, 3)) + rng.normal(0, 0.02, (tracks, frames, 16, 3))
    truth[..., 2] += 4.0
    pixels = truth @ LENS.T
    return {
        "joints2d": (pixels[..., :2] / pixels[..., 2:]).astype(np.float32),
        "confidence": rng.uniform(0.3, 1, (tracks, frames, 16)).astype(np.float32),
        "truth": truth.astype(np.float32),
        "intrinsics": np.tile(LENS, (tracks, 1, 1)),
    }


def read(folder: Path, **other: Any) -> SeenTracks:
    np.savez(folder / "tracks.npz", **(arrays() | other))
    return SeenTracks.read(folder / "tracks.npz")


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


# --- reading --------------------------------------------------------------------------------------


def test_exact_tracks_are_projections_of_their_truth(tmp_path: Path) -> None:
    tracks = read(tmp_path)
    torch.testing.assert_close(tracks.plane, tracks.joints[..., :2] / tracks.joints[..., 2:])


def test_what_was_not_seen_has_no_place(tmp_path: Path) -> None:
    made = arrays()
    made["joints2d"][0, 0, 3] = np.nan
    tracks = read(tmp_path, joints2d=made["joints2d"])
    assert tracks.plane.isfinite().all() and tracks.confidence[0, 0, 3] == 0
    assert tracks.digest != read(tmp_path).digest


def people(tracks: int = 5, frames: int = 20) -> dict[str, Any]:
    """Somebody who walks to the right, before cameras."""
    rest = np.zeros((16, 3))
    rest[:, 1] = np.linspace(-0.8, 0.8, 16)
    side = [0, 0, -1, -1.5, -2, 1, 1.5, 2, -0.5, -0.6, -0.6, -0.8, 0.5, 0.6, 0.6, 0.8]
    rest[:, 0] = 0.2 * np.array(side)
    rest[5:8], rest[12:] = rest[2:5] * [-1, 1, 1], rest[8:12] * [-1, 1, 1]
    way = np.linspace(-1, 1, frames)[:, None, None] * [1.0, 0.0, 0.2] + [0.0, 0.0, 4.0]
    truth = np.tile(rest + way, (tracks, 1, 1, 1))
    pixels = truth @ LENS.T
    seen = pixels[..., :2] / pixels[..., 2:]
    seen += np.random.default_rng(0).normal(0, 4, seen.shape)
    kept = arrays(tracks, frames)
    return kept | {"joints2d": seen.astype(np.float32), "truth": truth.astype(np.float32)}


SPOILED: dict[str, tuple[dict[str, Any], str]] = {
    "millimetres": ({"truth": 1000 * people()["truth"]}, "expected metres"),
    "upwards": ({"truth": people()["truth"] * np.float32([1, -1, 1])}, "5 of 5 tracks"),
    "late": ({"truth": np.roll(people()["truth"], 5, 1)}, "of a person's height"),
    "half": ({"intrinsics": people()["intrinsics"] * [[0.5], [0.5], [1]]}, "the same pictures"),
    "sides": ({"joints2d": people()["joints2d"][:, :, MIRRORED]}, "left and right"),
    "nobody": ({"confidence": 0 * people()["confidence"]}, "of track 0 nan"),
}


SEVERAL = 10  # tracks, of which each joint is judged


def reordered(*pairs: tuple[str, str]) -> dict[str, Any]:
    """Tracks with landmarks exchanged."""
    order = list(range(16))
    for one, other in pairs:
        a, b = LANDMARKS.index(one), LANDMARKS.index(other)
        order[a], order[b] = order[b], order[a]
    made = people(SEVERAL)
    return made | {"joints2d": made["joints2d"][:, :, order]}


def at_origin(name: str) -> dict[str, Any]:
    """Tracks with a landmark at 0, 0 that counts as seen."""
    made = people(SEVERAL)
    made["joints2d"][:, :, LANDMARKS.index(name)] = 0
    return made


SPOILED |= {
    "arms": (
        reordered(*((f"l_{n}", f"r_{n}") for n in ("shoulder", "elbow", "wrist"))),
        "r_shoulder and l_shoulder, r_elbow and l_elbow, r_wrist and l_wrist of joints2d are each",
    ),
    "neck": (reordered(("neck", "head_top")), "head_top and neck of joints2d are each nearer"),
    "elbow": (reordered(("l_elbow", "l_wrist")), "l_elbow and l_wrist of joints2d are each"),
    "hip": (reordered(("r_hip", "r_ankle")), "r_hip and r_ankle of joints2d are each"),
    "origin": (at_origin("l_wrist"), r"joints2d of l_wrist \(\d+%\) are farther .* confidence 0"),
}


def test_a_joint_that_is_nowhere_seen_is_accepted(tmp_path: Path) -> None:
    made = at_origin("l_wrist")
    with pytest.raises(InputError):  # as if it were seen there
        read(tmp_path, **made).require_followed(tmp_path / "tracks.npz")
    made["confidence"][..., LANDMARKS.index("l_wrist")] = 0
    read(tmp_path, **made).require_followed(tmp_path / "tracks.npz")


def test_a_joint_of_a_few_tracks_may_be_elsewhere(tmp_path: Path) -> None:
    """As an elbow that networks do not find behind a back."""
    made = at_origin("l_wrist")
    few = {name: values[:9] for name, values in made.items()}
    read(tmp_path, **few).require_followed(tmp_path / "tracks.npz")
    with pytest.raises(InputError):
        read(tmp_path, **made).require_followed(tmp_path / "tracks.npz")


def test_joints_that_are_exchanged_in_some_tracks(tmp_path: Path) -> None:
    """As where files of one camera have another order; medians over all hardly know of them."""
    right, other = people(SEVERAL), reordered(("l_wrist", "r_wrist"))
    for count, words in ((1, ""), (3, "r_wrist and l_wrist in 3 of 10 tracks; exchange them")):
        wrong = (np.arange(SEVERAL) < count)[:, None, None, None]
        made = right | {"joints2d": np.where(wrong, other["joints2d"], right["joints2d"])}
        tracks = read(tmp_path, **made)
        with pytest.raises(InputError, match=words) if words else nullcontext():
            tracks.require_followed(tmp_path)


@pytest.mark.parametrize(
    ("reading", "words"),
    [
        (lambda sure: sure, ""),
        (np.ones_like, ""),
        (lambda sure: np.where(sure > 0.6, 1.0, 0.5).astype(np.float32), ""),
        (lambda sure: 1.3 - sure, "the surest third of the joints is .* the least sure third"),
        (lambda sure: 0.01 * sure, "confidences are 0.01 at most.*percents divided twice"),
    ],
)
def test_surer_joints_are_nearer(tmp_path: Path, reading: Reading, words: str) -> None:
    made = people()
    sure = made["confidence"]
    noise = (
        np.random.default_rng(1).normal(0, 1, made["joints2d"].shape) * 20 * (1 - sure[..., None])
    )
    pixels = made["truth"] @ LENS.T
    joints = (pixels[..., :2] / pixels[..., 2:] + noise).astype(np.float32)
    tracks = read(tmp_path, **(made | {"joints2d": joints, "confidence": reading(sure)}))
    with pytest.raises(InputError, match=words) if words else nullcontext():
        tracks.require_followed(tmp_path / "tracks.npz")


@pytest.mark.parametrize("kind", SPOILED)
def test_tracks_that_are_not_of_their_truth_are_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "tracks.npz"
    read(tmp_path, **people()).require_followed(path)
    other, words = SPOILED[kind]
    with pytest.raises(InputError, match=words) as refused:
        read(tmp_path, **(people() | other)).require_followed(path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("truth", np.zeros((5, 20, 16, 3), np.float32), "not finite before the cameras"),
        ("truth", np.zeros((5, 19, 16, 3), np.float32), r"truth is float32 \(5, 19, 16, 3\)"),
        ("confidence", np.full((5, 20, 16), 2.0, np.float32), "not 0 to 1"),
        ("confidence", np.zeros((5, 20, 16), np.int64), "int64"),
        ("confidence", np.zeros((0, 20, 16), np.float32), r"expected floating point \(0, 20"),
        ("intrinsics", np.zeros((5, 3, 3)), "cannot be inverted"),
    ],
)
def test_other_arrays_are_refused(tmp_path: Path, name: str, value: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(tmp_path, **{name: value})


def test_a_missing_array_is_named(tmp_path: Path) -> None:
    made = arrays()
    del made["truth"]
    np.savez(tmp_path / "tracks.npz", **made)
    with pytest.raises(InputError, match="lacks truth"):
        SeenTracks.read(tmp_path / "tracks.npz")


# --- samples --------------------------------------------------------------------------------------


def test_turned_and_mirrored_tracks_are_still_projections(tmp_path: Path) -> None:
    """Features of the samples are those of the projections of the samples' poses."""
    tracks = read(tmp_path)
    batch = tracks.sample(200, 12, replace(EXACT, roll=30.0), generator())
    places = batch.features[..., :32].unflatten(-1, (16, 2)) * batch.features[..., 48:, None].exp()
    # x (Z + t_z) = X + t_x: linear in the translation
    joints, one, zero = batch.joints.double(), torch.ones(200, 12, 16), torch.zeros(200, 12, 16)
    rows = torch.stack(
        (torch.cat((one, zero), -1), torch.cat((zero, one), -1),
         -torch.cat((places[..., 0], places[..., 1]), -1)), -1)  # fmt: skip
    right = torch.cat([places[..., k] * joints[..., 2] - joints[..., k] for k in range(2)], -1)
    shift = torch.linalg.lstsq(rows.double(), right[..., None]).solution[..., 0]
    moved = joints + shift[..., None, :]
    assert (moved[..., :2] / moved[..., 2:] - places).abs().max() < 1e-4
    torch.testing.assert_close(mid_hip(batch.joints), torch.zeros(200, 12, 3), atol=1e-5, rtol=0)


def test_half_of_the_samples_are_mirrored_with_sides_exchanged(tmp_path: Path) -> None:
    made = {name: array[:1, :1].repeat(20, 1) for name, array in arrays().items() if array.ndim > 3}
    made["confidence"] = np.ones((1, 20, 16), np.float32)
    tracks = read(tmp_path, intrinsics=LENS[None], **made)
    batch = tracks.sample(400, 12, replace(EXACT, roll=0.0), generator())
    corners = [LANDMARKS.index(name) for name in ("head_top", "l_wrist", "r_toe")]
    across = [LANDMARKS.index(name) for name in ("head_top", "r_wrist", "l_toe")]
    truth = tracks.joints[0, 0] - mid_hip(tracks.joints[0, 0])
    kept = (torch.linalg.det(batch.joints[:, 0, corners]) - torch.linalg.det(truth[corners])).abs()
    turned = torch.linalg.det(batch.joints[:, 0, across]) + torch.linalg.det(truth[corners])
    assert ((kept < 1e-4) ^ (turned.abs() < 1e-4)).all()
    assert 0.4 < float((kept < 1e-4).float().mean()) < 0.6


def test_limbs_go_missing_as_the_noise_says(tmp_path: Path) -> None:
    noise = replace(EXACT.noise, absent=1.0)
    batch = read(tmp_path).sample(8, 12, replace(EXACT, noise=noise), generator())
    seen = batch.features[..., 32:48] > 0
    gone = {LANDMARKS[j] for j in range(16) if not seen[..., j].any()}
    assert gone == {"head_top", "l_toe", "r_toe"}


# --- batches --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> MotionLibrary:
    return MotionLibrary.read(write_library(tmp_path_factory.mktemp("motion")))


@pytest.mark.long
@pytest.mark.parametrize("share", [0.25, 1.0])
def test_batches_are_mixed_and_repeat(library: MotionLibrary, tmp_path: Path, share: float) -> None:
    data = replace(EXACT, seen=share)
    simulated, tracks = LiftingSamples(library, data, 1), read(tmp_path)
    first, again = (MixedSamples(simulated, tracks, data, 1) for _ in range(2))
    batch = first.batch(7, 8)
    assert batch.features.shape == (8, 12, 49) and batch.joints.shape == (8, 12, 16, 3)
    assert torch.equal(batch.features, again.batch(7, 8).features)
    assert not torch.equal(batch.features, first.batch(8, 8).features)
    rest = 8 - round(8 * share)
    if rest:
        assert torch.equal(batch.joints[-rest:], simulated.batch(7, rest).joints)


def test_truth_of_no_motion_is_refused(tmp_path: Path) -> None:
    """Depth negated, of none or in another unit, and frames in no order: pictures fit as well."""
    take = make_take(40)
    true = take.cameras.to_camera(take.actor.joints(take.truth)).expand(-1, 6, -1, -1)
    true = true.transpose(0, 1).numpy().astype(float)
    root = true[:, :, 8:9]

    def tracks(truth: np.ndarray) -> SeenTracks:
        pixels = truth @ LENS.T
        made = {"joints2d": pixels[..., :2] / pixels[..., 2:], "truth": truth}
        made["confidence"] = np.ones(truth.shape[:3])
        return read(tmp_path, **made, intrinsics=np.tile(LENS, (6, 1, 1)))

    tracks(true).require_people(tmp_path)
    mixed = np.random.default_rng(1).permutation(40)
    hands, arms, toes = list(range(16)), list(range(16)), list(range(16))
    toes[LANDMARKS.index("l_toe")] = LANDMARKS.index("l_ankle")
    for name, other, order in (("l_wrist", "r_wrist", hands), ("l_elbow", "l_wrist", arms)):
        one, two = LANDMARKS.index(name), LANDMARKS.index(other)
        order[one], order[two] = two, one
    text = sorted(range(40), key=str)
    for words, truth in (
        ("feet point backwards", root + (true - root) * [1, 1, -1]),
        ("are flat", root + (true - root) * [1, 1, 0]),
        ("do not follow one another", root + 4 * (true - root)[:, mixed]),
        ("sorted as text", true[:, text]),
        ("l_wrist and r_wrist look exchanged", true[:, :, hands]),
        ("l_elbow and l_wrist look exchanged", true[:, :, arms]),
        ("l_ankle and l_toe lie at one place", true[:, :, toes]),
        ("repeat the true joints of the frame before", true[:, np.arange(40) // 2 * 2]),
    ):
        with pytest.raises(InputError, match=f"6 of 6 tracks are no motion .* {words}"):
            tracks(truth).require_people(tmp_path)
