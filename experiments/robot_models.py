"""Robots as MuJoCo plays them, and where humanoids that packages ship lie.

A URDF has no floor and stands on the world; it gets a plane and a free joint here. MuJoCo reads
meshes as STL and OBJ, so others are left out.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from perfcap.io.robot.urdf import mesh_file

SUITE = ("humanoid.xml", "humanoid_CMU.xml")  # of dm_control's suite, Apache-2.0
EXAMPLES = (
    "g1_description/urdf/g1_29dof_rev_1_0.urdf",  # Unitree, BSD-3-Clause
    "human_description/robots/human.urdf",  # Gepetto, BSD-2-Clause
)
_MESHES = (".stl", ".obj")


def shipped() -> list[Path]:
    """Humanoids of installed packages: two MJCF of dm_control, two URDF of example-robot-data."""
    found = []
    if find_spec("dm_control") is not None:
        folder = Path(str(import_module("dm_control").__file__)).parent / "suite"
        found += [folder / name for name in SUITE]
    try:
        files = distribution("example-robot-data").files or []
    except PackageNotFoundError:
        files = []
    return found + [
        Path(str(file.locate())) for name in EXAMPLES for file in files if str(file).endswith(name)
    ]


def playable(path: Path) -> Any:
    """The ``mujoco.MjModel`` of a robot that moves freely, above a floor.

    Args:
        path: an MJCF with its own floor and free joint, or a URDF.
    """
    mujoco: Any = import_module("mujoco")
    if path.suffix.lower() != ".urdf":
        return mujoco.MjModel.from_xml_path(str(path))
    specification = mujoco.MjSpec.from_string(_for_mujoco(path))
    specification.worldbody.bodies[0].add_freejoint()
    specification.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1])
    return specification.compile()


def _for_mujoco(path: Path) -> str:
    """A URDF with the places of its meshes, what collides (else what is seen), and every link."""
    root = ElementTree.parse(path).getroot()
    for link in root.iter("link"):
        collisions = link.findall("collision")
        for part in collisions + link.findall("visual"):
            mesh = part.find("geometry/mesh")
            if mesh is not None:
                mesh.set("filename", str(mesh_file(path, mesh.get("filename", "")).resolve()))
            other = mesh is not None and not mesh.get("filename", "").lower().endswith(_MESHES)
            if other or (collisions and part.tag == "visual"):
                link.remove(part)
            part.tag = "collision"  # what is only seen touches nothing
    for own in root.findall("mujoco"):
        root.remove(own)
    ElementTree.SubElement(
        ElementTree.SubElement(root, "mujoco"),
        "compiler",
        strippath="false",
        discardvisual="false",
        fusestatic="false",  # every link is a body that can be compared
        boundmass="1e-3",  # links without inertia move too
        boundinertia="1e-6",
        balanceinertia="true",
    )
    return ElementTree.tostring(root, encoding="unicode")
