"""``perfcap train head``: a shipped network adapted to a person's own footage, without labels."""

from __future__ import annotations

import copy
import logging
import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.app.auto_actor import Casting, cast
from perfcap.app.capture_checks import examined, made_up, refuse_wrong, wants_bones
from perfcap.app.console import PlainConsole, progress_bars
from perfcap.app.head_checks import (
    describe,
    image_doubts,
    lags_of,
    late_doubts,
    misses_of,
    require_same,
)
from perfcap.app.inputs import Inputs, read_inputs
from perfcap.app.networks import DETECTORS, find_model
from perfcap.app.project import in_project
from perfcap.app.train import MODEL, make_folder, sole_training, tensorboard
from perfcap.commands.train import TrainHead
from perfcap.commands.views import DEFAULT_DETECTORS
from perfcap.detect.joint_set import LANDMARKS16, JointSet
from perfcap.detect.manifest import read_manifest
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline import PoseRefiner
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import PRESETS
from perfcap.pipeline.stage import Stage
from perfcap.train.card import frames_said, write_head_card
from perfcap.train.checkpoint import load_checkpoint
from perfcap.train.config import LoopConfig
from perfcap.train.export_head import export_head
from perfcap.train.head import Head, best_decay, fit_directly, score_directly
from perfcap.train.head_crops import CropAnswers, Tell, Watched, digest_of, look_at_crops
from perfcap.train.head_task import HeadTask, Refine, Split
from perfcap.train.loop import BEST, train
from perfcap.train.onnx_head import FrozenNetwork

_LOG = logging.getLogger(__name__)
_FEWEST = 10  # frames
CHOSEN, ALL = "chosen", "all"  # folders of trainings without the last frames and with them


@dataclass(frozen=True)
class _Taught:
    """A trained head and what it scores on frames that it has not learned from, millimetres."""

    head: Head
    scores: dict[str, float]
    steps: int | None  # through the solver; 0 where that was no better, None where there was none


def run_train_head(request: TrainHead) -> int:
    """Capture all views together, adapt a head to that, export and describe it; the exit code.

    Raises:
        InputError: bad input, in one line.
    """
    config = request.config
    config.require_sound()
    torch.set_num_threads(1)  # tensors are small
    request = in_project(request)
    _check(request)
    name = request.network or default_network()
    network = FrozenNetwork(find_model(name, DETECTORS), request.features)
    inputs = read_inputs(request)
    refuse_wrong(inputs)
    if inputs.rig.cameras.moving:
        raise InputError("--cameras: move; a head is adapted to views of fixed cameras")
    for folder in (request.out / CHOSEN, request.out):
        make_folder(folder, request.resume)
    with sole_training(request.out):
        _adapt(request, network, inputs)
    return 0


def _adapt(request: TrainHead, network: FrozenNetwork, inputs: Inputs) -> None:
    config = request.config
    performance = _solution(request, inputs)
    watched, step = _watched(performance, inputs, config.crops.frames)
    if len(watched.joints) < _FEWEST:
        raise InputError(
            f"{len(watched.joints)} frames are too few to adapt a network to; expected {_FEWEST}"
        )
    with progress_bars() as tell:
        crops = look_at_crops(network, watched, config.crops, config.loop.seed, tell)
        require_same(request, describe(request, digest_of(watched, crops)))
        names = inputs.clip.names
        late = late_doubts(lags_of(crops, watched), names, step)
        for line in (*late, *image_doubts(misses_of(crops), names)):
            _LOG.warning("%s", line)
        refine = refiner(performance.actor, watched.rate)
        taught = _teach(request, network, crops, watched, refine, tell)
    frames = len(watched.joints), performance.frames
    _finish(request, network, taught, inputs.clip.views, frames)


def doubts_of(scores: Mapping[str, float]) -> Iterator[str]:
    """What the scores of a head, as its card has them, say against using it."""
    shipped = scores["shipped, mm"]
    best = min(scores[name] for name in ("fitted, mm", "through the solver, mm") if name in scores)
    if best >= shipped:
        yield (
            f"the adapted network is no better than the one as it was ({best:.0f} and "
            f"{shipped:.0f} mm off the capture of all views in frames that it has not learned "
            "from); keep that one, or film more, with the motion that is to be captured"
        )


def default_network() -> str:
    """The network with 3D joints among those that captures use."""
    for name in DEFAULT_DETECTORS:
        spec = read_manifest(find_model(name, DETECTORS)).output
        if spec.joints3d and spec.kind == "coordinates":
            return name
    raise InputError("--network: none of the default ones has 3D coordinates; name one that has")


def _check(request: TrainHead) -> None:
    if len(request.videos) < 2:
        raise InputError(
            "one video shows no disagreement of views to learn from; expected two or more of the "
            "same moments, with --cameras"
        )
    if request.cameras is None:
        raise InputError("--cameras: is missing; expected the calibration of the views")


def _solution(request: TrainHead, inputs: Inputs) -> Performance:
    """The capture of all views together, which is what the head learns from."""
    inputs = examined(inputs, needs_images=True, detected=bool(request.detectors))
    like = torch.zeros((), dtype=torch.float64)
    with progress_bars() as tell:
        casting = Casting(request.actor, request.height)
        source = casting.source()
        chosen = cast(casting, inputs, tell)
        found = capture(
            chosen.actor,
            inputs.rig.cameras.to(like),
            inputs.detections.to(like),
            inputs.clip.fps,
            PRESETS["default"],
            until=Stage.TRACK_MOTION,
            solve_bones=wants_bones("auto", source.generic, inputs.detections),
            progress=tell,
        )
    first = inputs.clip.start
    untrusted = found.trust.sentences(first) if found.trust else ()
    for line in (*chosen.warnings, *found.warnings, *made_up(found, first), *untrusted):
        _LOG.warning("%s", line)
    return found


def _watched(performance: Performance, inputs: Inputs, most: int) -> tuple[Watched, int]:
    """The person in pixels of the images, in so many frames at most, and their distance."""
    clip, frames = inputs.clip, performance.frames
    trust = performance.trust
    believed = torch.ones(frames, dtype=torch.float64) if trust is None else trust.value
    watched = Watched(
        clip.read_view,
        inputs.pixel_map.cameras(inputs.rig.cameras, clip.sizes).to(performance.joints()),
        performance.joints(),
        believed.clamp(0, 1),
        inputs.pixel_map.to_video(inputs.detections.joints2d[:frames].double()),
        inputs.detections.confidence2d[:frames].double(),
        clip.fps,
    )
    step = -(-frames // most)
    return watched.every(step), step


def refiner(actor: Actor, rate: float, config: PoseConfig | None = None) -> Refine:
    """The solver of one view each, with derivatives."""
    layer = PoseRefiner(actor, LANDMARKS16, rate, config or PRESETS["default"].pose).train()

    def refine(
        cameras: list[Camera], pixels: list[Tensor], sure: list[Tensor], poses: list[Tensor]
    ) -> Tensor:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # doubts of the inputs were told before
            joints: Tensor = layer(cameras, pixels, sure, poses).joints
        return joints

    return refine


def _teach(
    request: TrainHead,
    network: FrozenNetwork,
    crops: CropAnswers,
    watched: Watched,
    refine: Refine,
    tell: Tell,
) -> _Taught:
    """A head that has learned from all frames as was best for the last of them, held out at first.

    Scores are of the head that had not seen them. The expected error is the root mean square of its
    error there, and of errors in views that were left out as well: neighbours of frames that were
    learned from are too easy, other views are harder than what a head is for.
    """
    config, frames = request.config, len(watched.joints)
    kept = frames - max(2, round(config.held_out * frames))
    split = Split(slice(0, kept), slice(kept, frames))
    size, joints = network.manifest.input.size[1], network.manifest.joint_set
    lesson = crops.lesson(split.learned, watched.trust, size)
    test = crops.lesson(split.chosen, watched.trust, size, plain=True)
    head = Head.of(lesson.features, size, joints)
    study = _Study(request, crops, watched, refine, tell)
    scores = {
        "shipped, mm": 1e3 * score_directly(head, test),
        **study.scores("shipped", head, split),
    }
    decay = best_decay(head, lesson, config.loss.decays, test)
    scores |= {"fitted, mm": 1e3 * score_directly(head, test)}
    before = study.scores("fitted", head, split)
    scores |= before
    steps = 0
    if request.through_solver:
        trained, steps = study.through_solver(head, split, config.loop, CHOSEN, decay)
        scores |= {"through the solver, mm": 1e3 * score_directly(trained, test)}
        after = study.scores("through the solver", trained, split)
        scores |= after
        if next(iter(after.values())) < next(iter(before.values())):
            head = trained
        else:
            steps = 0
    scores["view left out, mm"] = 1e3 * _left_out(crops, watched.trust, split, joints, decay, size)
    own = 1e3 * score_directly(head, test)
    scores["expected, mm"] = math.hypot(own, scores["view left out, mm"]) / math.sqrt(2)
    everything = Split(slice(0, frames), split.chosen)
    lesson = crops.lesson(everything.learned, watched.trust, size)
    final = Head.of(lesson.features, size, joints)
    fit_directly(final, lesson, decay)
    if steps:
        loop = replace(config.loop, steps=steps, evaluate_every=steps)
        final, _ = study.through_solver(final, everything, loop, ALL, decay)
    return _Taught(final, scores, steps if request.through_solver else None)


def _left_out(
    crops: CropAnswers, trust: Tensor, split: Split, joints: JointSet, decay: float, size: int
) -> float:
    """Mean error (m) in later frames of views that a head has not learned from, each in turn."""
    errors = []
    for view in range(crops.views):
        others = [each for each in range(crops.views) if each != view]
        lesson = crops.lesson(split.learned, trust, size, views=others)
        head = Head.of(lesson.features, size, joints)
        fit_directly(head, lesson, decay)
        test = crops.lesson(split.chosen, trust, size, plain=True, views=[view])
        errors.append(score_directly(head, test))
    return sum(errors) / len(errors)


@dataclass(frozen=True)
class _Study:
    """What heads learn from through the solver."""

    request: TrainHead
    crops: CropAnswers
    watched: Watched
    refine: Refine
    tell: Tell

    def scores(self, name: str, head: Head, split: Split) -> dict[str, float]:
        """Of a head whose views are solved alone; the disagreement of views first."""
        return {f"{name}, {k}": v for k, v in self._task(head, split).evaluate(head).items()}

    def through_solver(
        self, head: Head, split: Split, loop: LoopConfig, name: str, decay: float
    ) -> tuple[Head, int]:
        """The best head of a training from this one, and its number of steps."""
        request, folder = self.request, self.request.out / name
        described = {
            "videos": [str(path) for path in request.videos],
            "network": request.network,
            "features": request.features,
            "frames": request.frames,
            "decay": decay,
            "learned from": digest_of(self.watched, self.crops),
        }
        trained = train(
            self._task(copy.deepcopy(head), split),
            loop,
            folder,
            asdict(request.config) | described,
            resume=request.resume,
            progress=self.tell,
            watch=tensorboard(folder),
        )
        return trained, int(load_checkpoint(folder / BEST).values["step"])

    def _task(self, head: Head, split: Split) -> HeadTask:
        config = self.request.config
        more = config.window, config.loss, config.loop.seed
        return HeadTask(head, self.crops, self.watched, split, self.refine, *more)


def _finish(
    request: TrainHead,
    network: FrozenNetwork,
    taught: _Taught,
    views: int,
    frames: tuple[int, int],
) -> None:
    """Export, describe, and say what it gives; frames that were looked at, and all of the clip."""
    folder = request.out / MODEL
    config = request.config
    origin = f"perfcap train head, {frames_said(*frames)} of {views} views"
    origin += f", seed {config.loop.seed}"
    export_head(network, taught.head, folder, origin, 1e-3 * taught.scores["expected, mm"])
    name = network.manifest.path.parent.name
    write_head_card(folder, name, config, frames, taught.scores, taught.steps)
    console = PlainConsole()
    for name, value in taught.scores.items():
        console.print(f"{name}: {value:.3g}")
    for line in doubts_of(taught.scores):
        _LOG.warning("%s", line)
    console.print(f"written to {folder}", soft_wrap=True)
