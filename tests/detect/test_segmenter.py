"""Networks of person masks: manifests, layouts, crops that turn, and the shipped one."""

from __future__ import annotations

import hashlib
import pickle

import cv2
import numpy as np
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from recordings import demo, demo_motion
from surface_recordings import images_of

from perfcap.detect import OnnxSegmenter
from perfcap.errors import InputError
from perfcap.io import models_folder
from perfcap.pipeline.sight import Sight

SIDE = 64
UPRIGHT = np.array([[0.0, 0.0], [0.0, 1.0]])  # neck above hips


def write(
    folder,
    layout="nchw",
    classes=1,
    person=0,
    activation="sigmoid",
    batch="N",
    pool=2,
    extra="",
    weight=(12.0, -6.0, -6.0, -3.0),
):
    """A network to which red is a person: its map is smaller than its input by ``pool``."""
    shape = [batch, 3, SIDE, SIDE]
    weights = np.zeros((classes, 3, 1, 1), np.float32)
    weights[person] = np.array(weight[:3])[:, None, None]
    bias = np.zeros(classes, np.float32)
    bias[person] = weight[3]
    nodes = [
        helper.make_node("Conv", ["image", "w", "b"], ["fine"]),
        helper.make_node(
            "AveragePool", ["fine"], ["maps"], kernel_shape=[pool] * 2, strides=[pool] * 2
        ),
    ]
    last = "maps"
    if layout == "nhwc":
        nodes.append(helper.make_node("Transpose", ["maps"], ["turned"], perm=[0, 2, 3, 1]))
        last = "turned"
    if layout == "nhw":
        nodes.append(helper.make_node("Squeeze", ["maps", "axis"], ["flat"]))
        last = "flat"
    nodes.append(helper.make_node("Identity", [last], ["mask"]))
    constants = {"w": weights, "b": bias, "axis": np.array([1], np.int64)}
    graph = helper.make_graph(
        nodes,
        "red",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("mask", TensorProto.FLOAT, None)],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 9
    data = model.SerializeToString()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "red.onnx").write_bytes(data)
    (folder / "manifest.toml").write_text(
        f"""kind = "segmenter"
[[file]]
name = "red.onnx"
size = {len(data)}
sha256 = "{hashlib.sha256(data).hexdigest()}"
licence = "own"
[input]
size = [{SIDE}, {SIDE}]
color = "rgb"
scale = {1 / 255}
padding = 1.3
turns = "upright"
flip_test = true
[output]
name = "mask"
layout = "{layout}"
classes = {classes}
person = {person}
activation = "{activation}"
{extra}"""
    )
    return folder


def scene(angle=0.3):
    """A red, lopsided body on a grey ground: image, mask, spine."""
    image = np.full((150, 200, 3), 90, np.uint8)
    mask = np.zeros(image.shape[:2], np.uint8)
    cv2.ellipse(mask, (120, 70), (18, 45), np.degrees(angle), 0, 360, 1, -1)
    cv2.circle(mask, (140, 60), 12, 1, -1)
    image[mask > 0] = (230, 20, 20)
    up = np.array([np.sin(angle), -np.cos(angle)])
    return image, mask > 0, np.array([120.0, 70.0]) + np.outer([30, -10], up)


@pytest.mark.parametrize(
    "kind",
    [
        {},
        {"layout": "nhwc"},
        {"layout": "nhw"},
        {"classes": 3, "person": 2, "activation": "softmax"},
        {"classes": 2, "person": 1},
        {"batch": 1},
        {"pool": 1},
    ],
)
def test_the_person_is_found_whatever_the_layout(tmp_path, kind):
    network = OnnxSegmenter(write(tmp_path, **kind))
    image, truth, spine = scene()
    part = slice(10, 140), slice(60, 190)
    rough = cv2.erode(truth.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    odds = network(image, rough[part], spine, part)
    found = odds > 0
    assert odds.shape == found.shape == (130, 130)
    assert (found & truth[part]).sum() / (found | truth[part]).sum() > 0.9


def test_a_shift_of_the_part_shifts_the_answer(tmp_path):
    network = OnnxSegmenter(write(tmp_path))
    image, truth, spine = scene()
    one, other = (slice(10, 140), slice(60, 190)), (slice(15, 140), slice(70, 190))
    apart = network(image, truth[one], spine, one)[5:, 10:] - network(
        image, truth[other], spine, other
    )
    assert np.abs(apart).max() < 0.2


def test_nobody_and_a_spine_nobody_knows(tmp_path):
    network = OnnxSegmenter(write(tmp_path))
    image, truth, _ = scene()
    part = slice(0, 150), slice(0, 200)
    assert not network(image, np.zeros_like(truth), UPRIGHT, part).any()
    odds = network(image, truth, np.full((2, 2), np.nan), part)
    assert ((odds > 0) & truth).sum() > 0.9 * truth.sum()


def test_it_travels_to_another_process(tmp_path):
    network = OnnxSegmenter(write(tmp_path))
    again = pickle.loads(pickle.dumps(network))
    crops = np.random.default_rng(0).integers(0, 255, (3, SIDE, SIDE, 3)).astype(np.uint8)
    np.testing.assert_array_equal(network.probabilities(crops), again.probabilities(crops))


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ({"activation": "softmax"}, "softmax of one class"),
        ({"activation": "none"}, "expected probabilities; correct output.activation"),
        ({"layout": "nhw", "classes": 2, "person": 1}, "nhw with 2 classes"),
        ({"extra": 'colour = "red"'}, "colour"),
    ],
)
def test_manifests_that_do_not_fit(tmp_path, kind, message):
    write(tmp_path, **kind)
    with pytest.raises(InputError, match=message):
        OnnxSegmenter(tmp_path)


def test_probabilities_are_taken_and_scores_above_one_are_not(tmp_path):
    crops = np.random.default_rng(0).integers(0, 255, (3, SIDE, SIDE, 3)).astype(np.uint8)
    sure = OnnxSegmenter(write(tmp_path / "a", activation="none", weight=(0.3, 0.3, 0.3, 0)))
    assert 0 < sure.probabilities(crops).max() < 1
    write(tmp_path / "b", activation="none", weight=(6, 6, 6, 0))
    with pytest.raises(InputError, match="is 18 to 18, expected probabilities"):
        OnnxSegmenter(tmp_path / "b").probabilities(np.full_like(crops, 255))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [("classes = 3", "expected nchw of 3 classes"), ("classes = 1", "output.person is 1 of 1")],
)
def test_classes_that_are_not_there(tmp_path, wrong, message):
    write(tmp_path, classes=2, person=1)
    path = tmp_path / "manifest.toml"
    path.write_text(path.read_text().replace("classes = 2", wrong))
    with pytest.raises(InputError, match=message):
        OnnxSegmenter(tmp_path)


def test_a_detector_is_no_segmenter():
    with pytest.raises(InputError, match="give a folder of a segmenter"):
        OnnxSegmenter(models_folder() / "detectors" / "blazepose")


@pytest.mark.long
def test_the_shipped_one_finds_the_dancer():
    network = OnnxSegmenter(models_folder() / "detectors" / "blazepose" / "segmenter.toml")
    dancer = demo()
    images, motion = images_of(dancer), demo_motion()
    faces = torch.as_tensor(dancer.actor.template.faces.copy())
    sight = Sight(images.cameras, faces, dancer.actor.template.weld()[0])
    span = slice(40, 41)
    with torch.no_grad():
        truth = sight.look(dancer.actor.surface(motion[span]), span)[0][0].mask
        joints = images.cameras.project(dancer.actor.joints(motion[span]))[0, 0].numpy()
    spine = np.stack((joints[1], joints[[8, 12]].mean(0)))
    whole = slice(0, truth.shape[0]), slice(0, truth.shape[1])
    found = network(images.reader.read_view(0, 40, 41)[0], truth, spine, whole) > 0
    assert (found & truth).sum() / (found | truth).sum() > 0.85


def test_shares_whole_models_and_other_spines_are_refused(tmp_path):
    network = OnnxSegmenter(write(tmp_path))
    image, truth, spine = scene()
    part = slice(10, 140), slice(60, 190)
    network(image, truth[part], spine, part)
    for given, model, bone, words in (
        (image / 255, truth[part], spine, "image is"),
        (image, truth, spine, "model has shape"),
        (image, truth[part], spine[0], "spine has shape"),
    ):
        with pytest.raises(InputError, match=words):
            network(given, model, bone, part)
