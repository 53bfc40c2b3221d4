"""A model or manifest that cannot be used is one line that names the field and the remedy."""

import os
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper
from tiny_networks import MANIFESTS, MODELS, vitpose, write_model, write_tiny

from perfcap.detect import onnx_file
from perfcap.detect.manifest import read_manifest
from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError


def refused(folder: Path) -> str:
    with pytest.raises(InputError) as error:
        OnnxDetector(folder)
    line = str(error.value)
    assert "\n" not in line and len(line) < 500
    return line


FAULTS = {
    "kind": ("vitpose", 'kind = "heatmaps"', 'kind = "heat"', "output.kind is 'heat'"),
    "names": ("rtmpose", '["simcc_x", "simcc_y"]', '["simcc_x"]', "expected 2 for simcc"),
    "bins": ("rtmpose", "split = 2.0", "split = 1.0", "expected 96 bins: output.split of them"),
    "x for y": ("rtmpose", '["simcc_x", "simcc_y"]', '["simcc_y", "simcc_x"]',
                "names of x and then of y"),
    "unknown output": ("vitpose", '["heatmaps"]', '["maps"]', "the model has heatmaps"),
    "unknown 3d": ("mediapipe", '"world"', '"earth"', "output.joints3d names output 'earth'"),
    "size": ("vitpose", "[128, 96]", "[96, 128]", "correct input.size or input.layout"),
    "odd size": ("vitpose", "[128, 96]", "[128]", "input.size is [128]; expected 2 numbers"),
    "layout": ("vitpose", "[output]", 'layout = "nhwc"\n[output]', "input.layout"),
    "dtype": ("vitpose", "[output]", 'dtype = "float16"\n[output]', "the model wants float32"),
    "bytes": ("vnect", '"uint8"', '"uint8"\nscale = 0.1', "input.dtype is uint8 with a scale"),
    "color": ("vitpose", '"rgb"', '"grey"', "input.color is 'grey'; expected one of rgb, bgr"),
    "no color": ("vitpose", 'color = "rgb"', "", "input.color is missing"),
    "std": ("vitpose", "[58.395,", "[0.0,", "three numbers above 0"),
    "misspelt": ("vitpose", "decode", "decoder", "output.decoder is unknown; expected one of"),
    "table": ("vitpose", "[calibration]", "[calibrations]", "calibrations is unknown"),
    "set": ("vitpose", '"COCO-17"', '"COCO"', "joints.set is 'COCO'"),
    "another set": ("vitpose", '"COCO-17"', '"LSP"', "expected 14 maps"),
    "hips": ("vitpose", 'set = "COCO-17"', 'names = ["nose", "l_hip"]', "lacks r_hip"),
    "twice": ("vitpose", 'set = "COCO-17"', 'names = ["l_hip", "LHip"]',
              "a joint twice (l_hip and LHip)"),
    "both": ("vitpose", "[joints]", '[joints]\nnames = ["l_hip"]', "one of them"),
    "rank": ("vitpose", '"heatmaps"\nnames', '"coordinates"\nnames', "17 x 3 numbers a crop"),
    "maps of rank": ("direct", '"joints3d"\njoints3d = "pose"', '"heatmaps"\nnames = ["pose"]',
                     "maps of rank 4"),
    "rows": ("mediapipe", "rows = 39", "rows = 33", "expected 33 x 5 numbers"),
    "columns": ("mediapipe", '"z"', '"depth"', "output.columns is"),
    "signs": ("direct", "metres", "signs3d = [1, 2, 1]\nmetres", "three of 1 and -1"),
    "error in mm": ("direct", "metres", "error3d = 60\nmetres", "expected metres, 1 at most"),
    "calibration": ("vitpose", "[0.0, 0.1]", "[0.1, 0.0]", "numbers that rise"),
    "probability": ("vitpose", "[0.0, 1.0]", "[0.0, 1.5]", "0 to 1, none falling"),
    "toml": ("vitpose", "[joints]", "[joints", "is not TOML"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_manifests(tmp_path: Path, fault: str) -> None:
    name, before, after, words = FAULTS[fault]
    assert words in refused(write_tiny(tmp_path, name, (before, after)))


HEAD_FAULTS = {
    "digest": ("sha256 = ", 'sha256 = "ab', "sha256"),
    "elsewhere": ('name = "model.onnx"', 'name = "../model.onnx"', "the name of a file"),
    "licence": ("licence", "license", "licence is missing"),
    "no model": ('name = "model.onnx"', 'name = "model.bin"', "lists 0 .onnx files"),
    "absent": ('name = "model.onnx"', 'name = "other.onnx"', "no such file"),
    "kind": ('kind = "detector"', 'kind = "lifter"', "expected 'detector'"),
}


@pytest.mark.parametrize("fault", HEAD_FAULTS)
def test_faults_of_the_file_entry(tmp_path: Path, fault: str) -> None:
    before, after, words = HEAD_FAULTS[fault]
    folder = write_tiny(tmp_path, "vitpose")
    manifest = folder / "manifest.toml"
    text = manifest.read_text().replace(before, after, 1)
    manifest.write_text(text.replace('"ab"', '"ab', 1))
    assert words in refused(folder)


def test_a_folder_without_manifest(tmp_path: Path) -> None:
    assert "expected a manifest beside the model" in refused(tmp_path)


def test_a_model_that_changed(tmp_path: Path) -> None:
    folder = write_tiny(tmp_path, "vitpose")
    with (folder / "model.onnx").open("ab") as file:
        file.write(b"\x00")
    assert "not an ONNX model" in refused(folder)
    (folder / "model.onnx").write_bytes(vitpose(joints=16).SerializeToString())
    assert "restore the model" in refused(folder)


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04" + bytes(100), b"hello " * 50, bytes(64)])
def test_files_that_are_not_onnx(tmp_path: Path, data: bytes) -> None:
    assert "is not an ONNX model" in refused(write_model(tmp_path, data, MANIFESTS["vitpose"]))


def test_a_model_cut_short(tmp_path: Path) -> None:
    data = vitpose().SerializeToString()
    for length in range(1, len(data), len(data) // 7):
        folder = write_model(tmp_path / str(length), data[:length], MANIFESTS["vitpose"])
        assert "model.onnx: " in refused(folder)


def test_an_unknown_operator_and_a_future_opset(tmp_path: Path) -> None:
    model = vitpose()
    model.graph.node[0].op_type = "Convolve"
    assert "uses operator Convolve" in refused(
        write_model(tmp_path / "a", model, MANIFESTS["vitpose"])
    )
    model = vitpose()
    model.opset_import[0].version = 999
    assert "older opset" in refused(write_model(tmp_path / "b", model, MANIFESTS["vitpose"]))


def test_a_model_of_two_images(tmp_path: Path) -> None:
    model = vitpose()
    second = helper.make_tensor_value_info("other", onnx.TensorProto.FLOAT, [1])
    model.graph.input.append(second)
    assert "the model's only one" in refused(write_model(tmp_path, model, MANIFESTS["vitpose"]))


def test_large_models_are_refused_before_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_tiny(tmp_path, "vitpose")
    monkeypatch.setattr(onnx_file, "LIMIT", 1000)
    assert "expected at most" in refused(folder)


# --- weights outside the file ---------------------------------------------------------------------


def external(tmp_path: Path, location: str) -> Path:
    """A model whose weights are in ``tmp_path/model/weights.bin``, said to be elsewhere."""
    folder = tmp_path / "model"
    folder.mkdir(exist_ok=True)
    onnx.save(
        vitpose(),
        folder / "plain.onnx",
        save_as_external_data=True,
        location="weights.bin",
        size_threshold=0,
    )
    model = onnx.load(folder / "plain.onnx", load_external_data=False)
    (folder / "plain.onnx").unlink()
    for tensor in model.graph.initializer:
        for entry in tensor.external_data:
            if entry.key == "location":
                entry.value = location
    return write_model(folder, model, MANIFESTS["vitpose"])


def test_weights_beside_the_model_are_found_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = external(tmp_path, "weights.bin")
    monkeypatch.chdir(tmp_path)
    crops = np.random.default_rng(0).integers(0, 255, (1, 128, 96, 3), np.uint8)
    plain = OnnxDetector(write_tiny(tmp_path, "vitpose")).estimate(crops)
    assert (OnnxDetector(folder).estimate(crops).joints2d == plain.joints2d).all()


@pytest.mark.parametrize("location", ["../secret.bin", "/etc/hostname", "sub/../../secret.bin"])
def test_weights_outside_the_folder(tmp_path: Path, location: str) -> None:
    (tmp_path / "secret.bin").write_bytes(bytes(10_000))
    assert "outside its folder" in refused(external(tmp_path, location))


def test_a_link_that_leads_outside(tmp_path: Path) -> None:
    folder = external(tmp_path, "link.bin")
    os.symlink(tmp_path / "secret.bin", folder / "link.bin")
    (tmp_path / "secret.bin").write_bytes(bytes(10_000))
    assert "outside its folder" in refused(folder)


def test_missing_weights(tmp_path: Path) -> None:
    assert "which is missing" in refused(external(tmp_path, "gone.bin"))


def test_weights_hidden_in_a_subgraph_are_seen() -> None:
    tensor = onnx.TensorProto(name="w", data_type=1, dims=[1])
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="hidden.bin")
    inner = helper.make_graph([helper.make_node("Constant", [], ["c"], value=tensor)], "in", [], [])
    branch = helper.make_node("If", ["x"], ["y"], then_branch=inner, else_branch=inner)
    model = helper.make_model(helper.make_graph([branch], "g", [], []))
    assert set(onnx_file.external_names(model.SerializeToString())) == {"hidden.bin"}


@pytest.mark.parametrize("name", MODELS)
def test_manifests_read_as_written(tmp_path: Path, name: str) -> None:
    manifest = read_manifest(write_tiny(tmp_path, name))
    assert manifest.file.licence == "Apache-2.0"
    assert read_manifest(manifest.path) == manifest
