"""Colours of a body from pictures of it: what is seen, what is behind, what a hand hides."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from synthetic import cameras

from perfcap.actor.template import Template
from perfcap.io.body_model import load_body_model
from perfcap.pipeline.appearance import Appearance
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_silhouettes import given_record
from perfcap.pipeline.painting import _Atlas
from perfcap.render import ProjectedMesh, Texture, rasterize, render

SIZE, TURNS = 400, 4
RED, BLUE, GREEN = (200, 40, 40), (40, 60, 200), (40, 180, 60)


@dataclass(frozen=True)
class Pictures:
    """A reader of frames of one view."""

    frames: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.frames)

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        assert view == 0
        return self.frames[start:stop]


@pytest.fixture(scope="module")
def body() -> Template:
    return load_body_model().actor(torch.zeros(0)).template


def two_colors(atlas: _Atlas) -> NDArray[np.float64]:
    """Red in front, blue behind."""
    front = atlas.rest[:, 2] > np.median(atlas.rest[:, 2])
    return np.where(front[:, None], RED, BLUE).astype(np.float64)


def filmed(
    body: Template, texture: NDArray[np.uint8], turns: int
) -> tuple[Pictures, torch.Tensor, Evidence]:
    """The body turning about itself before a green wall, its surfaces, and its masks."""
    camera = cameras(1, SIZE, 5.0)
    middle = torch.tensor(body.vertices, dtype=torch.float64).mean(0)
    looks = Appearance.of(body)
    mapped = Texture.from_image(
        torch.from_numpy(texture), torch.tensor(body.uv).float(), looks.texture.faces
    )
    surfaces, frames, records = [], [], []
    for turn in range(turns):
        angle = 2 * np.pi * turn / turns
        cos, sin = np.cos(angle), np.sin(angle)
        matrix = torch.tensor([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], dtype=torch.float64)
        vertices = (torch.tensor(body.vertices, dtype=torch.float64) - middle) @ matrix.mT
        seen = vertices[looks.representative].float()
        mesh = ProjectedMesh.seen_by(camera, seen, looks.faces)
        wall = torch.tensor(GREEN, dtype=torch.uint8).expand(SIZE, SIZE, 3)
        frames.append(render(mesh, mapped, wall).image.reshape(SIZE, SIZE, 3).numpy())
        drawn = rasterize(mesh.pixels, mesh.depth, mesh.faces, mesh.size)
        records.append(given_record(drawn.mask.numpy()))
        surfaces.append(vertices)
    heights = torch.tensor([0.35 * SIZE])
    return Pictures(np.stack(frames)), torch.stack(surfaces), Evidence.collect([records], heights)


def test_colors_come_from_the_frames_that_see_them(body: Template) -> None:
    atlas = _Atlas.of(body)
    true = two_colors(atlas)
    texture = atlas.image(true)
    assert texture.shape == (512, 512, 3) and texture.dtype == np.uint8
    reader, surface, evidence = filmed(body, texture, TURNS)
    frames = list(range(TURNS))
    colors, known = atlas.seen(frames, surface, reader, cameras(1, SIZE, 5.0), evidence)
    assert known.mean() > 0.5
    found = colors[known]
    assert np.quantile(found.max(1), 0.01) > 30  # in shadow, but not black
    reds = true[known, 0] == RED[0]
    # light and shadow are in the colours; which of them it is, is not
    assert np.mean((found[:, 0] > found[:, 2]) == reds) > 0.97
    assert np.mean(found[:, 1] > found[:, [0, 2]].max(1)) < 0.005  # nothing of the wall
    whole = atlas.completed(colors, known)
    assert np.mean((whole[:, 0] > whole[:, 2]) == (true[:, 0] == RED[0])) > 0.9


def test_one_side_alone_leaves_the_other_unknown(body: Template) -> None:
    atlas = _Atlas.of(body)
    reader, surface, evidence = filmed(body, atlas.image(two_colors(atlas)), TURNS)
    colors, known = atlas.seen([0], surface, reader, cameras(1, SIZE, 5.0), evidence)
    assert 0.15 < known.mean() < 0.5
    found = colors[known]
    first = atlas.rest[known, 2] > np.median(atlas.rest[:, 2])
    assert first.mean() > 0.9 or first.mean() < 0.1  # one side of the body
    side = found[:, 0] > found[:, 2]
    assert side.mean() > 0.9 or side.mean() < 0.1


def test_what_a_mask_does_not_show_is_not_looked_at(body: Template) -> None:
    atlas = _Atlas.of(body)
    reader, surface, evidence = filmed(body, atlas.image(two_colors(atlas)), 1)
    mask = evidence.masks(0)[0].copy()
    rows = np.flatnonzero(mask.any(1))
    mask[rows[len(rows) // 2] :] = False  # legs hidden by something
    half = Evidence.collect([[given_record(mask)]], 100 * evidence.pixel_unit)
    _, known = atlas.seen([0], surface, reader, cameras(1, SIZE, 5.0), half)
    height = np.ptp(atlas.rest[:, 1])
    low = atlas.rest[:, 1] - atlas.rest[:, 1].min() < 0.45 * height
    assert low.any() and not known[low].any() and known[~low].any()


@pytest.mark.long
def test_unseen_parts_look_like_their_mirror_image(body: Template) -> None:
    atlas = _Atlas.of(body)
    left = atlas.rest[:, 0] > 0
    height = atlas.rest[:, 1] - atlas.rest[:, 1].min()
    colors = np.repeat(100 * height[:, None], 3, 1)
    whole = atlas.completed(np.where(left[:, None], colors, 0.0), left)
    assert np.array_equal(whole[left], colors[left])
    assert np.quantile(np.abs(whole - colors), 0.99) < 6  # of 100 a metre: within 6 cm


def test_a_texture_goes_on_beyond_its_parts(body: Template) -> None:
    """Levels of detail mix pixels with those beside them."""
    atlas = _Atlas.of(body)
    image = atlas.image(np.full((len(atlas.rest), 3), 77.0))
    assert (image == 77).all()
    assert cv2.imencode(".jpg", image)[0]
