"""A small take on disk, captured once."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from runs import Command, Outcome, command
from takes import TakeFiles, write_take

from perfcap.cli import main


@pytest.fixture
def perfcap(capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture) -> Command:
    """The command line as a function."""

    def run(arguments: Sequence[object]) -> Outcome:
        return command(capsys, caplog, arguments)

    return run


@pytest.fixture(scope="session")
def take(tmp_path_factory: pytest.TempPathFactory) -> TakeFiles:
    """24 frames of 160x120 with an actor, a camera, detections and truth."""
    return write_take(tmp_path_factory.mktemp("take"))


@pytest.fixture(scope="session")
def captured(take: TakeFiles, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one ordinary capture."""
    out = tmp_path_factory.mktemp("captured")
    with pytest.raises(SystemExit) as exit_:
        main(take.command(out))
    assert exit_.value.code == 0
    return out
