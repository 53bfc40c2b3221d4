"""A finished capture of two small views with a surface and masks, and where it came from."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from reported import FRAMES, SIZE, START, VIEWS
from takes import camera_entry, detect, make_take, shrunk, write_json, write_video

from perfcap.io.detections import save_detections
from perfcap.io.mask_files import save_masks
from perfcap.io.result_folder import PAGE
from perfcap.pipeline import CaptureConfig
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface
from perfcap.render import rasterize


@pytest.fixture(scope="session")
def take_performance() -> Performance:
    take = make_take(FRAMES, views=2, turns=0.3)
    cameras = shrunk(take.cameras, SIZE)
    take = replace(take, cameras=cameras, detections=detect(take.actor, cameras, take.truth))
    parts = (take.actor, take.cameras, take.detections, take.truth, take.rate, CaptureConfig())
    skinned = SkinnedSurface(take.actor, take.truth)
    bulge = 0.02 * torch.randn(skinned[0:1].shape, generator=torch.manual_seed(0))
    return Performance(*parts, surface=StoredSurface(skinned[:].float() + bulge))


@pytest.fixture(scope="session")
def made(take_performance: Performance, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``inputs/`` and, beside it, the result ``a "result" <b>``."""
    place = tmp_path_factory.mktemp("report")
    inputs = place / "inputs"
    inputs.mkdir()
    cameras = take_performance.cameras
    for name in ("one", "two"):
        write_video(inputs / f"{name}.mp4", START + FRAMES, SIZE)
    entries = {name: camera_entry(cameras, view) for view, name in enumerate(VIEWS)}
    write_json(inputs / "cameras.json", {"views": entries})
    seen = take_performance.detections
    save_detections(inputs / "detections.npz", seen, VIEWS, start=START)
    folder = place / 'a "result" <b> ö'
    request = {
        "videos": [str(inputs / "one.mp4"), str(inputs / "two.mp4")],
        "cameras": str(inputs / "cameras.json"),
        "detections": [str(inputs / "detections.npz")],
        "actor": "sam",
    }
    run = {"request": request, "views": list(VIEWS), "perfcap": "0.1.0"}
    take_performance.save(folder, START, run, VIEWS)
    save_masks(folder / "masks", _masks(take_performance), START)
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy to spoil, of another name; its inputs are where they were."""
    return Path(shutil.copytree(made, tmp_path / "copy", ignore=shutil.ignore_patterns(PAGE)))


def _masks(performance: Performance) -> dict[str, list[bytes]]:
    faces = torch.as_tensor(performance.actor.template.faces.copy())
    local = performance.cameras.to_camera(performance.shown[:].double())
    pixels = performance.cameras.project_camera(local)
    drawn = rasterize(pixels, local[..., 2], faces, SIZE).mask.numpy()
    return {
        name: [cv2.imencode(".png", mask.astype(np.uint8))[1].tobytes() for mask in drawn[:, view]]
        for view, name in enumerate(VIEWS)
    }
