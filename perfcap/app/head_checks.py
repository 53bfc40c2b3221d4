"""What a head is about to learn from: the same as before, and what the network itself sees."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from torch import Tensor

from perfcap.app.train import MODEL
from perfcap.commands.train import TrainHead
from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.files import MEBIBYTE
from perfcap.train.head_crops import CropAnswers, Watched

LEARNED = "learned_from.json"
# Share of the person by which a network's joints miss the solution, medians of a view: 0.02 to 0.08
# in the right images of a person who is not hidden, 0.08 to 0.25 in those of another view or take.
_MISSES = 0.08
# Misses of the network's joints from those of the solution some frames on, in parts of its misses
# now: 0.91 and more in right images, 0.5 to 0.8 where joints are three frames late or early.
_NEARER, _SHIFTS = 0.85, 12


def describe(request: TrainHead, digest: str) -> dict[str, Any]:
    """All that a head depends on, as plain values.

    Args:
        request: of the user.
        digest: of what the head learns from.
    """
    described = {
        "videos": [str(path) for path in request.videos],
        "network": request.network,
        "features": request.features,
        "frames": request.frames,
        "through_solver": request.through_solver,
        "learned from": digest,
        "settings": asdict(request.config),
    }
    plain: dict[str, Any] = json.loads(json.dumps(described, default=str))
    return plain


def require_same(request: TrainHead, described: Mapping[str, Any]) -> None:
    """Keep a description beside the model; with ``--resume``, refuse to go on with another one.

    Raises:
        InputError: the folder's training learned from something else, or does not say from what.
    """
    path = request.out / LEARNED
    if request.resume and path.is_file():
        before = _read(path)
        other = sorted(key for key in described if before.get(key) != described[key])
        if other:
            raise InputError(
                f"{path}: that training had another configuration, or other videos, cameras, "
                f"joints or actors (not the same: {', '.join(other)}); expected the same to "
                "resume; give another --out, or leave --resume"
            )
    elif request.resume and (request.out / MODEL).exists():
        raise InputError(
            f"--out {request.out}: holds a trained network, {MODEL}, but no {LEARNED} that says "
            "what it learned from; give another --out, so that it is not replaced"
        )
    with writing(path) as file:
        file.write(json.dumps(dict(described), indent=1, sort_keys=True).encode())


def _read(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > MEBIBYTE:
            raise ValueError("too large")
        table = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        table = None
    if not isinstance(table, dict):
        raise InputError(
            f"{path}: is malformed; expected what perfcap train head wrote; give another --out"
        )
    return table


def misses_of(crops: CropAnswers) -> list[float]:
    """How far the network's joints lie from the solution in each view, shares of the person, (C,).

    Medians over frames and joints, in crops as a capture would cut them.
    """
    seen, known = crops.joints2d[:, :, 0], crops.known2d[:, :, 0]
    size: Tensor = (known.amax(-2) - known.amin(-2)).amax(-1).clamp(min=1e-6)
    share = (seen - known).norm(dim=-1) / size[..., None]
    return [float(view.median()) for view in share]


def lags_of(crops: CropAnswers, watched: Watched) -> list[int]:
    """Frames by which the solution is late against the images of each view, (C,); 0 where none.

    The network's joints are those of the image, whatever crop it is shown. Of the solution's, those
    of the same moment are the nearest.
    """
    known = watched.cameras.project(watched.joints).transpose(0, 1)  # C F 16 2
    size = (known.amax(-2) - known.amin(-2)).amax(-1).median(-1).values.clamp(min=1e-6)  # C
    matrix = crops.to_image[:, :, 0].to(known)
    seen = crops.joints2d[:, :, 0].to(known) @ matrix[..., :2].mT + matrix[..., None, :, 2]
    frames, most = known.shape[1], min(_SHIFTS, known.shape[1] // 3)
    misses = {}
    for late in sorted(range(-most, most + 1), key=abs):
        first, last = max(0, -late), min(frames, frames - late)
        off = (seen[:, first:last] - known[:, first + late : last + late]).norm(dim=-1)
        misses[late] = off.flatten(1).median(-1).values / size
    found = []
    for view in range(len(known)):
        best = min(misses, key=lambda late: float(misses[late][view]))
        miss, now = float(misses[best][view]), float(misses[0][view])
        found.append(best if miss < min(_MISSES, _NEARER * now) else 0)
    return found


def late_doubts(lags: Sequence[int], names: Sequence[str], step: int = 1) -> Iterator[str]:
    """What speaks against the frames of the images: the network sees another moment in them.

    Args:
        lags: of ``lags_of``, (C,).
        names: of the views, (C,).
        step: frames of the videos from one to the next that was looked at.
    """
    if any(lags):
        each = ", ".join(
            f"{name} {abs(step * lag)} frames {'late' if lag > 0 else 'early'}"
            for name, lag in zip(names, lags, strict=True)
            if lag
        )
        yield (
            f"the joints look late or early against the images, as the network sees the person: "
            f"{each}; check that videos and joints are of the same frames (were frames cut from "
            "one of them?): the head learns to see the person where they are at another time"
        )


def image_doubts(misses: Sequence[float], names: Sequence[str]) -> Iterator[str]:
    """What speaks against the images: views in which the network sees nobody where they should be.

    Args:
        misses: of ``misses_of``, (C,).
        names: of the views, (C,).
    """
    odd = [view for view, miss in enumerate(misses) if miss > _MISSES]
    if odd:
        each = ", ".join(f"{names[view]} {100 * misses[view]:.0f} %" for view in odd)
        fair = [100 * miss for view, miss in enumerate(misses) if view not in odd]
        rest = f", up to {max(fair):.0f} % in the other views" if fair else ""
        yield (
            f"the network sees the joints far from where all views together have them: {each} of "
            f"the person (medians{rest}); check that these videos are of these cameras and of "
            "this take, and that the person is not hidden there: the head learns from their images"
        )
