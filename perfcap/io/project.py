"""Project folders of other programs: which of their files are videos, cameras and joints.

Layouts, from the programs' documentation and the names in their sources:

- Pose2Sim: ``videos/``; a folder with ``calib`` in its name that holds ``*.toml``, in the project
  or, of a trial, in the folders of its session, up to two above, which have a ``Config.toml``
  each; joints as OpenPose JSON, a folder of ``*json*`` for each camera, in ``pose/``, after
  synchronization also in ``pose-sync/``, and after association in ``pose-associated/``. The last
  one that is there is what Pose2Sim triangulates.
- FreeMoCap 1: ``synchronized_videos/``; ``*calibration*.toml`` beside it; MediaPipe's points of
  all views in ``output_data/raw_data/mediapipe*2dData_numCams*.npy``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.files import VIDEO_SUFFIXES, natural_key

POSE2SIM, FREEMOCAP = "Pose2Sim", "FreeMoCap"

_VIDEOS, _SYNCHRONIZED = "videos", "synchronized_videos"
_POSE, _SYNC, _ASSOCIATED = "pose", "pose-sync", "pose-associated"
_CONFIG = "Config.toml"
_LEVELS = 2  # folders above a trial that may hold its calibration


@dataclass(frozen=True)
class Project:
    """Files of a project.

    Attributes:
        program: that laid the folder out.
        folder: the project's.
        videos: one a view, in natural order of their names.
        cameras: the calibration.
        detections: as ``read_detections`` takes them; none where the project has none.
        warnings: what a user should know about the choice.
    """

    program: str
    folder: Path
    videos: tuple[Path, ...]
    cameras: Path
    detections: tuple[Path, ...] = ()
    warnings: tuple[str, ...] = ()

    def sentence(self) -> str:
        """What was found."""
        joints = "no joints, which are found in the videos"
        if self.detections:
            inside = self.detections[0]
            inside = inside.parent if len(self.detections) > 1 else inside
            joints = f"joints in {_within(inside, self.folder)}"
        return (
            f"{self.folder}: a project of {self.program} with {len(self.videos)} videos in "
            f"{_within(self.videos[0].parent, self.folder)}, cameras in "
            f"{_within(self.cameras, self.folder)}, and {joints}"
        )


def open_project(
    folder: str | Path, *, cameras: Path | None = None, joints: bool = True
) -> Project | None:
    """The files of a project folder; None for folders that are none, such as those of images.

    Args:
        folder: that may be a project's.
        cameras: the calibration, where it is known; else it is looked for.
        joints: whether joints are looked for.

    Raises:
        InputError: a project that lacks videos or a calibration, or holds several calibrations.
    """
    folder = Path(folder)
    if not folder.is_dir():
        return None
    if (folder / _SYNCHRONIZED).is_dir():
        return _freemocap(folder, cameras, joints)
    if (folder / _VIDEOS).is_dir() and _marks_of_pose2sim(folder):
        return _pose2sim(folder, cameras, joints)
    return None


def _marks_of_pose2sim(folder: Path) -> bool:
    names = {entry.name for entry in folder.iterdir()}
    return bool(names & {_CONFIG, _POSE, _SYNC, _ASSOCIATED}) or bool(_calibrations_in(folder))


def _pose2sim(folder: Path, cameras: Path | None, joints: bool) -> Project:
    videos = _videos(folder / _VIDEOS, POSE2SIM)
    if cameras is None:
        places = [folder, *_session(folder)]
        found = next((each for each in map(_calibrations_in, places) if each), [])
        cameras = _single(
            found,
            f"{folder}: is a project of Pose2Sim without calibration/*.toml, here or in its "
            "session; run Pose2Sim.calibration(), or give --cameras",
        )
    detections, notes = _pose2sim_joints(folder, len(videos)) if joints else ((), ())
    return Project(POSE2SIM, folder, videos, cameras, detections, notes)


def _session(trial: Path) -> list[Path]:
    """The folders above a trial that belong to its session."""
    found = []
    for folder in trial.resolve().parents[:_LEVELS]:
        if not (folder / _CONFIG).is_file():
            break
        found.append(folder)
    return found


def _pose2sim_joints(folder: Path, views: int) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Folders of JSON that count frames as the videos do, if there are such."""
    found = {name: _json_folders(folder / name) for name in (_ASSOCIATED, _SYNC, _POSE)}
    shifted = bool(found[_SYNC])
    order = (_POSE, _ASSOCIATED, _SYNC) if shifted else (_ASSOCIATED, _POSE)
    name = next((name for name in order if found[name]), None)
    if name is None:
        return (), ()
    chosen = found[name]
    if len(chosen) != views:
        raise InputError(
            f"{folder / name}: holds joints of {len(chosen)} views "
            f"({', '.join(path.name for path in chosen)}), {folder / _VIDEOS} {views} videos; "
            "expected one of each a camera"
        )
    if not shifted:
        return chosen, ()
    note = (
        f"{folder / _SYNC}: counts other frames than the videos, so that {name} is read; --sync "
        "auto finds how late each camera is"
    )
    if name != _POSE:
        note = (
            f"{folder / name}: was synchronized, so that its frames may be shifted against those "
            "of the videos; give videos that were cut alike, or keep pose/"
        )
    return chosen, (note,)


def _freemocap(folder: Path, cameras: Path | None, joints: bool) -> Project:
    videos = _videos(folder / _SYNCHRONIZED, FREEMOCAP)
    if cameras is None:
        found = [path for path in _listed(folder) if _is_toml(path) and "calibration" in path.name]
        cameras = _single(
            found,
            f"{folder}: is a recording of FreeMoCap without *_camera_calibration.toml; copy that "
            "of its calibration recording there, or give --cameras",
        )
    arrays: list[Path] = []
    if joints:
        raw = folder / "output_data" / "raw_data"
        arrays = [
            path
            for path in _listed(raw)
            if path.name.startswith("mediapipe") and "2dData_numCams" in path.name
        ]
    return Project(FREEMOCAP, folder, videos, cameras, tuple(arrays[:1]))


def _videos(folder: Path, program: str) -> tuple[Path, ...]:
    found = [path for path in _listed(folder) if path.suffix.lower() in VIDEO_SUFFIXES]
    if not found:
        raise InputError(
            f"{folder}: holds no videos; expected those of a project of {program}, one a camera"
        )
    return tuple(found)


def _calibrations_in(folder: Path) -> list[Path]:
    places = [each for each in _listed(folder) if each.is_dir() and "calib" in each.name.lower()]
    return [path for place in places for path in _listed(place) if _is_toml(path)]


def _single(found: list[Path], missing: str) -> Path:
    if not found:
        raise InputError(missing)
    if len(found) > 1:
        listing = ", ".join(str(path) for path in found)
        raise InputError(
            f"{found[0].parent}: holds {len(found)} calibrations ({listing}); expected one, or "
            "--cameras with the one to use"
        )
    return found[0]


def _json_folders(folder: Path) -> tuple[Path, ...]:
    """Folders of a camera's joints, as Pose2Sim tells them: by ``json`` in the name."""
    return tuple(path for path in _listed(folder) if path.is_dir() and "json" in path.name.lower())


def _listed(folder: Path) -> list[Path]:
    """What a folder holds, hidden files aside; nothing where there is none."""
    if not folder.is_dir():
        return []
    found: Iterable[Path] = (path for path in folder.iterdir() if not path.name.startswith("."))
    return sorted(found, key=lambda path: natural_key(path.name))


def _is_toml(path: Path) -> bool:
    return path.suffix.lower() == ".toml" and path.is_file()


def _within(path: Path, folder: Path) -> str:
    """A path as seen from the project."""
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)
