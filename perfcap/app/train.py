"""``perfcap train``: recorded motion to networks."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import torch
from rich.console import Console
from rich.table import Table
from torch import distributed

from perfcap.app.console import progress_bars
from perfcap.errors import InputError
from perfcap.train.card import write_lifter_card
from perfcap.train.checkpoint import start_from
from perfcap.train.config import TrainLifterConfig
from perfcap.train.export import export_lifter
from perfcap.train.lifter import Lifter
from perfcap.train.lifter_task import LiftingTask, score_lifter
from perfcap.train.loop import LAST, train
from perfcap.train.motion_library import MotionLibrary

MODEL = "model"

Watch = Callable[[int, Mapping[str, float]], None]


def run_train_lifter(
    motion: Path,
    out: Path,
    config: TrainLifterConfig,
    licence: str,
    resume: bool,
    start: Path | None = None,
) -> int:
    """Train, export, score and describe a lifter; returns the exit code.

    Args:
        motion: folder of the motion library.
        out: folder for checkpoints, ``metrics.jsonl`` and ``model/``.
        config: everything else.
        licence: of the weights.
        resume: go on from the last checkpoint.
        start: checkpoint whose weights to start from, for fine-tuning.

    Raises:
        InputError: bad input, in one line.
    """
    library = MotionLibrary.read(motion)
    make_folder(out, resume)
    others = (*config.held_out, *config.validation)
    learned = library.without(others)
    task = LiftingTask(
        learned,
        library.of(config.validation),
        config.lifter,
        config.data,
        config.loss,
        config.loop.seed,
        config.dense,
    )
    if start is not None:
        start_from(task.model, start)
    torch.set_num_threads(1)  # tensors are small
    with processes() as first, progress_bars() as tell:
        trained = train(
            task,
            config.loop,
            out,
            asdict(config),
            resume=resume,
            progress=tell if first else None,
            watch=tensorboard(out) if first else None,
        )
        if first:
            _finish(trained, out / MODEL, library, learned, config, licence)
    return 0


def _finish(
    trained: Lifter,
    folder: Path,
    library: MotionLibrary,
    learned: MotionLibrary,
    config: TrainLifterConfig,
    licence: str,
) -> None:
    """Export, score on people held out, write the card."""
    low, high = config.data.rate
    origin = f"perfcap train lifter, {config.loop.steps} steps, seed {config.loop.seed}"
    export_lifter(trained, folder, 0.5 * (low + high), origin, licence)
    scores = {
        person: score_lifter(trained, library.of([person]), config.data)
        for person in (*config.held_out, *config.validation)
    }
    write_lifter_card(folder, config, learned.subjects, scores)
    console = Console(highlight=False)
    table = Table("person", *next(iter(scores.values())))
    for person, values in scores.items():
        table.add_row(person, *(f"{value:.1f}" for value in values.values()))
    console.print(table)
    console.print(f"written to {folder}", soft_wrap=True)


def make_folder(out: Path, resume: bool) -> None:
    """The folder of a training; refused where another one was not resumed."""
    if (out / LAST).is_file() and not resume:
        raise InputError(
            f"--out {out}: holds an unfinished or finished training; expected an empty folder, or "
            "--resume to go on"
        )
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be made ({error.strerror}); choose another"
        ) from None


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
