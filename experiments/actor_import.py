"""Characters of other programs: imported, moved for a second, exported and read again.

Expect every posed vertex to agree within 0.1 mm, on the exported file as well as on the character's
own file when it takes over the exported animation by the names of its bones.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from makehuman_rigs import build, rigs
from numpy.typing import NDArray
from report import DATA, Report, Table, data_folder, main

from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import dual_quaternion_blend, linear_blend
from perfcap.actor.template import Template
from perfcap.io.actor import load_actor
from perfcap.io.actor_folder import save_actor
from perfcap.io.actor_import import ImportedActor, import_actor
from perfcap.io.gltf_animation import read_bone_transforms
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import read_template
from perfcap.io.gltf_write import save_animation

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests"))
from foreign_rigs import RIGS, played_on, transformed  # noqa: E402
from takes import sway  # noqa: E402

FRAMES, RATE = 30, 30.0
_EXACT = ("vertices", "faces", "uv", "weights", "weight_bones")


@dataclass(frozen=True)
class Experiment:
    """Which data, and where a validator is."""

    data: Path = DATA
    """Folder of the recordings and of the MakeHuman assets."""
    validator: Path | None = None
    """Folder in which `npm install gltf-validator` was run."""


def run(config: Experiment) -> Report:
    """Import, capture and export every character."""
    rows, notes = [], []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for number, (name, path) in enumerate(_characters(config.data, folder)):
            rows.append(_row(name, path, folder / f"capture_{number}.glb", folder / str(number)))
        captures = sorted(folder.glob("capture_*.glb"))
        if config.validator is not None:
            notes.append(_validated(config.validator, captures))
    notes.append("MakeHuman's openpose rig was published without weights, so it moves nothing.")
    columns = ("rig", "bones", "names", "file", "found", "exported mm", "own file mm", "folder")
    table = Table("a second of motion", columns, tuple(rows), digits=5)
    return Report((table,), tuple(notes))


def _characters(data: Path, folder: Path) -> Iterator[tuple[str, Path]]:
    """Names and files of characters."""
    makehuman = data_folder(data, "makehuman")
    for name, (skeleton, weights) in rigs(makehuman).items():
        if weights is not None:
            template = build(makehuman, skeleton, weights)
            yield f"MakeHuman {name}", _written(template, folder / f"{name[:4]}.glb")
            if name == "default":
                nameless = [f"bone_{n}" for n in range(len(template.bone_names))]
                turned = transformed(template, np.diag([-100.0, 100.0, -100.0]), np.zeros(3))
                turned = _renamed(turned, nameless)
                yield "the same, no names, centimetres", _written(turned, folder / "turned.glb")
    for name in ("dev_tight", "dev_skirt"):
        yield name, data_folder(data, "rendered", name) / "template.glb"
    for number, (name, rig) in enumerate(RIGS.items()):
        path = folder / f"foreign_{number}.glb"
        rig.write(path)
        yield name, path


def _renamed(template: Template, names: list[str]) -> Template:

    return replace(template, bone_names=tuple(names))


def _written(template: Template, path: Path) -> Path:
    still = np.tile(np.eye(4), (1, len(template.bone_names), 1, 1))
    save_animation(path, template, still, RATE)
    return path


def _row(name: str, path: Path, capture: Path, folder: Path) -> tuple[Any, ...]:
    started = time.perf_counter()
    found = import_actor(path)
    seconds = time.perf_counter() - started
    sources = list(found.bones.sources.values())
    motion = sway(found.actor, FRAMES, RATE)
    transforms = found.actor.bone_transforms(motion)
    save_animation(capture, found.actor.template, transforms.numpy(), RATE)
    surface = found.actor.surface(motion)
    return (
        name,
        len(found.actor.template.bone_names),
        found.bones.convention or "by places",
        f"{found.correction.up} up, unit {found.correction.scale:g} m, {seconds:.2f} s",
        f"{sources.count('name')} by name, {sources.count('place')} by place",
        1e3 * float((_exported(capture) - surface).norm(dim=-1).max()),
        1e3 * _own_file(found, path, capture, transforms),
        "bit-equal" if _kept(found, folder) else "differs",
    )


def _exported(capture: Path) -> torch.Tensor:
    """Posed vertices (F, V, 3) of the exported file."""
    document = open_document(capture)
    template = read_template(document)
    matrices = torch.tensor(read_bone_transforms(document, template, FRAMES))
    skin = SkinWeights(torch.tensor(template.weights), torch.tensor(template.weight_bones))
    vertices = torch.tensor(template.vertices)
    return dual_quaternion_blend(vertices, skin, matrices[..., :3, :3], matrices[..., :3, 3])


def _own_file(found: ImportedActor, path: Path, capture: Path, transforms: torch.Tensor) -> float:
    """Largest distance of the character's own file, playing the animation, from what was meant."""
    template, matrix = found.actor.template, found.correction.matrix
    skin = SkinWeights(torch.tensor(template.weights), torch.tensor(template.weight_bones))
    vertices = torch.tensor(template.vertices)
    meant = linear_blend(vertices, skin, transforms[..., :3, :3], transforms[..., :3, 3]).numpy()
    worst = 0.0
    for frame in (0, 9, 19, FRAMES - 1):
        theirs: NDArray[np.float64] = played_on(path, capture, frame, RATE)
        ours = theirs @ matrix[:3, :3].T + matrix[:3, 3]
        worst = max(worst, float(np.linalg.norm(ours - meant[frame], axis=-1).max()))
    return worst


def _kept(found: ImportedActor, folder: Path) -> bool:
    """Whether an actor folder gives back every bit."""
    save_actor(found.actor, folder)
    one, two = found.actor.template, load_actor(folder).template
    same = all(np.array_equal(getattr(one, name), getattr(two, name)) for name in _EXACT
               if getattr(one, name) is not None)  # fmt: skip
    return same and one.texture == two.texture


def _validated(folder: Path, files: list[Path]) -> str:
    command = ["node", str(ROOT / "tools/validate_glb.mjs"), *map(str, files)]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    clean = sum("errors 0 warnings 0" in line for line in result.stdout.splitlines())
    return f"Khronos validator: {clean} of {len(files)} exported files without error or warning."


if __name__ == "__main__":
    main(run, Experiment, "actor_import")
