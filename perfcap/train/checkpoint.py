"""Checkpoints: tensors by name and a few words, as safetensors. Nothing is unpickled."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from perfcap.errors import InputError
from perfcap.io.atomic import writing

_LOG = logging.getLogger(__name__)
_LIMIT = 8 * 2**30  # bytes


@dataclass(frozen=True)
class Checkpoint:
    """Named tensors and named texts.

    Attributes:
        tensors: names have a part in front: ``model.``, ``average.``, ``optimizer.``.
        values: texts.
        path: where it was read from.
    """

    tensors: Mapping[str, Tensor]
    values: Mapping[str, str]
    path: Path = Path()

    def part(self, name: str) -> dict[str, Tensor]:
        """The tensors of a part, by the rest of their names."""
        front = f"{name}."
        return {k.removeprefix(front): v for k, v in self.tensors.items() if k.startswith(front)}


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint; the old one stays until the new one is whole.

    Raises:
        InputError: the place cannot be written.
    """
    tensors = {
        name: value.detach().cpu().contiguous() for name, value in checkpoint.tensors.items()
    }
    with writing(path) as file:
        file.write(save(tensors, dict(checkpoint.values)))


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint.

    Raises:
        InputError: it is missing, too large, or no checkpoint.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected a checkpoint, .safetensors")
    if path.stat().st_size > _LIMIT:
        raise InputError(f"{path}: is too large for a checkpoint; expected at most 8 GB")
    try:
        with safe_open(str(path), "pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            values = file.metadata() or {}
    except (SafetensorError, OSError, ValueError) as error:
        raise InputError(f"{path}: is not a checkpoint ({error}); train again") from None
    missing = {"step", "best", "config"} - set(values)
    if missing:
        raise InputError(
            f"{path}: lacks {', '.join(sorted(missing))}; expected a checkpoint "
            "that perfcap train wrote"
        )
    return Checkpoint(tensors, values, path)


def start_from(model: nn.Module, path: Path) -> None:
    """Give a network the averaged weights of a checkpoint.

    A detector may have more blocks: they change nothing at first, so it goes on where the smaller
    one stopped (Chen et al. 2016, Net2Net).

    Raises:
        InputError: it is of another network.
    """
    weights = load_checkpoint(path).part("average")
    own = model.state_dict()
    other = [n for n, v in weights.items() if n not in own or own[n].shape != v.shape]
    if other or not weights:
        raise InputError(
            f"{path}: is of another network ({', '.join(other[:2]) or 'it has no weights'}); give "
            "the sizes that it was trained with; a detector may have more blocks"
        )
    model.load_state_dict(own | weights)


def described_start(path: Path | None) -> dict[str, str]:
    """What a training's description says of the weights it began with: nothing where it had none,
    else their digest, so that it is not resumed as if it had begun with others.
    """
    if path is None:
        return {}
    with path.open("rb") as file:
        return {"start": hashlib.file_digest(file, "sha256").hexdigest()}


def require_taps(path: Path, dilations: Sequence[int]) -> None:
    """Refuse weights of a lifter whose taps lie otherwise in time: they have the same shapes.

    Args:
        path: of the checkpoint.
        dilations: of the lifter that they are for.

    Raises:
        InputError: it was trained with others.
    """
    try:
        config = json.loads(load_checkpoint(path).values["config"])
    except ValueError:
        return
    lifter = config.get("lifter") if isinstance(config, dict) else None
    other = lifter.get("dilations") if isinstance(lifter, dict) else None
    if other is not None and other != list(dilations):
        raise InputError(
            f"{path}: has learned with --lifter.dilations {other}, expected {list(dilations)}; "
            "give those that it was trained with"
        )


def require_unseen(path: Path, people: Collection[str], motion: str) -> None:
    """Refuse weights that have learned from people who are held out; warn where that is unknown.

    Args:
        path: of the checkpoint.
        people: who are held out.
        motion: digest of the library that they are in.

    Raises:
        InputError: it has learned from some of them, whose errors would be too small.
    """
    try:
        config = json.loads(load_checkpoint(path).values["config"])
    except ValueError:
        return
    if not isinstance(config, dict) or "held_out" not in config:
        return
    apart = [str(each) for key in ("held_out", "validation") for each in config.get(key) or ()]
    seen = sorted(set(people) - set(apart))
    if not seen:
        return
    if config.get("motion") == motion:
        raise InputError(
            f"{path}: has learned from people who are held out here ({', '.join(seen)}), whose "
            f"errors would be too small; hold out some of those that it has not learned from: "
            f"{', '.join(apart)}"
        )
    _LOG.warning(
        "%s: has learned from other motion, of which it held out %s; errors on %s are too small "
        "where they were in it",
        *(path, ", ".join(apart), ", ".join(seen)),
    )
