"""What can be exported, and how each format likes its axes and units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.export.characters import write_bvh, write_glb
from perfcap.io.export.markers import write_c3d, write_trc
from perfcap.io.export.meshes import write_obj, write_ply
from perfcap.io.export.opensim import write_osim
from perfcap.io.export.options import Options
from perfcap.io.export.recording import Recording
from perfcap.io.export.tables import write_csv, write_npz, write_qpos
from perfcap.io.export.usd import write_usd, write_usdz


@dataclass(frozen=True)
class Format:
    """A format.

    Attributes:
        write: puts the files of a recording into a folder.
        unit: of length, where none is asked for.
        up: the axis that points up, where none is asked for.
        fixed: whether axis and unit are the format's own and nobody's choice.
        package: that has to be installed for it, as modules are called.
        extra: of perfcap that brings the package.
    """

    write: Callable[[Path, Recording, Options], None]
    unit: str = "m"
    up: str = "y"
    fixed: bool = False
    package: str | None = None
    extra: str | None = None

    def require(self, name: str) -> None:
        """Refuse where a package is missing.

        Raises:
            InputError: it is.
        """
        if self.package is not None and find_spec(self.package) is None:
            raise InputError(
                f"--to {name}: needs the package {self.package}, which is not installed; "
                f'pip install "perfcap[{self.extra}]"'
            )


FORMATS: Mapping[str, Format] = {
    "glb": Format(write_glb, fixed=True),
    "bvh": Format(write_bvh, unit="cm"),
    "usd": Format(write_usd, package="pxr", extra="usd"),
    "usdz": Format(write_usdz, package="pxr", extra="usd"),
    "obj": Format(write_obj),
    "ply": Format(write_ply),
    "trc": Format(write_trc, unit="mm"),
    "c3d": Format(write_c3d, unit="mm", up="z", package="ezc3d", extra="mocap"),
    "npz": Format(write_npz),
    "csv": Format(write_csv),
    "osim": Format(write_osim, fixed=True),
    "qpos": Format(write_qpos, up="z", fixed=True),
}
