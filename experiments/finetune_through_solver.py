"""Fine-tuning a detector through the solver against fine-tuning it on heat maps, same clips.

A small network is trained on rendered frames of random people. Then it is fine-tuned on short
clips of two views, either with the loss of its heat maps, or with the distance of the motion that
the solver makes of its joints and confidences from the true one. Held-out clips are of another
actor and of people whose motion was not shown; the solver is the same for both.
"""

from __future__ import annotations

import copy
import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import torch
from report import Report, Table, data_folder
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.heatmap import map_to_input, soft_argmax
from perfcap.geometry.alignment import similarity_align
from perfcap.geometry.camera import Camera
from perfcap.io.actor import load_actor
from perfcap.io.body_model import load_body_model
from perfcap.pipeline import PoseConfig, PoseRefiner
from perfcap.render import ProjectedMesh, Texture, look_at, render
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.body_parts import UNKNOWN
from perfcap.train.crop_batches import CropBatch
from perfcap.train.detector import Detector
from perfcap.train.detector_config import DetectorConfig, DetectorLoss
from perfcap.train.detector_task import detection_loss
from perfcap.train.figure import Figure, actor_figure, pose_figure, rest_turns
from perfcap.train.motion_library import MotionLibrary, Recording
from perfcap.train.wardrobe import Wardrobe, random_outfit

_STEP = 4  # recorded frames between those of a clip: 15 Hz
_FOCAL, _DISTANCE = 2.0, 4.6  # image sizes; m
_SURE = 3.0  # map pixels of spread at which confidence is exp(-1/2)


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Of bodies, clips and weights."""
    clips: int = 12
    """To learn from; six more are held out."""
    frames: int = 12
    """Of each clip."""
    window: int = 6
    """Frames of a training example."""
    size: int = 96
    """Pixels of an image."""
    pretraining: int = 900
    """Steps on heat maps, 16 images each."""
    steps: int = 120
    """Of fine-tuning, two examples each."""
    learning_rate: float = 4e-4


@dataclass(frozen=True)
class Clip:
    """Images (F, C, 3, H, W), joints in them (F, C, 16, 2) and in the world (F, 16, 3)."""

    actor: Actor
    cameras: Camera
    images: Tensor
    pixels: Tensor
    joints: Tensor


def run(config: Experiment) -> Report:
    """Both ways from the same start, for each seed."""
    torch.set_num_threads(1)
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    rows = []
    for seed in config.seeds:
        start = time.process_time()
        train, held_out = _clips(config, library, seed)
        network = _pretrained(config, train, seed)
        errors = [_score(network, held_out)]
        for through in (False, True):
            tuned = _tuned(config, network, train, seed, through)
            errors.append(_score(tuned, held_out))
        lower = 100 * (1 - errors[2] / errors[1])
        rows.append((f"seed {seed}", *errors, lower, time.process_time() - start))
    values = np.array([row[1:] for row in rows])
    rows.append(("mean", *values.mean(0).tolist()))
    rows.append(("deviation", *values.std(0).tolist()))
    columns = ("", "before", "heat maps", "through the solver", "lower by %", "CPU s")
    title = "PA-MPJPE of the refined motion, held-out actor and people, mm"
    return Report((Table(title, columns, tuple(rows)),))


def _clips(config: Experiment, library: MotionLibrary, seed: int) -> tuple[list[Clip], list[Clip]]:
    rng = np.random.default_rng(seed)
    body = load_body_model()
    mean = actor_figure(body.actor(torch.zeros(0, dtype=torch.float64)), 192)
    wardrobe, sam = Wardrobe.of(mean), load_actor("sam")
    learned, others = library.of(["01", "02", "03"]), library.of(["05", "06", "07"])
    train = []
    for _ in range(config.clips):
        shape = torch.from_numpy(rng.normal(size=10).clip(-2, 2))
        actor = body.actor(shape)
        figure = wardrobe.dress(actor_figure(actor, 192), random_outfit(rng), rng)
        train.append(_clip(config, actor, figure, _picked(learned, rng), rng))
    own = actor_figure(sam, 192)
    held_out = [_clip(config, sam, own, _picked(others, rng), rng) for _ in range(6)]
    return train, held_out


def _picked(library: MotionLibrary, rng: np.random.Generator) -> Recording:
    return library.recordings[int(rng.integers(len(library.recordings)))]


def _clip(
    config: Experiment,
    actor: Actor,
    figure: Figure,
    recording: Recording,
    rng: np.random.Generator,
) -> Clip:
    """Somebody's motion about the origin, in two views a quarter of a turn apart."""
    count, size = config.frames, config.size
    room = max(1, len(recording.turns) - _STEP * count)
    start = int(rng.integers(room))
    turns = recording.turns[start : start + _STEP * count : _STEP]
    cameras = _cameras(size, float(rng.uniform(0, 2 * math.pi)))
    behind = [torch.from_numpy(Backgrounds().draw(size, rng)) for _ in range(cameras.views)]
    texture = Texture.from_image(torch.from_numpy(figure.texture), figure.uv, figure.faces_uv)
    rest = rest_turns(figure)
    images, joints = [], []
    for frame in turns:
        surface, marks = pose_figure(figure, figure.vertices, frame, rest)
        for view in range(cameras.views):
            mesh = ProjectedMesh.seen_by(cameras.select([view]), surface, figure.faces)
            images.append(render(mesh, texture, behind[view]).image)
        joints.append(marks)
    world = torch.stack(joints).double()
    stacked = torch.stack(images).reshape(len(turns), cameras.views, size, size, 3)
    return Clip(actor, cameras, stacked.movedim(-1, 2), cameras.project(world), world)


def _cameras(size: int, heading: float) -> Camera:
    angle = heading + 0.5 * math.pi * torch.arange(2, dtype=torch.float64)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    eye = _DISTANCE * torch.stack((angle.sin(), 0 * angle + 0.15, angle.cos()), -1)
    rotation, translation = look_at(eye, -0.05 * up.expand(2, 3), up.expand(2, 3))
    middle, focal = 0.5 * (size - 1), _FOCAL * size
    lens = up.new_tensor([[focal, 0, middle], [0, focal, middle], [0, 0, 1]]).expand(2, 3, 3)
    return Camera(lens, rotation, translation, size=((size, size),) * 2)


def _pretrained(config: Experiment, clips: list[Clip], seed: int) -> Detector:
    """A network as it comes from ordinary training on the frames."""
    torch.manual_seed(seed)
    network = Detector(DetectorConfig(config.size, (16, 24, 32, 48), (1, 1, 1)))
    images = torch.cat([clip.images.flatten(0, 1) for clip in clips])
    pixels = torch.cat([clip.pixels.flatten(0, 1) for clip in clips]).float()
    adam = torch.optim.AdamW(network.parameters(), lr=2e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, config.pretraining, 2e-4)
    random = torch.Generator().manual_seed(seed)
    for _ in range(config.pretraining):
        rows = torch.randint(len(images), (16,), generator=random)
        adam.zero_grad()
        _heat_loss(network.train(), images[rows], pixels[rows]).backward()
        adam.step()
        schedule.step()
    return network.eval()


def _tuned(
    config: Experiment, start: Detector, clips: list[Clip], seed: int, through: bool
) -> Detector:
    """The network after more steps on windows of clips, with one loss or the other."""
    network = copy.deepcopy(start).eval()  # statistics of the images stay as they are
    adam = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, config.steps)
    random = torch.Generator().manual_seed(seed + 1000)
    for _ in range(config.steps):
        adam.zero_grad()
        for _ in range(2):
            clip = clips[int(torch.randint(len(clips), (), generator=random))]
            room = max(1, len(clip.images) - config.window + 1)
            first = int(torch.randint(room, (), generator=random))
            part = slice(first, first + config.window)
            if through:
                loss = _distance(_refined(network, clip, part, train=True), clip.joints[part])
            else:
                images, pixels = clip.images[part].flatten(0, 1), clip.pixels[part].flatten(0, 1)
                loss = _heat_loss(network, images, pixels.float())
            loss.backward()
        adam.step()
        schedule.step()
    return network


def _heat_loss(network: Detector, images: Tensor, pixels: Tensor) -> Tensor:
    size = images.shape[-1]
    inside = ((pixels > -0.5) & (pixels < size - 0.5)).all(-1)
    known, none = torch.ones_like(inside), torch.zeros(len(images), dtype=torch.bool)
    nothing = pixels.new_zeros(*pixels.shape[:-1], 3)
    parts = torch.full((len(images), size // 4, size // 4), UNKNOWN, dtype=torch.uint8)
    batch = CropBatch(images.float(), pixels, nothing, inside, known, none, parts)
    logits, places = network(batch.crops)
    heat: Tensor = detection_loss(logits, places, batch, DetectorLoss())["heat"]
    return heat


def _refined(network: Detector, clip: Clip, part: slice, train: bool) -> Tensor:
    """Joints of the motion that the solver makes of what the network sees, (F, 16, 3)."""
    images = clip.images[part]
    logits, _ = network(images.flatten(0, 1).float())
    points, spread = soft_argmax(logits)
    size = (images.shape[-2], images.shape[-1])
    pixels = map_to_input(points, (logits.shape[-2], logits.shape[-1]), size, "centers")
    shape = images.shape[:2]
    confidence = torch.exp(-0.5 * (spread / _SURE).square()).double().reshape(*shape, -1)
    settings = PoseConfig(window=max(2, len(images)), overlap=0, tolerance=1e-4, clean=0.0)
    refiner = PoseRefiner(clip.actor, rate=15.0, config=settings).train(train)
    joints: Tensor = refiner(
        clip.cameras, pixels.double().reshape(*shape, -1, 2), confidence
    ).joints
    return joints


def _distance(found: Tensor, truth: Tensor) -> Tensor:
    mean: Tensor = (found - truth).norm(dim=-1).mean()
    return mean


@torch.no_grad()
def _score(network: Detector, clips: list[Clip]) -> float:
    """PA-MPJPE over the clips, mm."""
    errors = []
    for clip in clips:
        found = _refined(network.eval(), clip, slice(None), train=False)
        errors.append(_distance(similarity_align(found, clip.joints), clip.joints))
    return 1e3 * float(torch.stack(errors).mean())


if __name__ == "__main__":
    report.main(run, Experiment, "finetune_through_solver")
