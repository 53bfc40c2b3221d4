"""Crops as a network of images wants them, and whether it does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.detect.manifest import InputSpec
from perfcap.detect.session import Session
from perfcap.errors import InputError


def prepare_crops(crops: NDArray[np.uint8], spec: InputSpec) -> NDArray[Any]:
    """The input of a network for crops (N, h, w, 3), RGB."""
    channels = crops[..., ::-1] if spec.color == "bgr" else crops
    if "int" in spec.dtype:
        values: NDArray[Any] = channels.astype(spec.dtype)
    else:
        mean, std = (np.asarray(v, np.float32) for v in (spec.mean, spec.std))
        values = ((channels * np.float32(spec.scale) - mean) / std).astype(spec.dtype)
    return values if spec.layout == "nhwc" else values.transpose(0, 3, 1, 2)


def check_image_input(path: Path, spec: InputSpec, session: Session) -> tuple[str, int]:
    """Name of a network's only input, and its fixed batch, 0 when open.

    Args:
        path: of the manifest.
        spec: what the manifest says.
        session: the open network.

    Raises:
        InputError: manifest and network do not fit each other.
    """
    name = spec.name or session.inputs[0]
    if len(session.inputs) != 1 or name not in session.inputs:
        raise InputError(
            f"{path}: input {name!r} is to be the model's only one, it has "
            f"{', '.join(session.inputs)}; expected a network of one image"
        )
    height, width = spec.size
    image = (3, height, width) if spec.layout == "nchw" else (height, width, 3)
    found = session.shapes[name]
    fits = len(found) == 4 and all(
        a is None or a == b for a, b in zip(found[1:], image, strict=True)
    )
    if not fits:
        raise InputError(
            f"{path}: input.size and layout mean (N, {', '.join(map(str, image))}), the "
            f"model wants {_shown(found)}; correct input.size or input.layout"
        )
    if session.dtypes[name] != np.dtype(spec.dtype).type:
        wanted = session.dtypes[name]
        raise InputError(
            f"{path}: input.dtype is {spec.dtype}, the model wants "
            f"{np.dtype(wanted).name if wanted else 'another type'}; correct input.dtype"
        )
    return name, found[0] or 0


def _shown(shape: Sequence[int | None]) -> str:
    return f"({', '.join('N' if axis is None else str(axis) for axis in shape)})"
