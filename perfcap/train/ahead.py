"""Batches that other processes make before they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from torch.utils.data import DataLoader, Dataset

Batch = TypeVar("Batch")

Make = Callable[[int, int, int | None], Batch]


class Ahead(Generic[Batch]):
    """Makes the batches that are likely to be asked for next; what they are does not change.

    Args:
        make: a batch of a number, a size and a count of frames; sent to the processes.
        workers: processes; none make batches when they are asked for.
        stride: between the numbers that are asked for.
    """

    def __init__(self, make: Make[Batch], workers: int, stride: int = 1) -> None:
        self._make, self._workers, self._stride = make, workers, stride
        self._expected: tuple[int, int, int | None] | None = None
        self._batches: Iterator[Batch] = iter(())

    def __call__(self, number: int, size: int, frames: int | None = None) -> Batch:
        """Batch ``number``."""
        if not self._workers:
            return self._make(number, size, frames)
        if self._expected != (number, size, frames):
            series = _Series(self._make, number, size, frames, self._stride)
            self._batches = iter(
                DataLoader(
                    series,
                    batch_size=None,
                    num_workers=self._workers,
                    prefetch_factor=4,
                    multiprocessing_context="spawn",
                )
            )
        self._expected = (number + self._stride, size, frames)
        return next(self._batches)


@dataclass(frozen=True)
class _Series(Dataset[Batch], Generic[Batch]):
    """Batches from a number on."""

    make: Make[Batch]
    first: int
    size: int
    frames: int | None
    stride: int

    def __len__(self) -> int:
        return 2**31  # more than any training asks for

    def __getitem__(self, index: int) -> Batch:
        return self.make(self.first + index * self.stride, self.size, self.frames)
