"""Captures in children of a process that has captured, with several threads each.

A forked child computes with one thread, so sums are rounded in another order.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import os, sys
from takes import make_take
import torch
from torch.utils.data import DataLoader, Dataset
from perfcap.pipeline import PoseRefiner, capture

class Captures(Dataset):
    def __len__(self):
        return 2
    def __getitem__(self, number):
        take = make_take(60)
        found = capture(take.actor, take.cameras, take.detections, 30.0).joints()
        refiner = PoseRefiner(take.actor, joint_set="landmarks16", rate=30.0)
        with torch.no_grad():
            refined = refiner(take.cameras, take.detections.joints2d[:8])
        return torch.stack((found.sum(), refined.joints.sum()))

if __name__ == "__main__":
    assert torch.get_num_threads() == 2
    expected = Captures()[0]
    if sys.argv[1] == "plain":
        child = os.fork()
        if not child:
            os._exit(0 if torch.allclose(Captures()[0], expected, rtol=1e-9) else 1)
        sys.exit(os.waitpid(child, 0)[1] and 1)
    loader = DataLoader(
        Captures(), batch_size=None, num_workers=1, multiprocessing_context=sys.argv[1]
    )
    assert all(torch.allclose(found, expected, rtol=1e-9) for found in loader)
"""


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system does not fork")
@pytest.mark.parametrize(
    "kind",
    [
        "plain",
        pytest.param("fork", marks=pytest.mark.slow),
        pytest.param("spawn", marks=pytest.mark.slow),
    ],
)
def test_a_child_captures_what_its_parent_did(tmp_path: Path, kind: str) -> None:
    script = tmp_path / "captures.py"
    script.write_text(CODE)
    paths = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    more = {"OMP_NUM_THREADS": "2", "PYTHONPATH": paths}
    call = [sys.executable, "-W", "ignore", str(script), kind]
    ended = subprocess.run(call, env={**os.environ, **more}, check=False, timeout=240)
    assert ended.returncode == 0
