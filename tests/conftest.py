"""One thread for every test: the suite runs beside others, and small tensors gain nothing."""

from collections.abc import Iterator

import cv2
import pytest
import torch

from perfcap.geometry.plain import torch_only

torch.set_num_threads(1)
cv2.setNumThreads(1)


@pytest.fixture(params=["kernels", "torch"])
def both_twins(request: pytest.FixtureRequest) -> Iterator[None]:
    """Runs a test with compiled kernels, and with torch alone as on a graphics card."""
    if request.param == "kernels":
        yield
    else:
        with torch_only():
            yield
