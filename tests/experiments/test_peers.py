"""What perfcap is compared with is what its name says."""

from __future__ import annotations

import json
import math
import stat
from pathlib import Path

import pytest
import torch
from peers import low_pass
from pose2sim_project import pose2sim
from takes import make_take

from perfcap.errors import InputError

# writes the frames that it is given but the last, as Pose2Sim's z-up points turned y up
STAND_IN = """#!/usr/bin/env python3
import json, pathlib, sys
config = json.load(open(sys.argv[3]))
folder = pathlib.Path(config["project"]["project_dir"])
names = [child["name"] for child in config["pose"]["PERFCAP"]["children"]][::-1]
frames = len(list((folder / "pose" / "cam01_json").glob("*.json")))
rows = ["", "", "", "Frame#\\tTime\\t" + "\\t\\t\\t".join(names) + "\\t\\t", "\\t\\tX1\\tY1\\tZ1"]
for frame in range(frames - 1):
    cells = [c for k in range(len(names)) for c in ((k, frame, 7) if k else ("", "", ""))]
    rows.append("\\t".join(map(str, (frame, frame / 30, *cells))))
(folder / "pose-3d").mkdir()
(folder / "pose-3d" / "a_filt_butterworth.trc").write_text("\\n".join(rows) + "\\n")
"""


def test_the_filter_keeps_what_is_slow_and_fills_gaps() -> None:
    time = torch.arange(120, dtype=torch.float64) / 30
    slow, fast = (2 * math.pi * time).sin(), (2 * math.pi * 14 * time).sin()
    points = torch.stack((slow, slow + 0.2 * fast, torch.ones_like(time)), -1)[:, None]
    holed = points.clone()
    holed[40:43] = torch.nan
    for given, apart in ((points, 0.02), (holed, 0.15)):  # a straight line bridges a gap
        found = low_pass(given, 30.0)[10:-10, 0]
        assert (found[:, :2] - slow[10:-10, None]).abs().max() < apart
        assert torch.allclose(found[:, 2], torch.ones_like(found[:, 2]))
    assert low_pass(torch.full((40, 1, 3), torch.nan), 30.0).isnan().all()


def test_a_project_is_written_and_its_result_read(tmp_path: Path) -> None:
    program = tmp_path / "python"
    program.write_text(STAND_IN)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    take = make_take(8, views=3, lifted=False)
    found = pose2sim(program, tmp_path / "project", take.cameras, take.detections, 30.0)
    assert found.shape == (8, 16, 3) and found[-1].isnan().all()
    assert found[:-1, -1].isnan().all()  # its first marker has empty cells
    # markers come in another order; (x, y, z) of the file are (y, z, x) of the world
    assert torch.equal(found[2, :-1, 1], torch.arange(15.0, 0, -1, dtype=torch.float64))
    assert (found[3, :-1, 2] == 3).all() and (found[3, :-1, 0] == 7).all()
    keypoints = tmp_path / "project" / "pose" / "cam02_json" / "cam02_000003.json"
    (person,) = json.loads(keypoints.read_text())["people"]
    first = torch.tensor(person["pose_keypoints_2d"]).reshape(16, 3)[0, :2]
    assert torch.allclose(first, take.detections.joints2d[3, 1, 0].float())
    program.write_text("#!/bin/sh\necho no such module >&2; exit 1\n")
    with pytest.raises(InputError, match="no such module"):
        pose2sim(program, tmp_path / "other", take.cameras, take.detections, 30.0)
