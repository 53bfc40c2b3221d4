"""What commands print is kept in their results too, for whoever reads tables of many."""

import json
import logging
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import robots
from crowd_files import SIZE, write_crowd
from crowds import make_crowd
from runs import Command
from takes import TakeFiles

from perfcap.app.said import all_said, hearing

UNKNOWN = "colour are not known and count for nothing"
LOG = logging.getLogger("perfcap.somewhere.deep")


def test_warnings_are_heard_once_and_printable() -> None:
    with hearing() as heard:
        LOG.warning("%s is %d", "it", 3)
        LOG.info("nothing")
        logging.getLogger("another").warning("of another program")
        LOG.warning("it is 3")
        LOG.warning("a\x1b[31m line")
    LOG.warning("later")
    assert heard == ["it is 3", "a\\x1b[31m line"]
    assert all_said(heard, "kept", "a\x1b[31m line", "it is 3", "kept") == (*heard, "kept")


def test_nothing_listens_after_an_error() -> None:
    before = list(logging.getLogger("perfcap").handlers)
    with pytest.raises(ValueError, match="wrong"), hearing():
        raise ValueError("wrong")
    assert logging.getLogger("perfcap").handlers == before


def annotated(actor: Path, folder: Path) -> Path:
    """The actor with a line in its manifest that counts for nothing."""
    folder.mkdir()
    (folder / "manifest.toml").write_text('colour = "red"\n')
    return Path(shutil.copy(actor, folder / "actor.glb"))


@pytest.mark.long
def test_captures_keep_what_reading_an_actor_says(
    take: TakeFiles, tmp_path: Path, perfcap: Command
) -> None:
    actor = annotated(take.actor, tmp_path / "own")
    outcome = perfcap(take.command(tmp_path / "out", actor=actor))
    assert sum(UNKNOWN in line for line in outcome.notes) == 1
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    kept = [*run["input_warnings"], *run["warnings"]]
    assert sum(UNKNOWN in line for line in kept) == 1 and len(set(kept)) == len(kept)


@pytest.mark.long
def test_captures_of_several_people_keep_it(tmp_path: Path, perfcap: Command) -> None:
    crowd = write_crowd(tmp_path / "in", make_crowd(2, frames=20, views=3, size=SIZE, noise=2.0))
    actors = [crowd.actors[0], annotated(crowd.actors[1], tmp_path / "own")]
    outcome = perfcap(crowd.command(tmp_path / "out", "--no-overlay", actors=actors))
    assert sum(UNKNOWN in line for line in outcome.notes) == 1
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    kept = [*run["input_warnings"], *run["warnings"]]
    assert sum(UNKNOWN in line for line in kept) == 1


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace('"degree"', '"radian"'), "look like degrees"),
        (lambda text: re.sub('range="[^"]*"', 'range="-1.5 2"', text), "limits in radians"),
    ],
)
def test_retargeting_keeps_what_reading_a_robot_says(
    captured: Path, tmp_path: Path, perfcap: Command, change: Callable[[str], str], words: str
) -> None:
    (tmp_path / "robot.xml").write_text(change(robots.mjcf()))
    out = tmp_path / "out"
    outcome = perfcap(["retarget", captured, "--actor", tmp_path / "robot.xml", "--out", out])
    assert outcome.code == 0
    kept = json.loads((out / "run.json").read_text())["warnings"]
    assert sum(words in line for line in outcome.notes) == 1
    assert sum(words in line for line in kept) == 1 and len(set(kept)) == len(kept)
