"""What a head is about to learn from: the same as before."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from perfcap.app.train import MODEL
from perfcap.commands.train import TrainHead
from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.files import MEBIBYTE

LEARNED = "learned_from.json"


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
