"""Fine-tuning a detector through the solver against fine-tuning it on heat maps, same clips.

A trained detector is fine-tuned on short clips of two views with the loss of its heat maps, in two
rounds. How its maps are read, how sharply and with what confidence, no heat map teaches: that is
learned from the distance of the motion, which the solver makes of joints and confidences, from the
true one. Either it alone, after both rounds, or it and the network instead of the second round,
with a little of the heat maps' loss: the solver's robust kernels take no notice of joints that are
far off, which motion alone may therefore unteach. Held-out clips are of other actors and of people
whose motion was never shown.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import report
import torch
from recordings import rendered
from rendered_clips import Clip, Filming, performances, strangers
from report import Report, Table, data_folder
from torch import Tensor, nn

from perfcap.detect.heatmap import map_to_input, soft_argmax
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.geometry.alignment import similarity_align
from perfcap.io.actor import models_folder
from perfcap.pipeline import PoseConfig, PoseRefiner
from perfcap.train.body_parts import UNKNOWN
from perfcap.train.checkpoint import start_from
from perfcap.train.config import DetectorLoss
from perfcap.train.crop_batches import CropBatch
from perfcap.train.detector import Detector
from perfcap.train.detector_task import detection_loss
from perfcap.train.motion_library import MotionLibrary

_LEARNED, _HELD_OUT = ("01", "02", "03"), ("05", "06")  # people whose motion it is
_COLUMNS = (
    "", "before", "heat maps", "heat maps again", "reading by motion then",
    "all by motion instead",
    "reading, lower by %", "all by motion, lower by %", "CPU s",
)  # fmt: skip
_READING = 30.0  # rate of learning how to read, against that of the network's weights
_KEPT = 0.05  # m a nat, of the loss of the heat maps beside that of the motion
_SURE = 3.0  # map pixels of spread at which confidence is exp(-1/2), at first
_MIRRORED = list(LANDMARKS16.mirrored())
_DOUBTS, _HIDDEN = 5, 24  # what tells of doubt, and units that weigh it
_APART = 10.0  # map pixels
_TINY = 1e-4


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    start: Path = models_folder() / "detectors/rendered/weights.safetensors"
    """Weights to start from."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Of bodies, clips and order."""
    clips: int = 96
    """To learn from."""
    held_out: int = 36
    """To score on."""
    frames: int = 12
    """Of each clip."""
    window: int = 6
    """Frames of a training example."""
    size: int = 224
    """Pixels of an image."""
    steps: int = 150
    """Of fine-tuning, two examples each; as many again with one loss or the other."""
    learning_rate: float = 3e-4


class Reading(nn.Module):
    """Heat maps read as joints and confidences, both differentiable.

    The softmax of each joint's map is as sharp as it is told to be; confidence falls with its
    spread, and with what a small network makes of the shape of the maps.
    """

    def __init__(self) -> None:
        super().__init__()
        joints = len(LANDMARKS)
        self.sharpness = nn.Parameter(torch.zeros(joints))  # logarithms
        self.trust = nn.Parameter(torch.zeros(joints))
        last = nn.Linear(_HIDDEN, 1)
        nn.init.zeros_(last.weight)
        nn.init.constant_(last.bias, 2.0)  # believed, at first
        self.belief = nn.Sequential(nn.Linear(_DOUBTS + joints, _HIDDEN), nn.Tanh(), last)

    def forward(self, logits: Tensor) -> tuple[Tensor, Tensor]:
        """Joints (N, 16, 2) in pixels of the maps (N, 16, h, w), and confidences (N, 16)."""
        points, spread = soft_argmax(self.sharpness.exp()[:, None, None] * logits)
        share = logits.flatten(2).softmax(-1)
        peak = (share.amax(-1) + _TINY).log()
        common = (share * share[:, _MIRRORED]).sum(-1) / (share.square().sum(-1) + _TINY**2)
        paired = torch.tensor([j != other for j, other in enumerate(_MIRRORED)])
        doubts = (
            spread / _SURE,
            peak / 3,
            (paired * common).clamp(max=2),  # both sides on one limb
            (points - points[:, _MIRRORED]).norm(dim=-1) / _APART,
            peak.mean(1, keepdim=True).expand_as(peak) / 3,
        )
        which = torch.eye(len(LANDMARKS)).expand(len(logits), -1, -1)
        belief = self.belief(torch.cat((torch.stack(doubts, -1), which), -1))[..., 0].sigmoid()
        sure = torch.exp(-0.5 * (self.trust.exp() * spread / _SURE).square())
        return points, sure * belief


class Reader(nn.Module):
    """A detector and how its maps are read."""

    def __init__(self, start: Path) -> None:
        super().__init__()
        self.detector = Detector()
        start_from(self.detector, start)
        self.reading = Reading()

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Joints (N, 16, 2) in pixels of images (N, 3, S, S), and confidences (N, 16)."""
        logits, _ = self.detector(images)
        points, confidence = self.reading(logits)
        maps, size = logits.shape[-2:], images.shape[-2:]
        pixels = map_to_input(points, (maps[0], maps[1]), (size[0], size[1]), "centers")
        return pixels.double(), confidence.double()


def run(config: Experiment) -> Report:
    """Both ways from the same start, for each seed."""
    torch.set_num_threads(1)
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    actors = [rendered(config.data, name).actor for name in ("dev_tight", "dev_skirt")]
    rows = []
    for seed in config.seeds:
        start = time.process_time()
        rng, filming = np.random.default_rng(seed), Filming(config.frames, config.size)
        train = strangers(config.clips, filming, library.of(_LEARNED), rng)
        held_out = performances(config.held_out, actors, filming, library.of(_HELD_OUT), rng)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            network = Reader(config.start).eval()
        errors = [_score(network, held_out)]
        plain = _tuned(config, network, train, seed, _heat_loss, ("detector",))
        again = _tuned(config, plain, train, seed + 1000, _heat_loss, ("detector",))
        read = _tuned(config, again, train, seed + 2000, _motion_loss, ("reading",))
        through = _tuned(config, plain, train, seed + 1000, _motion_loss, ("detector", "reading"))
        errors += [_score(tuned, held_out) for tuned in (plain, again, read, through)]
        lower = [100 * (1 - error / errors[2]) for error in errors[3:]]
        rows.append((f"seed {seed}", *errors, *lower, time.process_time() - start))
    values = np.array([row[1:] for row in rows])
    rows.append(("mean", *values.mean(0).tolist()))
    rows.append(("deviation", *values.std(0).tolist()))
    title = "PA-MPJPE of the refined motion, held-out actors and people, mm"
    return Report((Table(title, _COLUMNS, tuple(rows)),))


def _tuned(
    config: Experiment,
    start: Reader,
    clips: list[Clip],
    seed: int,
    loss: Callable[[Reader, Clip, slice], Tensor],
    learned: tuple[str, ...],
) -> Reader:
    """The network after more steps on windows of clips; the parts named learn, with one loss."""
    network = copy.deepcopy(start).eval()  # statistics of the images stay as they are
    rates = {"detector": config.learning_rate, "reading": _READING * config.learning_rate}
    parts = {"detector": network.detector, "reading": network.reading}
    for name, part in parts.items():
        part.requires_grad_(name in learned)
    groups: list[dict[str, Any]] = [
        {"params": list(parts[name].parameters()), "lr": rates[name]} for name in learned
    ]
    adam = torch.optim.Adam(groups)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, config.steps)
    random = torch.Generator().manual_seed(seed + 1000)
    for _ in range(config.steps):
        adam.zero_grad()
        for _ in range(2):
            clip = clips[int(torch.randint(len(clips), (), generator=random))]
            room = max(1, len(clip.images) - config.window + 1)
            first = int(torch.randint(room, (), generator=random))
            loss(network, clip, slice(first, first + config.window)).backward()  # type: ignore[no-untyped-call]
        adam.step()
        schedule.step()
    return network


def _heat_loss(network: Reader, clip: Clip, part: slice) -> Tensor:
    """What detectors are trained with."""
    images, pixels = clip.images[part].flatten(0, 1), clip.pixels[part].flatten(0, 1).float()
    size = images.shape[-1]
    inside = ((pixels > -0.5) & (pixels < size - 0.5)).all(-1)
    known, none = torch.ones_like(inside), torch.zeros(len(images), dtype=torch.bool)
    nothing = pixels.new_zeros(*pixels.shape[:-1], 3)
    parts = torch.full((len(images), size // 4, size // 4), UNKNOWN, dtype=torch.uint8)
    batch = CropBatch(images.float(), pixels, nothing, inside, known, none, parts)
    logits, places = network.detector(batch.crops)
    heat: Tensor = detection_loss(logits, places, batch, DetectorLoss())["heat"]
    return heat


def _motion_loss(network: Reader, clip: Clip, part: slice) -> Tensor:
    """How far the solved joints are from the true ones, as they are scored, m, and heat maps."""
    found, truth = _refined(network, clip, part, train=True), clip.joints[part]
    kept = _KEPT * _heat_loss(network, clip, part)
    return _distance(similarity_align(found, truth), truth) + kept


def _refined(network: Reader, clip: Clip, part: slice, train: bool) -> Tensor:
    """Joints of the motion that the solver makes of what the network sees, (F, 16, 3)."""
    images = clip.images[part]
    pixels, confidence = network(images.flatten(0, 1).float())
    shape = images.shape[:2]
    settings = PoseConfig(window=max(2, len(images)), overlap=0, tolerance=1e-4, clean=0.0)
    refiner = PoseRefiner(clip.actor, rate=15.0, config=settings).train(train)
    joints: Tensor = refiner(
        clip.cameras, pixels.reshape(*shape, -1, 2), confidence.reshape(*shape, -1)
    ).joints
    return joints


def _distance(found: Tensor, truth: Tensor) -> Tensor:
    mean: Tensor = (found - truth).norm(dim=-1).mean()
    return mean


@torch.no_grad()
def _score(network: Reader, clips: list[Clip]) -> float:
    """PA-MPJPE over the clips, mm."""
    errors = []
    for clip in clips:
        found = _refined(network.eval(), clip, slice(None), train=False)
        errors.append(_distance(similarity_align(found, clip.joints), clip.joints))
    return 1e3 * float(torch.stack(errors).mean())


if __name__ == "__main__":
    report.main(run, Experiment, "finetune_through_solver")
