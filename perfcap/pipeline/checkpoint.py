"""Finished work of a capture, kept block by block so that a kill costs little; networks' too."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.candidates import Candidates
from perfcap.detect.decode import Estimate
from perfcap.detect.joint_set import JointSet
from perfcap.detect.look import CropNetwork
from perfcap.detect.manifest import Manifest
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

    ``capture`` writes beside them what it was given, and refuses a folder that holds the work of
    another capture.

    Attributes:
        folder: exists; None where nothing is kept.
        prefix: of the journals' names.
        checked: whoever gives it has seen to it that it belongs to the same inputs and settings
            as the call, so that ``capture`` neither writes them down nor compares them.
    """

    folder: Path | None = None
    prefix: str = ""
    checked: bool = False

    def kept(self, stage: str) -> Kept:
        """What is kept of a stage."""
        if self.folder is None:
            return Kept(stage, None)
        return Kept(stage, Journal(self.folder / f"{self.prefix}{stage}{SUFFIX}"))

    def of(self, part: str) -> Checkpoint:
        """The same for a part of the work, beside the others."""
        return replace(self, prefix=f"{self.prefix}{part}_")


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


# --- A network whose answers are kept: asked again in the same order, it need not run -------------

_FIELDS = ("joints2d", "confidence", "joints3d")


class RememberingNetwork:
    """A joint network that follows a person through a view, frame after frame.

    Which crops it is asked about follows from its own answers, so a run that starts over asks the
    same questions until the kept answers end.
    """

    def __init__(self, network: CropNetwork, kept: Kept) -> None:
        self.manifest: Manifest = network.manifest
        self.network, self.kept = network, kept
        self._known = kept.recall(ESTIMATES)

    @property
    def joint_set(self) -> JointSet:
        """Names of its joints."""
        return self.network.joint_set

    def estimate(self, crops: NDArray[np.uint8]) -> Estimate:
        """Joints of crops (N, h, w, 3)."""
        known = next(self._known, None)
        if known is not None and len(known.joints2d) == len(crops):
            return known
        self._known = iter(())
        return self.kept.add(ESTIMATES, self.network.estimate(crops))


def _pack(estimate: Estimate) -> Record:
    found = {name: getattr(estimate, name) for name in _FIELDS}
    if estimate.candidates is not None:
        found |= {"places": estimate.candidates.places, "support": estimate.candidates.support}
    return {name: value.numpy(force=True) for name, value in found.items() if value is not None}


def _unpack(record: dict[str, Any]) -> Estimate:
    found = {name: torch.from_numpy(value) for name, value in record.items()}
    candidates = Candidates(found["places"], found["support"]) if "places" in found else None
    return Estimate(found["joints2d"], found["confidence"], found.get("joints3d"), candidates)


ESTIMATES: Codec[Estimate] = Codec(_pack, _unpack)
