"""Running ``perfcap`` in this process."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import pytest

from perfcap.cli import main

# what a stage says after ten seconds, which any may take on a busy machine
_PROGRESS = re.compile(r"perfcap: [\w: ]+ \d+ of \d+(, about .* left)?")


@dataclass(frozen=True)
class Outcome:
    """Exit code, what was written to the streams, and what was logged for the user."""

    code: int
    out: str
    err: str
    notes: tuple[str, ...]

    @property
    def said(self) -> list[str]:
        """Lines of the error stream but those of progress, which come where a machine is slow."""
        lines = self.err.strip().splitlines()
        return [line for line in lines if not _PROGRESS.fullmatch(line)]

    def refused(self) -> str:
        """The one line of a refusal."""
        assert self.code == 2, self
        lines = self.said
        assert len(lines) == 1, self.err
        assert lines[0].startswith("perfcap: ") and "Traceback" not in self.err
        assert not self.notes
        return lines[0]


Command = Callable[[Sequence[object]], Outcome]


def command(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture, arguments: Sequence[Any]
) -> Outcome:
    """Run a command line and collect what it does."""
    capsys.readouterr()
    caplog.clear()
    with pytest.raises(SystemExit) as exit_:
        main([str(argument) for argument in arguments])
    streams = capsys.readouterr()
    assert isinstance(exit_.value.code, int)
    return Outcome(exit_.value.code, streams.out, streams.err, tuple(caplog.messages))
