"""Whole data sets in the layout of each reader, written by the tests of the readers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import test_mpi_inf_3dhp as mpi
import test_packed_positions as packed
import test_panoptic
import test_pickled_datasets as pickled
import torch
from fuzzing.mutate import Random
from fuzzing.targets import Target
from scenes import FRAMES, cameras, person
from scipy.io import savemat
from test_monoperfcap import write as write_monoperfcap
from test_own_recordings import write_pose2sim, write_rendered

from perfcap.io.datasets import find_dataset
from perfcap.io.datasets.joint_sets import H36M32, HUMANEVA15, MPI28
from perfcap.io.datasets.monoperfcap import read_off

_MOST = 3  # sequences read of a folder


def data_sets(root: Path) -> list[Target]:
    """One target for each data set; two for that of two kinds of files."""
    writers: dict[str, Callable[[Path], object]] = {
        "monoperfcap": write_monoperfcap,
        "human36m": _human36m,
        "humaneva": _humaneva,
        "mpi_inf_3dhp": _training,
        "3dpw": lambda place: pickled.write_3dpw(place, pickled.sequence_of_3dpw()),
        "emdb": pickled.write_emdb,
        "panoptic": test_panoptic.write,
        "rendered": write_rendered,
        "pose2sim": write_pose2sim,
    }
    found = [_target(root, name, name, write) for name, write in writers.items()]
    return [*found, _target(root, "mpi_inf_3dhp_test", "mpi_inf_3dhp", mpi.write_test)]


def _target(root: Path, name: str, dataset: str, write: Callable[[Path], object]) -> Target:
    folder = root / f"data_{name}"
    folder.mkdir(parents=True)
    write(folder)
    reader = find_dataset(dataset)

    def read(folder: Path, _: Random) -> Any:
        found = []
        names = reader.sequences(folder)[:_MOST]
        for each in [who for name in names for who in reader.people(folder, name)][:_MOST]:
            sequence = reader.read(folder, each)
            for mesh in sequence.meshes[:_MOST]:
                read_off(mesh)
            surface = None if sequence.surface is None else sequence.surface()
            vertices = None if surface is None else surface.vertices
            rig = sequence.rig
            # unknown joints are NaN; infinite ones are none
            joints = None if sequence.joints3d is None else sequence.joints3d.nan_to_num(0.0)
            if joints is not None and bool((joints.abs() > 1e300).any()):
                raise ArithmeticError("joints are infinite")
            cameras = None if rig is None else rig.cameras
            found.append((cameras, sequence.rate, vertices))
        return found

    return Target(f"data_{name}", folder, read)


def _human36m(folder: Path) -> None:
    packed.pack(
        folder / "data_3d_h36m.npz", {"S9": {"Directions 1": person(H36M32).astype(np.float32)}}
    )
    packed.write_metadata(folder / "metadata.xml", cameras(4), 9)


def _humaneva(folder: Path) -> None:
    points = {"Validate/S1": {"Walking 1 chunk0": person(HUMANEVA15)}}
    packed.pack(folder / "data_3d_humaneva15.npz", points)
    for view in range(3):
        path = folder / "S1" / "Calibration_Data" / f"C{view + 1}.cal"
        packed.write_cal(path, cameras(3, 480), view, [-0.28, 0.1, -0.001, 0.002, 0.0])


def _training(folder: Path) -> None:
    place = folder / "S1" / "Seq1"
    place.mkdir(parents=True)
    points = torch.from_numpy(person(MPI28))
    local, pixels = mpi.ring().to_camera(points), mpi.ring().project(points)
    flat = [
        mpi.cells([factor * values[:, view].reshape(FRAMES, -1).numpy() for view in range(14)])
        for factor, values in ((1, pixels), (1000, local))
    ]
    values = {"annot2": flat[0], "annot3": flat[1], "frames": np.arange(FRAMES)[:, None]}
    savemat(place / "annot.mat", values)
    mpi.write_calibration(place / "camera.calibration", mpi.ring())
