"""Every script is listed and, as far as the shipped clip allows, runs a little."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import all as everything
import pytest
import report

FOLDER = Path(__file__).parents[2] / "experiments"
MAIN = 'if __name__ == "__main__":'
SCRIPTS = sorted(p.stem for p in FOLDER.glob("*.py") if MAIN in p.read_text())
# sweeps of the shipped clip, which need no recordings, with as little as shows a table
TINY = {
    "noise_sweep": {"levels": (1.0,), "kinds": ("swaps", "all")},
    "occlusion": {"lengths": (3,)},
    "term_ablation": {},
    "weight_sweep": {"factors": (0.5,)},
    "window_sweep": {"windows": (20,), "overlaps": (5,), "ranks": (8,)},
}


def test_every_script_is_run_by_all_of_them() -> None:
    assert {*everything.SMALL, *everything.LONG, "all"} == set(SCRIPTS)
    assert not set(everything.SMALL) & set(everything.LONG)


@pytest.mark.long
def test_every_script_is_listed_once_by_what_it_asks() -> None:
    call = [sys.executable, "-m", "experiments"]
    done = subprocess.run([*call, "list"], cwd=FOLDER.parent, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr
    names = [line.split()[0] for line in done.stdout.splitlines() if line.startswith("  ")]
    assert sorted(names) == SCRIPTS
    few = subprocess.run([*call, "list", "retarget"], cwd=FOLDER.parent, capture_output=True)
    assert few.stdout.count(b"\n  ") == 1
    for wrong in (["run", "retarge"], ["show"]):
        failed = subprocess.run([*call, *wrong], cwd=FOLDER.parent, capture_output=True, text=True)
        assert failed.returncode == 2 and failed.stderr
    assert (
        "did you mean retarget"
        in subprocess.run(
            [*call, "run", "retarge"], cwd=FOLDER.parent, capture_output=True, text=True
        ).stderr
    )


def test_every_script_is_in_the_list_of_tables() -> None:
    text = (FOLDER / "README.md").read_text()
    assert [name for name in SCRIPTS if f"experiments/{name}.py" not in text] == []


@pytest.mark.parametrize("name", SCRIPTS)
def test_scripts_are_no_longer_than_a_page_or_three(name: str) -> None:
    assert len((FOLDER / f"{name}.py").read_text().splitlines()) <= 350
    assert re.match(r'"""[A-Z]', (FOLDER / f"{name}.py").read_text())


@pytest.mark.long
@pytest.mark.parametrize("name", TINY)
def test_sweeps_run_and_repeat(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "RESULTS", tmp_path)
    module = importlib.import_module(name)
    config = module.Experiment(sequences=("demo",), seeds=1, frames=20, **TINY[name])
    found = module.run(config)
    assert found.tables[0].rows
    assert all(value == value for row in found.tables[0].rows for value in row[1:])
    assert found == module.run(config)  # from what was kept
    path = report.write(name, found, config)
    assert path.read_text() == report.write(name, found, config).read_text()
