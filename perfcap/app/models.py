"""``perfcap models``: what is shipped or found, and manifests for networks of one's own."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from perfcap.app.console import PlainConsole
from perfcap.app.network_guess import guess_manifest
from perfcap.app.network_trial import try_network
from perfcap.app.networks import DETECTORS, find_model
from perfcap.app.pose_trial import try_poses
from perfcap.commands.models import TryNetwork, WriteManifest
from perfcap.detect.joint_set import JOINT_SETS
from perfcap.detect.manifest import FILE as MANIFEST
from perfcap.detect.manifest import PEOPLE, ModelFile, read_manifest
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.onnx_file import read_model
from perfcap.detect.people import OnnxFinder
from perfcap.detect.session import Session
from perfcap.errors import InputError
from perfcap.io.actor import models_folder
from perfcap.io.atomic import writing
from perfcap.io.files import TEXT_LIMIT, require_file

_KINDS = ("actors", "bodies", "detectors", "edges", "lifters", "priors")
_MOST = 1000  # folders that are looked at


def run_list(folder: Path | None) -> int:
    """Print models by kind; returns the exit code.

    Raises:
        InputError: the folder is not there.
    """
    console = PlainConsole()
    for kind in _KINDS:
        for path in sorted((models_folder() / kind).glob(f"*/{MANIFEST}")):
            console.print(_line(kind.removesuffix("s"), path, path.parent.name), soft_wrap=True)
    if folder is not None:
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; expected one with models in it")
        found = sorted({*folder.glob(MANIFEST), *folder.glob(f"*/{MANIFEST}")})[:_MOST]
        for path in found:
            console.print(_line("", path, str(path.parent)), soft_wrap=True)
        if not found:
            console.print(f"{folder}: holds no {MANIFEST}; perfcap models manifest FILE writes one")
    return 0


def _line(kind: str, path: Path, name: str) -> str:
    """One model: kind, name, size, joints, licence."""
    try:
        require_file(path, TEXT_LIMIT, "a manifest")
        values = tomllib.loads(path.read_text(encoding="utf-8"))
        files = [f for f in _list(values.get("file")) if isinstance(f, dict)]
        size = sum(f["size"] for f in files if isinstance(f.get("size"), int)) / 1e6
        said = kind or str(values.get("kind", ""))
        kind = "body" if said == "bodie" else said
        parts = [f"{kind:<9} {name:<12} {size:6.1f} MB"]
        joints = values.get("joints")
        if isinstance(joints, dict) and kind == "detector":
            parts.append(str(joints.get("set", f"{len(_list(joints.get('names')))} joints")))
        licences = dict.fromkeys(str(f["licence"]) for f in files if "licence" in f)
        return "  ".join((*parts, *licences, *_damage(path.parent, files)))
    except (InputError, ValueError, OSError) as error:
        return f"{kind:<9} {name:<12} cannot be read ({error})"


def _damage(folder: Path, files: list[dict[str, Any]]) -> Iterator[str]:
    """Files that the manifest names, and that are not there or were cut off."""
    for each in files:
        name = each.get("name")
        if not isinstance(name, str) or name != Path(name).name:
            continue
        if not (folder / name).is_file():
            yield f"{name} is missing"
        elif (found := (folder / name).stat().st_size) != each.get("size", found):
            yield f"{name} has {found} bytes, not {each['size']}; copy it again"


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def run_network(request: WriteManifest | TryNetwork) -> int:
    """Write a manifest, or try the network of one; returns the exit code.

    Raises:
        InputError: the network cannot be used, or there is a manifest already.
    """
    return run_manifest(request) if isinstance(request, WriteManifest) else run_try(request)


def run_manifest(request: WriteManifest) -> int:
    """Write a manifest beside an ONNX file; returns the exit code.

    Raises:
        InputError: the file cannot be opened, its outputs cannot be understood, or there is a
            manifest already.
    """
    target = request.file.parent / MANIFEST
    if target.exists() and not request.overwrite:
        raise InputError(f"{target}: is there already; add --overwrite to replace it")
    sets = {joint_set.name: joint_set for joint_set in JOINT_SETS}
    if request.joints is not None and request.joints not in sets:
        raise InputError(f"--joints {request.joints}: expected one of {', '.join(sets)}")
    data, _ = read_model(request.file)
    digest = hashlib.sha256(data).hexdigest()
    session = Session(ModelFile(request.file, digest, request.licence, request.origin))
    guess = guess_manifest(session, None if request.joints is None else sets[request.joints])
    text = "\n".join(
        (
            'kind = "detector"',
            "",
            "[[file]]",
            f"name = {_quoted(request.file.name)}",
            f"size = {len(data)}",
            f'sha256 = "{digest}"',
            f"licence = {_quoted(request.licence)}",
            f"origin = {_quoted(request.origin)}",
            "",
            guess.text,
        )
    )
    with writing(target) as file:
        file.write(text.encode())
    console = PlainConsole()
    console.print(f"{target}: {guess.family}", soft_wrap=True)
    for line in guess.check:
        console.print(f"to check: {line}", soft_wrap=True)
    try:
        for line in _tried(request.file.parent):
            console.print(line, soft_wrap=True)
    except InputError as error:  # the manifest is there, to be completed by hand
        console.print(f"to check: {error}", soft_wrap=True)
    networks = " ".join(filter(None, (str(request.file.parent), guess.closer)))
    console.print(f"try it: perfcap capture VIDEO --detector {networks}", soft_wrap=True)
    return 0


def run_try(request: TryNetwork) -> int:
    """Print how well a network sees the person of the shipped clip; returns the exit code.

    Raises:
        InputError: there is no such network, or it cannot be used.
    """
    console = PlainConsole()
    lines = [*_tried(find_model(request.model, DETECTORS))]
    for line in lines or ["has no joints to try"]:
        console.print(line, soft_wrap=True)
    return 0


def _tried(folder: Path) -> Iterator[str]:
    """What there is to say of a network after a trial."""
    finds = read_manifest(folder).output.kind == PEOPLE
    if finds:
        yield from try_network(OnnxFinder(folder))
        return
    network = OnnxDetector(folder)
    yield from try_network(network)
    yield from try_poses(network)


def _quoted(text: str) -> str:
    """A TOML string."""
    shown = "".join(c if c.isprintable() else " " for c in text)
    return '"' + shown.replace("\\", "\\\\").replace('"', '\\"') + '"'
