"""``--actor auto`` from several views: the person's body, its files, and what is doubtful of it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import synthetic
import torch
from runs import Command
from takes import camera_entry, write_json, write_video

from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.app import auto_actor, fit_views
from perfcap.app import capture as capture_module
from perfcap.cli import main
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.actor import load_actor, models_folder
from perfcap.io.body_model import load_body_model
from perfcap.io.detections import read_detections, save_detections
from perfcap.io.fitted_body import load_fitted_body
from perfcap.pipeline.extract_silhouettes import SilhouetteSource
from perfcap.render.projected_mesh import ProjectedMesh
from perfcap.rigging import BodyFit, ViewFitSettings, fit_body


class Killed(BaseException):
    """The process ends here."""


QUICK = ViewFitSettings(heights=(60.0,), steps=(10, 4), edge_heights=(60.0,), edge_steps=(3,))
FRAMES, SIZE = 6, 160


@dataclass(frozen=True)
class Views:
    """Two views of somebody of the shipped body model, as files."""

    folder: Path
    height: float

    def command(self, out: Path, *more: object) -> list[object]:
        one, two = (self.folder / f"{name}.mp4" for name in ("one", "two"))
        known = ["--cameras", self.folder / "cameras.json", "--out", out]
        joints = ["--detections", self.folder / "detections.npz", "--until", "track_motion"]
        return ["capture", one, two, *known, *joints, "--no-overlay", *more]


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> Views:
    """A turning person 1.7 to 1.9 m tall, exact joints and masks."""
    folder = tmp_path_factory.mktemp("views")
    model = load_body_model()
    actor = model.actor(torch.zeros(0))
    rest = actor.skeleton.rest_motion(FRAMES)
    turn = torch.zeros(FRAMES, 3, dtype=torch.float64)
    turn[:, 1] = torch.linspace(0, 1.5, FRAMES)
    shape = torch.zeros(model.components, dtype=torch.float64)
    shape[:3] = torch.tensor([0.8, -1.0, 0.5])
    motion = Motion(torch.zeros(FRAMES, 3).double(), turn, rest.angles, {BODY: shape})
    cameras = synthetic.cameras(4, size=SIZE, distance=4.0).select([0, 1])
    marks = ShapedPoints.of_landmarks(model, actor)(motion)[:, :16]
    write_views(folder, cameras)
    pixels = cameras.project(marks).numpy()
    np.savez(
        folder / "detections.npz",
        joints2d=pixels,
        confidence2d=np.ones(pixels.shape[:-1]),
        joint_names=np.array(LANDMARKS),
        view_names=np.array(["one", "two"]),
    )
    bodies = ShapedPoints.of_surface(model, actor)(motion)
    write_masks(folder, cameras, bodies, torch.from_numpy(model.rig.faces))
    top, low = (float(f) for f in (bodies[0, :, 1].max(), bodies[0, :, 1].min()))
    return Views(folder, top - low)


def write_views(folder: Path, cameras: Camera) -> None:
    for name in ("one", "two"):
        write_video(folder / f"{name}.mp4", FRAMES, (SIZE, SIZE))
    entries = {name: camera_entry(cameras, view) for view, name in enumerate(("one", "two"))}
    write_json(folder / "cameras.json", {"views": entries})


def write_masks(folder: Path, cameras: Camera, bodies: torch.Tensor, faces: torch.Tensor) -> None:
    for view in range(2):
        for kind in ("masks", "empty", "wide", "aside", "inverted"):
            (folder / f"{kind}{view}").mkdir()
        for frame, vertices in enumerate(bodies):
            one = cameras.select([view])
            mask = ProjectedMesh.seen_by(one, vertices, faces).rasterize().mask.numpy()
            drawn = 255 * mask.astype(np.uint8)
            kinds = {
                "masks": drawn,
                "empty": 0 * drawn,
                "wide": cv2.dilate(drawn, np.ones((13, 13), np.uint8)),
                "aside": np.roll(drawn, SIZE // 3, 1),
                "inverted": 255 - drawn,
            }
            for kind, image in kinds.items():
                cv2.imwrite(str(folder / f"{kind}{view}" / f"{frame:06d}.png"), image)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small pictures and few steps."""
    monkeypatch.setattr(fit_views, "fit_body", quick_fit)


def quick_fit(
    *arguments: Any, settings: ViewFitSettings | None = None, contours: Any = None
) -> BodyFit:
    return fit_body(*arguments, settings=settings or QUICK, contours=contours)


def masks_of(views: Views, *kinds: str) -> list[object]:
    """Of one kind, or of one in each view."""
    both = kinds if len(kinds) > 1 else 2 * kinds
    return ["--masks", *(views.folder / f"{kind}{view}" for view, kind in enumerate(both))]


@pytest.mark.long
def test_a_capture_writes_the_body_it_found(views: Views, tmp_path: Path, perfcap: Command) -> None:
    done = perfcap(views.command(tmp_path, *masks_of(views, "masks")))
    assert done.code == 0, done
    found = load_fitted_body(tmp_path / "body.npz")
    assert found.model == "ada" and (found.deviation > 0).all()
    known = json.loads((tmp_path / "measurements.json").read_text())
    assert known["height"]["metres"] == pytest.approx(views.height, abs=0.03)
    assert "joints and silhouettes of 6 frames in 2 views" in known["source"]
    assert cv2.imread(str(tmp_path / "body.jpg")) is not None
    (note,) = (line for line in done.notes if "--actor auto" in line)
    assert "fitted to the joints and silhouettes" in note
    assert note in json.loads((tmp_path / "run.json").read_text())["input_warnings"]
    # the character in capture.glb is this body
    again = perfcap(views.command(tmp_path, *masks_of(views, "masks"), "--resume"))
    assert again.code == 0 and not [n for n in again.notes if "--actor auto" in n]


@pytest.mark.long
def test_silhouettes_found_for_the_body_are_kept(
    views: Views, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed once they are found, a capture does not look for them again."""
    fits: list[bool] = []

    def counted(*arguments: Any, settings: ViewFitSettings | None = None) -> BodyFit:
        fits.append(arguments[4] is not None)
        if fits[-1] and len(fits) < 3:
            raise Killed
        return quick_fit(*arguments, settings=settings)

    def unwanted(*_: object) -> None:
        raise Killed

    monkeypatch.setattr(fit_views, "fit_body", counted)
    call = [str(each) for each in views.command(tmp_path, "--until", "refine_pose")]
    call.remove("track_motion")
    call.remove("--until")
    with pytest.raises(Killed):
        main(call)
    assert fits == [False, True]
    monkeypatch.setattr(SilhouetteSource, "segment", unwanted)
    with pytest.raises(Killed):  # from the stage behind
        main([*call, "--resume"])
    assert fits == [False, True, False, True]


@pytest.mark.long
def test_a_preset_of_contours_fits_the_body_to_edges(
    views: Views, tmp_path: Path, perfcap: Command
) -> None:
    command = views.command(tmp_path, "--preset", "rhodin2016")
    command[command.index("track_motion")] = "refine_pose"
    done = perfcap(command)
    assert done.code in (0, 3), done
    (note,) = (line for line in done.notes if "--actor auto" in line)
    assert "fitted to the joints and contours" in note
    known = json.loads((tmp_path / "measurements.json").read_text())
    assert "joints and contours of 6 frames in 2 views" in known["source"]
    # the videos show something else than the person
    assert any("of the body's outline; girths" in line for line in done.notes), done.notes


@pytest.mark.long
def test_an_actor_leaves_no_body_of_an_older_result(
    views: Views, tmp_path: Path, perfcap: Command
) -> None:
    assert perfcap(views.command(tmp_path)).code == 0
    assert (tmp_path / "body.npz").exists()
    assert perfcap(views.command(tmp_path, "--actor", "sam", "--overwrite")).code in (0, 3)
    assert not (tmp_path / "body.npz").exists() and not (tmp_path / "body.jpg").exists()


@pytest.mark.long
def test_a_character_is_read_and_told_of_once(
    views: Views, tmp_path: Path, perfcap: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a user should know of it was printed twice."""
    read: list[str] = []

    def counted(name: str) -> object:
        read.append(name)
        return load_actor(name)

    for module in (capture_module, auto_actor):
        monkeypatch.setattr(module, "load_actor", counted)
    assert perfcap(views.command(tmp_path / "out", "--actor", "sam")).code in (0, 3)
    assert read == ["sam"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("kinds", "words"),
    [
        (("empty", "masks"), "masks of one: are empty"),
        (("masks", "aside"), "of the detected joints; expected those of the person"),
        (("wide", "wide"), "silhouettes exceed the body"),
        (("masks", "masks"), "edges of the images"),  # the video shows somebody else
    ],
)
def test_masks_of_something_else_are_told(
    views: Views, tmp_path: Path, perfcap: Command, kinds: tuple[str, str], words: str
) -> None:
    done = perfcap(views.command(tmp_path, *masks_of(views, *kinds)))
    assert any(words in note for note in done.notes), done.notes


@pytest.mark.long
@pytest.mark.parametrize("kind", ["empty", "aside", "inverted"])
def test_masks_of_nobody_are_refused(
    views: Views, tmp_path: Path, perfcap: Command, kind: str
) -> None:
    line = perfcap(views.command(tmp_path, *masks_of(views, kind))).refused()
    assert "of the detected joints of the views; expected images that are white" in line


def test_masks_that_nothing_looks_at_are_refused(
    views: Views, tmp_path: Path, perfcap: Command
) -> None:
    given = masks_of(views, "masks")
    line = perfcap(views.command(tmp_path, *given, "--actor", "sam")).refused()
    assert "--masks: are not looked at with --until track_motion; leave one of them out" in line


def test_clocks_are_told_and_kept(views: Views, tmp_path: Path, perfcap: Command) -> None:
    """Too short a clip is refused; ``run.json`` tells what a longer one showed."""
    line = perfcap(views.command(tmp_path, "--sync", "auto")).refused()
    assert "--sync auto: clip has 6 frames" in line


@pytest.mark.long
@pytest.mark.parametrize(("off", "said"), [(-0.25, "legs are 0."), (0.16, "legs are 1.0")])
def test_a_height_that_the_views_contradict_is_told(
    views: Views, tmp_path: Path, perfcap: Command, off: float, said: str
) -> None:
    """The body met a height 16 cm too large halfway: neither it nor its legs were far off."""
    other = views.command(tmp_path / "other", "--height", views.height + off)
    done = perfcap([*other, "--until", "initialize"])
    assert done.code in (0, 3) and f"the body's {said}" in str(done.notes)
    right = views.command(tmp_path / "right", "--height", views.height)
    done = perfcap([*right, "--until", "initialize"])
    assert done.code in (0, 3) and "legs" not in str(done.notes)


@pytest.mark.long
def test_what_the_capture_says_of_joints_is_not_said_by_the_fit_again(
    views: Views, tmp_path: Path, perfcap: Command
) -> None:
    """It was a raw warning of Python, and wrong of joints that were found in this very video."""
    known = dict(np.load(views.folder / "detections.npz"))
    del known["view_names"]
    known = {key: value[:, 0] if value.ndim > 2 else value for key, value in known.items()}
    np.savez(tmp_path / "half.npz", **{**known, "joints2d": known["joints2d"] / 2})
    call = ["capture", views.folder / "one.mp4", "--detections", tmp_path / "half.npz"]
    more = ["--height", 1.8, "--until", "initialize", "--no-overlay", "--out", tmp_path / "out"]
    done = perfcap([*call, *more])
    assert done.code in (0, 3), done
    assert sum("top left quarter" in note for note in done.notes) == 1
    assert "UserWarning" not in done.err


@pytest.mark.long
def test_the_body_wears_what_the_images_show(tmp_path: Path, perfcap: Command) -> None:
    """A film in grey makes a grey person of the body in its red trousers."""
    demo = models_folder() / "demo"
    video = cv2.VideoCapture(str(demo / "video.mp4"))
    (tmp_path / "frames").mkdir()
    for frame in range(8):
        picture = cv2.cvtColor(video.read()[1], cv2.COLOR_BGR2GRAY)
        cv2.imwrite(str(tmp_path / "frames" / f"{frame:02d}.png"), picture)
    joints = read_detections([demo / "detections.npz"], views=("cam",))[0].frames(slice(0, 8))
    save_detections(tmp_path / "joints.npz", joints, ("frames",))
    call = ["capture", tmp_path / "frames", "--detections", tmp_path / "joints.npz", "--no-overlay"]
    call += ["--fov", 41, "--until", "refine_pose", "--out", tmp_path / "out"]
    assert perfcap(call).code in (0, 3)
    worn = load_actor(tmp_path / "out" / "capture.glb").template.texture
    own = load_body_model().actor(torch.zeros(0)).template.texture
    assert worn is not None and own is not None
    colored = [
        np.ptp(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), 2).mean()
        for data in (worn, own)
    ]
    assert colored[0] < 6 < 20 < colored[1]
