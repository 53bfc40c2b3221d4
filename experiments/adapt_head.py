"""A network adapted to a real man's footage without labels, and to rendered people's.

``perfcap train head`` sees the first half of the frames in all views, and no truth. Each view is
then captured alone on the second half, with the network as shipped and as adapted; all else is the
default of ``perfcap capture``. Truth is used to score alone; that of the real man is triangulated
from other detections, good to some centimetres.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from recordings import balancing, rendered_views
from report import Report, Table, data_folder
from torch import Tensor

from perfcap.app.capture import run_capture
from perfcap.app.train_head import default_network, run_train_head
from perfcap.commands.capture import Capture
from perfcap.commands.train import TrainHead
from perfcap.commands.views import DEFAULT_DETECTORS
from perfcap.metrics import joint_errors
from perfcap.train.config import TrainHeadConfig

_REAL = "pose2sim_balancing"


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = (_REAL,)
    """The real man, and sequences of rendered_multi with one person or more; of these the first."""
    network: str | None = None
    """To adapt; the default one if not given."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Of crops and windows."""
    solver: bool = True
    """Adapt through the solver as well, not only directly to the solution of all views."""
    left_out: bool = True
    """Adapt to all views but one as well, directly, and capture that one."""
    keep: Path | None = None
    """Folder to keep models and captures in."""


@dataclass(frozen=True)
class Footage:
    """Views of a person, and the truth (F, 16, 3) m, NaN where unknown."""

    name: str
    videos: tuple[Path, ...]
    cameras: Path
    video_map: Path | None
    truth: Tensor
    rate: float

    @property
    def half(self) -> int:
        """Frames to adapt to; as many are captured."""
        return len(self.truth) // 2


def run(config: Experiment) -> Report:
    """PA-MPJPE of each view alone, as shipped and as adapted."""
    torch.set_num_threads(1)
    tables = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = config.keep or Path(scratch)
        for name in config.sequences:
            footage = _footage(config.data, name)
            tables.append(_table(config, footage, folder / name))
    notes = (
        "PA-MPJPE mm of the second half of the frames, each view captured alone. As adapted to all "
        "views of the first half, to views without the one that is captured, and as shipped.",
    )
    return Report(tuple(tables), notes)


def _footage(data: Path, name: str) -> Footage:
    if name == _REAL:
        known, folder = balancing(data), data_folder(data, _REAL)
        videos = tuple(sorted((folder / "videos").glob("*.mp4")))  # in the calibration's order
        calibration = folder / "calibration" / "Calib_scene.toml"
        more = calibration, folder / "video_to_native.json"
        return Footage(name, videos, *more, known.truth, known.rate)
    known = rendered_views(data, name)
    videos = tuple(sorted((known.folder / "views").glob("*.mp4")))
    return Footage(name, videos, known.folder / "cameras.json", None, known.truth, known.rate)


def _table(config: Experiment, footage: Footage, folder: Path) -> Table:
    network = config.network or default_network()
    views = range(len(footage.videos))
    rows: list[tuple[object, ...]] = []
    shipped: list[float] = []  # and means of what follows

    def add(label: str, models: list[str]) -> None:
        name = label.replace(", ", "_").replace(" ", "_")
        scores = [_captured(footage, v, models[v], folder / f"{name}_{v}") for v in views]
        mean = float(np.mean(scores))
        lower = 100 * (1 - mean / shipped[0]) if shipped else 0.0
        shipped.append(mean)
        rows.append((label, *scores, mean, lower))

    add("as shipped", [network] * len(views))
    for seed in config.seeds:
        for through in (False, True) if config.solver else (False,):
            label = f"{'through the solver' if through else 'directly'}, seed {seed}"
            out = folder / f"model_{int(through)}_{seed}"
            model = _adapted(footage, network, views, seed, through, out)
            add(label, [model] * len(views))
    if config.left_out:
        seed = config.seeds[0] if config.seeds else 0
        models = []
        for view in views:
            others = [v for v in views if v != view]
            out = folder / f"model_without_{view}"
            models.append(_adapted(footage, network, others, seed, False, out))
        add(f"directly, without the view, seed {seed}", models)
    columns = ("adapted", *(f"view {v + 1}" for v in views), "mean", "lower, %")
    return Table(f"{footage.name}, {network}", columns, tuple(rows))


def _adapted(
    footage: Footage, network: str, views: Sequence[int], seed: int, through: bool, out: Path
) -> str:
    """Folder of a network that is adapted to the first half of some views."""
    settings = TrainHeadConfig()
    run_train_head(
        TrainHead(
            videos=tuple(footage.videos[view] for view in views),
            cameras=footage.cameras,
            video_map=footage.video_map,
            frames=f"0:{footage.half}",
            out=out,
            network=network,
            config=replace(settings, loop=replace(settings.loop, seed=seed)),
            through_solver=through,
        )
    )
    return str(out / "model")


def _captured(footage: Footage, view: int, network: str, out: Path) -> float:
    """PA-MPJPE of the second half of a view, millimetres."""
    chain = tuple(network if name == default_network() else name for name in DEFAULT_DETECTORS)
    first, last = footage.half, len(footage.truth)
    run_capture(
        Capture(
            videos=(footage.videos[view],),
            out=out,
            detector=chain,
            lifter="cmu",
            frames=f"{first}:{last}",
            until="track_motion",
            overlay=False,
            overwrite=True,
        )
    )
    with np.load(out / "motion.npz") as file:
        joints = torch.from_numpy(file["joints3d"]).double()
    truth = footage.truth[first : first + len(joints)].double()
    return float(joint_errors(joints[: len(truth)], truth, footage.rate).mpjpe_similarity)


if __name__ == "__main__":
    report.main(run, Experiment, "adapt_head")
