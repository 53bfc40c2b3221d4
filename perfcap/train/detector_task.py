"""Learning to detect."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from perfcap.detect.decode import read_locations
from perfcap.detect.heatmap import decode_dark, map_to_input
from perfcap.detect.joint_set import LANDMARKS
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.body_parts import UNKNOWN
from perfcap.train.config import DetectorLoss, TrainDetectorConfig
from perfcap.train.crop_batches import Ahead, CropBatch, CropBatches, Shots, plain_batch
from perfcap.train.detector import Detector

TORSO = LANDMARKS.index("l_shoulder"), LANDMARKS.index("r_hip")
PCK = 0.2  # of the torso's length
_BATCH = 32  # crops scored at once
_MM = 1000.0


class DetectorTask:
    """A detector, what it learns from, and crops it is validated on.

    Args:
        shots: to learn from.
        validation: of other people.
        config: everything else.
        device: where to compute; products are in bfloat16 where that is a GPU.
        backgrounds: pictures to show people before; None leaves them where they were rendered.
    """

    model: Detector

    def __init__(
        self,
        shots: Shots,
        validation: Shots,
        config: TrainDetectorConfig,
        device: torch.device | None = None,
        backgrounds: Backgrounds | None = None,
    ) -> None:
        self._device = device or torch.device("cpu")
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.loop.seed)
            model = Detector(config.detector)
        self.model = model.to(self._device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._config, self._validation = config, validation
        batches = CropBatches(
            shots, config.scene.margin, config.augmentation, config.loop.seed, backgrounds
        )
        self._ahead = Ahead(batches.batch)

    def loss(self, number: int, size: int, progress: float) -> dict[str, Tensor]:
        """Losses of a batch; see ``detection_loss``."""
        side = side_at(self._config, progress)
        batch = self._ahead(number, size, side).to(self._device)
        with torch.autocast(self._device.type, torch.bfloat16, enabled=self._device.type == "cuda"):
            guessed = self.model.guess(batch.crops)
        weights = self._config.loss
        losses = detection_loss(guessed.logits.float(), guessed.places.float(), batch, weights)
        whole = pose_loss(guessed.pose.float(), batch)
        parts = parts_loss(guessed.parts.float(), batch)
        total = losses["loss"] + weights.pose * whole + weights.parts * parts
        return losses | {"loss": total, "pose": whole, "parts": parts}

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores on people who are not learned from; see ``score_detector``."""
        return score_detector(model, self._validation, self._config, self._device)


def side_at(config: TrainDetectorConfig, progress: float) -> int:
    """Pixels along a crop when a share of the steps is done."""
    return [side for start, side in config.sizes if progress >= start][-1]


def detection_loss(
    logits: Tensor, places: Tensor, batch: CropBatch, weights: DetectorLoss
) -> dict[str, Tensor]:
    """Losses of maps.

    ``heat`` is the divergence (nats) of the heat maps from Gaussians about the joints, and from
    even maps for joints that are not in the crop: what is nowhere is spread everywhere, so that
    the peak of a map says how sure it is. ``places`` is the mean distance (m) along an axis of
    what the location maps say.

    Args:
        logits: (N, 16, h, w).
        places: (N, 3, 16, h, w).
        batch: the truth.
        weights: of the parts.
    """
    target = heat_targets(batch, logits.shape[-1], weights.deviation)
    flat = target.flatten(2)
    log = logits.flatten(2).log_softmax(-1)
    divergence = (flat * ((flat + 1e-12).log() - log)).sum(-1)  # N J
    inside = batch.inside.to(divergence)
    weight = batch.known * (inside + weights.nowhere * (1 - inside))
    heat = (weight * divergence).sum() / weight.sum().clamp(min=1)
    # around the joint, and where the heat map says it is; pixel by pixel, since one is read
    apart = (places.flatten(3) - batch.joints3d.transpose(1, 2)[..., None]).abs().mean(1)  # N J p
    error = (0.5 * (flat + log.detach().exp()) * apart).sum(-1)
    posed = inside * batch.posed[:, None]
    place = (posed * error).sum() / posed.sum().clamp(min=1)
    return {"loss": heat + weights.places * place, "heat": heat, "places": place}


def pose_loss(pose: Tensor, batch: CropBatch) -> Tensor:
    """Mean distance (m) along an axis of poses (N, 16, 3) guessed from whole crops."""
    posed = batch.inside * batch.posed[:, None]
    error = (pose - batch.joints3d).abs().mean(-1)
    mean: Tensor = (posed * error).sum() / posed.sum().clamp(min=1)
    return mean


def parts_loss(logits: Tensor, batch: CropBatch) -> Tensor:
    """Cross entropy (nats) of parts of the body (N, 19, h, w), half of it before people."""
    truth = batch.parts.long()
    entropy = nn.functional.cross_entropy(logits, truth, ignore_index=UNKNOWN, reduction="none")
    known, person = truth != UNKNOWN, (truth != 0) & (truth != UNKNOWN)
    shares = [
        entropy[where].sum() / where.sum().clamp(min=1) for where in (person, known & ~person)
    ]
    return shares[0] + shares[1]


def heat_targets(batch: CropBatch, side: int, deviation: float) -> Tensor:
    """Maps (N, 16, side, side) that sum to one: Gaussians, or even where a joint is not inside."""
    size = batch.crops.shape[-1]
    center = (batch.joints2d + 0.5) * side / size - 0.5
    axis = torch.arange(side, device=center.device, dtype=center.dtype)
    apart = (axis - center[..., None]) / deviation  # N J 2 side
    share = (-0.5 * apart.square()).softmax(-1)
    gaussian = share[..., 1, :, None] * share[..., 0, None, :]
    even = torch.full_like(gaussian, 1 / side**2)
    return torch.where(batch.inside[..., None, None], gaussian, even)


def read_joints(logits: Tensor, places: Tensor, size: int) -> tuple[Tensor, Tensor, Tensor]:
    """Joints as the exported model's manifest reads them.

    Returns:
        Pixels of the crop (N, 16, 2), peaks (N, 16), positions (N, 16, 3).
    """
    heat = logits.flatten(2).softmax(-1).reshape(logits.shape)
    points, peak = decode_dark(heat)
    shape = (heat.shape[-2], heat.shape[-1])
    joints3d = read_locations(heat, list(places.unbind(1)))
    return map_to_input(points, shape, (size, size), "centers"), peak, joints3d


def score_detector(
    model: nn.Module, shots: Shots, config: TrainDetectorConfig, device: torch.device
) -> dict[str, float]:
    """Scores on crops: joints missed (further than a fifth of the torso), PCK, 3D error."""
    errors, missed = [], []
    for batch, points, _, joints3d in _looks(model, shots, config, device):
        present = batch.inside.any(-1)
        missed.append(_far(points, batch.joints2d)[present].float())
        errors.append((joints3d - batch.joints3d).norm(dim=-1)[present])
    share, error = float(torch.cat(missed).mean()), float(torch.cat(errors).mean())
    return {"missed %": 100 * share, "PCK %": 100 * (1 - share), "MPJPE mm": _MM * error}


def score_guess(shots: Shots, config: TrainDetectorConfig) -> dict[str, float]:
    """Scores of finding each joint where it is in the mean of all crops, whatever is in them."""
    seen = [(b.joints2d, b.inside) for b in _batches(shots, config)]
    joints, inside = (torch.cat(part) for part in zip(*seen, strict=True))
    weight = inside[..., None].float()
    mean = (joints * weight).sum(0) / weight.sum(0).clamp(min=1)
    missed = _far(mean, joints)[inside.any(-1)]
    return {"missed %": 100 * float(missed.float().mean())}


def peaks_and_hits(
    model: nn.Module, shots: Shots, config: TrainDetectorConfig, device: torch.device
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Peaks of the heat maps of all joints, and whether each was found, (N,).

    Joints that are not inside, and those of nobody, are not found whatever is answered.
    """
    peaks, hits = [], []
    for batch, points, peak, _ in _looks(model, shots, config, device):
        peaks.append(peak.flatten())
        hits.append((~_far(points, batch.joints2d) & batch.inside).flatten())
    return torch.cat(peaks).double().cpu().numpy(), torch.cat(hits).cpu().numpy()


def _looks(
    model: nn.Module, shots: Shots, config: TrainDetectorConfig, device: torch.device
) -> Iterator[tuple[CropBatch, Tensor, Tensor, Tensor]]:
    """Batches with the points, peaks and positions that a model finds in them."""
    model.eval()
    size = config.sizes[-1][1]
    for plain in _batches(shots, config):
        batch = plain.to(device)
        with torch.no_grad():
            logits, places = model(batch.crops)
            points, peak, joints3d = read_joints(logits, places, size)
        yield batch, points, peak, joints3d


def _batches(shots: Shots, config: TrainDetectorConfig) -> Iterator[CropBatch]:
    """All shots as a person is followed, at the size that is exported."""
    for start in range(0, len(shots), _BATCH):
        numbers = range(start, min(start + _BATCH, len(shots)))
        yield plain_batch(shots, numbers, config.sizes[-1][1], config.scene.margin)


def _far(points: Tensor, truth: Tensor) -> Tensor:
    """Joints (N, 16, 2) further from the truth than a fifth of the torso, (N, 16)."""
    limit = PCK * torso_length(truth)
    far: Tensor = (points - truth).norm(dim=-1) > limit[:, None]
    return far


def torso_length(joints2d: Tensor) -> Tensor:
    """From the left shoulder to the right hip (Sapp and Taskar 2013), (...), pixels."""
    shoulder, hip = TORSO
    length: Tensor = (joints2d[..., shoulder, :] - joints2d[..., hip, :]).norm(dim=-1)
    return length
