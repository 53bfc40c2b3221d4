"""What a preset is not made for is said of several people, too."""

import json
from pathlib import Path

import pytest
from crowd_files import SIZE, write_crowd
from crowds import make_crowd
from runs import Command


@pytest.mark.long
def test_weights_of_one_view_are_named(tmp_path: Path, perfcap: Command) -> None:
    crowd = write_crowd(tmp_path, make_crowd(2, frames=12, views=3, size=SIZE, noise=2.0))
    call = crowd.command(tmp_path / "both")
    outcome = perfcap([*call, "--preset", "monoperfcap", "--no-overlay"])
    assert outcome.code in (0, 3)
    run = json.loads((tmp_path / "both/run.json").read_text())
    said = [line for line in run["warnings"] if "--preset monoperfcap" in line]
    assert "weights of one view, and there are 3" in said[0] and len(said) == 2
