"""Sweeps: resumed, shared out, the same however they were run."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import report
from sweep import Cell, Scores, Sweep, run_cells, tables

from perfcap.errors import InputError


@dataclass(frozen=True)
class Toy(Sweep):
    """Cells that leave a mark when they run."""

    sequences: tuple[str, ...] = ("one", "two")
    marks: str = ""
    power: int = 2


def run_toy(config: Toy, cell: Cell) -> Scores:
    """Numbers that depend on the cell alone; a worker in a marked folder dies once."""
    if config.marks:
        folder = Path(config.marks)
        (folder / f"{cell.file}.{os.getpid()}").touch()
        fatal = folder / "die"
        if cell.variant == "b" and fatal.exists():
            fatal.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
    return {"score": float(len(cell.sequence) + cell.seed**config.power), "none": float("nan")}


@pytest.fixture(autouse=True)
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(report, "RESULTS", tmp_path / "results")
    return tmp_path / "results"


def kept(results: Path) -> dict[str, str]:
    return {str(path.relative_to(results)): path.read_text() for path in results.rglob("*.json")}


def test_cells_are_kept_and_not_run_again(tmp_path: Path, results: Path) -> None:
    config = Toy(marks=str(tmp_path))
    first = run_cells("toy", config, "ab", run_toy)
    assert len(first) == 2 * 2 * 3
    assert first[Cell("a", "one", 2)]["score"] == 7
    files = kept(results)
    marks = len(list(tmp_path.glob("*.json.*")))
    assert run_cells("toy", config, "ab", run_toy) == first
    assert len(list(tmp_path.glob("*.json.*"))) == marks == len(files)
    next(iter(results.rglob("*.json"))).unlink()
    assert run_cells("toy", config, "ab", run_toy) == first
    assert kept(results) == files
    run_cells("toy", replace(config, power=3), "ab", run_toy)  # other settings, other files
    assert len(kept(results)) == 2 * len(files)


def test_shards_make_the_whole(results: Path) -> None:
    with pytest.raises(InputError, match="6 of 12 cells are not in"):
        run_cells("toy", Toy(shard="0/2"), "ab", run_toy)
    both = run_cells("toy", Toy(shard="1/2"), "ab", run_toy)
    files = kept(results)
    assert run_cells("toy", Toy(fresh=True), "ab", run_toy) == both
    assert kept(results) == files


@pytest.mark.parametrize("shard", ["2/2", "1", "-1/2", "a/b", "0/0"])
def test_a_shard_that_is_none(shard: str) -> None:
    with pytest.raises(InputError, match="expected i/n"):
        run_cells("toy", Toy(shard=shard), "a", run_toy)


def test_names_alike_are_kept_apart() -> None:
    cells = [Cell("a b", "c", 0), Cell("a_b", "c", 0), Cell("a", "b-c", 0), Cell("A b", "c", 0)]
    assert len({cell.file for cell in cells}) == 4
    assert all("/" not in Cell("a/../b", "ß", 1).file for _ in cells)


def test_tables_show_means_and_deviations() -> None:
    found = {Cell("v", "s", n): {"x": float(n), "y": None} for n in range(3)}
    (table,) = tables("title", found, ("x", "y"))
    assert table.columns == ("variant", "x", "± x", "y", "± y")
    assert table.rows[0][:2] == ("v", 1.0)
    assert table.rows[0][2] == pytest.approx((2 / 3) ** 0.5)
    (single,) = tables("title", {Cell("v", "s", 0): {"x": 4.0}})
    assert single.rows == (("v", 4.0),)


@pytest.mark.slow
def test_processes_change_nothing(results: Path) -> None:
    alone = run_cells("toy", Toy(), "ab", run_toy)
    files = kept(results)
    together = run_cells("toy", Toy(processes=2, fresh=True), "ab", run_toy)
    assert together == alone and kept(results) == files


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # Ray's own
def test_a_cluster_whose_worker_is_killed(tmp_path: Path, results: Path) -> None:
    pytest.importorskip("ray", reason="Ray is not installed; pip install 'perfcap[cluster]'")
    alone = run_cells("toy", Toy(), "abc", run_toy)
    (tmp_path / "die").touch()
    config = Toy(cluster="local", processes=2, marks=str(tmp_path))
    together = run_cells("toy", config, "abc", run_toy)
    assert not (tmp_path / "die").exists()  # it did die
    assert together == alone
