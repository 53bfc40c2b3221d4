import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from perfcap.metrics.joints import joint_errors, reprojection_error

SHARED = Path(__file__).parents[2] / "../shared"
SEQUENCE = SHARED / "data/rendered/dev_tight"
NAMES = {
    "mpjpe_mm": "mpjpe",
    "mpjpe_root_mm": "mpjpe_root",
    "mpjpe_transl_mm": "mpjpe_translation",
    "pa_mpjpe_mm": "mpjpe_similarity",
    "pck3d_150": "pck",
    "auc3d": "auc",
    "accel_err_mm_per_frame2": "acceleration_error",
    "jitter_jerk_m_s3": "jerk",
    "jitter_jerk_gt_m_s3": "jerk_truth",
}

pytestmark = [
    pytest.mark.skipif(
        not (SEQUENCE / "gt.npz").exists(),
        reason="the rendered sequences are not beside the checkout",
    ),
    # the reference scorer leaves its files for the collector to close
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def score():
    tool = SHARED / "tools/score.py"
    before = list(sys.path)
    spec = importlib.util.spec_from_file_location("score", tool)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)  # it puts its folder on the path
    finally:
        sys.path[:] = before
    return module


def fake(missing):
    """The truth, disturbed by an offset, a scale and noise; some frames missing."""
    with np.load(SEQUENCE / "gt.npz", allow_pickle=False) as file:
        truth, pixels = file["joints3d"].astype(float), file["joints2d"].astype(float)
    noise = np.random.default_rng(0).normal(size=truth.shape)
    estimate = 1.05 * truth + [0.1, -0.2, 0.3] + 0.08 * noise
    estimate[missing] = np.nan
    return estimate, truth, pixels


@pytest.mark.parametrize("missing", [[], [3, 40, 41]])
def test_equals_the_reference_scores(score, missing):
    estimate, truth, pixels = fake(missing)
    expected = score.evaluate(str(SEQUENCE), joints=estimate)
    camera = score.json.loads((SEQUENCE / "camera.json").read_text())
    found = joint_errors(torch.tensor(estimate), torch.tensor(truth), camera["fps"])
    assert found.frames == expected["frames_scored"]
    for theirs, ours in NAMES.items():
        if theirs in expected:  # it scores no acceleration when a frame is missing
            assert getattr(found, ours).item() == pytest.approx(expected[theirs], rel=1e-10)
    assert ("accel_err_mm_per_frame2" in expected) == (not missing)
    projected = np.stack(
        [
            score.project(points, *(np.array(camera[k][f]) for k in "KRt"))[0]
            for f, points in enumerate(estimate)
        ]
    )
    error = reprojection_error(torch.tensor(projected), torch.tensor(pixels))
    assert error.item() == pytest.approx(expected["reproj_px"], rel=1e-10)
