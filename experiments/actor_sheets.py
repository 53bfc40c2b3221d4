"""Six actors made by the commands, and their contact sheets as the page of actors shows them.

Two bodies (of measures, of a real man in four views), two imported rigs (MakeHuman's, and a clothed
character under Mixamo's names in centimetres), two scans without bones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import report
from actor_import import RATE
from foreign_rigs import transformed
from makehuman_rigs import build, rigs
from report import Report, Table, data_folder

from perfcap.actor.template import Template
from perfcap.cli import main
from perfcap.errors import InputError
from perfcap.io.actor_place import SHEET
from perfcap.io.gltf_read import load_template
from perfcap.io.gltf_write import save_animation

_WIDTH, _QUALITY = 900, 82  # px of a sheet on the page
_MIXAMO = {
    "pelvis": "Hips", "spine": "Spine2", "neck": "Neck", "head": "Head", "head_top": "HeadTop_End",
    **{
        f"{side[0].lower()}_{ours}": f"{side}{theirs}"
        for side in ("Left", "Right")
        for ours, theirs in (
            ("shoulder", "Arm"), ("elbow", "ForeArm"), ("wrist", "Hand"), ("hip", "UpLeg"),
            ("knee", "Leg"), ("ankle", "Foot"), ("toe", "ToeBase"),
        )
    },
}  # fmt: skip
_SCANNED = 100.0 * np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # centimetres, z up


@dataclass(frozen=True)
class Experiment:
    """Where things are."""

    data: Path = report.DATA
    """Folder of the recordings."""
    out: Path = report.RESULTS / "actors"
    """Folder of the actors."""
    pages: Path | None = None
    """Folder for the small sheets, such as ``docs/images``."""
    only: tuple[str, ...] = ()
    """Names of the actors to make; all if not given."""


def run(config: Experiment) -> Report:
    """Make them."""
    config.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for name, arguments in _commands(config).items():
        if config.only and name not in config.only:
            continue
        folder = config.out / name
        _command(["actor", *arguments(), "--name", name, "--out", str(folder)])
        if config.pages is not None:
            _shrink(folder / SHEET, config.pages / f"actor_{name}.jpg")
        rows.append((name, str(folder)))
    return Report((Table("actors", ("name", "folder"), tuple(rows)),))


def _commands(config: Experiment) -> dict[str, Callable[[], list[str]]]:
    """What follows ``perfcap actor`` for each actor; makes the files it needs."""
    skirt, tight = (data_folder(config.data, "rendered", f"dev_{n}") for n in ("skirt", "tight"))
    measures = ["--body", "--height", "1.70", "--weight", "68", "--gender", "female"]
    return {
        "body": lambda: ["build", *measures],
        "man": lambda: ["fit", *_views(data_folder(config.data, "pose2sim_balancing"))],
        "makehuman": lambda: ["build", _makehuman(config)],
        "mixamo": lambda: ["build", _mixamo(skirt / "template.glb", config.out / "mixamo.glb")],
        "scan": lambda: ["build", _scan(skirt / "template.glb", config.out / "scan")],
        "scan2": lambda: ["build", _scan(tight / "template.glb", config.out / "scan2")],
    }


def _command(arguments: list[str]) -> None:
    try:
        main(arguments)
    except SystemExit as done:
        if done.code:
            raise InputError(f"perfcap {' '.join(arguments)}: ended with {done.code}") from None


def _views(folder: Path) -> Iterator[str]:
    """A real man, seen from four sides."""
    views = [f"cam{n:02d}" for n in range(1, 5)]
    yield from (str(folder / "videos" / f"{view}.mp4") for view in views)
    yield from ("--cameras", str(folder / "calibration" / "Calib_scene.toml"))
    yield "--detections"
    yield from (str(folder / "pose2d_associated" / f"{view}_json") for view in views)
    yield from ("--video-map", str(folder / "video_to_native.json"))


def _makehuman(config: Experiment) -> str:
    folder = data_folder(config.data, "makehuman")
    skeleton, weights = rigs(folder)["default"]
    assert weights is not None
    return _written(build(folder, skeleton, weights), config.out / "makehuman.glb")


def _mixamo(source: Path, path: Path) -> str:
    """The same character under other names, in centimetres."""
    template = transformed(load_template(source), 100.0 * np.eye(3), np.zeros(3))
    names = tuple(f"mixamorig:{_MIXAMO[name]}" for name in template.bone_names)
    return _written(replace(template, bone_names=names, landmarks={}), path)


def _written(template: Template, path: Path) -> str:
    still = np.tile(np.eye(4), (1, len(template.bone_names), 1, 1))
    save_animation(path, template, still, RATE)
    return str(path)


def _scan(source: Path, folder: Path) -> str:
    """The character's surface alone, as a scanner saves it: an OBJ, centimetres, z up."""
    template = load_template(source)
    folder.mkdir(exist_ok=True)
    assert template.uv is not None and template.texture is not None
    kind = (template.texture_mime or "image/png").removeprefix("image/")
    (folder / f"skin.{kind}").write_bytes(template.texture)
    (folder / "scan.mtl").write_text(f"newmtl skin\nmap_Kd skin.{kind}\n")
    corners = template.faces + 1
    lines = ["mtllib scan.mtl", "usemtl skin"]
    lines += [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in template.vertices @ _SCANNED.T]
    lines += [f"vt {u:.6f} {1 - v:.6f}" for u, v in template.uv]
    lines += ["f " + " ".join(f"{i}/{i}" for i in face) for face in corners]
    (folder / "scan.obj").write_text("\n".join([*lines, ""]))
    return str(folder / "scan.obj")


def _shrink(sheet: Path, path: Path) -> None:
    picture = cv2.imread(str(sheet))
    assert picture is not None
    size = (_WIDTH, round(_WIDTH * picture.shape[0] / picture.shape[1]))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])


if __name__ == "__main__":
    report.main(run, Experiment, "actor_sheets")
