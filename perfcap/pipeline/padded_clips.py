"""Clips of a batch without their padding."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from perfcap.errors import InputError


def cut_clips(
    name: str,
    values: Tensor | Sequence[Tensor] | None,
    axes: int,
    lengths: Tensor | Sequence[int] | None,
) -> tuple[list[Tensor], bool] | None:
    """Clips with so many axes each, cut to their lengths, and whether they came as a batch.

    Raises:
        InputError: they are no tensors of such axes, or lengths are not theirs.
    """
    if values is None:
        return None
    alone = isinstance(values, Tensor) and values.dim() != axes + 1
    several = isinstance(values, Tensor | list | tuple)
    clips: list[Tensor] = [torch.as_tensor(values)] if alone else list(values) if several else []
    kinds = {type(each).__name__ for each in (clips if several else [values])}
    if not several or not all(isinstance(each, Tensor) for each in clips):
        raise InputError(
            f"{name}: got {', '.join(sorted(kinds))}, expected a tensor, or a list of one a clip; "
            "torch.from_numpy makes them of arrays, and Detections have them as attributes"
        )
    batched = not alone
    shapes = [tuple(clip.shape) for clip in clips]
    if not clips or any(len(shape) != axes or not shape[0] for shape in shapes):
        last = {"joints2d": "J, 2", "confidence2d": "J", "joints3d": "J, 3"}[name]
        raise InputError(
            f"{name} has clips of shape {shapes[:1] or 'none'}; expected (F, C, {last}), a batch "
            f"(B, F, C, {last}), or a list of clips"
        )
    if lengths is None:
        return clips, batched
    whole = torch.as_tensor(lengths)
    if whole.dim() != 1 or whole.is_floating_point() or whole.dtype == torch.bool:
        raise InputError(
            f"lengths have shape {tuple(whole.shape)} and type {whole.dtype}; expected a whole "
            "number of frames a clip, (B,): of a mask (B, F) that is mask.sum(1)"
        )
    counts = whole.tolist()
    longest = [shape[0] for shape in shapes]
    if len(counts) != len(clips) or any(
        not 1 <= n <= most for n, most in zip(counts, longest, strict=True)
    ):
        raise InputError(
            f"lengths are {counts[:8]} but {name} has {len(clips)} clips of {longest[:8]} frames; "
            "give one number of frames a clip, from 1 to what there is"
        )
    _require_own(name, clips, counts)
    return [clip[:n] for clip, n in zip(clips, counts, strict=True)], batched


def _require_own(name: str, clips: Sequence[Tensor], counts: Sequence[int]) -> None:
    """Refuse lengths that are those of the clips in another order.

    Raises:
        InputError: clips end, before zeros, NaN or their last frame over and over, at the lengths
            of others.
    """
    if len(set(counts)) < 2:
        return
    ends = [_end(clip.detach().nan_to_num()) for clip in clips]
    if ends != list(counts) and sorted(ends) == sorted(counts):
        raise InputError(
            f"lengths are {list(counts[:8])} but the clips of {name} end after {ends[:8]} frames, "
            "which are the same in another order; give lengths in the order of the clips (were "
            "they sorted?)"
        )


def _end(clip: Tensor) -> int:
    """Frames of a clip (F, ...) before its padding."""
    frames = clip.flatten(1)
    changes = (frames[1:] != frames[:-1]).any(-1).nonzero()
    start = int(changes[-1]) + 1 if len(changes) else 0  # of what is alike until the end
    return start + bool((frames[start] != 0).any())
