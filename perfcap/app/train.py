"""``perfcap train``: recorded motion to networks."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path

import torch
from rich.table import Table
from torch import distributed

from perfcap.app.console import PlainConsole, progress_bars
from perfcap.commands.train import TrainLifter
from perfcap.errors import InputError
from perfcap.io.doctor.finding import counted
from perfcap.io.result_folder import locked
from perfcap.train.card import last_part, origin_of, weights_said, write_lifter_card
from perfcap.train.checkpoint import (
    described_start,
    require_taps,
    require_unseen,
    start_from,
)
from perfcap.train.config import LifterConfig
from perfcap.train.export import export_lifter
from perfcap.train.lifter import Lifter, LifterCommittee
from perfcap.train.lifter_task import LiftingTask, score_guess, score_lifter
from perfcap.train.loop import LAST, train
from perfcap.train.motion_library import MotionLibrary
from perfcap.train.outcome import outcome_doubts
from perfcap.train.seen_tracks import SeenTracks

_LOG = logging.getLogger(__name__)

MODEL = "model"

Watch = Callable[[int, Mapping[str, float]], None]


def run_train_lifter(request: TrainLifter) -> int:
    """Train, export, score and describe a lifter; returns the exit code.

    Raises:
        InputError: bad input, in one line.
    """
    config, out = request.config, request.out
    config.require_sound()
    library = read_library(request.motion, (*config.held_out, *config.validation))
    for path in (*request.together_with, *((request.start,) if request.start else ())):
        require_unseen(path, (*config.held_out, *config.validation), library.digest)
        require_taps(path, config.lifter.dilations)
    others = [_lifter(path, config.lifter) for path in request.together_with]
    make_folder(out, request.resume)
    learned = library.without((*config.held_out, *config.validation))
    tracks = None if request.tracks is None else _tracks(request.tracks)
    task = LiftingTask(
        learned,
        library.of(config.validation),
        config.lifter,
        config.data,
        config.loss,
        config.loop.seed,
        config.dense,
        tracks,
        torch.device("cuda" if torch.cuda.is_available() else "cpu"),
    )
    if request.start is not None:
        start_from(task.model, request.start)
    torch.set_num_threads(1)  # tensors are small
    with sole_training(out), processes() as first, progress_bars() as tell:
        trained = train(
            task,
            config.loop,
            out,
            asdict(config) | _described(library, tracks) | described_start(request.start),
            resume=request.resume,
            progress=tell if first else None,
            watch=tensorboard(out) if first else None,
        )
        if first:
            trained = trained.cpu()
            model = LifterCommittee([trained, *others]) if others else trained
            _finish(model, request, library, learned.subjects, lifter_sources(request, tracks))
    return 0


def lifter_sources(request: TrainLifter, tracks: SeenTracks | None) -> tuple[str, ...]:
    """All that a lifter is made of, for its card: a phrase each."""
    found = [f"recorded motion of {last_part(request.motion)}"]
    if request.tracks is not None and tracks is not None and request.config.data.seen:
        found.append(f"{counted(len(tracks.plane), 'track')} of {last_part(request.tracks)}")
    if request.start is not None:
        found.append(f"to start from, {weights_said(request.start)}")
    found += [f"averaged with it, {weights_said(path)}" for path in request.together_with]
    return tuple(found)


def _tracks(path: Path) -> SeenTracks:
    """Tracks of videos that are of their truth."""
    tracks = SeenTracks.read(path)
    tracks.require_followed(path)
    tracks.require_people(path)
    return tracks


def _described(library: MotionLibrary, tracks: SeenTracks | None) -> dict[str, str]:
    """What is learned from, by its digests."""
    seen = {} if tracks is None else {"tracks": tracks.digest}
    return {"motion": library.digest} | seen


def read_library(folder: Path, kept: Sequence[str]) -> MotionLibrary:
    """Recorded motion; a warning says who may be the same as people kept from training.

    Raises:
        InputError: it is not what it says.
    """
    library = MotionLibrary.read(folder)
    known = [name for name in kept if name in library.subjects]
    for doubt in library.doubts(known) if known else ():
        _LOG.warning("--motion %s: %s", folder, doubt)
    return library


def _lifter(path: Path, config: LifterConfig) -> Lifter:
    """A lifter of a checkpoint."""
    lifter = Lifter(config)
    start_from(lifter, path)
    return lifter


def _finish(
    model: Lifter | LifterCommittee,
    request: TrainLifter,
    library: MotionLibrary,
    learned: tuple[str, ...],
    sources: tuple[str, ...],
) -> None:
    """Export, score on people held out, write the card."""
    config, folder = request.config, request.out / MODEL
    low, high = config.data.rate
    run = f"perfcap train lifter, {config.loop.steps} steps, seed {config.loop.seed}"
    origin, licence = origin_of(run, sources), request.licence
    export_lifter(model, folder, 0.5 * (low + high), origin, licence)
    scores = {
        person: score_lifter(model, library.of([person]), config.data)
        for person in (*config.held_out, *config.validation)
    }
    members = 1 + len(request.together_with)
    write_lifter_card(folder, config, learned, sources, licence, scores, members)
    for doubt in _outcome(model, request, library.of(config.validation)):
        _LOG.warning("%s", doubt)
    console = PlainConsole()
    table = Table("person", *next(iter(scores.values())))
    for person, values in scores.items():
        table.add_row(person, *(f"{value:.1f}" for value in values.values()))
    console.print(table)
    console.print(f"written to {folder}", soft_wrap=True)


def _outcome(
    model: Lifter | LifterCommittee, request: TrainLifter, people: MotionLibrary
) -> Iterator[str]:
    """What scores on the people of the validation say against using a lifter."""
    data, start = request.config.data, None
    if request.start is not None:
        start = score_lifter(_lifter(request.start, request.config.lifter), people, data)
    yield from outcome_doubts(score_lifter(model, people, data), score_guess(people, data), start)


def make_folder(out: Path, resume: bool) -> None:
    """The folder of a training; refused where another one was not resumed."""
    if (out / LAST).is_file() and not resume:
        raise InputError(
            f"--out {out}: holds an unfinished or finished training; expected an empty folder, or "
            "--resume to go on"
        )
    if (out / MODEL).exists() and not resume:
        raise InputError(
            f"--out {out}: holds a trained network, {MODEL}; expected an empty folder, so that it "
            "is not replaced; or --resume to train it again"
        )
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be made ({error.strerror}); choose another"
        ) from None


@contextmanager
def sole_training(out: Path) -> Iterator[None]:
    """Be the only training that writes into a folder, in the first of torchrun's processes.

    Raises:
        InputError: another one, or a capture, writes there.
    """
    first = os.environ.get("RANK", "0") == "0"  # the others write nothing
    with locked(out) if first else nullcontext():
        yield


@contextmanager
def processes() -> Iterator[bool]:
    """Join the processes that torchrun started; whether this is the first, or the only one."""
    if "RANK" not in os.environ:
        yield True
        return
    distributed.init_process_group("gloo")
    try:
        yield distributed.get_rank() == 0
    finally:
        distributed.destroy_process_group()


def tensorboard(out: Path) -> Watch | None:
    """Writes numbers for TensorBoard where it is installed."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    writer = SummaryWriter(str(out))

    def watch(step: int, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            writer.add_scalar(name, value, step)
        writer.flush()

    return watch
