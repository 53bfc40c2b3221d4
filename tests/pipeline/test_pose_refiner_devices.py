"""The layer in several processes, and on a graphics card."""

from __future__ import annotations

import os

import pytest
import torch
from test_pose_refiner import F64, PIXELS, VIEWS, motion, observed, refiner
from torch import nn

from perfcap.solve import Implicit


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


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_a_gpu_refines_the_same() -> None:
    """Joints, and the gradient that reaches the pixels."""
    found = []
    for device in ("cpu", "cuda"):
        pixels = PIXELS.to(device).requires_grad_()
        layer = refiner(adjoint=Implicit()).to(device).train()
        refined = layer(VIEWS.to(torch.zeros(0, dtype=F64, device=device)), pixels)
        (slope,) = torch.autograd.grad(refined.joints.square().sum(), pixels)
        found.append((refined.joints.detach().cpu(), slope.cpu()))
    torch.testing.assert_close(found[1][0], found[0][0], rtol=0, atol=1e-5)
    torch.testing.assert_close(found[1][1], found[0][1], rtol=1e-3, atol=1e-6)
