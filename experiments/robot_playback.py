"""Recorded motion on public humanoids, played back in MuJoCo.

Expect no joint beyond its range, and a foot more than a centimetre through the floor in at most
2 % of the frames. Needs ``pip install mujoco``. Where no robots are given, two MJCF of dm_control
and two URDF of example-robot-data are taken where installed; without any nothing is measured.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from report import DATA, Report, Table, data_folder, main
from retarget import CMU, OTHERS, panel, shipped_clip
from robot_models import playable, shipped

from perfcap.app.export import run_export
from perfcap.app.retarget import run_retarget
from perfcap.commands.results import Export, Retarget
from perfcap.io.actor import load_actor
from perfcap.io.export import Recording
from perfcap.io.result import read_result

DEEP = 0.01  # m


@dataclass(frozen=True)
class Experiment:
    """Which robots and clips."""

    data: Path = DATA
    """Folder of the recordings."""
    robots: tuple[Path, ...] = ()
    """URDF files, or MJCF with a floor; those of installed packages if none."""
    frames: int = 240
    """At most, of each clip."""
    picture: Path | None = None
    """Draw the demo's man and every robot in one frame into this file."""


def run(config: Experiment) -> Report:
    """Put every clip on every robot and play it."""
    robots = config.robots or tuple(shipped())
    if find_spec("mujoco") is None or not robots:
        return Report((), ("skipped: pip install mujoco dm_control example-robot-data",))
    if config.picture is not None:
        shown = [
            ("man", load_actor("sam")),
            *((r.stem, load_actor(r, robots=True)) for r in robots),
        ]
        panels = [panel(name, actor, shipped_clip()) for name, actor in shown]
        cv2.imwrite(str(config.picture), np.concatenate(panels, 1)[..., ::-1])
    rows = []
    for robot in robots:
        for name, clip, frames in _clips(config):
            with tempfile.TemporaryDirectory() as scratch:
                rows.append((f"{name} on {robot.stem}", *_played(robot, clip, frames, scratch)))
    columns = ("clip", "frames", "beyond limits", "feet > 1 cm deep, %", "deepest foot, mm",
               "bodies apart, mm", "limbs °", "95 %", "largest step °")  # fmt: skip
    every = np.array([row[1:] for row in rows])
    seen = every[np.isfinite(every[:, 2])]
    share = seen[:, 0] @ seen[:, 2] / seen[:, 0].sum() if len(seen) else np.nan
    note = (
        f"{every[:, 0].sum():.0f} frames: {every[:, 1].sum():.0f} values beyond limits; a foot "
        f"more than 1 cm through the floor in {share:.2f} % of {seen[:, 0].sum():.0f} frames"
    )
    return Report((Table("each clip on each robot", columns, tuple(rows), 2),), (note,))


def _clips(config: Experiment) -> Iterator[tuple[str, Path, str]]:
    cmu, bandai = (data_folder(config.data, f"mocap_{n}_bvh") for n in ("cmu", "bandai"))
    for name in CMU:  # behind an inserted T-pose
        yield f"CMU {name}", cmu / f"{name}.bvh", f"1:{1 + config.frames}"
    for name in OTHERS:
        path = bandai / f"dataset-1_{name}_normal_001.bvh"
        yield f"Bandai {name}", path, f"0:{config.frames}"


def _played(robot: Path, clip: Path, frames: str, scratch: str) -> tuple[float, ...]:
    """Frames, values beyond limits, share of frames with a foot in the floor, and more."""
    out = Path(scratch) / "out"
    run_retarget(Retarget(clip, (str(robot),), out, frames))
    run_export(Export(out, ("qpos",), name="played"))
    with np.load(out / "export" / "played_qpos.npz", allow_pickle=False) as found:
        qpos, names = found["qpos"], found["joint_names"].tolist()
    mujoco: Any = import_module("mujoco")
    model = playable(robot)
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in names]
    places = [int(joint.qposadr[0]) for joint in joints]
    limited = np.array([bool(joint.limited[0]) for joint in joints])
    lower, upper = np.array([joint.range for joint in joints]).T
    beyond = (qpos[:, 7:] < lower) | (qpos[:, 7:] > upper)
    result = read_result(out)
    bones = Recording(result, "played", 0, len(qpos)).facing_up("z").posed_bones
    feet = _feet(model, load_actor(robot, robots=True))
    depth, apart = np.zeros(len(qpos)), 0.0
    if not any(int(body) in feet for body in model.geom_bodyid):
        depth += np.nan  # without shapes nothing is known of the floor
    for frame, values in enumerate(qpos):
        data.qpos[:7] = values[:7]
        data.qpos[places] = values[7:]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        depth[frame] += _depth(mujoco, model, data, feet)
        apart = max(apart, _apart(model, data, result.template.bone_names, bones[frame]))
    kept = json.loads((out / "run.json").read_text())["retarget"]["limbs_degrees"]
    step = np.degrees(np.abs(np.diff(qpos[:, 7:], axis=0))).max()
    return (
        float(len(qpos)),
        float((beyond & limited).sum()),
        100 * float((depth > DEEP).mean()),
        1000 * float(depth.max()),
        1000 * apart,
        kept["median"],
        kept["q95"],
        float(step),
    )


def _feet(model: Any, actor: Any) -> set[int]:
    """Bodies of the feet and of what hangs on them."""
    rig = actor.skeleton.rig
    feet = {model.body(rig.joints[rig.roles[row]]).id for row in (-1, -2)}
    for body in range(model.nbody):
        if int(model.body_parentid[body]) in feet:
            feet.add(body)
    return feet


def _depth(mujoco: Any, model: Any, data: Any, feet: set[int]) -> float:
    """How far feet are below the floor by MuJoCo's own contacts, metres."""
    plane = int(mujoco.mjtGeom.mjGEOM_PLANE)
    deepest = 0.0
    for contact in data.contact:
        floor = [model.geom_type[geom] == plane for geom in contact.geom]
        bodies = {int(model.geom_bodyid[geom]) for geom in contact.geom}
        if any(floor) and bodies & feet:
            deepest = max(deepest, -float(contact.dist))
    return deepest


def _apart(model: Any, data: Any, names: tuple[str, ...], bones: NDArray[np.float64]) -> float:
    """Largest distance of MuJoCo's hinges from perfcap's bones, metres."""
    last = {int(model.jnt_bodyid[joint]): joint for joint in range(model.njnt)}
    found = 0.0
    for body, joint in last.items():
        name = model.body(body).name
        if model.jnt_type[joint] == 3 and name in names:
            place = bones[names.index(name), :3, 3]
            found = max(found, float(np.linalg.norm(data.xanchor[joint] - place)))
    return found


if __name__ == "__main__":
    main(run, Experiment, "robot_playback")
