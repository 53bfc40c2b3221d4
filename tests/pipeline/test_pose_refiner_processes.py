"""The layer in several processes."""

from __future__ import annotations

import os

import pytest
import torch
from test_pose_refiner import VIEWS, motion, observed, refiner
from torch import nn


def _replica(rank: int, store: str, out: str) -> None:
    torch.distributed.init_process_group(
        "gloo", init_method=f"file://{store}", rank=rank, world_size=2
    )
    torch.set_num_threads(1)
    layer = nn.parallel.DistributedDataParallel(refiner(learn_weights=True))
    clip = observed(motion(8, seed=20 + rank))
    loss = (layer(VIEWS, clip[1]).joints - clip[0]).square().mean()
    loss.backward()
    torch.save(layer.module.log_weights.grad, f"{out}.{rank}")
    torch.distributed.destroy_process_group()


@pytest.mark.slow
def test_distributed_replicas_agree(tmp_path: os.PathLike[str]) -> None:
    torch.multiprocessing.spawn(
        _replica, (f"{tmp_path}/store", f"{tmp_path}/gradient"), nprocs=2, join=True
    )
    first, second = (torch.load(f"{tmp_path}/gradient.{rank}") for rank in range(2))
    assert torch.equal(first, second)
    own = []
    for rank in range(2):
        layer = refiner(learn_weights=True)
        clip = observed(motion(8, seed=20 + rank))
        (layer(VIEWS, clip[1]).joints - clip[0]).square().mean().backward()
        own.append(layer.log_weights.grad)
    torch.testing.assert_close(first, sum(own) / 2)
