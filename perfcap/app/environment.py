"""What a capture ran on: versions, machine, memory."""

from __future__ import annotations

import platform
import resource
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from perfcap import __version__
from perfcap.app.inputs import Inputs

_PACKAGES = ("torch", "kornia", "numpy", "numba", "opencv-python-headless", "av")


def environment(inputs: Inputs) -> dict[str, Any]:
    """Versions, machine, memory, files that were read and what reading them had to say."""
    return {
        "perfcap": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(terse=True),
        "packages": {name: _version(name) for name in _PACKAGES},
        "peak_memory_mib": _peak_memory_mib(),
        "views": list(inputs.rig.names),
        "input_files": dict(inputs.files),
        "input_warnings": list(inputs.warnings),
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _peak_memory_mib() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)
