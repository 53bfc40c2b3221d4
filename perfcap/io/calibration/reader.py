"""Which camera file is which."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.calibration import colmap, easymocap
from perfcap.io.calibration.camera_json import read_camera_json
from perfcap.io.calibration.colmap import read_colmap
from perfcap.io.calibration.easymocap import read_easymocap
from perfcap.io.calibration.rig import CameraRig
from perfcap.io.calibration.toml_file import read_toml

EXPECTED = (
    "camera.json, cameras.json, Calib*.toml, a folder with intri.yml and extri.yml, or a folder "
    "with COLMAP's cameras.txt and images.txt"
)


_TOGETHER = ((easymocap.INTRINSICS, easymocap.EXTRINSICS), (colmap.CAMERAS, colmap.IMAGES))


def files_beside(path: Path) -> tuple[Path, ...]:
    """Files that ``read_cameras`` reads beside the one that it is given."""
    groups = (names for names in _TOGETHER if path.name in names)
    return tuple(path.with_name(name) for names in groups for name in names if name != path.name)


def read_cameras(
    path: str | Path, default_sizes: Sequence[tuple[int, int]] | None = None
) -> CameraRig:
    """Read the calibrated views of a file or folder.

    Args:
        path: ``camera.json`` or ``cameras.json`` (ours), ``Calib*.toml`` (Pose2Sim), EasyMocap's
            ``intri.yml`` / ``extri.yml``, or COLMAP's text model.
        default_sizes: (height, width) a view, or one that all share, for files that do not state
            image sizes: those of the videos.

    Raises:
        InputError: a file that is missing, of unknown kind, or cannot be a camera.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; expected {EXPECTED}")
    names = {entry.name for entry in path.iterdir()} if path.is_dir() else {path.name}
    if path.suffix.lower() == ".json" and path.is_file():
        return read_camera_json(path, default_sizes)
    if path.suffix.lower() == ".toml" and path.is_file():
        return read_toml(path, default_sizes)
    if names & {easymocap.INTRINSICS, easymocap.EXTRINSICS}:
        return read_easymocap(path, default_sizes)
    if names & {colmap.CAMERAS, colmap.IMAGES}:
        return read_colmap(path, default_sizes)
    raise InputError(f"{path}: is not a camera file I know; expected {EXPECTED}")
