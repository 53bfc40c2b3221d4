"""A small humanoid as URDF and as MJCF: the same bodies, hinges and limits, z up, facing x."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

# name, parent, place in the parent (m), hinges: name, axis, limits in degrees
BODIES = (
    ("base", None, (0.0, 0.0, 0.9), ()),
    ("chest", "base", (0.0, 0.0, 0.15), (("waist_yaw", (0, 0, 1), (-60, 60)),)),
    ("head", "chest", (0.0, 0.0, 0.4), (("head_pitch", (0, 1, 0), (-30, 45)),)),
    *(
        body
        for side, sign in (("left", 1.0), ("right", -1.0))
        for body in (
            (f"{side}_shoulder_pitch", "chest", (0.0, 0.2 * sign, 0.3),
             ((f"{side}_shoulder_pitch", (0, 1, 0), (-180, 90)),)),
            (f"{side}_shoulder_roll", f"{side}_shoulder_pitch", (0.0, 0.0, 0.0),
             ((f"{side}_shoulder_roll", (1, 0, 0), (-20, 170) if sign > 0 else (-170, 20)),)),
            (f"{side}_upper_arm", f"{side}_shoulder_roll", (0.0, 0.0, -0.05),
             ((f"{side}_shoulder_yaw", (0, 0, 1), (-120, 120)),)),
            (f"{side}_forearm", f"{side}_upper_arm", (0.0, 0.0, -0.25),
             ((f"{side}_elbow", (0, 1, 0), (-140, 0)),)),
            (f"{side}_hand", f"{side}_forearm", (0.0, 0.0, -0.25), ()),
            (f"{side}_hip_yaw", "base", (0.0, 0.1 * sign, 0.0),
             ((f"{side}_hip_yaw", (0, 0, 1), (-60, 60)),)),
            (f"{side}_hip_roll", f"{side}_hip_yaw", (0.0, 0.0, -0.03),
             ((f"{side}_hip_roll", (1, 0, 0), (-45, 45)),)),
            (f"{side}_thigh", f"{side}_hip_roll", (0.0, 0.0, -0.02),
             ((f"{side}_hip_pitch", (0, 1, 0), (-120, 40)),)),
            (f"{side}_shin", f"{side}_thigh", (0.0, 0.0, -0.4),
             ((f"{side}_knee", (0, 1, 0), (0, 150)),)),
            (f"{side}_ankle", f"{side}_shin", (0.0, 0.0, -0.38),
             ((f"{side}_ankle_pitch", (0, 1, 0), (-50, 40)),)),
            (f"{side}_foot", f"{side}_ankle", (0.0, 0.0, 0.0),
             ((f"{side}_ankle_roll", (1, 0, 0), (-25, 25)),)),
        )
    ),
)  # fmt: skip
FOOT = (0.06, (0.22, 0.09, 0.03))  # its box: ahead of the ankle, and sizes; the sole is 5 cm below
HINGES = [hinge for body in BODIES for hinge in body[3]]


def words(values: object) -> str:
    """Numbers of an attribute."""
    return " ".join(f"{value:.12g}" for value in np.ravel(np.asarray(values)))


def urdf() -> str:
    """As URDF."""
    lines = ['<?xml version="1.0"?>', '<robot name="walker">']
    for name, parent, place, hinges in BODIES:
        box = ""
        if name.endswith("foot"):
            box = (
                f'<collision><origin xyz="{FOOT[0]} 0 -0.035"/><geometry>'
                f'<box size="{words(FOOT[1])}"/></geometry></collision>'
            )
        lines.append(f'<link name="{name}">{box}</link>')
        if parent is None:
            continue
        kind = "revolute" if hinges else "fixed"
        title, axis, limits = hinges[0] if hinges else (f"{name}_fixed", (1, 0, 0), (0, 0))
        limit = (
            f'<limit lower="{np.radians(limits[0]):.15g}" upper="{np.radians(limits[1]):.15g}"/>'
        )
        lines.append(
            f'<joint name="{title}" type="{kind}"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{words(place)}"/><axis xyz="{words(axis)}"/>'
            f"{limit if hinges else ''}</joint>"
        )
    return "\n".join((*lines, "</robot>"))


def mjcf() -> str:
    """As MJCF, with classes and degrees, as MuJoCo's own models are written."""

    def body(name: str) -> str:
        _, parent, place, hinges = next(b for b in BODIES if b[0] == name)
        inner = '<freejoint name="root"/>' if parent is None else ""
        for title, axis, limits in hinges:
            inner += f'<joint name="{title}" axis="{words(axis)}" range="{words(limits)}"/>'
        if name.endswith("foot"):
            half = words(np.array(FOOT[1]) / 2)
            inner += f'<geom type="box" size="{half}" pos="{FOOT[0]} 0 -0.035"/>'
        inner += "".join(body(child[0]) for child in BODIES if child[1] == name)
        kind = ' childclass="robot"' if parent is None else ""
        return f'<body name="{name}" pos="{words(place)}"{kind}>{inner}</body>'

    return (
        '<mujoco model="walker"><compiler angle="degree"/><default><default class="robot">'
        '<joint type="hinge" limited="true"/></default></default><worldbody>'
        f'<geom type="plane" size="5 5 1"/>{body("base")}</worldbody></mujoco>'
    )


def write(folder: Path) -> dict[str, Path]:
    """Both files, by ending."""
    found = {}
    for ending, text in (("urdf", urdf()), ("xml", mjcf())):
        found[ending] = folder / f"walker.{ending}"
        found[ending].write_text(text)
    return found


def posed(qpos: np.ndarray, names: list[str]) -> dict[str, np.ndarray]:
    """Body-to-world transforms (4, 4) of a row of ``qpos``, by plain products."""
    angles = dict(zip(names, qpos[7:], strict=True))
    world: dict[str, np.ndarray] = {}
    for name, parent, place, hinges in BODIES:
        local = np.eye(4)
        if parent is None:
            local[:3, 3] = qpos[:3]
            local[:3, :3] = Rotation.from_quat(qpos[3:7], scalar_first=True).as_matrix()
        else:
            local[:3, 3] = place
        for title, axis, _ in hinges:
            turn = Rotation.from_rotvec(angles[title] * np.array(axis, dtype=float))
            local[:3, :3] = local[:3, :3] @ turn.as_matrix()
        world[name] = local if parent is None else world[parent] @ local
    return world
