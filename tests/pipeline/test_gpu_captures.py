"""Refinement and captures on a graphics card against those on the CPU."""

from __future__ import annotations

import pytest
import torch
from synthetic import actor, cameras
from takes import sway
from torch import Tensor

import perfcap
from perfcap.detect.detections import Detections
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.pose_refiner import PoseRefiner
from perfcap.solve import Implicit

F64 = torch.float64
CONFIG = PoseConfig(window=10, overlap=4, max_steps=20)
needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")


def seen() -> Tensor:
    """Pixels of 14 frames in two views."""
    person = actor()
    pixels = cameras(2).project(person.joints(sway(person, 14)))
    noise = torch.randn(pixels.shape, generator=torch.Generator().manual_seed(7), dtype=F64)
    return pixels + noise


@pytest.mark.gpu
@needs_cuda
def test_a_gpu_refines_the_same() -> None:
    """Joints, and the gradient that reaches the pixels."""
    found = []
    for device in ("cpu", "cuda"):
        pixels = seen().to(device).requires_grad_()
        layer = PoseRefiner(actor(), config=CONFIG, adjoint=Implicit()).to(device).train()
        refined = layer(cameras(2).to(torch.zeros(0, dtype=F64, device=device)), pixels)
        (slope,) = torch.autograd.grad(refined.joints.square().sum(), pixels)
        found.append((refined.joints.detach().cpu(), slope.cpu()))
    torch.testing.assert_close(found[1][0], found[0][0], rtol=0, atol=1e-5)
    torch.testing.assert_close(found[1][1], found[0][1], rtol=1e-3, atol=1e-6)


@pytest.mark.gpu
@needs_cuda
def test_a_gpu_captures_the_same() -> None:
    """Poses of two views: preparation, first poses, both solves, contacts."""
    found = []
    for device in ("cpu", "cuda"):
        like = torch.zeros(0, dtype=F64, device=device)
        pixels = seen().to(like)
        detections = Detections.from_joints(pixels, torch.ones_like(pixels[..., 0]))
        views = cameras(2).to(like)
        found.append(perfcap.capture(actor().to(device), views, detections, 30.0).joints().cpu())
    torch.testing.assert_close(found[1], found[0], rtol=0, atol=1e-4)
