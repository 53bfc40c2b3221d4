"""``perfcap models try``: networks whose manifests are right, and have one thing wrong."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from runs import Command

from perfcap.app.network_trial import try_network
from perfcap.app.networks import open_networks
from perfcap.detect.decode import Estimate
from perfcap.detect.joint_set import COCO17, find_joint_set
from perfcap.detect.onnx import OnnxDetector
from perfcap.errors import InputError
from perfcap.io.actor import models_folder

SLOW = pytest.mark.slow
DETECTORS = models_folder() / "detectors"


def spoilt(folder: Path, name: str, old: str, new: str) -> Path:
    """A shipped network whose manifest has something else."""
    shutil.copytree(DETECTORS / name, folder / name)
    manifest = folder / name / "manifest.toml"
    text = manifest.read_text()
    assert old in text
    manifest.write_text(text.replace(old, new))
    return folder / name


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["lightning", *(pytest.param(name, marks=SLOW) for name in ("blazepose", "rendered"))]
)
def test_right_manifests_are_not_doubted(perfcap: Command, name: str) -> None:
    outcome = perfcap(["models", "try", name])
    assert outcome.code == 0 and "of the person off (median), 9" in outcome.out
    assert "to check" not in outcome.out


WRISTS = [{"l_wrist": "r_wrist", "r_wrist": "l_wrist"}.get(n, n) for n in COCO17.joints]
ANCLES = [n.replace("ankle", "ancle") for n in COCO17.joints]
LOW = "\n[calibration]\nraw = [0.0, 1.0]\nprobability = [0.0, 0.2]"
SIDES = [{"l_": "r_", "r_": "l_"}.get(n[:2], n[:2]) + n[2:] for n in COCO17.joints]


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("lightning", '"rgb"', '"bgr"', 'with color = "rgb" they are 1.9 % off'),
        ("lightning", "padding = 1.1", "padding = 1.1\nscale = 0.0039", "with values 0 to 255"),
        ("blazepose", "scale = 0.00392156862745098", "", "with values 0 to 1 (scale = 0.00392157)"),
        pytest.param(
            "multipose", '"y", "x"', '"x", "y"', "columns = ['y', 'x', 'confidence']", marks=SLOW
        ),
        ("lightning", 'set = "COCO-17"', f"names = {SIDES}", "have left and right exchanged"),
        ("lightning", 'set = "COCO-17"', f"names = {WRISTS}", "r_wrist is where l_wrist is"),
        ("lightning", 'set = "COCO-17"', f"names = {ANCLES}", "it sees no r_ankle, l_ankle; are"),
        ("lightning", "padding = 1.1", "padding = 2.0", "with padding = 1.25 they are 1.9 % off"),
        (
            "rendered",
            "[output]",
            "padding = 2.0\n[output]",
            "with padding = 1.25 they are 1.5",
        ),
        ("lightning", '"confidence"', '"ignored"', "output.columns has no confidence, so that"),
        ("lightning", 'set = "COCO-17"', f'set = "COCO-17"{LOW}', "confidences are 0.13 in the"),
        (
            "lightning",
            "[output]",
            '[output]\nactivation = "sigmoid"',
            'activation = "sigmoid" makes of 0 to 1',
        ),
        ("rendered", '"head_top", "neck"', '"neck", "head_top"', "head_top is where neck is"),
        ("lightning", '"y", "x", "confidence"', '"confidence", "y", "x"', "few joints are found"),
    ],
)
def test_what_is_wrong_is_named(
    perfcap: Command, tmp_path: Path, name: str, old: str, new: str, said: str
) -> None:
    outcome = perfcap(["models", "try", spoilt(tmp_path, name, old, new)])
    assert outcome.code == 0
    assert said in outcome.out.partition("to check: ")[2]


def test_captures_refuse_networks_that_take_left_for_right(tmp_path: Path) -> None:
    assert open_networks([str(spoilt(tmp_path / "same", "lightning", "1.1", "1.15"))])[1]
    folder = spoilt(tmp_path, "lightning", 'set = "COCO-17"', f"names = {SIDES}")
    with pytest.raises(InputError, match="left and right are exchanged"):
        open_networks([str(folder)])


def test_networks_that_are_not_there_are_refused(perfcap: Command) -> None:
    assert "no such folder" in perfcap(["models", "try", "nothing"]).refused()


class Bins(OnnxDetector):
    """`lightning` as if it classified x and y: where names are exchanged, so are both."""

    def __init__(self, *names: str) -> None:
        super().__init__(DETECTORS / "lightning")
        output = replace(self.manifest.output, kind="simcc", names=names, columns=())
        self.own, self.manifest = self.manifest, replace(self.manifest, output=output)

    def estimate(self, crops: NDArray[np.uint8]) -> Estimate:
        if not hasattr(self, "own"):  # while it is opened
            return super().estimate(crops)
        asked, self.manifest = self.manifest, self.own
        found, self.manifest = super().estimate(crops), asked
        exchanged = asked.output.names == ("y", "x")
        return replace(found, joints2d=found.joints2d.flip(-1)) if exchanged else found


@pytest.mark.long
def test_classifications_of_x_and_y_may_have_each_other_s_names() -> None:
    (said,) = list(try_network(Bins("y", "x")))[1:]
    assert "with names = ['x', 'y'] they are 1.9 % off" in said
    assert len(list(try_network(Bins("x", "y")))) == 1


@pytest.mark.long
@pytest.mark.parametrize(
    ("new", "said"),
    [
        ("signs3d = [1, 1, -1]", "with signs3d = [1, 1, 1] they are 11"),
        ("signs3d = [-1, 1, 1]", "with signs3d = [1, 1, 1] they are 11"),
        ("metres = 1000.0", "times as large as the person; output.metres = 1 fits"),
        ("metres = 0.001\nsigns3d = [1, -1, 1]", "with signs3d = [1, 1, 1] they are 11"),
    ],
)
def test_3d_poses_with_other_signs_or_units_are_named(
    perfcap: Command, tmp_path: Path, new: str, said: str
) -> None:
    folder = spoilt(tmp_path, "blazepose", 'joints3d = "world"', f'joints3d = "world"\n{new}')
    assert said in perfcap(["models", "try", folder]).out.partition("to check: ")[2]


@pytest.mark.long
def test_3d_poses_with_sides_exchanged_are_named(perfcap: Command, tmp_path: Path) -> None:
    names = [
        {"l_": "r_", "r_": "l_"}.get(name[:2], name[:2]) + name[2:]
        for name in find_joint_set("BlazePose-33").joints
    ]
    folder = spoilt(tmp_path, "blazepose", 'set = "BlazePose-33"', f"names = {names}")
    said = perfcap(["models", "try", folder]).out
    assert "left and right in joints.names or joints.set exchanged they are 11" in said


@pytest.mark.long
def test_3d_poses_that_lack_landmarks_are_said_to_be_unused(
    perfcap: Command, tmp_path: Path
) -> None:
    names = [name.replace("toe", "claw") for name in find_joint_set("BlazePose-33").joints]
    folder = spoilt(tmp_path, "blazepose", 'set = "BlazePose-33"', f"names = {names}")
    assert "to check: 3D poses are not used" in perfcap(["models", "try", folder]).out
    (words,) = OnnxDetector(folder).warnings
    assert words.endswith("its 3D poses are not used, which need all of the 16 landmarks")
