"""Boxes, angles and maps in other units, which were taken for what they are not."""

import warnings

import numpy as np
import pytest
import torch

from perfcap.detect import Crop, HeatmapHead, soft_argmax
from perfcap.detect.onnx import _pictures
from perfcap.detect.person import Start
from perfcap.errors import InputError


@pytest.mark.parametrize(
    "box", [(0.2, 0.1, 0.6, 0.9), (300, 200, 80, 190), (0, 0, 50), (0, 0, float("nan"), 9)]
)
def test_boxes_are_pixels(box: tuple[float, float, float, float]) -> None:
    Start((300.0, 200, 380, 390))
    with pytest.raises(InputError, match="box"):
        Start(box)


def test_angles_are_radians() -> None:
    Crop((0.0, 0.0), 10.0, (4, 4), -3.1)
    with pytest.raises(InputError, match="radians"):
        Crop((0.0, 0.0), 10.0, (4, 4), 90.0)


def test_maps_that_a_softmax_went_through_are_named() -> None:
    logits = torch.randn(2, 3, 16, 16, generator=torch.Generator().manual_seed(0))
    shares = logits.flatten(-2).softmax(-1).reshape(logits.shape)
    for wrong in (shares, logits.sigmoid()):
        with pytest.warns(UserWarning, match="softmax"):
            soft_argmax(wrong)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        right, _ = soft_argmax(logits)
        again, _ = soft_argmax(shares.log())
        soft_argmax(torch.zeros(2, 16, 16))
        HeatmapHead(4)(torch.zeros(1, 1, 4, 16, 16), torch.eye(2, 3)[None, None])
    torch.testing.assert_close(right, again)


def test_frames_of_a_view_are_bytes() -> None:
    frame = np.full((8, 6, 3), 128, np.uint8)
    assert len(list(_pictures([frame, frame]))) == 2
    for wrong in (frame / 255, frame[..., 0], frame.transpose(2, 0, 1)):
        with pytest.raises(InputError, match="frame 1 is"):
            list(_pictures([frame, wrong]))
