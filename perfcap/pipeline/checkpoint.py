"""Finished work of a capture, kept block by block so that a kill costs little of it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.errors import InputError
from perfcap.io.journal import Journal, Record
from perfcap.workers import ordered_map

Task = TypeVar("Task")
Result = TypeVar("Result")

SUFFIX = ".log"

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Codec(Generic[Result]):
    """How results become records and records results, to the last bit."""

    pack: Callable[[Result], Record]
    unpack: Callable[[dict[str, Any]], Result]


@dataclass(frozen=True)
class Checkpoint:
    """A folder of journals, one for each stage.

    Whoever gives it sees to it that it belongs to the same inputs and settings as the call.

    Attributes:
        folder: exists; None where nothing is kept.
        prefix: of the journals' names.
    """

    folder: Path | None = None
    prefix: str = ""

    def kept(self, stage: str) -> Kept:
        """What is kept of a stage."""
        if self.folder is None:
            return Kept(stage, None)
        return Kept(stage, Journal(self.folder / f"{self.prefix}{stage}{SUFFIX}"))

    def of(self, part: str) -> Checkpoint:
        """The same for a part of the work, beside the others."""
        return Checkpoint(self.folder, f"{self.prefix}{part}_")


@dataclass(frozen=True)
class Kept:
    """The finished blocks of one stage, in their order."""

    stage: str
    journal: Journal | None

    def each(
        self,
        codec: Codec[Result],
        function: Callable[[Task], Result],
        tasks: Sequence[Task],
        workers: int | None = 1,
    ) -> Iterator[Result]:
        """Like ``ordered_map``; results that are kept are not computed again."""
        yield from self.rest(codec, function, lambda done: tasks[done:], len(tasks), workers)

    def rest(
        self,
        codec: Codec[Result],
        function: Callable[[Task], Result],
        tasks: Callable[[int], Sequence[Task] | Iterator[Task]],
        count: int,
        workers: int | None = 1,
    ) -> Iterator[Result]:
        """The same of ``count`` tasks that are made from the first on whose result is not kept."""
        done = 0
        for result in islice(self.recall(codec), count):
            done += 1
            yield result
        if done:
            _LOG.info("%s: %d of %d blocks are kept", self.stage, done, count)
        for result in ordered_map(function, tasks(done), workers) if done < count else ():
            yield self.add(codec, result)

    def once(self, codec: Codec[Result], function: Callable[[], Result]) -> Result:
        """One result of a whole stage."""
        (result,) = self.each(codec, lambda _: function(), [None])
        return result

    def add(self, codec: Codec[Result], result: Result) -> Result:
        """Keep a result behind the others; returns it."""
        if self.journal is not None:
            self.journal.append(codec.pack(result))
        return result

    def recall(self, codec: Codec[Result]) -> Iterator[Result]:
        """The results that are kept.

        Raises:
            InputError: a record holds something else.
        """
        if self.journal is None:
            return
        for record in self.journal.records():
            try:
                result = codec.unpack(record)
            except (LookupError, TypeError, ValueError, RuntimeError) as error:
                raise InputError(
                    f"{self.journal.path}: holds something else than {self.stage} ({error}); "
                    "--overwrite starts over"
                ) from error
            yield result


ARRAY: Codec[NDArray[np.float64]] = Codec(
    lambda values: {"values": values}, lambda record: record["values"]
)
NO_CHECKPOINT = Checkpoint()
NOTHING = NO_CHECKPOINT.kept("")


def tensors(like: Tensor) -> Codec[tuple[Tensor, ...]]:
    """Tensors, on the device of another."""
    return Codec(
        lambda values: {str(i): value.numpy(force=True) for i, value in enumerate(values)},
        lambda record: tuple(
            torch.from_numpy(record[str(i)]).to(like.device) for i in range(len(record))
        ),
    )


def motions(like: Tensor) -> Codec[Motion]:
    """Motions with known bone lengths."""
    plain = tensors(like)
    return Codec(
        lambda motion: plain.pack((motion.translation, motion.rotation, motion.angles)),
        lambda record: _motion(*plain.unpack(record)),
    )


def _motion(translation: Tensor, rotation: Tensor, angles: Tensor) -> Motion:
    return Motion(translation, rotation, angles)
