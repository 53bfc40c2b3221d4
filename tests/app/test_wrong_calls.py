"""What is no command line of perfcap, and its help."""

from pathlib import Path

import pytest
from runs import Command

from perfcap.cli import main


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["capture"],
        ["capture", "video.mp4"],
        ["frobnicate"],
        ["evaluate", "folder"],
        ["capture", "video.mp4", "--until", "nowhere"],
        ["capture", "--no-such-option"],
        ["doctor", "--cameras"],
    ],
)
def test_wrong_calls_are_code_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(arguments)
    streams = capsys.readouterr()
    assert exit_.value.code == 2
    assert streams.err and "Traceback" not in streams.err


@pytest.mark.parametrize(
    "arguments",
    [
        ["capture", "none.mp4"],
        ["capture", "none.mp4", "--out", "a/b"],
        ["capture", "none.mp4", "--people", "2"],
        ["retarget", "none", "--actor", "sam", "--out", "a/b"],
        ["batch", "none.csv", "--out", "a/b"],
        ["actor", "build", "none.obj", "--out", "a/b"],
        ["export", "none", "--to", "glb", "--out", "a/b"],
        ["train", "head", "none.mp4", "--out", "a/b"],
    ],
)
def test_refused_calls_leave_nothing(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, perfcap: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    assert perfcap(arguments).refused()
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("arguments", [["--help"], ["capture", "--help"], ["doctor", "--help"]])
def test_help_is_code_0(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(arguments)
    assert exit_.value.code == 0
    assert "usage" in capsys.readouterr().out
