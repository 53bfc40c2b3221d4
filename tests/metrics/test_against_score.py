import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from perfcap.metrics import (
    girth_errors,
    joint_errors,
    reprojection_error,
    silhouette_scores,
    surface_distance,
    surface_error,
    vertex_error,
)

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


def load(name):
    before = list(sys.path)
    spec = importlib.util.spec_from_file_location(name, SHARED / f"tools/{name}.py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)  # it puts its folder on the path
    finally:
        sys.path[:] = before
    return module


@pytest.fixture(scope="module")
def score():
    return load("score")


@pytest.fixture(scope="module")
def surfaces():
    """Two frames of a disturbed surface, the truth, its faces."""
    with np.load(SEQUENCE / "gt.npz", allow_pickle=False) as file:
        truth = file["vertices"][:2].astype(float)
    with np.load(SEQUENCE / "template.npz", allow_pickle=False) as file:
        faces = file["faces"].astype(np.int64)
    return truth + 0.03 * np.sin(9 * truth[..., [1, 2, 0]]) + 0.05, truth, faces


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


def test_vertices_and_surfaces_equal_the_reference(score, surfaces):
    found, truth, faces = surfaces
    expected = score.evaluate(str(SEQUENCE), verts=found[:1], frames=[0])
    aligned, absolute = (
        vertex_error(torch.tensor(found[:1]), torch.tensor(truth[:1]), translated=translated)
        for translated in (True, False)
    )
    assert aligned.item() == pytest.approx(expected["vertex_transl_mm"], rel=1e-6)
    assert absolute.item() == pytest.approx(expected["vertex_abs_mm"], rel=1e-6)
    rng = np.random.default_rng(0)
    error = surface_error(found[0], truth[0], faces, rng)
    assert error.vertex == pytest.approx(aligned.item(), rel=1e-9)
    # both draw samples of the surfaces
    assert error.surface == pytest.approx(expected["surface_transl_mm"], rel=0.02)


@pytest.mark.long
def test_masks_equal_the_reference(score):
    frames = [40, 99]
    truth = np.stack(
        [score.cv2.imread(str(SEQUENCE / f"masks/{f:04d}.png"), 0) > 127 for f in frames]
    )
    masks = np.roll(truth, (5, -9), (1, 2))
    expected = score.evaluate(str(SEQUENCE), masks=masks.astype(np.uint8), frames=frames)
    found = silhouette_scores(torch.tensor(masks), torch.tensor(truth))
    assert 100 * found.iou.mean().item() == pytest.approx(expected["segmentation_iou"], rel=1e-12)


def test_several_views_equal_the_reference():
    """Joints, a surface of another topology, and girths of one of several people."""
    folder = SHARED / "data/rendered_multi/dev_views"
    if not folder.is_dir():
        pytest.skip("the rendered sequences with several views are not beside the checkout")
    score = load("score_multi")
    with np.load(folder / "person1/gt.npz", allow_pickle=False) as file:
        joints = file["joints3d"].astype(float)
        truth = np.cumsum(file["vertices_delta"][:1].astype(np.int32), 0).transpose(0, 2, 1)[0]
        truth = truth * float(file["vertices_scale"])
    with np.load(folder / "person1/template.npz", allow_pickle=False) as file:
        faces = file["faces"].astype(np.int64)
    estimate = joints + 0.02 * np.random.default_rng(0).normal(size=joints.shape)
    half = faces[: len(faces) // 2]
    found = 1.01 * truth
    girths = {"chest": 1.0, "waist": 0.85, "belly": 0.9, "hip": 1.1}
    measures = [*girths.values(), np.nan]
    expected = score.evaluate(
        str(folder), [estimate], [found[None]], [half], girths=[measures], every=100
    )
    errors = joint_errors(torch.tensor(estimate), torch.tensor(joints), 30.0)
    for theirs, ours in (("mpjpe_mm", "mpjpe"), ("mpjpe_root_mm", "mpjpe_root")):
        assert getattr(errors, ours).item() == pytest.approx(expected[f"person1.{theirs}"])
    assert errors.mpjpe_similarity.item() == pytest.approx(expected["person1.pa_mpjpe_mm"])
    distance = surface_distance(found, half, truth, faces, np.random.default_rng(0))
    assert distance == pytest.approx(expected["person1.surface_abs_mm"], rel=0.03)
    body = score.json.loads((folder / "person1/truth.json").read_text())
    apart = girth_errors(girths, {name: body[name]["body"] for name in girths})
    for name, error in apart.errors.items():
        assert error == pytest.approx(expected[f"person1.girth_{name}_body_err_mm"])
