"""Exported lifters: equal to torch, and what onnxruntime makes of real tracks."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import onnx
import pytest
import torch
from takes import make_take, without

from perfcap.detect import lifter as lifter_module
from perfcap.detect.detections import Detections
from perfcap.detect.lifter import OnnxLifter
from perfcap.detect.lifting import lifting_features
from perfcap.errors import InputError
from perfcap.train import export as export_module
from perfcap.train.config import LifterConfig
from perfcap.train.export import check_equal, export_lifter
from perfcap.train.lifter import Lifter

CONFIG = LifterConfig(channels=16, dilations=(1, 3))


@pytest.fixture(scope="module")
def network() -> Lifter:
    torch.manual_seed(0)
    return Lifter(CONFIG).eval()


@pytest.fixture(scope="module")
def folder(network: Lifter, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("models") / "small"
    export_lifter(network, place, 30.0, 'made in a "test"', "Apache-2.0")
    return place


@pytest.mark.long
def test_export_is_whole_valid_and_says_nothing_of_this_machine(folder: Path) -> None:
    assert sorted(p.name for p in folder.iterdir()) == ["manifest.toml", "model.onnx"]
    onnx.checker.check_model(onnx.load(folder / "model.onnx"), full_check=True)
    assert not re.search(rb"\.py\b|/home|/tmp|site-packages", (folder / "model.onnx").read_bytes())


@pytest.mark.long
def test_lifting_equals_torch(network: Lifter, folder: Path) -> None:
    take = make_take(40, views=2)
    found = take.detections
    plane = take.cameras.to_plane(found.joints2d).float().transpose(0, 1)
    features, turn = lifting_features(plane, found.confidence2d.float().transpose(0, 1))
    with torch.no_grad():
        expected, error = network(features)
    lifter = OnnxLifter(folder, flip_test=False)
    for rate in (24.0, 30.0, 44.0):
        joints, spread = lifter.lift(found, take.cameras, rate)
        turned = (expected @ turn.mT).transpose(0, 1).double()
        torch.testing.assert_close(joints, turned, atol=1e-4, rtol=0)
        torch.testing.assert_close(spread, error.transpose(0, 1).double(), atol=1e-4, rtol=0)


@pytest.mark.long
def test_other_rates_are_tracks_of_the_usual_one(folder: Path) -> None:
    """At twice the rate a frame is the mean of its own track and of the other's between."""
    take = make_take(41)
    lifter = OnnxLifter(folder)
    both = lifter.lift(take.detections, take.cameras, 60.0)[0]
    even, odd = (
        lifter.lift(take.detections.frames(slice(p, None, 2)), take.cameras, 30.0)[0]
        for p in (0, 1)
    )
    torch.testing.assert_close(both[2:40:2], 0.5 * even[1:20] + 0.25 * (odd[:-1] + odd[1:]),
                               atol=1e-5, rtol=0)  # fmt: skip
    for rate in (100.0, 3000.0):
        assert lifter.lift(take.detections, take.cameras, rate)[0].isfinite().all()


def test_long_tracks_in_parts(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = make_take(50)
    lifter = OnnxLifter(folder)
    whole = lifter.lift(take.detections, take.cameras, 30.0)
    monkeypatch.setattr(lifter_module, "_CHUNK", 7)
    parts = lifter.lift(take.detections, take.cameras, 30.0)
    torch.testing.assert_close(whole, parts, atol=1e-6, rtol=0)


def test_flip_test_makes_mirror_images_of_mirror_images(folder: Path) -> None:
    take = make_take(20)
    lifter, mirrored = OnnxLifter(folder), list(lifter_module._MIRRORED)
    found = take.detections
    middle = take.cameras.intrinsics[..., 0, 2]
    flipped = found.joints2d[..., mirrored, :].clone()
    flipped[..., 0] = 2 * middle[..., None] - flipped[..., 0]
    mirror = replace(found, joints2d=flipped, confidence2d=found.confidence2d[..., mirrored])
    straight, _ = lifter.lift(found, take.cameras, 30.0)
    other, _ = lifter.lift(mirror, take.cameras, 30.0)
    back = other[..., mirrored, :] * torch.tensor([-1.0, 1, 1], dtype=torch.float64)
    torch.testing.assert_close(back, straight, atol=1e-5, rtol=0)


def test_more_is_expected_where_a_track_and_its_mirror_image_differ(folder: Path) -> None:
    take, order = make_take(20), list(lifter_module._MIRRORED)
    plane = take.cameras.to_plane(take.detections.joints2d).float().transpose(0, 1)
    sure = take.detections.confidence2d.float().transpose(0, 1)
    flip = torch.tensor([-1.0, 1.0, 1.0])
    both, one = OnnxLifter(folder), OnnxLifter(folder, flip_test=False)
    joints, spread = both.lift_tracks(plane, sure)
    mirror, other = one.lift_tracks(plane[..., order, :] * flip[:2], sure[..., order])
    straight, own = one.lift_tracks(plane, sure)
    mirror, other = mirror[..., order, :] * flip, other[..., order]
    torch.testing.assert_close(joints, 0.5 * (straight + mirror), atol=1e-5, rtol=0)
    apart = (0.5 * (straight - mirror)).square().sum(-1)
    assert apart.max() > 1e-6  # a network that has learned nothing
    expected = (0.5 * (own.square() + other.square()) + apart).sqrt()
    torch.testing.assert_close(spread, expected, atol=1e-5, rtol=0)


def test_frames_with_3d_keep_it_and_those_of_nobody_are_not_trusted(folder: Path) -> None:
    take = make_take(12, views=2)
    found = take.detections
    assert found.joints3d is not None
    trusted = found.trusted3d.clone()
    trusted[:, 1] = trusted[8:] = False
    some = without(replace(found, trusted3d=trusted), slice(3, 5))
    lifted = OnnxLifter(folder)(some, take.cameras, 30.0)
    assert lifted.joints3d is not None
    assert torch.equal(lifted.joints3d[:8, 0], found.joints3d[:8, 0])
    others = (lifted.joints3d != found.joints3d).flatten(2).any(-1)
    assert others[8:, 0].all() and others[:3, 1].all() and others[5:, 1].all()
    expected = torch.ones(12, 2, dtype=torch.bool)
    expected[3:5] = False
    assert torch.equal(lifted.trusted3d, expected)
    plain = Detections.from_joints(found.joints2d, found.confidence2d)
    assert OnnxLifter(folder)(plain, take.cameras, 30.0).trusted3d.all()


def test_no_frames(folder: Path) -> None:
    take = make_take(4)
    nothing = OnnxLifter(folder).lift(take.detections.frames(slice(0)), take.cameras, 30.0)
    assert nothing[0].shape == (0, 1, 16, 3) and nothing[1].shape == (0, 1, 16)


def test_an_export_that_differs_is_refused(folder: Path) -> None:
    torch.manual_seed(1)
    other = Lifter(CONFIG).eval()
    with pytest.raises(InputError, match="differs from torch by"):
        check_equal(other, (folder / "model.onnx").read_bytes())
    torch.nn.init.constant_(next(other.parameters()), float("inf"))
    with pytest.raises(InputError, match="not finite; train again with a lower learning rate"):
        check_equal(other, (folder / "model.onnx").read_bytes())


def edit(before: str, after: str) -> Callable[[str], str]:
    return lambda text: text.replace(before, after, 1)


FAULTS = {
    "rate": (edit("rate = 30", "rate = 0"), "input.rate is 0"),
    "reach": (edit("reach = 4", "reach = -1"), "input.reach is -1"),
    "output": (edit('joints = "joints"', 'joints = "poses"'), "the model has joints, spread"),
    "swapped": (edit('joints = "joints"', 'joints = "spread"'), "has shape (1, 5, 16)"),
    "unknown": (edit("[output]", "[output]\nunit = 1"), "output.unit is unknown"),
    "kind": (edit('"lifter"', '"detector"'), "expected 'lifter'"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_manifests(folder: Path, tmp_path: Path, fault: str) -> None:
    change, words = FAULTS[fault]
    (tmp_path / "model.onnx").write_bytes((folder / "model.onnx").read_bytes())
    (tmp_path / "manifest.toml").write_text(change((folder / "manifest.toml").read_text()))
    with pytest.raises(InputError, match=re.escape(words)):
        OnnxLifter(tmp_path)


def test_a_detector_is_no_lifter(tmp_path: Path) -> None:
    from tiny_networks import write_tiny

    with pytest.raises(InputError, match="expected 'lifter'"):
        OnnxLifter(write_tiny(tmp_path, "vitpose"))


def test_without_the_exporter(
    network: Lifter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "onnxscript", None)
    with pytest.raises(InputError, match=r"perfcap\[train\]"):
        export_lifter(network, tmp_path / "x", 30.0, "", "")
    assert not (tmp_path / "x").exists() and export_module.TOLERANCE == 1e-4
