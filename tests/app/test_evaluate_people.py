"""``perfcap evaluate`` against the truth of another person of the same take."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from crowds import circle, walkers
from rendered_files import metrics_of, save_motion
from runs import Command
from takes import camera_entry, write_json

from perfcap.app.truth import read_truth
from perfcap.app.truth_people import match_truths, own_truths, read_truths
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError

FRAMES, VIEWS, RATE = 60, 3, 30.0
Writer = Callable[[Path, np.ndarray], Path]
KNOWN = ("good to some centimetres", "its frames are numbered from 21")  # of pose2sim
NEARER = "of the same recording is nearer to the result"


@pytest.fixture(scope="module")
def people() -> np.ndarray:
    """Joints (2, F, 16, 3) m of two people who cross; the second walks his way backwards."""
    one, other = (a.joints(m).numpy() for a, m in zip(*walkers(2, FRAMES), strict=True))
    return np.stack((one, other[::-1]))


def captured(folder: Path, joints: np.ndarray) -> Path:
    """A result that is some 15 mm off, smoothly."""
    noise = np.random.default_rng(0).normal(size=joints.shape).cumsum(0)
    save_motion(folder, joints + 0.01 * noise / noise.std())
    return folder


def write_own(folder: Path, people: np.ndarray) -> Path:
    for number, joints in enumerate(people, 1):
        (folder / f"person{number}").mkdir(parents=True)
        np.savez(folder / f"person{number}" / "truth.npz", joints3d=joints, fps=RATE)
    return folder


def write_rendered(folder: Path, people: np.ndarray) -> Path:
    camera = circle(VIEWS)
    for number, joints in enumerate(people, 1):
        (folder / f"person{number}").mkdir(parents=True)
        pixels = camera.project(torch.from_numpy(joints.copy())).numpy()
        np.savez(folder / f"person{number}" / "gt.npz", joints3d=joints, joints2d=pixels)
    views = {f"cam{view}": camera_entry(camera, view) for view in range(VIEWS)}
    write_json(folder / "cameras.json", {"fps": RATE, "views": views})
    return folder


def write_pose2sim(folder: Path, people: np.ndarray) -> Path:
    """A take with a file a person, the second from frame 20 on, and the first filtered too."""
    (folder / "calibration").mkdir(parents=True)
    (folder / "pose-3d").mkdir()
    (folder / "calibration" / "Calib_demo.toml").write_text(
        '[cam1]\nname = "cam1"\nsize = [1088.0, 1920.0]\n'
        "matrix = [[1600.0, 0.0, 540.0], [0.0, 1600.0, 960.0], [0.0, 0.0, 1.0]]\n"
        "distortions = [0.0, 0.0, 0.0, 0.0]\nrotation = [0.1, 0.2, 0.3]\n"
        "translation = [0.0, 0.0, 4.0]\nfisheye = false\n"
    )
    for name, joints, first in (
        ("take_P1_0-60", people[0], 0),
        ("take_P1_0-60_filt_butterworth", people[0] + 1e-3, 0),
        ("take_P2_0-60", people[1], 20),
    ):
        lines = [
            "PathFileType\t4",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
            f"{RATE}\t{RATE}\t{len(joints)}\t16\tm",
            "Frame#\tTime\t" + "\t\t\t".join(LANDMARKS),
            "\t",
        ]
        for frame in range(first, len(joints)):  # Y up: the axes turn round
            cells = [repr(float(x)) for x in joints[frame][:, [1, 2, 0]].ravel()]
            lines.append("\t".join([str(frame + 1), repr(frame / RATE), *cells]))
        (folder / "pose-3d" / f"{name}.trc").write_text("\n".join(lines) + "\n")
    return folder


def notes_of(result: Path, perfcap: Command, *truth: object) -> list[str]:
    assert perfcap(["evaluate", result, "--truth", *truth]).code == 0
    notes = metrics_of(result)["notes"]
    assert isinstance(notes, list)
    return [note for note in notes if not any(known in note for known in KNOWN)]


@pytest.mark.parametrize("write", [write_own, write_rendered])
@pytest.mark.parametrize("shown", [1, 2])
def test_another_person_of_a_folder(
    tmp_path: Path, perfcap: Command, people: np.ndarray, write: Writer, shown: int
) -> None:
    take = write(tmp_path / "take", people)
    result = captured(tmp_path / "r", people[shown - 1])
    right, wrong = (take / f"person{number}" for number in (shown, 3 - shown))
    assert not notes_of(result, perfcap, right)
    (note,) = notes_of(result, perfcap, wrong)
    assert note.startswith(f"{right} {NEARER}") and f"--truth {right} compares" in note
    assert metrics_of(result)["mpjpe_mm"] > 200


@pytest.mark.parametrize(
    ("write", "dataset", "names"),
    [
        (write_rendered, "rendered", ("take/1", "take/2")),
        (write_pose2sim, "pose2sim", ("take/take_P1_0-60", "take/take_P2_0-60")),
    ],
    ids=["rendered", "pose2sim"],
)
def test_another_person_of_a_data_set(
    tmp_path: Path,
    perfcap: Command,
    people: np.ndarray,
    write: Writer,
    dataset: str,
    names: tuple[str, str],
) -> None:
    write(tmp_path / "take", people)
    for shown, (right, wrong) in enumerate((names, names[::-1])):
        result = captured(tmp_path / f"r{shown}", people[shown])
        arguments = (tmp_path, "--dataset", dataset, "--sequence")
        assert not notes_of(result, perfcap, *arguments, right)
        (note,) = notes_of(result, perfcap, *arguments, wrong)
        assert note.startswith(f"{right} {NEARER}") and f"--sequence {right} compares" in note


@pytest.mark.parametrize("write", [write_rendered, write_pose2sim])
def test_everybody_of_a_take(tmp_path: Path, people: np.ndarray, write: Writer) -> None:
    write(tmp_path / "take", people)
    dataset = write.__name__.removeprefix("write_")
    truths = read_truths(tmp_path, dataset, "take")
    results = [captured(tmp_path / f"r{k}", people[k]) for k in (1, 0)]
    assert match_truths(results, truths) == truths[::-1] and len(truths) == 2
    assert all(len(truth.sequence.others) == 1 for truth in truths)


def test_other_people_are_where_their_frames_are(tmp_path: Path, people: np.ndarray) -> None:
    """Of files of one's own, by number; damaged ones are left out."""
    write_own(tmp_path, people)
    values = {"joints3d": people[1], "frames": np.arange(10, 10 + FRAMES)}
    np.savez(tmp_path / "person2" / "truth.npz", **values)
    (tmp_path / "person3").mkdir()
    (tmp_path / "person3" / "truth.npz").write_bytes(b"none")
    (tmp_path / "person4").mkdir()
    others = read_truth(tmp_path / "person1" / "truth.npz").sequence.others
    assert list(others) == [str(tmp_path / "person2")]
    joints = others[str(tmp_path / "person2")].numpy()
    assert np.isnan(joints[:10]).all()
    np.testing.assert_array_equal(joints[10:], people[1][:-10])
    np.savez(tmp_path / "alone.npz", joints3d=people[0])
    assert not read_truth(tmp_path / "alone.npz").sequence.others


def test_a_world_turned_about_the_people_shows_no_other_one(
    tmp_path: Path, perfcap: Command, people: np.ndarray
) -> None:
    """Two people face each other, so that after half a turn each is where the other was."""
    pose = people[0] - people[0].mean(1, keepdims=True)
    half, ahead, up = np.array([-1.0, 1.0, -1.0]), np.array([0.0, 0.0, 0.5]), [0.0, 0.9, 0.0]
    facing = np.stack((pose + ahead + up, half * (pose[::-1] + ahead) + up))
    take = write_own(tmp_path / "take", half * facing)
    (note,) = notes_of(captured(tmp_path / "r", facing[0]), perfcap, take / "person1")
    assert "one rotation of all frames by 180 degrees" in note


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_pages_of_several_people_have_a_truth_each(
    people: np.ndarray, tmp_path: Path, order: tuple[int, int]
) -> None:
    truth = write_own(tmp_path / "truth", people[list(order)])
    found = [captured(tmp_path / f"of{number}", joints) for number, joints in enumerate(people)]
    assert own_truths(found, truth) == [truth / f"person{order.index(k) + 1}" for k in (0, 1)]
    assert own_truths(found[:1], truth / "person2") == [truth / "person2"]
    with pytest.raises(InputError, match=r"has 1 people, the result 2.*or name the folder of one"):
        own_truths(found, truth / "person1" / "truth.npz")
