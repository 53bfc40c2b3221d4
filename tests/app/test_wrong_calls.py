"""What is no command line of perfcap, and its help."""

import pytest

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


@pytest.mark.parametrize("arguments", [["--help"], ["capture", "--help"], ["doctor", "--help"]])
def test_help_is_code_0(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(arguments)
    assert exit_.value.code == 0
    assert "usage" in capsys.readouterr().out
