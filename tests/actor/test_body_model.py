"""Body models from arrays: shape to rigged template, shipped and users' own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import synthetic
import torch

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.body_model import BodyModel
from perfcap.errors import InputError
from perfcap.io.body_model import load_body_model

Arrays = dict[str, np.ndarray[Any, Any]]


def arrays() -> Arrays:
    """The synthetic person with two components: everything taller, everything wider."""
    template = synthetic.actor().template
    positions = template.bone_rest[:, :3, 3]
    grow = np.stack((np.diag([0.0, 0.1, 0.0]), np.diag([0.05, 0.0, 0.05])))
    marks = template.landmarks
    nearest = {n: ((template.vertices - p) ** 2).sum(1).argmin() for n, (_, p) in marks.items()}
    return {
        "vertices": template.vertices,
        "faces": template.faces,
        "shape_basis": template.vertices @ grow,
        "bone_names": np.array(template.bone_names),
        "bone_parents": template.bone_parents,
        "bone_positions": positions,
        "bone_basis": positions @ grow,
        "weights": template.dense_weights(),
        "landmark_names": np.array(list(marks), dtype=np.str_),
        "landmark_bones": np.array([bone for bone, _ in marks.values()], dtype=np.int64),
        "landmark_vertices": np.array([[v] for v in nearest.values()], dtype=np.int64),
        "licence": np.array("CC0-1.0"),
    }


def test_shape_gives_a_moving_actor() -> None:
    model = BodyModel.from_arrays(arrays())
    tall = torch.tensor([1.0, 0.0]).double()
    actor = model.actor(tall)
    ratio = np.ptp(actor.template.vertices[:, 1]) / np.ptp(arrays()["vertices"][:, 1])
    assert ratio == pytest.approx(1.1)
    assert actor.template.vertices[:, 1].min() == pytest.approx(0.0)
    posed = actor.surface(actor.skeleton.rest_motion())[0]
    assert torch.allclose(posed, actor.vertices, atol=1e-12)


def test_is_differentiable_in_shape() -> None:
    model = BodyModel.from_arrays(arrays())
    shape = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    (model.vertices(shape).square().sum() + model.joints(shape).square().sum()).backward()
    assert shape.grad is not None and bool((shape.grad.abs() > 0).all())


def test_batch_equals_loop() -> None:
    model = BodyModel.from_arrays(arrays())
    shapes = torch.tensor([[0.5, -1.0], [2.0, 0.3]]).double()
    for one, many in zip(shapes, model.vertices(shapes), strict=True):
        assert torch.allclose(model.vertices(one), many)


def test_a_regressor_stands_in_for_bones() -> None:
    given = arrays()
    vertices = given["vertices"]
    # least squares: any rows that reproduce the bones from vertices
    lifted = np.c_[vertices, np.ones(len(vertices))]
    target = np.c_[given.pop("bone_positions"), np.ones(len(given["bone_names"]))]
    given.pop("bone_basis")
    given["joint_regressor"] = np.linalg.lstsq(lifted.T, target.T, rcond=None)[0].T
    model, direct = BodyModel.from_arrays(given), BodyModel.from_arrays(arrays())
    shape = torch.tensor([0.7, -0.4]).double()
    assert torch.allclose(model.joints(shape), direct.joints(shape), atol=1e-9)


def test_sparse_weights_equal_dense_ones() -> None:
    given = arrays()
    dense = given["weights"]
    order = np.argsort(-dense, 1)[:, :4]
    given["weights"], given["weight_bones"] = np.take_along_axis(dense, order, 1), order
    first = BodyModel.from_arrays(arrays()).template(torch.zeros(2))
    second = BodyModel.from_arrays(given).template(torch.zeros(2))
    assert np.allclose(first.dense_weights(), second.dense_weights())


def test_texture_corners_split_vertices() -> None:
    given = arrays()
    count = given["faces"].size
    given["uv"] = np.random.default_rng(0).uniform(size=(count, 2))
    given["faces_uv"] = np.arange(count).reshape(-1, 3)
    template = BodyModel.from_arrays(given).template(torch.zeros(2))
    assert template.uv is not None and len(template.vertices) >= count
    corners = template.vertices[template.faces]
    floor = given["vertices"][:, 1].min()
    assert np.allclose(corners, given["vertices"][given["faces"]] - (0, floor, 0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vertices": None}, "lacks vertices"),
        ({"bone_basis": None}, "give one of the two"),
        ({"bone_names": np.array([1, 2])}, "list of texts"),
        ({"faces": np.array([[0.0, 1.0, 2.0]])}, "expected integers"),
        ({"shape_basis": np.full((2, 3), 0.0)}, "shape_basis"),
        ({"joint_regressor": np.ones((2, 3))}, "joint_regressor"),
        ({"landmark_vertices": np.array([[10**6]] * 3)}, "landmark"),
        ({"bone_positions": np.full((19, 3), np.nan)}, "NaN"),
    ],
)
def test_bad_arrays_are_named(change: Arrays, words: str) -> None:
    given = {k: v for k, v in {**arrays(), **change}.items() if v is not None}
    with pytest.raises(InputError, match=words):
        BodyModel.from_arrays(given)


def test_npz_and_safetensors_agree(tmp_path: Path) -> None:
    save_file = pytest.importorskip("safetensors.numpy", reason="no safetensors").save_file
    given = arrays()
    np.savez(tmp_path / "mine.npz", **given)
    texts = {k: given[k] for k in ("bone_names", "landmark_names", "licence")}
    numbers = {k: np.ascontiguousarray(v) for k, v in given.items() if k not in texts}
    metadata = {k: repr(v.tolist()).replace("'", '"') for k, v in texts.items() if v.ndim}
    save_file(numbers, tmp_path / "mine.safetensors", {**metadata, "licence": "CC0-1.0"})
    first = load_body_model(tmp_path / "mine.npz")
    second = load_body_model(tmp_path / "mine.safetensors")
    shape = torch.tensor([0.2, 0.9]).double()
    assert torch.equal(first.vertices(shape), second.vertices(shape))
    assert first.rig.licence == second.rig.licence == "CC0-1.0"


def test_damaged_safetensors_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.safetensors"
    for data in (b"\xff" * 9, b"\x02" + bytes(7) + b"{]", b"\x02" + bytes(7) + b"[]"):
        path.write_bytes(data)
        with pytest.raises(InputError, match="cannot be read as safetensors"):
            load_body_model(path)


def test_bodies_in_other_units_are_refused(tmp_path: Path) -> None:
    values = arrays()
    lengths = ("vertices", "shape_basis", "bone_positions", "bone_basis")
    scaled = {name: 100 * v if name in lengths else v for name, v in values.items()}
    np.savez(tmp_path / "a.npz", **scaled)
    with pytest.raises(InputError, match="long; expected a person in metres"):
        load_body_model(tmp_path / "a.npz")


def test_unknown_names_list_what_is_shipped() -> None:
    with pytest.raises(InputError, match="ada"):
        load_body_model("nobody")


def test_the_shipped_body_is_a_person() -> None:
    model = load_body_model()
    template = model.template(torch.zeros(model.components))
    assert set(JOINTS) <= set(template.bone_names)
    assert template.texture is not None
    assert 1.6 < np.ptp(template.vertices[:, 1]) < 1.85
    extents = [np.ptp(model.vertices(s * torch.eye(20)[0].double())[:, 1].numpy()) for s in (-1, 1)]
    assert abs(extents[1] - extents[0]) > 0.1  # the first component is mostly stature


def test_a_body_is_saved_and_loaded(tmp_path: Path) -> None:
    from perfcap.actor.actor import Actor
    from perfcap.io import load_actor, save_actor

    actor = Actor(load_body_model().template(torch.zeros(0)).rounded())
    save_actor(actor, tmp_path / "me")
    again = load_actor(tmp_path / "me")
    assert torch.allclose(again.skeleton.rest_landmarks, actor.skeleton.rest_landmarks, atol=1e-6)


@pytest.mark.parametrize(
    "change",
    [
        {"weights": np.zeros((7, 2))},
        {"weights": np.array(1.0)},
        {"faces": np.array([[0, 1, 10**6]])},
        {"faces": np.array(3)},
        {"bone_names": np.array("x")},
        {"vertices": np.array(0.5)},
        {"shape_deviation": np.array(1.0)},
        {"bone_parents": np.array(0)},
    ],
)
def test_arrays_that_do_not_fit_one_another(change: dict[str, np.ndarray]) -> None:
    """Found by tools/fuzz.py."""
    from perfcap.io.archive import read_archive
    from perfcap.io.body_model import ARRAYS, models_folder

    arrays = read_archive(models_folder() / "bodies" / "ada" / "body.npz", ARRAYS, "a body")
    with pytest.raises(InputError):
        BodyModel.from_arrays({**arrays, **change})
