"""A heat-map head with a planted bias, trained through the solver without labels of joints.

A head on frozen features says where joints are; three of them it puts ten pixels off, in every
image, as a head does that was trained on another labelling convention. What corrects it is what
captures have anyway: masks of the person, several calibrated views, the person's bones and limits.
The refined motion, a differentiable function of the head's joints, must cover the masks and be seen
where the head sees it. The same images, without a solver in between, offer a 2D loss alone:
agreement of the views, by triangulation. Nothing is trained on true joints; held-out clips are of
other motions, and solved without masks.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from report import Report, Table
from rig_fit import fit_rig
from torch import Tensor
from window_motion import clip_landmarks, random_landmarks

from perfcap.actor.actor import Actor
from perfcap.detect.heatmap import HeatmapHead
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.geometry.triangulation import triangulate
from perfcap.io.actor import load_actor
from perfcap.pipeline import PoseConfig, PoseRefiner, ReprojectionConfig
from perfcap.render.soft_silhouette import SoftSilhouette

_TRAIN = ("07_01", "02_05", "05_02", "01_03", "06_11")
_HELD_OUT = ("03_01", "05_10", "02_04")
_BIASED = ("r_wrist", "l_elbow", "r_knee")
_IMAGE, _STRIDE, _MASK = 256, 8, 128  # px
_PRETRAINING = 900  # steps
_REACH = 14.0  # px: where a joint's other feature channels respond
_COLUMNS = (
    "training", "bias left, px", "bias removed, %", "held-out joints, px", "held-out MPJPE, mm",
    "CPU s",
)  # fmt: skip
Loss = Callable[["Scene", Tensor], Tensor]


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings; smooth random motions are used without it."""
    frames: int = 24
    """Of each clip, at 15 Hz."""
    window: int = 8
    """Frames of a training example."""
    steps: int = 140
    """Of training, two examples each."""
    learning_rate: float = 0.05
    bias: float = 10.0
    """Pixels."""
    jitter: float = 2.0
    """Deviation of the features' own error, pixels."""
    agreement: float = 0.003
    """Weight of a pixel, squared, beside the share of a mask that is not covered."""
    seed: int = 0


@dataclass(frozen=True)
class Scene:
    """Frames of a clip: features (F, C, n, h, w), masks (F, C, H, W), and the truth for scoring."""

    cameras: Camera
    features: Tensor
    masks: Tensor
    pixels: Tensor
    joints: Tensor

    def cut(self, part: slice) -> Scene:
        """Some frames."""
        return Scene(
            self.cameras,
            self.features[part],
            self.masks[part],
            self.pixels[part],
            self.joints[part],
        )


@dataclass(frozen=True)
class Study:
    """What all ways of training share."""

    actor: Actor
    refiner: PoseRefiner
    silhouette: SoftSilhouette
    train: list[Scene]
    held_out: list[Scene]


def run(config: Experiment) -> Report:
    """Train from the same biased head in every way."""
    torch.set_num_threads(1)
    study = _study(config)
    start = _biased_head(study, config)
    ways: dict[str, Loss | None] = {
        "none: the planted bias": None,
        "2D loss alone: agreement of the views": _views_loss,
        "through the solver, no masks": lambda s, j: _solver_loss(study, config, s, j, 0.0),
        "through the solver, masks and agreement": lambda s, j: _solver_loss(study, config, s, j),
    }
    rows: list[tuple[object, ...]] = []
    for name, loss in ways.items():
        head, begin = _copy(start), time.process_time()
        if loss is not None:
            _train(head, study, config, loss)
        rows.append(_row(name, head, start, study, time.process_time() - begin))
    title = f"bias of {config.bias:g} px on {', '.join(_BIASED)}; {len(study.held_out)} other clips"
    note = (
        "Bias: length of the mean offset of a joint in the held-out images, mean of the three. "
        "Held-out joints: mean distance of all of the head's joints from the true ones. MPJPE: of "
        "the motion refined from them, in the world."
    )
    return Report((Table(title, _COLUMNS, tuple(rows)),), (note,))


def _study(config: Experiment) -> Study:
    actor = load_actor("sam")
    random = torch.Generator().manual_seed(config.seed)
    rng = np.random.default_rng(config.seed)
    weld = torch.tensor(actor.template.weld()[0])
    faces = torch.tensor(actor.template.faces)
    silhouette = SoftSilhouette(faces, (_MASK, _MASK), band=4.0, weld=weld)
    library = config.data / "mocap_cmu_library"

    def scenes(clips: tuple[str, ...]) -> list[Scene]:
        found = []
        for clip in clips:
            if library.is_dir():
                places = clip_landmarks(actor.skeleton, library, clip, 2 * config.frames)[::2]
            else:
                places = random_landmarks(actor.skeleton, config.frames, rng)
            found.append(_scene(actor, silhouette, places, config, random))
        return found

    # quadratic: a robust kernel would leave out the very joints that are to be corrected
    settings = PoseConfig(
        window=config.window,
        overlap=0,
        tolerance=1e-4,
        clean=0.0,
        reprojection=ReprojectionConfig(scale=None),
    )
    refiner = PoseRefiner(actor, rate=15.0, config=settings)
    return Study(actor, refiner, silhouette, scenes(_TRAIN), scenes(_HELD_OUT))


@torch.no_grad()
def _scene(
    actor: Actor,
    silhouette: SoftSilhouette,
    places: Tensor,
    config: Experiment,
    random: torch.Generator,
) -> Scene:
    motion = fit_rig(actor, places)
    motion = replace(motion, translation=motion.translation - motion.translation.mean(0))
    cameras = _cameras(float(torch.rand((), generator=random)) * 2 * math.pi)
    joints = actor.joints(motion)
    pixels = cameras.project(joints)
    noise = torch.randn(pixels.shape, generator=random, dtype=pixels.dtype)
    masks = silhouette.seen_by(_small(cameras), actor.surface(motion)) > 0.5
    features = _features(pixels + config.jitter * noise, random)
    return Scene(cameras, features, masks.to(pixels), pixels, joints)


def _cameras(heading: float) -> Camera:
    """Three views around the origin, a third of a turn apart, that look down a little."""
    turn = heading + 2 * math.pi / 3 * torch.arange(3, dtype=torch.float64)
    zero, one = torch.zeros_like(turn), torch.ones_like(turn)
    around = (turn.cos(), zero, -turn.sin(), zero, -one, zero, -turn.sin(), zero, -turn.cos())
    tilt = torch.tensor([[1, 0, 0], [0, 0.98, -0.199], [0, 0.199, 0.98]], dtype=torch.float64)
    tilt = torch.linalg.qr(tilt).Q
    tilt = tilt * tilt.diagonal().sign()
    focal, middle = 1.15 * _IMAGE, 0.5 * (_IMAGE - 1)
    lens = torch.tensor([[focal, 0, middle], [0, focal, middle], [0, 0, 1]], dtype=torch.float64)
    return Camera(
        lens.expand(3, 3, 3),
        tilt @ torch.stack(around, -1).reshape(3, 3, 3),
        torch.tensor([0, 0, 3.2], dtype=torch.float64).expand(3, 3),
        size=((_IMAGE, _IMAGE),) * 3,
    )


def _small(cameras: Camera) -> Camera:
    """The same views in the resolution of masks."""
    share = _MASK / _IMAGE
    lens = cameras.intrinsics.clone()
    lens[..., :2, :2] *= share
    lens[..., :2, 2] = (lens[..., :2, 2] + 0.5) * share - 0.5
    return replace(cameras, intrinsics=lens, size=((_MASK, _MASK),) * cameras.views)


def _features(pixels: Tensor, random: torch.Generator) -> Tensor:
    """Frozen features: each joint excites five channels, at it and beside it, and there is noise.

    Args:
        pixels: where the backbone believes joints, (F, C, 16, 2).
        random: of the noise.
    """
    count = _IMAGE // _STRIDE
    beside = _REACH * torch.tensor([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], dtype=pixels.dtype)
    centre = ((pixels.unsqueeze(-2) + beside) / _STRIDE).flatten(-3, -2)  # F C 80 2
    axis = torch.arange(count, dtype=pixels.dtype)
    columns, rows = (torch.exp(-0.5 * (axis - centre[..., [i]]).square()) for i in range(2))
    maps = rows.unsqueeze(-1) * columns.unsqueeze(-2)
    noise = torch.randn(maps.shape, generator=random, dtype=torch.float32)
    return maps.float() + 0.02 * noise


def _seen(head: HeatmapHead, scene: Scene) -> Tensor:
    """The head's joints, (F, C, 16, 2), pixels, in the precision of the solver."""
    to_image = torch.tensor([[_STRIDE, 0, 0], [0, _STRIDE, 0]], dtype=torch.float32)
    whole = to_image.expand(*scene.features.shape[:2], 2, 3)
    joints: Tensor = head(scene.features, whole).joints2d
    return joints.double()


def _planted(config: Experiment) -> Tensor:
    """Where the biased head puts joints beside where they are, (16, 2), pixels."""
    planted = torch.zeros(len(LANDMARKS), 2, dtype=torch.float64)
    for index, name in enumerate(_BIASED):
        angle = 0.4 + 2.1 * index
        planted[LANDMARKS.index(name)] = config.bias * torch.tensor(
            [math.cos(angle), math.sin(angle)], dtype=torch.float64
        )
    return planted


def _biased_head(study: Study, config: Experiment) -> HeatmapHead:
    """A head as it comes: trained on labels that are off."""
    torch.manual_seed(config.seed)
    head = HeatmapHead(study.train[0].features.shape[-3])
    planted = _planted(config)
    adam = torch.optim.Adam(head.parameters(), lr=0.1)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, _PRETRAINING)
    for step in range(_PRETRAINING):
        start = step % (config.frames - config.window + 1)
        scene = study.train[step % len(study.train)].cut(slice(start, start + config.window))
        adam.zero_grad()
        missed = (_seen(head, scene) - scene.pixels - planted).square().mean()
        torch.autograd.backward(missed)
        adam.step()
        schedule.step()
    return head


def _copy(head: HeatmapHead) -> HeatmapHead:
    other = HeatmapHead(head.maps.in_channels)
    other.load_state_dict(head.state_dict())
    return other


def _train(head: HeatmapHead, study: Study, config: Experiment, loss: Loss) -> None:
    """Adam with a cosine schedule on windows of the training clips."""
    random = torch.Generator().manual_seed(config.seed)
    adam = torch.optim.Adam(head.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, config.steps)
    for _ in range(config.steps):
        adam.zero_grad()
        for _ in range(2):
            clip = int(torch.randint(len(study.train), (), generator=random))
            first = int(torch.randint(config.frames - config.window + 1, (), generator=random))
            scene = study.train[clip].cut(slice(first, first + config.window))
            torch.autograd.backward(loss(scene, _seen(head, scene)))
        adam.step()
        schedule.step()


def _views_loss(scene: Scene, seen: Tensor) -> Tensor:
    """Squared distance, in pixels, of each view's joints from where all views together see them."""
    with torch.no_grad():
        ones = torch.ones_like(seen[..., 0])
        points, _ = triangulate(scene.cameras, scene.cameras.to_plane(seen), ones)
        together = scene.cameras.project(points)
        together = torch.where(together.isfinite(), together, seen)
    return (seen - together).square().sum(-1).mean()


def _solver_loss(
    study: Study, config: Experiment, scene: Scene, seen: Tensor, masks: float = 1.0
) -> Tensor:
    """What the motion leaves uncovered of the masks, and how far from it joints are seen."""
    refined = study.refiner.train()(scene.cameras, seen)
    apart = (scene.cameras.project(refined.joints) - seen).square().sum(-1).mean()
    loss: Tensor = config.agreement * apart
    if masks:
        surface = study.actor.surface(refined.motion)
        covered = study.silhouette.seen_by(_small(scene.cameras), surface)
        area = scene.masks.sum((-2, -1)).clamp(min=1)
        loss = loss + masks * ((covered - scene.masks).square().sum((-2, -1)) / area).mean()
    return loss


@torch.no_grad()
def _row(
    name: str, head: HeatmapHead, start: HeatmapHead, study: Study, seconds: float
) -> tuple[object, ...]:
    errors, distances = [], []
    for scene in study.held_out:
        seen = _seen(head, scene)
        refined = study.refiner.eval()(scene.cameras, seen).joints
        errors.append((refined - scene.joints).norm(dim=-1).mean())
        distances.append((seen - scene.pixels).norm(dim=-1).mean())
    left = _bias(head, study)
    removed = 100 * (1 - left / _bias(start, study))
    distance, error = (float(torch.stack(values).mean()) for values in (distances, errors))
    return name, left, removed, distance, 1e3 * error, seconds


def _bias(head: HeatmapHead, study: Study) -> float:
    """Length of the mean offset of a biased joint in the held-out images, mean of the three."""
    offset = torch.cat([_seen(head, scene) - scene.pixels for scene in study.held_out])
    columns = [LANDMARKS.index(joint) for joint in _BIASED]
    return float(offset.mean((0, 1))[columns].norm(dim=-1).mean())


if __name__ == "__main__":
    report.main(run, Experiment, "bias_through_solver")
