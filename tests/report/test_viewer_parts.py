"""What the viewer computes: files of curves, and cameras in 3D."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
import torch
from takes import make_take
from viewer import NODE, run

from perfcap.report.outlines import shown_cameras

pytestmark = pytest.mark.skipif(NODE is None, reason="needs node")

CHARTS = [
    {"title": "Trust", "unit": "%", "lines": [{"name": "trust", "values": [90, None, 12.5]}]},
    {
        "title": 'Error, "mean"',
        "unit": "",
        "lines": [{"name": "=1+1", "values": [1, 2, 3]}, {"name": "b", "values": [4, 5, -6]}],
    },
    {"title": "=cmd", "unit": "", "lines": [{"name": "x", "values": [0, 0, 0]}]},
]


def test_a_csv_holds_every_value() -> None:
    data = {"first": 7, "rate": 25, "frames": 3}
    text = run('import { tableOf } from "./csv.js";', "tableOf(given[0], given[1])", [data, CHARTS])
    head, *rows = csv.reader(io.StringIO(text))
    assert head == [
        *("frame", "time_s", "Trust [%]", 'Error, "mean": =1+1', 'Error, "mean": b', "'=cmd")
    ]
    assert [row[0] for row in rows] == ["7", "8", "9"]
    np.testing.assert_allclose([float(row[1]) for row in rows], [0.28, 0.32, 0.36])
    assert [row[2] for row in rows] == ["90", "", "12.5"]
    assert [row[4] for row in rows] == ["4", "5", "-6"]


@pytest.mark.parametrize("moving", [False, True])
def test_frusta_are_seen_at_the_corners_of_their_images(moving: bool) -> None:
    take = make_take(3, views=1, moving=moving)
    camera = shown_cameras(take.cameras, [(90, 160)])
    parts = (camera.intrinsics, camera.rotation, camera.translation[..., None])
    table = torch.cat(parts, -1).reshape(-1, 3, 7).double()
    stage = np.eye(4)
    stage[:3, :3] = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    stage[:3, 3] = (0.5, -2, 3)
    given = {
        "table": table.flatten().tolist(),
        "shape": list(table.shape),
        "stage": stage.T.flatten().tolist(),
    }
    expression = (
        "(() => { const table = Float32Array.from(given.table); table.shape = given.shape;"
        "return frustum({ table, width: 160, height: 90 }, 2, Float32Array.from(given.stage), 1.5)"
        "; })()"
    )
    found = np.array(run('import { frustum } from "./frusta.js";', expression, given))
    world = (found - stage[:3, 3]) @ stage[:3, :3]
    row = table[2 if moving else 0].numpy()
    local = world @ row[:, 3:6].T + row[:, 6]
    np.testing.assert_allclose(local[0], 0, atol=1e-5)
    np.testing.assert_allclose(local[1:, 2], 1.5, atol=1e-5)
    pixels = local[1:] @ row[:, :3].T
    corners = [[0, 0], [160, 0], [160, 90], [0, 90]]
    np.testing.assert_allclose(pixels[:, :2] / pixels[:, 2:] + 0.5, corners, atol=1e-3)
