"""Joints that are given to a refiner by another set's names, all of which it takes."""

import warnings

import pytest
import torch
from takes import make_take

from perfcap.detect.joint_set import LANDMARKS, MPII
from perfcap.pipeline.pose_refiner import PoseRefiner

TAKE = make_take(12, views=3)
PIXELS = TAKE.detections.joints2d


def test_joints_of_a_set_with_as_many_are_named() -> None:
    """MPII has 16 joints, as the landmarks: the person came out 0.9 m away, without a word."""
    places = [LANDMARKS.index(name) if name in LANDMARKS else 1 for name in MPII.joints]
    layer = PoseRefiner(TAKE.actor).eval()
    with pytest.warns(UserWarning, match="order of the joint set"):
        layer(TAKE.cameras, PIXELS[..., places, :])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        PoseRefiner(TAKE.actor).eval()(TAKE.cameras, PIXELS)
        noise = torch.randn(PIXELS.shape, generator=torch.Generator().manual_seed(0))
        PoseRefiner(TAKE.actor).train()(TAKE.cameras, PIXELS + 5 * noise.to(PIXELS))
