"""Networks that find the people of whole images, and searches with them."""

import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tiny_networks import MANIFESTS, body, draw, vitpose, write_model
from tiny_people import SIDE, write_people

from perfcap.detect.joint_set import COCO17, map_to_landmarks
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.people import OnnxFinder
from perfcap.errors import InputError

PLACES = body(17)


def two_people(size: tuple[int, int]) -> tuple[NDArray[np.uint8], np.ndarray]:
    """A frame with one person in each half, and where their joints are, (2, 17, 2)."""
    height, width = size
    tall = 0.8 * min(height, width)
    corners = np.array([[0.05 * width, 0.1 * height], [0.55 * width, 0.1 * height]])
    places = corners[:, None] + tall * PLACES
    radius = 2.4 * max(size) / SIDE
    frame = draw(size, places[0], radius)
    return np.maximum(frame, draw(size, places[1], radius)), places


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_people(tmp_path_factory.mktemp("models"))


@pytest.mark.parametrize("size", [(192, 192), (160, 240), (300, 200)])
def test_people_of_images_of_any_shape_are_found(folder: Path, size: tuple[int, int]) -> None:
    frame, places = two_people(size)
    found = OnnxFinder(folder)(frame)
    assert len(found) == 2, "the row of NaN is no person"
    for look in found:
        errors = [np.linalg.norm(look.joints2d.numpy() - one, axis=-1) for one in places]
        near = min(errors, key=np.median)
        assert np.median(near) < 0.02 * max(size)
        assert (look.confidence > 0.3).float().mean() > 0.8


def test_the_surest_is_first(folder: Path) -> None:
    frame, places = two_people((192, 192))
    for x, y in places[0][:8].astype(int):  # of the left one, joints are covered
        frame[max(0, y - 5) : y + 6, max(0, x - 5) : x + 6] = 0
    first, second = OnnxFinder(folder)(frame)
    assert first.confidence.mean() > second.confidence.mean()
    assert first.joints2d[:, 0].mean() > 96 > second.joints2d[:, 0].mean()


def test_a_fixed_batch_and_a_copy_of_the_finder_answer_alike(folder: Path, tmp_path: Path) -> None:
    frame, _ = two_people((160, 240))
    expected = OnnxFinder(folder)(frame)
    others = [
        OnnxFinder(write_people(tmp_path, batch=2)),
        pickle.loads(pickle.dumps(OnnxFinder(folder))),
    ]
    for other in others:
        for one, same in zip(expected, other(frame), strict=True):
            torch.testing.assert_close(one.joints2d, same.joints2d)
            torch.testing.assert_close(one.confidence, same.confidence)


@pytest.mark.parametrize("nobody", [np.nan, -1.0, 0.0])
def test_rows_of_nobody_are_left_out(tmp_path: Path, nobody: float) -> None:
    frame, _ = two_people((192, 192))
    found = OnnxFinder(write_people(tmp_path, nobody=nobody, rows=4))(frame)
    assert len(found) == 2
    assert all(look.joints2d.isfinite().all() for look in found)


@pytest.mark.parametrize("nobody", [np.inf, 1e30])
def test_joints_far_outside_the_image_count_for_nothing(tmp_path: Path, nobody: float) -> None:
    frame, _ = two_people((192, 192))
    found = OnnxFinder(write_people(tmp_path, nobody=nobody))(frame)
    assert [look.box() is None for look in found] == [True, False, False]
    assert all(look.joints2d.isfinite().all() for look in found)


def refused(make: type[OnnxDetector] | type[OnnxFinder], folder: Path) -> str:
    with pytest.raises(InputError) as error:
        make(folder)
    line = str(error.value)
    assert "\n" not in line and len(line) < 500
    return line


@pytest.mark.parametrize(
    ("details", "change", "words"),
    [
        ({"about": 4}, ("", ""), "(1, 3, 55), expected (1, people, 56)"),
        ({}, ('"y", "x"', '"y", "x", "z"'), "check output.columns and rows"),
        ({"rows": 99}, ("", ""), "has 101 people, expected at most 100"),
        ({}, ('["people"]', '["persons"]'), "the model has people"),
        ({}, ("[192, 192]", "[192, 256]"), "correct input.size"),
        ({}, ('["people"]', '["people", "people"]'), "expected 1 for people: the people"),
        ({}, ('"y", "x", "confidence"', '"y", "confidence"'), "output.columns is"),
    ],
)
def test_what_does_not_fit_is_refused(
    tmp_path: Path, details: dict[str, int], change: tuple[str, str], words: str
) -> None:
    assert words in refused(OnnxFinder, write_people(tmp_path, change, **details))


def test_networks_of_the_other_kind_are_refused(folder: Path, tmp_path: Path) -> None:
    assert "finds the people of whole images" in refused(OnnxDetector, folder)
    crops = write_model(tmp_path, vitpose(), MANIFESTS["vitpose"])
    assert "output.kind is 'heatmaps', expected 'people'" in refused(OnnxFinder, crops)
    changed = write_people(tmp_path)
    text = (changed / "manifest.toml").read_text()
    digest = text[text.index("sha256") :].split('"')[1]
    (changed / "manifest.toml").write_text(text.replace(digest, 64 * "0"))
    assert "has sha256" in refused(OnnxFinder, changed)


def test_a_detector_looks_where_a_finder_finds_people(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unwanted(*_: object) -> None:
        raise AssertionError("windows were searched")

    monkeypatch.setattr("perfcap.detect.search._windows", unwanted)
    detector = OnnxDetector(write_model(tmp_path, vitpose(), MANIFESTS["vitpose"]))
    frame, places = two_people((160, 240))
    images = torch.from_numpy(frame).permute(2, 0, 1)[None, None]
    found = detector(images, finder=OnnxFinder(folder))
    truth = torch.from_numpy(places).float()
    known = map_to_landmarks(truth, torch.ones(2, 17), COCO17)[0]
    seen = found.confidence2d[0, 0] > 0.3
    apart = (found.joints2d[0, 0] - known).norm(dim=-1)[:, seen]
    assert seen.double().mean() > 0.7 and apart.median(-1).values.min() < 1
