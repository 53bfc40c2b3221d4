r"""Pose2Sim on inputs of perfcap: a project with 16 keypoints, run by an interpreter of its own.

Pose2Sim is no dependency. Its triangulation and filtering need few of its own, such as

    python -m venv peer && peer/bin/pip install --no-deps pose2sim
    peer/bin/pip install rtoml anytree pandas scipy statsmodels filterpy c3d tqdm matplotlib \
        opencv-python-headless lxml
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import matrix_to_rotvec

_RUN = """
import json, sys
from Pose2Sim import Pose2Sim
config = json.load(open(sys.argv[1]))
Pose2Sim.triangulation(config)
Pose2Sim.filtering(config)
"""
_OUTPUT_TO_WORLD = (2, 0, 1)  # it turns z up into y up


def pose2sim(
    python: Path, folder: Path, cameras: Camera, detections: Detections, rate: float
) -> Tensor:
    """Landmarks (F, 16, 3), metres, of Pose2Sim's triangulation and filter; NaN where none.

    Its settings are its defaults, but for distortion, which it is asked to take off.

    Args:
        python: an interpreter that has it.
        folder: new, for its project.
        cameras: C fixed views.
        detections: (F, C, 16).
        rate: frames a second.
    """
    _write(folder, cameras, detections)
    names = [_name(name) for name in LANDMARKS]
    children = [{"name": name, "id": index} for index, name in enumerate(names)]
    config = {
        "project": {"project_dir": str(folder.resolve()), "frame_rate": rate, "frame_range": "all"},
        "pose": {"pose_model": "PERFCAP",
                 "PERFCAP": {"name": "PERFCAP", "id": "None", "children": children}},
        "triangulation": {"undistort_points": True, "make_c3d": False,
                          "fill_large_gaps_with": "nan"},
        "filtering": {"display_figures": False, "save_filt_plots": False, "make_c3d": False},
    }  # fmt: skip
    (folder / "config.json").write_text(json.dumps(config))
    call = [str(python), "-c", _RUN, str(folder / "config.json")]
    done = subprocess.run(call, cwd=folder, capture_output=True, text=True, check=False)
    found = sorted((folder / "pose-3d").glob("*filt*.trc"))
    if done.returncode or not found:
        raise InputError(f"{python}: Pose2Sim failed: {done.stderr.strip()[-500:]}")
    return _read(found[0], names, detections.frame_count)


def _name(landmark: str) -> str:
    """As its skeletons have them, so that it may exchange left and right."""
    words = {"l": "L", "r": "R"}
    return "".join(words.get(word, word.capitalize()) for word in landmark.split("_"))


def _write(folder: Path, cameras: Camera, detections: Detections) -> None:
    """Calibration, and keypoints as OpenPose writes them."""
    (folder / "calibration").mkdir(parents=True)
    (folder / "Config.toml").write_text("")
    lines = [line for view in range(cameras.views) for line in _calibration(cameras, view)]
    (folder / "calibration" / "Calib.toml").write_text("\n".join(lines))
    for view in range(cameras.views):
        place = folder / "pose" / f"cam{view + 1:02}_json"
        place.mkdir(parents=True)
        seen = detections.confidence2d[:, view, :, None]
        rows = torch.cat((detections.joints2d[:, view], seen), -1)
        rows = torch.where(seen > 0, rows, 0).nan_to_num()
        for frame, row in enumerate(rows.flatten(1).tolist()):
            people = {"people": [{"pose_keypoints_2d": row}]}
            (place / f"cam{view + 1:02}_{frame:06}.json").write_text(json.dumps(people))


def _calibration(cameras: Camera, view: int) -> Iterator[str]:
    one = cameras.select([view])
    height, width = one.size[0]
    distortion = [0.0] * 4 if one.distortion is None else one.distortion.flatten().tolist()[:4]
    values = {
        "name": f"cam{view + 1:02}",
        "size": [float(width), float(height)],
        "matrix": one.intrinsics.reshape(3, 3).tolist(),
        "distortions": distortion,
        "rotation": matrix_to_rotvec(one.rotation.reshape(3, 3)).tolist(),
        "translation": one.translation.flatten().tolist(),
        "fisheye": False,
    }
    yield f"[cam{view + 1:02}]"
    yield from (f"{key} = {json.dumps(value)}" for key, value in values.items())


def _read(path: Path, names: list[str], frames: int) -> Tensor:
    """Rows of a TRC by frame number, in the world of the calibration."""
    lines = path.read_text().splitlines()
    marks = lines[3].split("\t")[2::3]
    found = np.full((frames, len(names), 3), np.nan)
    for line in lines[5:]:
        cells = line.split("\t")
        if cells[0].strip():
            row = [float(cell) if cell.strip() else np.nan for cell in cells[2:]]
            row += [np.nan] * (3 * len(marks) - len(row))
            points = np.array(row[: 3 * len(marks)]).reshape(-1, 3)
            found[int(float(cells[0]))] = points[[marks.index(name) for name in names]]
    return torch.tensor(found[..., _OUTPUT_TO_WORLD])
