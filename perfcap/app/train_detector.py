"""``perfcap train detector``: recorded motion and bodies to a joint network."""

from __future__ import annotations

import hashlib
import logging
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path

import cv2
import torch
from torch import distributed

from perfcap.actor.actor import Actor
from perfcap.app.console import PlainConsole, progress_bars
from perfcap.app.networks import DETECTORS
from perfcap.app.train import (
    MODEL,
    make_folder,
    processes,
    read_library,
    sole_training,
    tensorboard,
)
from perfcap.commands.train import TrainDetector
from perfcap.commands.views import FINDER
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.people import OnnxFinder
from perfcap.errors import InputError
from perfcap.io.actor import actor_files, load_actor, models_folder
from perfcap.io.atomic import writing
from perfcap.io.body_model import body_model_files, load_body_model
from perfcap.io.doctor.finding import counted
from perfcap.train.augment import FOLLOWED
from perfcap.train.background_looks import background_doubts
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.card import last_part, origin_of, weights_said, write_detector_card
from perfcap.train.cast import Cast
from perfcap.train.checkpoint import described_start, require_unseen, start_from
from perfcap.train.config import TrainDetectorConfig
from perfcap.train.crop_batches import Shots
from perfcap.train.crop_store import CropStore, Progress, render_crops
from perfcap.train.detector import Detector
from perfcap.train.detector_task import DetectorTask, peaks_and_hits, score_detector, score_guess
from perfcap.train.export import expected_error, export_detector, fit_calibration
from perfcap.train.loop import BEST, train
from perfcap.train.motion_library import MotionLibrary
from perfcap.train.outcome import outcome_doubts
from perfcap.train.photograph_looks import photograph_doubts
from perfcap.train.photographs import ANNOTATIONS, Mixture, Photographs
from perfcap.train.scenes import Scenes

_LOG = logging.getLogger(__name__)

CROPS = "crops"
WEIGHTS = "weights.safetensors"  # beside the exported model: what others start from
_SHARP = 0.9  # of the pixels that a network is shown
_LOOKING = "lightning"  # finds 64 % of the joints of lspet, in a third of the time of `thunder`
_VALIDATION_SEED = 2**32  # none that a run would be given


def run_train_detector(request: TrainDetector) -> int:
    """Render, train, export, score and describe a detector; returns the exit code.

    Raises:
        InputError: bad input, in one line.
    """
    config = request.config
    _check(config)
    config.require_sound()
    library = read_library(request.motion, (*config.held_out, *config.validation))
    if request.start is not None:
        require_unseen(request.start, (*config.held_out, *config.validation), library.digest)
    behind, photographs = _backgrounds(request.backgrounds), _photographs(request)
    drawn = describe_drawn(request, behind)
    seen = {} if photographs is None else {"photographs": photographs.digest}
    learned_from = {"motion": library.digest} | drawn | seen
    make_folder(request.out, request.resume)
    for doubt in _blurred(config):
        _LOG.warning("%s", doubt)
    torch.set_num_threads(1)  # several processes are faster than several threads
    cv2.setNumThreads(1)
    with sole_training(request.out), processes() as first, progress_bars() as tell:
        rendered, validation = _crops(request, library, behind, drawn, first, tell)
        shots = rendered if photographs is None else Mixture(rendered, photographs)
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        pictures = behind if request.backgrounds is not None else None
        task = DetectorTask(shots, validation, config, device, pictures)
        if request.start is not None:
            start_from(task.model, request.start)
        trained = train(
            task,
            config.loop,
            request.out,
            asdict(config) | learned_from | described_start(request.start),
            resume=request.resume,
            progress=tell if first else None,
            watch=tensorboard(request.out) if first else None,
        )
        if first:
            learned = library.without((*config.held_out, *config.validation)).subjects
            sources = detector_sources(request, behind, photographs)
            _finish(trained, request, validation, len(rendered), learned, sources)
    return 0


def detector_sources(
    request: TrainDetector, behind: Backgrounds, photographs: Photographs | None
) -> tuple[str, ...]:
    """All that a detector is made of, for its card: a phrase each."""
    found = [
        f"recorded motion of {last_part(request.motion)}",
        f"the body model {last_part(request.body_model)}",
    ]
    if request.actors and request.config.scene.actors:
        names = ", ".join(map(last_part, request.actors))
        found.append(f"the actor{'s' if len(request.actors) > 1 else ''} {names}")
    if request.backgrounds is not None:
        count = counted(len(behind.files), "background")
        found.append(f"{count} of {last_part(request.backgrounds)}")
    if request.photographs is not None and photographs is not None:
        count = counted(len({each.path for each in photographs.people}), "photograph")
        shown = counted(len(photographs), "person", "people")
        found.append(f"{count} with {shown} of {last_part(request.photographs)}")
    if request.start is not None:
        found.append(f"to start from, {weights_said(request.start)}")
    return tuple(found)


def _check(config: TrainDetectorConfig) -> None:
    sides = [config.detector.size, *(side for _, side in config.sizes)]
    starts = [start for start, _ in config.sizes]
    if not starts or starts[0] != 0 or starts != sorted(starts) or starts[-1] >= 1:
        raise InputError(
            f"sizes: start at {starts}; expected rising shares of the steps, from 0 to below 1"
        )
    if any(side % 32 or side < 64 for side in sides) or sides[-1] != sides[0]:
        raise InputError(
            f"sizes: are {sides[1:]}, detector.size {sides[0]}; expected multiples of 32 from 64 "
            "on, the last one detector.size"
        )


def _blurred(config: TrainDetectorConfig) -> Iterator[str]:
    """What speaks against the size of stored crops: people in them are enlarged to be shown."""
    scene, side = config.scene, config.detector.size
    shown = scene.size * FOLLOWED / scene.margin
    if shown < _SHARP * side:
        yield (
            f"--scene.size {scene.size}: what the network is shown has {shown:.0f} pixels in "
            f"stored crops and is enlarged to --detector.size {side}, so that it learns from "
            "blurred pictures and photographs; expected "
            f"{math.ceil(side * scene.margin / FOLLOWED)} or more"
        )


def _backgrounds(folder: Path | None) -> Backgrounds:
    """Pictures to show people before; a shipped network looks for people in some of them."""
    behind = Backgrounds(folder)
    if folder is not None:
        finder = OnnxFinder(models_folder() / DETECTORS / FINDER)
        for doubt in background_doubts(folder, behind.files, finder):
            _LOG.warning("%s", doubt)
    return behind


def _photographs(request: TrainDetector) -> Photographs | None:
    """Photographs to learn from; a shipped network looks whether their joints are theirs."""
    if request.photographs is None:
        return None
    scene = request.config.scene
    photographs = Photographs(request.photographs, scene.size, scene.margin)
    network = OnnxDetector(models_folder() / DETECTORS / _LOOKING, flip_test=False)
    path = request.photographs / ANNOTATIONS
    for doubt in photograph_doubts(path, network, photographs.people):
        _LOG.warning("%s", doubt)
    return photographs


def describe_drawn(request: TrainDetector, behind: Backgrounds) -> dict[str, object]:
    """Who is drawn and before what, by digests: files of the same names may have been corrected.

    Raises:
        InputError: there is no such actor or body model.
    """
    described: dict[str, object] = {
        "actors": [_digest(actor_files(name)) for name in request.actors],
        "body_model": _digest(body_model_files(request.body_model)),
    }
    return described | ({} if behind.digest is None else {"backgrounds": behind.digest})


def _digest(files: Iterable[Path]) -> str:
    """SHA-256 of what files hold, one after the other, whatever they are called."""
    total = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            total.update(hashlib.file_digest(file, "sha256").digest())
    return total.hexdigest()


def _crops(
    request: TrainDetector,
    library: MotionLibrary,
    behind: Backgrounds,
    drawn: Mapping[str, object],
    first: bool,
    tell: Progress,
) -> tuple[Shots, Shots]:
    """Rendered people to learn from and to validate on; drawn by the first process."""
    config, folder = request.config, request.crops_folder or request.out / CROPS
    others = (*config.held_out, *config.validation)
    if first:
        actors = tuple(dressed_actor(name) for name in request.actors)
        parts = {
            "validation": (
                library.of(config.validation),
                config.validation_crops,
                _VALIDATION_SEED,
            ),
            "training": (library.without(others), config.crops, config.loop.seed),
        }
        for name, (people, count, seed) in parts.items():
            scenes = _scenes(request, actors, people, behind, seed)
            described: dict[str, object] = {
                **{"scene": asdict(config.scene), "seed": seed, "motion": people.digest},
                **drawn,
            }
            render_crops(folder / name, scenes, count, described, tell)
    if distributed.is_initialized():
        distributed.barrier()  # the crops are there
    return CropStore(folder / "training"), CropStore(folder / "validation")


def dressed_actor(name: str) -> Actor:
    """An actor; a warning says where it has no clothes to learn from."""
    actor = load_actor(name)
    if actor.template.texture is None or actor.template.uv is None:
        _LOG.warning(
            "--actors %s: has no texture, and is learned from as a person who is grey all over; "
            "expected one with clothes in its texture: give it one, or leave it out",
            name,
        )
    return actor


def _scenes(
    request: TrainDetector,
    actors: tuple[Actor, ...],
    people: MotionLibrary,
    behind: Backgrounds,
    seed: int,
) -> Scenes:
    data = request.config.scene
    cast = Cast(load_body_model(request.body_model), actors, people, data)
    return Scenes(cast, behind, data, seed)


def _finish(
    trained: Detector,
    request: TrainDetector,
    validation: Shots,
    crops: int,
    learned: tuple[str, ...],
    sources: tuple[str, ...],
) -> None:
    """Export, score on people held out, write the card; learned from so many rendered crops."""
    config, folder = request.config, request.out / MODEL
    trained = trained.cpu()
    device = torch.device("cpu")
    peaks, hits = peaks_and_hits(trained, validation, config, device)
    calibration = fit_calibration(peaks, hits)
    run = f"perfcap train detector, {config.loop.steps} steps, seed {config.loop.seed}"
    export_detector(trained, folder, calibration, origin_of(run, sources), request.licence)
    with writing(folder / WEIGHTS) as file:
        file.write((request.out / BEST).read_bytes())
    scores = score_detector(trained, validation, config, device)
    scores["calibration error"] = expected_error(peaks, hits, calibration)
    counts = crops, len(validation)
    write_detector_card(folder, config, learned, sources, request.licence, scores, counts)
    start = None
    if request.start is not None:
        before = Detector(config.detector)
        start_from(before, request.start)
        start = score_detector(before, validation, config, device)
    for doubt in outcome_doubts(scores, score_guess(validation, config), start):
        _LOG.warning("%s", doubt)
    console = PlainConsole()
    for name, value in scores.items():
        console.print(f"{name}: {value:.3g}")
    console.print(f"learned from {crops} rendered crops, scored on {len(validation)}")
    console.print(f"written to {folder}", soft_wrap=True)
