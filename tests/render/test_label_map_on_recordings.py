"""The z-buffer against silhouettes that an independent rasteriser drew."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from perfcap.render.label_map import Cull, rasterize

SEQUENCE = Path(__file__).parents[2] / "../shared/data/rendered/dev_tight"


@pytest.mark.skipif(
    not SEQUENCE.is_dir(), reason="the rendered sequence is not beside the checkout"
)
@pytest.mark.parametrize("frame", [0, 45, 95])
def test_masks_of_a_person(frame: int) -> None:
    with np.load(SEQUENCE / "gt.npz", allow_pickle=False) as truth:
        vertices = torch.tensor(truth["vertices"][frame], dtype=torch.float64)
    with np.load(SEQUENCE / "template.npz", allow_pickle=False) as template:
        faces = torch.tensor(template["faces"])
    camera = json.loads((SEQUENCE / "camera.json").read_text())
    intrinsics, rotation, translation = (
        torch.tensor(camera[name][frame], dtype=torch.float64) for name in ("K", "R", "t")
    )
    local = vertices @ rotation.T + translation
    plane = local @ intrinsics.T
    pixels = plane[:, :2] / plane[:, 2:] - camera["pixel_centre"]
    size = (camera["height"], camera["width"])
    drawn = rasterize(pixels, local[:, 2], faces, size, Cull.BACK).mask
    mask = cv2.imread(str(SEQUENCE / f"masks/{frame:04d}.png"), cv2.IMREAD_GRAYSCALE)
    assert mask is not None
    truth_mask = torch.tensor(mask > 0)
    assert (drawn & truth_mask).sum() / (drawn | truth_mask).sum() > 0.999
