"""Training shared by two processes on one machine."""

from pathlib import Path

import pytest
import torch
from motion_files import write_library
from torch import distributed, multiprocessing

from perfcap.train.config import LifterConfig, LiftingData, LiftingLoss, LoopConfig
from perfcap.train.lifter_task import LiftingTask
from perfcap.train.loop import BEST, LAST, LOG, train
from perfcap.train.motion_library import MotionLibrary


def work(rank: int, folder: str) -> None:
    """One of two processes: trains, and keeps the weights it ended with."""
    torch.set_num_threads(1)
    place = Path(folder)
    distributed.init_process_group(
        "gloo", init_method=f"file://{place / 'meeting'}", rank=rank, world_size=2
    )
    library = MotionLibrary.read(place / "motion")
    people = library.of(["01"]), library.of(["02"])
    config = LifterConfig(channels=8, dilations=(1, 3))
    task = LiftingTask(*people, config, LiftingData(frames=16), LiftingLoss(), 0, 0.5)
    loop = LoopConfig(steps=4, batch=8, evaluate_every=2, warmup=1)
    model = train(task, loop, place / "run", {})
    torch.save(model.state_dict(), place / f"{rank}.pt")
    torch.save(task.model.state_dict(), place / f"last{rank}.pt")
    distributed.destroy_process_group()


@pytest.mark.slow
def test_two_processes_end_with_the_same_weights(tmp_path: Path) -> None:
    write_library(tmp_path / "motion", people=2)
    multiprocessing.spawn(work, (str(tmp_path),), nprocs=2)
    for name in ("", "last"):
        one, other = (torch.load(tmp_path / f"{name}{rank}.pt") for rank in (0, 1))
        assert all(torch.equal(one[key], other[key]) for key in one)
    assert {p.name for p in (tmp_path / "run").iterdir()} == {BEST, LAST, LOG}
    assert len((tmp_path / "run" / LOG).read_text().splitlines()) == 2
