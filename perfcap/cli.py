"""The command line. Nothing heavy is imported before a command runs."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, Protocol

import tyro

from perfcap.errors import InputError
from perfcap.train.config import TrainLifterConfig
from perfcap.train.detector_config import TrainDetectorConfig


@dataclass(frozen=True)
class Demo:
    """Capture the shipped clip with the shipped actor and print the errors against its truth."""

    out: Path = Path("demo")
    """Folder for the results."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.demo import run_demo

        return run_demo(self.out)


@dataclass(frozen=True)
class Capture:
    """Capture the motion and surface of one person from one or several calibrated videos."""

    videos: tyro.conf.Positional[tuple[Path, ...]]
    """A video or a folder of images; one for each view."""
    actor: str
    """Name of a shipped actor, a skinned .glb/.gltf, or a folder with actor.glb."""
    cameras: Path
    """Calibration: camera.json, Calib*.toml, EasyMocap intri/extri.yml, or a COLMAP text folder."""
    out: Path
    """Folder for the results."""
    detections: tuple[Path, ...] = ()
    """Joints: detections.npz, OpenPose folders, or keypoint JSON; one for each view."""
    detector: str | None = None
    """Find the joints in the videos instead: a folder with manifest.toml and an ONNX network."""
    box: tuple[float, ...] = ()
    """Where --detector finds the person in the first frame: LEFT TOP RIGHT BOTTOM for each view,
    pixels; searched for if not given."""
    lifter: str | None = None
    """Give 3D poses to views without: a folder with manifest.toml, or a shipped network's name."""
    until: Literal["initialize", "track_motion", "refine_pose", "refine_surface"] = "refine_surface"
    """The last stage to run."""
    frames: str | None = None
    """Part of the clip, A:B (B exclusive)."""
    preset: Literal["default", "monoperfcap"] = "default"
    """Measured defaults, or the constants published by Xu et al. 2018."""
    bones: Literal["auto", "solve", "template"] = "auto"
    """Solve the person's bone lengths? auto: for a generic actor seen by several views."""
    video_map: Path | None = None
    """JSON of affine maps from video to calibration pixels, where the two differ."""
    detections_in: Literal["calibration", "video"] = "calibration"
    """Which pixels detections are in, where the two differ."""
    device: str = "auto"
    """Where to compute: auto, cpu, cuda, ..."""
    overlay: bool = True
    """Write overlay.mp4 and textured.mp4."""
    report: bool = False
    """Write report.html, which plays the result in a browser, from disk."""
    resume: bool = False
    """Do nothing if the folder already holds the complete result of this very call."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.capture import CaptureRequest, run_capture

        return run_capture(CaptureRequest(**vars(self)))


@dataclass(frozen=True)
class Evaluate:
    """Errors of a result against its truth, as a table and metrics.json."""

    folder: tyro.conf.Positional[Path]
    """Folder of a capture."""
    truth: Path
    """An npz with joints3d [F,16,3] in metres, a folder that holds truth.npz or gt.npz, or the
    folder of a data set."""
    dataset: str | None = None
    """Which data set that is: monoperfcap, human36m, mpi_inf_3dhp, humaneva, 3dpw, emdb, panoptic,
    rendered or pose2sim."""
    sequence: str | None = None
    """Which of its sequences."""
    out: Path | None = None
    """Where the numbers go, as JSON; metrics.json in the folder if not given."""
    every: int = 1
    """Compare surfaces and silhouettes of one in so many frames."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.evaluate import EvaluateRequest, run_evaluate

        return run_evaluate(EvaluateRequest(**vars(self)))


@dataclass(frozen=True)
class Render:
    """Draw a finished capture from any camera, as a video."""

    folder: tyro.conf.Positional[Path]
    """Folder of a capture; nothing else is needed."""
    out: Path
    """The video, .mp4."""
    orbit: float | None = None
    """Degrees that the camera goes around the person; 360 if no camera is given."""
    camera: Path | None = None
    """See it from the camera of a calibration file, fixed or moving, instead."""
    view: str | None = None
    """Which view of that file; the first if not given."""
    size: tuple[int, int] | None = None
    """Width and height in pixels; 720 720, or the camera's."""
    frames: str | None = None
    """Part of the capture, A:B (B exclusive), counted as in its video."""
    freeze: int | None = None
    """Show this frame only, while the camera moves."""
    seconds: float | None = None
    """How long a frozen frame is shown; 4."""
    up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = "auto"
    """Which axis of the world points up; auto: the one along which the person stands."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.render import RenderRequest, run_render

        return run_render(RenderRequest(**vars(self)))


@dataclass(frozen=True)
class Export:
    """Write a finished capture as files of other programs; docs/formats.md says which for which."""

    folder: tyro.conf.Positional[Path]
    """Folder of a capture."""
    to: tuple[Literal["glb", "bvh", "usd", "usdz", "obj", "ply", "trc", "c3d", "npz", "csv"], ...]
    """One or several formats; usd, usdz and c3d need an extra of perfcap."""
    out: Path | None = None
    """Folder for the files; FOLDER/export if not given."""
    name: str | None = None
    """What to call the files; the name of the folder if not given."""
    frames: str | None = None
    """Part of the capture, A:B (B exclusive), counted as in its video."""
    up: Literal["y", "z"] | None = None
    """Which axis points up in the files; z in c3d, else y, if not given. glb is always y up."""
    unit: Literal["m", "cm", "mm"] | None = None
    """Of length; cm in bvh, mm in trc and c3d, else m, if not given. glb is always in metres."""
    world_up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = "auto"
    """Which axis of the capture's world points up; auto: the one along which the person stands."""
    surface: bool = True
    """Write the captured surface into glb and usd, where there is one, beside the skinned mesh."""
    markers: Literal["landmarks", "bones"] = "landmarks"
    """Markers of trc and c3d: the 16 landmarks, or the origins of the actor's bones."""
    order: Literal["auto", "ZXY", "ZYX", "XYZ", "XZY", "YXZ", "YZX"] = "auto"
    """Of the axes in bvh; auto: for each joint the one whose angles move the least."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.export import ExportRequest, run_export

        return run_export(ExportRequest(**vars(self)))


@dataclass(frozen=True)
class Report:
    """Write report.html: the result as one page that plays in a browser, without a network."""

    folder: tyro.conf.Positional[Path]
    """Folder of a capture."""
    videos: tuple[Path, ...] = ()
    """The input videos, where they are no longer where the capture found them."""
    cameras: Path | None = None
    """The calibration, likewise."""
    truth: Path | None = None
    """True joints, for curves of errors: an npz with joints3d, or a folder that holds one."""
    frames: str | None = None
    """Part of the capture, A:B (B exclusive), counted as in its video."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.report import ReportRequest, run_report

        return run_report(ReportRequest(**vars(self)))


@dataclass(frozen=True)
class View:
    """Open the report of a result in a browser; written first where it is missing or old."""

    folder: tyro.conf.Positional[Path]
    """Folder of a capture."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.report import run_view

        return run_view(self.folder)


@dataclass(frozen=True)
class Doctor:
    """Check the installation and, before any solve, the inputs."""

    videos: tyro.conf.Positional[tuple[Path, ...]] = ()
    """The videos, to compare their size with the calibration's."""
    cameras: Path | None = None
    """Calibration to check."""
    detections: tuple[Path, ...] = ()
    """Detections to check against the cameras."""
    video_map: Path | None = None
    """JSON of affine maps from video to calibration pixels."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.doctor import run_doctor

        return run_doctor(self.cameras, self.detections, self.videos, self.video_map)


@dataclass(frozen=True)
class TrainLifter:
    """Train a network from 2D joint tracks to 3D poses, export it and write its card."""

    motion: Path
    """Folder of recorded motion: clips.npz and clips.csv."""
    out: Path
    """Folder for checkpoints, metrics.jsonl and the model."""
    config: Annotated[TrainLifterConfig, tyro.conf.arg(name="")] = field(
        default_factory=TrainLifterConfig
    )
    """People, steps, network, cameras, noise."""
    licence: str = "unstated"
    """Of the weights; follows from the motion's."""
    resume: bool = False
    """Go on from the last checkpoint; ends as if it had never stopped."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.train import run_train_lifter

        return run_train_lifter(self.motion, self.out, self.config, self.licence, self.resume)


@dataclass(frozen=True)
class TrainDetector:
    """Train a network from images to 2D and 3D joints; export it and write its card."""

    motion: Path
    """Folder of recorded motion: clips.npz and clips.csv."""
    out: Path
    """Folder for rendered crops, checkpoints, metrics.jsonl and the model."""
    config: Annotated[TrainDetectorConfig, tyro.conf.arg(name="")] = field(
        default_factory=TrainDetectorConfig
    )
    """People, steps, network, pictures."""
    licence: str = "unstated"
    """Of the weights; follows from those of motion, actors and pictures."""
    resume: bool = False
    """Go on from the last checkpoint; ends as if it had never stopped."""
    crops_folder: Path | None = None
    """Folder of rendered crops, to share them between runs; OUT/crops if not given."""
    body_model: str = "ada"
    """Name or file of the body model."""
    actors: tuple[str, ...] = ("sam",)
    """People with clothes of their own: names, .glb files or folders."""
    backgrounds: Path | None = None
    """Folder of pictures without people; procedural ones if not given."""
    photographs: Path | None = None
    """Folder of photographs with annotated joints to learn from as well."""
    start: Path | None = None
    """Checkpoint whose weights to start from."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.train_detector import DetectorRequest, run_train_detector

        return run_train_detector(DetectorRequest(**vars(self)))


TrainCommand = (
    Annotated[TrainLifter, tyro.conf.subcommand("lifter")]
    | Annotated[TrainDetector, tyro.conf.subcommand("detector")]
)


@dataclass(frozen=True)
class Train:
    """Train a network: a lifter or a detector."""

    command: Annotated[tyro.conf.OmitSubcommandPrefixes[TrainCommand], tyro.conf.arg(name="")]

    def run(self) -> int:
        """Run the command; returns the exit code."""
        return self.command.run()


@dataclass(frozen=True)
class ActorInspect:
    """Print what an actor is and what is wrong with it; draw a contact sheet."""

    actor: tyro.conf.Positional[str]
    """Name of a shipped actor, a skinned .glb/.gltf, or a folder with actor.glb."""
    mapping: Path | None = None
    """TOML that names the bones of joints, for rigs that are not recognised."""
    out: Path | None = None
    """Folder for contact_sheet.jpg."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.actor_inspect import run_inspect

        return run_inspect(self.actor, self.mapping, self.out)


@dataclass(frozen=True)
class ActorBuild:
    """Make an actor folder of a rigged character, a bare mesh, or a person's measures."""

    out: Path
    """Folder for actor.glb, manifest.toml and contact_sheet.jpg."""
    source: tyro.conf.Positional[Path | None] = None
    """A skinned .glb or .gltf with any bones, or a mesh of a person in a T- or A-pose without any
    (.obj, .ply, .stl, .glb), in any units, with any axis up."""
    mapping: Path | None = None
    """TOML that names the bones of joints, for rigs that are not recognised."""
    name: str | None = None
    """What to call the actor; the name of the file."""
    licence: str | None = None
    """Under which licence it may be used; what the file says."""
    overrides: Path | None = None
    """TOML of regions of a bare mesh that only some bones may move, such as a skirt."""
    body: bool = False
    """Make a body of the measures below instead of a file."""
    body_model: str = "ada"
    """Name or file of the body model."""
    height: float | None = None
    """Of the person, metres; for a bare mesh, with shoes and hair."""
    weight: float | None = None
    """Kilograms, for --body."""
    chest: float | None = None
    """Girth, metres, for --body, like the two below."""
    waist: float | None = None
    """Girth, metres."""
    hip: float | None = None
    """Girth, metres."""
    inseam: float | None = None
    """From the crotch to the floor, metres, for --body."""
    gender: Literal["female", "male"] | None = None
    """For --body."""
    age: float | None = None
    """Years, for --body."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.actor_build import build_request, run_build

        return run_build(build_request(vars(self)))


@dataclass(frozen=True)
class ActorFit:
    """Make an actor with the body of a person seen by one or several calibrated cameras."""

    videos: tyro.conf.Positional[tuple[Path, ...]]
    """A video or a folder of images; one for each view."""
    cameras: Path
    """Calibration, as for capture."""
    out: Path
    """Folder for actor.glb, manifest.toml, measurements.json, contact_sheet.jpg and fit.jpg."""
    detections: tuple[Path, ...] = ()
    """Joints, as for capture; one for each view."""
    detector: str | None = None
    """Find the joints in the videos instead: a folder with manifest.toml and an ONNX network."""
    box: tuple[float, ...] = ()
    """Where --detector finds the person in the first frame: LEFT TOP RIGHT BOTTOM for each view."""
    lifter: str | None = None
    """Give 3D poses to views without: a folder with manifest.toml, or a shipped network's name."""
    masks: tuple[Path, ...] = ()
    """Silhouettes of the person: a folder of images for each view, one image a frame of the video,
    0 is background; segmented if not given."""
    silhouettes: bool = True
    """Fit to silhouettes as well as joints; switch it off for loose clothes."""
    height: float | None = None
    """Of the person, metres; one camera needs it."""
    frames: str | None = None
    """Part of the clip to choose frames from, A:B (B exclusive)."""
    count: int = 12
    """Frames to fit to, spread over the clip."""
    name: str | None = None
    """What to call the actor; the name of the folder."""
    body_model: str = "ada"
    """Name or file of the body model."""
    video_map: Path | None = None
    """JSON of affine maps from video to calibration pixels, where the two differ."""
    detections_in: Literal["calibration", "video"] = "calibration"
    """Which pixels detections are in, where the two differ."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.actor_fit import FitRequest, run_fit

        return run_fit(FitRequest(**vars(self)))


@dataclass(frozen=True)
class ActorFrames:
    """Pick sharp, evenly spread stills with masks from a video that goes around a person."""

    video: tyro.conf.Positional[Path]
    """A video, or a folder of images."""
    out: Path
    """New folder for images/, masks/ and preview.jpg."""
    count: int = 60
    """Stills to pick."""
    frames: str | None = None
    """Part of the video, A:B (B exclusive)."""
    masks: Literal["colmap", "plain", "none"] = "colmap"
    """How masks are called: 000123.jpg.png (COLMAP), 000123.png (Meshroom, Metashape); or none."""
    box: tuple[float, ...] = ()
    """Where the person stays in the picture: LEFT TOP RIGHT BOTTOM, pixels; its middle if not
    given."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.actor_frames import FramesRequest, run_frames

        return run_frames(FramesRequest(**vars(self)))


ActorCommand = (
    Annotated[ActorBuild, tyro.conf.subcommand("build")]
    | Annotated[ActorFit, tyro.conf.subcommand("fit")]
    | Annotated[ActorFrames, tyro.conf.subcommand("frames")]
    | Annotated[ActorInspect, tyro.conf.subcommand("inspect")]
)


@dataclass(frozen=True)
class ActorTools:
    """Make or examine an actor."""

    command: tyro.conf.OmitSubcommandPrefixes[tyro.conf.OmitArgPrefixes[ActorCommand]]

    def run(self) -> int:
        """Run the command; returns the exit code."""
        return self.command.run()


Command = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Capture, tyro.conf.subcommand("capture")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Render, tyro.conf.subcommand("render")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[ActorTools, tyro.conf.subcommand("actor")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
    | Annotated[Train, tyro.conf.subcommand("train")]
)


class Runnable(Protocol):
    """A command with its options."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        ...


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: 0 done, 2 wrong call or input (one line says what), 3 captured with gaps."""
    logging.basicConfig(level=logging.WARNING, format="perfcap: %(message)s")
    command: Runnable = tyro.cli(
        Command,
        prog="perfcap",
        args=arguments,
        description="Human performance capture: skeleton motion and deforming surface from video.",
    )
    try:
        code = command.run()
    except InputError as error:
        sys.stderr.write(f"perfcap: {error}\n")
        code = 2
    except KeyboardInterrupt:
        sys.stderr.write("perfcap: interrupted\n")
        code = 130
    sys.exit(code)
