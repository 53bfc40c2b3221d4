"""What is installed, and what of it gets in its own way."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import sys
from collections.abc import Callable, Iterable

import torch

from perfcap.io.doctor.finding import Finding, Severity

REQUIRED = (
    *("torch", "kornia", "pytorch-kinematics", "trimesh", "opencv-python-headless"),
    *("onnxruntime", "scikit-image", "scipy", "numpy", "numba", "av", "tyro", "rich", "pyyaml"),
)
# Distributions that unpack into one folder: the last one installed wins, and removing any of them
# breaks the rest.
RIVALS = {
    "cv2": (
        *("opencv-python", "opencv-contrib-python"),
        *("opencv-python-headless", "opencv-contrib-python-headless"),
    ),
    "onnxruntime": ("onnxruntime", "onnxruntime-gpu", "onnxruntime-directml"),
}


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def examine_installation(version: Callable[[str], str | None] = _version) -> list[Finding]:
    """Versions, rival packages, threads, accelerator.

    Args:
        version: version of an installed distribution by name, None where there is none.
    """
    return [
        Finding(Severity.INFO, "python", f"{platform.python_version()} on {sys.platform}"),
        *_packages(version),
        *_rivals(version),
        *_threads(),
        *_accelerator(version),
    ]


def _packages(version: Callable[[str], str | None]) -> Iterable[Finding]:
    for name in REQUIRED:
        found = version(name)
        if found is not None:
            yield Finding(Severity.INFO, name, found)
        elif not any(version(rival) for rival in _rivals_of(name)):
            yield Finding(Severity.ERROR, name, "is not installed", f"pip install {name}")


def _rivals_of(name: str) -> tuple[str, ...]:
    return next((names for names in RIVALS.values() if name in names), ())


def _rivals(version: Callable[[str], str | None]) -> Iterable[Finding]:
    for folder, names in RIVALS.items():
        installed = [name for name in names if version(name) is not None]
        if len(installed) > 1:
            what = f"{' and '.join(installed)} share the folder {folder} and overwrite each other"
            remedy = f"pip uninstall {' '.join(installed)}, then install one of them again"
            yield Finding(Severity.WARNING, folder, what, remedy)


def _threads() -> Iterable[Finding]:
    cores, threads = os.cpu_count() or 1, torch.get_num_threads()
    yield Finding(Severity.INFO, "threads", f"torch uses {threads} of {cores} cores")


def _accelerator(version: Callable[[str], str | None]) -> Iterable[Finding]:
    if not torch.cuda.is_available():
        yield Finding(Severity.INFO, "accelerator", "none that torch can use; running on the CPU")
        return
    names = {torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())}
    yield Finding(Severity.INFO, "accelerator", ", ".join(sorted(names)))
    if version("onnxruntime-gpu") is None:
        what = "runs detectors on the CPU although there is a GPU"
        remedy = "pip uninstall onnxruntime, then pip install onnxruntime-gpu"
        yield Finding(Severity.INFO, "onnxruntime", what, remedy)
