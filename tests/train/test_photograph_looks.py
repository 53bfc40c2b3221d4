"""What a network sees in photographs, against the joints that are marked in them."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from perfcap.detect.decode import Estimate
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError
from perfcap.io.actor import models_folder
from perfcap.train.photograph_looks import photograph_doubts
from perfcap.train.photographs import Annotation, read_annotations

LSPET = Path(__file__).parents[3] / "shared" / "data" / "lspet"
OPPOSITE = list(LANDMARKS16.mirrored())
WIDTH, HEIGHT = 160, 120


class Reader:
    """Sees joints as spots of their own brightness."""

    manifest = SimpleNamespace(input=SimpleNamespace(size=(192, 192), padding=1.25))
    joint_set = LANDMARKS16

    def estimate(self, crops: NDArray[np.uint8]) -> Estimate:
        found = np.zeros((len(crops), 16, 2), np.float32)
        for row, crop in enumerate(crops):
            y, x = np.nonzero(crop[..., 1] > 250)
            joint = np.rint((crop[y, x, 0] - 20.0) / 14).astype(int).clip(0, 15)
            count = np.bincount(joint, minlength=16).clip(min=1)
            found[row] = np.stack([np.bincount(joint, v, 16) / count for v in (x, y)], -1)
        return Estimate(torch.from_numpy(found), torch.ones(len(crops), 16), None)


def shade(joint: int) -> int:
    return 20 + 14 * joint


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> list[Annotation]:
    """Joints in the cells of a grid, in another order each time."""
    rng, folder, people = np.random.default_rng(0), tmp_path_factory.mktemp("photographs"), []
    for number in range(60):
        cells = rng.permutation(16)
        joints = np.stack([20 + 18 * (cells % 4), 20 + 18 * (cells // 4)], -1).astype(np.float32)
        image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        for joint, (x, y) in enumerate(joints):
            cv2.circle(image, (int(x), int(y)), 5, (0, 255, shade(joint)), -1)  # B G R
        path = folder / f"{number}.png"
        cv2.imwrite(str(path), image)
        people.append(Annotation(path, joints))
    return people


def doubts(people: list[Annotation], network: object = None) -> list[str]:
    return [*photograph_doubts(Path("a.json"), network or Reader(), people)]  # type: ignore[arg-type]


def moved(people: list[Annotation], how: object) -> list[Annotation]:
    return [replace(each, joints2d=how(each.joints2d)) for each in people]  # type: ignore[operator]


def mirrored(joints: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray([WIDTH - 1, 0] + joints * [-1, 1], np.float32)


def test_joints_where_they_are_seen_are_believed(people: list[Annotation]) -> None:
    assert not doubts(people)
    unknown = np.full((60, 16, 1), np.nan)
    unknown[:, [1, 2, 5, 8, 9, 12, 13]] = 0  # others are not visible
    assert not doubts(
        [replace(p, joints2d=p.joints2d + u) for p, u in zip(people, unknown, strict=True)]
    )


@pytest.mark.long
def test_sides_and_mirror_images_are_refused(people: list[Annotation]) -> None:
    with pytest.raises(InputError, match="100% of the joints where those of the other side"):
        doubts(moved(people, lambda joints: joints[OPPOSITE]))
    for how in (mirrored, lambda joints: mirrored(joints)[OPPOSITE]):
        with pytest.raises(InputError, match="in mirror images of the photographs 100%"):
            doubts(moved(people, how))


@pytest.mark.long
def test_joints_of_others_are_warned_of(people: list[Annotation]) -> None:
    others = [
        replace(a, joints2d=b.joints2d)
        for a, b in zip(people, people[1:] + people[:1], strict=True)
    ]
    (said,) = doubts(others)
    assert "pixels of these very photographs" in said and "of the list" not in said
    assert len(doubts(moved(people, lambda joints: joints + 15))) == 1
    assert not doubts(others[:19])  # too few to say anything
    (said,) = doubts(people * 3 + others + people * 3)
    assert said.startswith("a.json: in people 180 to 239 of the list, a network sees")


@pytest.mark.slow
@pytest.mark.skipif(not LSPET.is_dir(), reason="the photographs are not here")
def test_real_photographs() -> None:
    network = OnnxDetector(models_folder() / "detectors" / "lightning", flip_test=False)
    known = [*read_annotations(LSPET)][::12]
    assert not doubts(known, network)
    with pytest.raises(InputError, match="where those of the other side are marked"):
        doubts(moved(known, lambda joints: joints[OPPOSITE]), network)
    assert doubts(moved(known, lambda joints: 0.9 * joints), network)
