"""``manifest.toml``: everything about a joint network that its ONNX file does not say."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from perfcap.detect.joint_set import (
    JOINT_SETS,
    KNOWN_JOINTS,
    JointSet,
    canonical_name,
    doubled_names,
)
from perfcap.detect.toml_table import TomlTable

FILE = "manifest.toml"

_MAPS = ("heatmaps", "location_maps")
PEOPLE = "people"
KINDS = (*_MAPS, "simcc", "coordinates", "joints3d", PEOPLE)
TURNS = ("none", "quarters", "upright")
COLUMNS = ("x", "y", "z", "confidence", "ignored")
# how many outputs a kind has, for messages and for the check against the model
_OUTPUTS = {
    "heatmaps": ("the heat maps",),
    "simcc": ("the bins of x", "the bins of y"),
    "coordinates": ("the coordinates",),
    "location_maps": ("the heat maps", "the maps of X", "of Y", "of Z"),
    "joints3d": (),
    PEOPLE: ("the people",),
}
_MOST_ERROR = 1.0  # m: who says no more of a pose has none
_SIZE_LIMIT = 4096  # pixels of a network's input


@dataclass(frozen=True)
class ModelFile:
    """The network's file beside the manifest, and what it must be."""

    path: Path
    sha256: str
    licence: str
    origin: str


@dataclass(frozen=True)
class InputSpec:
    """What a network wants to see.

    A channel is given as ``(pixel * scale - mean) / std`` with pixels 0 to 255.

    Attributes:
        name: of the input; empty for the model's only one.
        size: (height, width) of the crop, pixels.
        color: order of the channels, ``rgb`` or ``bgr``; mean and std are in this order.
        layout: ``nchw`` or ``nhwc``.
        dtype: ``float32``, ``float16``, ``uint8`` or ``int32``.
        scale: factor of pixels.
        mean: of each channel, after ``scale``.
        std: of each channel, after ``scale``.
        padding: size of the crop, in sizes of the person.
        flip_test: whether mirror images are looked at too, unless a user says otherwise.
        turns: of crops: ``none``; ``quarters``, for somebody upside down or lying; ``upright``,
            for networks that learned crops turned so that shoulders are above hips.
    """

    name: str
    size: tuple[int, int]
    color: str
    layout: str
    dtype: str
    scale: float
    mean: tuple[float, ...]
    std: tuple[float, ...]
    padding: float
    flip_test: bool
    turns: str = "none"


@dataclass(frozen=True)
class OutputSpec:
    """How to read joints from what a network says.

    Attributes:
        kind: ``heatmaps`` (N,J,h,w); ``simcc``, two outputs (N,J,bins); ``coordinates``
            (N,J,k) or flat; ``location_maps``, heat maps and three maps of metric coordinates
            read at their peaks; ``joints3d``, positions alone; ``people`` (N,P,J k + 5), several
            people of a whole image, see ``perfcap.detect.people``.
        names: outputs of the kind, in its order.
        joints3d: a further output of root-relative positions (N,J,3) or flat; empty for none.
        decode: of maps: ``argmax`` (a quarter pixel towards the higher neighbour), ``dark``
            (Newton step on the logarithm), ``soft_argmax``.
        alignment: of map pixels to input pixels: ``scale`` x W/w, ``corners`` x (W-1)/(w-1),
            ``centers`` (x + 1/2) W/w - 1/2.
        layout: of maps, ``nchw`` or ``nhwc``.
        split: bins a pixel of ``simcc``.
        units: of coordinates, ``pixels`` of the crop or ``unit``, shares of it.
        columns: meaning of the k numbers of a joint in ``coordinates`` and ``people``.
        sharpness: factor of maps before the softmax of ``soft_argmax``.
        activation: of confidences, ``none`` or ``sigmoid``.
        rows: joints in the output where these are more than named; the first ones are used.
        metres: of one unit of 3D output.
        signs3d: +1 or -1 for each 3D axis, to get x right, y down, z forward.
        crop_axes: whether 3D axes follow the ray through the middle of the crop.
        error3d: metres that 3D joints are expected to be off in the mean, as measured on footage of
            the kind; None where nobody has measured it.
    """

    kind: str
    names: tuple[str, ...]
    joints3d: str
    decode: str
    alignment: str
    layout: str
    split: float
    units: str
    columns: tuple[str, ...]
    sharpness: float
    activation: str
    rows: int
    metres: float
    signs3d: tuple[float, ...]
    crop_axes: bool
    error3d: float | None = None


@dataclass(frozen=True)
class Calibration:
    """Monotone map, linear between knots, of what a network calls confidence to probability."""

    raw: tuple[float, ...] = (0.0, 1.0)
    probability: tuple[float, ...] = (0.0, 1.0)


@dataclass(frozen=True)
class Manifest:
    """A joint network on disk."""

    path: Path
    file: ModelFile
    input: InputSpec
    output: OutputSpec
    joint_set: JointSet
    calibration: Calibration


def read_manifest(folder: Path) -> Manifest:
    """Read and check the manifest of a detector's folder, or the file itself.

    Raises:
        InputError: one line that names the field and what to write there.
    """
    table = open_manifest(folder, "detector")
    file = read_model_file(table)
    spec = read_input(table.table("input"))
    joint_set = _read_joints(table.table("joints"))
    output = _read_output(table.table("output"), len(joint_set))
    calibration = _read_calibration(table.table("calibration", optional=True))
    table.done()
    return Manifest(table.path, file, spec, output, joint_set, calibration)


def open_manifest(folder: Path, kind: str) -> TomlTable:
    """The manifest of a folder, of a kind of model.

    Raises:
        InputError: it is absent, no TOML, or of another kind.
    """
    table = TomlTable.read(folder / FILE if folder.is_dir() else folder)
    found = table.text("kind")
    if found != kind:
        table.fail("kind", f"is {found!r}", f"{kind!r}; give a folder of a {kind}")
    return table


def read_model_file(table: TomlTable) -> ModelFile:
    """The one ONNX file that a manifest lists; other files listed must only be well formed."""
    files = [_read_file(entry) for entry in table.tables("file")]
    models = [file for file in files if file.path.suffix.lower() == ".onnx"]
    if len(models) != 1:
        table.fail("file", f"lists {len(models)} .onnx files", "one, with name and sha256")
    return models[0]


def _read_file(entry: TomlTable) -> ModelFile:
    name, digest = entry.text("name"), entry.text("sha256").lower()
    if Path(name).name != name or name in {".", ".."}:
        entry.fail("name", f"is {name!r}", "the name of a file in the manifest's folder")
    if not re.fullmatch(r"[0-9a-f]{64}", digest):
        entry.fail("sha256", f"is {digest!r:.80}", "64 hexadecimal digits, as sha256sum prints")
    entry.integer("size", 1)
    file = ModelFile(
        entry.path.parent / name, digest, entry.text("licence"), entry.text("origin", "unknown")
    )
    entry.done()
    return file


def read_input(table: TomlTable) -> InputSpec:
    """What a network of images wants to see."""
    size = table.numbers("size", count=2)
    if not all(side == int(side) and 8 <= side <= _SIZE_LIMIT for side in size):
        table.fail("size", f"is {list(size)}", f"[height, width], each 8 to {_SIZE_LIMIT}")
    std = table.numbers("std", (1.0, 1.0, 1.0), count=3)
    if min(std) <= 0:
        table.fail("std", f"is {list(std)}", "three numbers above 0")
    spec = InputSpec(
        name=table.text("name") if "name" in table else "",
        size=(int(size[0]), int(size[1])),
        color=table.text("color", choices=("rgb", "bgr")),
        layout=table.text("layout", "nchw", ("nchw", "nhwc")),
        dtype=table.text("dtype", "float32", ("float32", "float16", "uint8", "int32")),
        scale=table.number("scale", 1.0),
        mean=table.numbers("mean", (0.0, 0.0, 0.0), count=3),
        std=std,
        padding=table.number("padding", 1.25, low=1.0),
        flip_test=table.flag("flip_test", False),
        turns=table.text("turns", "none", TURNS),
    )
    plain = spec.scale == 1 and set(spec.mean) == {0.0} and set(spec.std) == {1.0}
    if "int" in spec.dtype and not plain:
        table.fail(
            "dtype", f"is {spec.dtype} with a scale, mean or std", "bytes as they are, or float32"
        )
    table.done()
    return spec


def _read_joints(table: TomlTable) -> JointSet:
    if ("set" in table) == ("names" in table):
        table.fail("set", "and joints.names are both given or both missing", "one of them")
    if "set" in table:
        known = {joint_set.name: joint_set for joint_set in JOINT_SETS}
        joint_set = known[table.text("set", choices=tuple(known))]
    else:
        names = tuple(canonical_name(name) for name in table.texts("names"))
        if len(set(names)) != len(names):
            twice = doubled_names(table.texts("names"))
            table.fail("names", f"names a joint twice ({twice:.200})", "each joint once")
        # joints that perfcap has no use for may be called anything
        joint_set = JointSet(f"{table.path.parent.name}'s set", names)
    lacking = {"r_hip", "l_hip"} - set(joint_set.joints)
    if lacking:
        known_here = ", ".join(j for j in joint_set.joints if j in KNOWN_JOINTS) or "none"
        table.fail(
            "names" if "names" in table else "set",
            f"lacks {', '.join(sorted(lacking))} (known: {known_here:.120})",
            "a set with both hips, which every pose is relative to",
        )
    table.done()
    return joint_set


def _read_output(table: TomlTable, joints: int) -> OutputSpec:
    kind = table.text("kind", choices=KINDS)
    names = table.texts("names", ())
    wanted = _OUTPUTS[kind]
    if len(names) != len(wanted):
        listing = ", ".join(wanted) or "none (the output is joints3d)"
        table.fail("names", f"has {len(names)} names", f"{len(wanted)} for {kind}: {listing}")
    signs = table.numbers("signs3d", (1.0, 1.0, 1.0), count=3)
    if any(abs(sign) != 1 for sign in signs):
        table.fail("signs3d", f"is {list(signs)}", "three of 1 and -1: x right, y down, z forward")
    spec = OutputSpec(
        kind=kind,
        names=names,
        joints3d=_further_output(table, kind),
        decode=table.text("decode", "argmax", ("argmax", "dark", "soft_argmax")),
        alignment=table.text("alignment", "scale", ("scale", "corners", "centers")),
        layout=table.text("layout", "nchw", ("nchw", "nhwc")),
        split=table.number("split", 2.0, low=0.01),
        units=table.text("units", "pixels", ("pixels", "unit")),
        columns=_read_columns(table, kind),
        sharpness=table.number("sharpness", 1.0, low=1e-6),
        activation=table.text("activation", "none", ("none", "sigmoid")),
        rows=table.integer("rows", joints, low=joints),
        metres=table.number("metres", 1.0, low=1e-6),
        signs3d=signs,
        crop_axes=table.flag("crop_axes", False),
        error3d=_read_error(table) if "error3d" in table else None,
    )
    table.done()
    return spec


def _read_error(table: TomlTable) -> float:
    error = table.number("error3d", low=1e-3)
    if error > _MOST_ERROR:
        table.fail("error3d", f"is {error:g}", f"metres, {_MOST_ERROR:g} at most")
    return error


def _further_output(table: TomlTable, kind: str) -> str:
    if kind in ("location_maps", PEOPLE):
        return ""
    return table.text("joints3d") if "joints3d" in table or kind == "joints3d" else ""


def _read_columns(table: TomlTable, kind: str) -> tuple[str, ...]:
    columns = table.texts("columns", ("x", "y", "confidence"))
    if kind in ("coordinates", PEOPLE):
        named = [column for column in columns if column != "ignored"]
        bad = set(columns) - set(COLUMNS) or len(set(named)) != len(named)
        if bad or not {"x", "y"} <= set(columns):
            table.fail("columns", f"is {list(columns)}", f"x, y and others of {', '.join(COLUMNS)}")
    return columns


def _read_calibration(table: TomlTable) -> Calibration:
    if not table.values:
        return Calibration()
    raw, probability = table.numbers("raw"), table.numbers("probability")
    if len(raw) < 2 or any(b <= a for a, b in pairwise(raw)):
        table.fail("raw", f"is {list(raw)}", "two or more numbers that rise")
    falls = any(b < a for a, b in pairwise(probability))
    if len(probability) != len(raw) or falls or min(probability) < 0 or max(probability) > 1:
        table.fail(
            "probability", f"is {list(probability)}", f"{len(raw)} numbers, 0 to 1, none falling"
        )
    table.done()
    return Calibration(raw, probability)
