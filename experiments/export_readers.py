"""Exported files as programs read them that are not ours."""

from __future__ import annotations

import json
import subprocess
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

TOOLS = Path(__file__).resolve().parents[1] / "tools"

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Programs:
    """Where programs are; what is None is not asked."""

    blender: Path | None = None
    """A Python that has bpy."""
    node_modules: Path | None = None
    """Folder in which `npm install gltf-validator three playwright-core` was run."""
    chromium: Path | None = None
    """The browser."""

    def sample_blender(self, path: Path, rate: float, frames: Sequence[int], *more: str) -> Any:
        """Arrays of ``tools/blender_sample.py``."""
        out = path.parent / "blender.npz"
        command = [str(self.blender), str(TOOLS / "blender_sample.py"), str(path), str(out)]
        command += ["--fps", str(rate), *more, "--frames", *map(str, frames)]
        subprocess.run(command, check=True, capture_output=True)
        with np.load(out, allow_pickle=False) as data:
            return dict(data)

    def sample_three(self, path: Path, rate: float, frames: Sequence[int]) -> Floats:
        """Vertices (f, V, 3) of ``tools/three_sample.mjs``."""
        out = path.parent / "three.f32"
        listed = ",".join(map(str, frames))
        command = ["node", str(TOOLS / "three_sample.mjs"), str(self.chromium), repr(rate), listed]
        subprocess.run([*command, str(path), str(out)], check=True, cwd=self.node_modules)
        return np.fromfile(out, "<f4").reshape(len(frames), -1, 3).astype(float)

    def validate(self, paths: Sequence[Path]) -> tuple[int, int]:
        """Errors and warnings of the Khronos validator over all files."""
        command = ["node", str(TOOLS / "validate_glb.mjs"), *map(str, paths)]
        done = subprocess.run(command, cwd=self.node_modules, capture_output=True, text=True)
        counts = [line.rpartition(": errors ")[2].split() for line in done.stdout.splitlines()
                  if ": errors " in line]  # fmt: skip
        assert len(counts) == len(paths), done.stderr
        return sum(int(c[0]) for c in counts), sum(int(c[2]) for c in counts)


def read_bvh(path: Path, names: Sequence[str], frames: Sequence[int]) -> tuple[Floats, Floats]:
    """Places (f, B, 3) and turns from the rest pose (f, B, 3, 3), by bvhio."""
    import bvhio

    root = bvhio.readAsHierarchy(str(path))

    def turns() -> list[Rotation]:
        by_name = {joint.Name: joint.RotationWorld for joint, _, _ in root.layout()}
        return [Rotation.from_quat([(q := by_name[n]).x, q.y, q.z, q.w]) for n in names]

    root.loadRestPose()
    rest = turns()
    places, turned = [], []
    for frame in frames:
        root.loadPose(frame)
        by_name = {joint.Name: list(joint.PositionWorld) for joint, _, _ in root.layout()}
        places.append([by_name[name] for name in names])
        turned.append([(a * b.inv()).as_matrix() for a, b in zip(turns(), rest, strict=True)])
    return np.array(places), np.array(turned)


def read_c3d(path: Path) -> tuple[Floats, float]:
    """Points (F, M, 3) and rate, by the package c3d."""
    import c3d

    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = c3d.Reader(file)
        return np.array([points[:, :3] for _, points, _ in reader.read_frames()]), reader.point_rate


def read_trc(path: Path) -> tuple[Floats, Floats]:
    """Points (F, M, 3) and times (F,), by OpenSim."""
    import opensim

    table = opensim.TimeSeriesTableVec3(str(path))
    rows = range(table.getNumRows())
    points = [[list_of(table.getRowAtIndex(r)[m]) for m in range(table.getNumColumns())]
              for r in rows]  # fmt: skip
    return np.array(points), np.array(table.getIndependentColumn())


def list_of(vector: object) -> list[float]:
    return [vector[axis] for axis in range(3)]  # type: ignore[index]


def read_usd(path: Path, frames: Sequence[int]) -> tuple[Floats, Floats, int]:
    """Skinned vertices (f, V, 3), bone motions (f, B, 4, 4) and errors, by USD's own library."""
    from pxr import Usd, UsdGeom, UsdSkel, UsdValidation, Vt

    stage = Usd.Stage.Open(str(path))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root(stage.GetDefaultPrim()), Usd.TraverseInstanceProxies())
    body = stage.GetDefaultPrim().GetChild("body")
    skeleton = UsdSkel.Skeleton(stage.GetDefaultPrim().GetChild("skeleton"))
    query, skinning = cache.GetSkelQuery(skeleton), cache.GetSkinningQuery(body)
    vertices, motions = [], []
    for frame in frames:
        points = Vt.Vec3fArray(UsdGeom.Mesh(body).GetPointsAttr().Get())
        motion = query.ComputeSkinningTransforms(frame)
        skinning.ComputeSkinnedPoints(motion, points, frame)
        vertices.append(np.array(points))
        motions.append(np.array(motion).swapaxes(-1, -2))
    return np.array(vertices, float), np.array(motions), len(errors)


def read_usd_surface(path: Path, frames: Sequence[int]) -> Floats:
    """Points (f, V, 3) of a stage."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    attribute = UsdGeom.Mesh(stage.GetDefaultPrim().GetChild("body")).GetPointsAttr()
    return np.array([attribute.Get(frame) for frame in frames], float)


def targets(path: Path) -> int:
    """Number of morph targets of a GLB."""
    data = path.read_bytes()
    tree = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    return len(tree["meshes"][0]["primitives"][0].get("targets", []))
