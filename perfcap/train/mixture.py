"""Two sources of shots as one."""

from __future__ import annotations

from perfcap.train.crop_batches import Shots
from perfcap.train.scenes import Shot


class Mixture:
    """Shots of two sources in turn; the smaller one comes round again as often as need be.

    Args:
        first: a source.
        second: another one.
    """

    def __init__(self, first: Shots, second: Shots) -> None:
        self._sources = (first, second)

    def __len__(self) -> int:
        return 2 * max(len(source) for source in self._sources)

    def __getitem__(self, number: int) -> Shot:
        """An even number is of the first source, an odd one of the second."""
        row, which = divmod(number, 2)
        source = self._sources[which]
        return source[row % len(source)]
