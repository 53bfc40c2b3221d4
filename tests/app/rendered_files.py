"""A small rendered sequence and results of it, as files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from synthetic import cameras as circle

from perfcap.render import rasterize


def save_motion(folder: Path, joints: np.ndarray, frames: Any = None, fps: float = 30.0) -> None:
    folder.mkdir(exist_ok=True)
    frames = np.arange(len(joints)) if frames is None else np.array(frames)
    np.savez(folder / "motion.npz", joints3d=joints, frames=frames, fps=fps)


def metrics_of(folder: Path) -> dict[str, Any]:
    values = json.loads((folder / "metrics.json").read_text())
    assert isinstance(values, dict)
    return values


def write_rendered(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """A rendered sequence of two frames: a pyramid of five vertices in front of a camera.

    Returns:
        Vertices (2, 5, 3), and the actor's vertex for each, in which the first is split.
    """
    (folder / "masks").mkdir(parents=True)
    base = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    vertices = np.stack([base, base + np.array([0.2, 0, 0])])
    places = np.array([0, 1, 2, 3, 4, 0])
    camera = circle(1, size=200)
    entry = {
        "pixel_centre": 0,
        "K": [camera.intrinsics[0].tolist()] * 2,
        "R": [camera.rotation[0].tolist()] * 2,
        "t": [camera.translation[0].tolist()] * 2,
        **{"width": 200, "height": 200, "fps": 30},
    }
    (folder / "camera.json").write_text(json.dumps(entry))
    inside = np.random.default_rng(0).uniform([-0.45, -0.45, 0.05], [0.45, 0.45, 0.95], (16, 3))
    joints = np.stack([inside, inside + np.array([0.2, 0, 0])])
    pixels = camera.project(torch.from_numpy(joints))[:, 0].numpy()
    np.savez(folder / "gt.npz", joints3d=joints, joints2d=pixels, vertices=vertices)
    names = np.array(["skin", "skirt"])
    part = np.array([0, 0, 0, 0, 1])
    np.savez(
        folder / "template.npz", faces=faces, part=part, part_names=names, glb_vertex_map=places
    )
    for frame, corners in enumerate(torch.from_numpy(vertices)):
        local = camera.to_camera(corners)
        flat = camera.project_camera(local)[0]
        drawn = rasterize(flat, local[0, :, 2], torch.from_numpy(faces), (200, 200)).mask.numpy()
        cv2.imwrite(str(folder / "masks" / f"{frame:04d}.png"), 255 * drawn.astype(np.uint8))
    return vertices, places
