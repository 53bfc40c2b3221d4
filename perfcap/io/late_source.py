"""A view that is late: frames of its file that were taken when those of the first view were."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from perfcap.io.clip import Frames, FrameSource


class LateSource:
    """Frames of another source, ``late`` later; its first or last one where it has none.

    Args:
        source: the file.
        late: whole frames; below 0 for earlier ones.
    """

    def __init__(self, source: FrameSource, late: int) -> None:
        self.source, self.late = source, late
        self.name, self.size, self.lost = source.name, source.size, source.lost
        self.total, self.warnings = source.total, source.warnings

    @property
    def fps(self) -> float | None:
        """Frames a second, None when unknown."""
        return self.source.fps

    @property
    def timestamps(self) -> NDArray[np.float64] | None:
        """Seconds from the first frame, (F,), None when unknown."""
        return self.source.timestamps

    def __len__(self) -> int:
        return len(self.source)

    def read(self, start: int, stop: int) -> Frames:
        """RGB frames, (stop - start, H, W, 3)."""
        if start == stop:
            return self.source.read(start, stop)
        wanted = np.clip(np.arange(start, stop) + self.late, 0, len(self.source) - 1)
        first = int(wanted[0])
        read: Frames = self.source.read(first, int(wanted[-1]) + 1)[wanted - first]
        return read

    def close(self) -> None:
        """Let go of files."""
        self.source.close()
