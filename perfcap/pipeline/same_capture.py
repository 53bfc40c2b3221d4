"""Whether a folder of finished work belongs to the capture that is to go on with it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.errors import InputError
from perfcap.geometry.record import Record
from perfcap.io.journal import Journal
from perfcap.pipeline.checkpoint import SUFFIX, Checkpoint
from perfcap.pipeline.people import Scene

_STAGE = "inputs"  # of the journal, beside those of stages
_PEOPLE = "people"


def require_same_capture(checkpoint: Checkpoint, scene: Scene, **settings: object) -> None:
    """Write down what is captured, or refuse a folder that holds the work of another capture.

    Work of which nothing is written down, of an older version, is taken as it is.

    Args:
        checkpoint: the folder; one that is kept nowhere, or is checked already, is left alone.
        scene: who is captured: cameras, rate and people are compared, images are not.
        **settings: of all stages, by name: tensors, or what has a ``repr`` that says all of it.

    Raises:
        InputError: the folder holds other work.
    """
    folder = checkpoint.folder
    if folder is None or checkpoint.checked:
        return
    journal = checkpoint.kept(_STAGE).journal
    if journal is None:
        return
    own = dict(_parts(scene, settings))
    known = _last(journal)
    if known == own:
        return
    logs = folder.glob(f"{checkpoint.prefix}*{SUFFIX}") if folder.is_dir() else ()
    if any(path != journal.path and path.stat().st_size for path in logs):
        if known is None:
            return
        raise InputError(
            f"checkpoint {folder}: holds the work of another capture, which differs in "
            f"{_differing(own, known)}; give another folder, or empty it"
        )
    journal.append(own)  # behind that of a call which was refused before it finished anything


def _last(journal: Journal) -> dict[str, Any] | None:
    """What is written down; damaged records are as if they were not there."""
    try:
        return [None, *journal.records()][-1]
    except ValueError:
        return None


def _differing(own: dict[str, Any], known: dict[str, Any]) -> str:
    """Which parts differ, in words."""
    if own[_PEOPLE] != known.get(_PEOPLE):
        return "numbers of people"  # all else of them differs with it
    return ", ".join(n for n in {**own, **known} if own.get(n) != known.get(n))


def _parts(scene: Scene, settings: dict[str, object]) -> Iterator[tuple[str, str]]:
    """All that decides about the bits of a motion, by name, as digests."""
    yield _PEOPLE, str(len(scene.people))
    yield "cameras", _digest(_values(scene.cameras))
    yield "rate", repr(scene.rate)
    for number, person in enumerate(scene.people, 1):
        of = "" if len(scene.people) == 1 else f" of person {number}"
        yield f"joints{of}", _digest(_values(person.detections))
        yield f"actor{of}", _digest(_actor(person.actor))
        yield f"solve_bones{of}", repr(person.solve_bones)
    for name, value in settings.items():
        yield name, _digest([value])


def _actor(actor: Actor) -> Iterator[object]:
    for name, value in sorted(actor.state_dict().items()):  # rest places, limits and vertices
        yield from (name, value)
    template = actor.template
    for array in (template.weights, template.weight_bones, template.faces):
        yield torch.from_numpy(np.array(array))  # copied, since some are read-only


def _values(record: Record) -> Iterator[object]:
    for field in fields(record):  # type: ignore[arg-type]  # all records are data classes
        yield from (field.name, getattr(record, field.name))


def _digest(values: Iterable[object]) -> str:
    """Of values in their order, wherever tensors lie."""
    found = hashlib.sha256()
    for value in values:
        if isinstance(value, Tensor):
            found.update(f"{value.dtype} {tuple(value.shape)};".encode())
            plain = value.detach().cpu().contiguous().reshape(-1)
            found.update(plain.view(torch.uint8).numpy().tobytes())
        else:
            found.update(f"{value!r};".encode())
    return found.hexdigest()
