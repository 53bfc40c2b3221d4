"""Masks of a result of ``--sync auto``, given back: they come out as they went in."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from runs import Command
from takes import (
    Take,
    camera_entry,
    make_take,
    marked_template,
    shrunk,
    write_actor,
    write_json,
    write_video,
)
from written_files import report

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.io.detections import save_detections
from perfcap.render.projected_mesh import ProjectedMesh

FRAMES, SIZE = 24, (120, 160)
LATE = {"a": 0, "b": -2, "c": 1}  # frames
FIRST = {name: 2 - late for name, late in LATE.items()}  # of the take, in each video
CALL = ("--sync", "auto", "--until", "refine_pose", "--segmenter", "none", "--no-overlay")

Masks = dict[str, dict[int, np.ndarray]]


def filmed(folder: Path) -> tuple[list[str], Masks]:
    """Three views of a take, each from its own frame, and where the person is in their frames."""
    whole = make_take(FRAMES + 4, views=3, actor=Actor(marked_template()))
    cameras = shrunk(whole.cameras, SIZE)
    pixels = cameras.project(whole.actor.joints(whole.truth))
    pixels = torch.stack(
        [pixels[f : f + FRAMES, view] for view, f in enumerate(FIRST.values())], dim=1
    )
    for view, name in enumerate(LATE):
        write_video(folder / f"{name}.mp4", FRAMES, SIZE, seen=pixels[:, view])
    entries = {name: camera_entry(cameras, view) for view, name in enumerate(LATE)}
    write_json(folder / "cameras.json", {"views": entries})
    write_actor(folder / "actor.glb", whole.actor.template)
    found = Detections.from_joints(pixels, torch.ones_like(pixels[..., 0]))
    save_detections(folder / "detections.npz", found, list(LATE))
    given = ["capture", *(str(folder / f"{name}.mp4") for name in LATE)]
    for name, file in (("actor", "actor.glb"), ("cameras", "cameras.json")):
        given += [f"--{name}", str(folder / file)]
    return [*given, "--detections", str(folder / "detections.npz"), *CALL], true_masks(whole, SIZE)


def true_masks(take: Take, size: tuple[int, int]) -> Masks:
    cameras, faces = shrunk(take.cameras, size), torch.as_tensor(take.actor.template.faces.copy())
    surface = take.actor.surface(take.truth)
    return {
        name: {
            row: ProjectedMesh.seen_by(cameras.select([view]), surface[first + row], faces)
            .rasterize()
            .mask.numpy()
            for row in range(FRAMES)
        }
        for view, (name, first) in enumerate(FIRST.items())
    }


def masks_in(folder: Path) -> Masks:
    return {
        name: {
            int(path.stem): cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 0
            for path in sorted((folder / name).glob("*.png"))
        }
        for name in LATE
    }


@pytest.mark.long
def test_masks_of_a_result_with_clocks_come_back(tmp_path: Path, perfcap: Command) -> None:
    call, truth = filmed(tmp_path)
    folders = [tmp_path / "true" / name for name in LATE]
    for folder, masks in zip(folders, truth.values(), strict=True):
        folder.mkdir(parents=True)
        for frame, mask in masks.items():
            cv2.imwrite(str(folder / f"{frame:06d}.png"), 255 * mask.astype(np.uint8))
    for out in ("first", "again"):
        given = ("--out", str(tmp_path / out), "--masks", *map(str, folders))
        done = perfcap([*call, *given])
        assert done.code in (0, 3), done
        assert not [note for note in done.notes if "are given for" in note], done.notes
        assert not [note for note in done.notes if "look as if" in note], done.notes
        assert report(tmp_path / out)["late_frames"] == LATE
        found = masks_in(tmp_path / out / "masks")
        for name, late in LATE.items():
            rows = [row for row in range(late, FRAMES + late) if 0 <= row < FRAMES]
            assert list(found[name]) == rows  # of the view's own frames
            for row in rows:
                np.testing.assert_array_equal(found[name][row], truth[name][row])
        folders = [tmp_path / out / "masks" / name for name in LATE]
