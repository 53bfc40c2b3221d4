"""Learning to lift."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from perfcap.errors import InputError
from perfcap.geometry.alignment import similarity_align
from perfcap.train.config import LifterConfig, LiftingData, LiftingLoss
from perfcap.train.lifter import Lifter
from perfcap.train.lifting_data import LiftingSamples
from perfcap.train.motion_library import MotionLibrary
from perfcap.train.seen_tracks import MixedSamples, SeenTracks

BATCHES = 6  # of tracks that scores are taken on
_TRACKS = 32  # in each
_VALIDATION_SEED = 2**32  # none that a run would be given
_MM = 1000.0
_DENSE_COST = 8  # of a whole track, in tracks of three poses


class LiftingTask:
    """A lifter, what it learns from, and people it is validated on.

    Args:
        library: motion to learn from.
        validation: motion of other people.
        config: of the network.
        data: of the tracks.
        loss: weights.
        seed: of the network's first weights and of the tracks.
        dense: share of the training, at its end, that learns from whole tracks; all of it where
            dilations are not powers of three, so that poses cannot be had for less.
        tracks: of videos, to learn from as well.
        device: where to compute, and to make batches.

    Raises:
        InputError: tracks that are shorter than what is learned from.
    """

    model: Lifter

    def __init__(
        self,
        library: MotionLibrary,
        validation: MotionLibrary,
        config: LifterConfig,
        data: LiftingData,
        loss: LiftingLoss,
        seed: int,
        dense: float = 1.0,
        tracks: SeenTracks | None = None,
        device: torch.device | None = None,
    ) -> None:
        self._device = device or torch.device("cpu")
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.model = Lifter(config).to(self._device)
        simulated = LiftingSamples(library, data, seed, self._device)
        self._span = 2 * config.reach + 1
        needed = max(self._span, data.frames)
        if tracks is not None and tracks.plane.shape[1] < needed:
            raise InputError(
                f"tracks: have {tracks.plane.shape[1]} frames each; expected {needed} or more"
            )
        mixed = None if tracks is None else MixedSamples(simulated, tracks, data, seed)
        self._samples = mixed or simulated
        self._validation = LiftingSamples(validation, as_recorded(data), _VALIDATION_SEED)
        self._loss, self._dense = loss, dense if self.model.has_thirds else 1.0

    def loss(self, number: int, size: int, progress: float = 1.0) -> dict[str, Tensor]:
        """Mean joint error (m) of a batch, with the parts that smooth it and tell its size.

        At first three poses of each track, many for their cost; whole tracks, with their ends and
        their speeds, at last.
        """
        if progress < 1 - self._dense:
            batch = self._samples.batch(number, size, self._span)
            joints, spread = self.model.sparse(batch.features)
            apart = self._span // 3
            truth = batch.joints[:, apart // 2 :: apart]
            weights = replace(self._loss, velocity=0.0)  # these frames are far apart
        else:
            batch = self._samples.batch(number, max(1, size // _DENSE_COST))
            joints, spread = self.model(batch.features)
            truth, weights = batch.joints, self._loss
        return lifting_loss(joints, spread, truth, weights)

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores on people who are not learned from; see ``score_samples``."""
        return score_samples(model, self._validation)


def as_recorded(data: LiftingData) -> LiftingData:
    """The same settings, with motion as it was recorded: what scores are taken on."""
    return replace(data, recombined=0.0, loosened=0.0)


def score_lifter(
    model: nn.Module, people: MotionLibrary, data: LiftingData, batches: int = BATCHES
) -> dict[str, float]:
    """Scores of a lifter on simulated detections of people; see ``score_samples``."""
    samples = LiftingSamples(people, as_recorded(data), _VALIDATION_SEED)
    return score_samples(model, samples, batches)


def score_samples(
    model: nn.Module, samples: LiftingSamples, batches: int = BATCHES
) -> dict[str, float]:
    """Mean joint error and the error expected, mm, root-relative; and how the two go together.

    ``PA`` is after the best similarity of each pose.
    """
    model.eval()
    device = next(model.parameters()).device
    errors, aligned, expected = [], [], []
    with torch.no_grad():
        for number in range(batches):
            batch = samples.batch(number, _TRACKS).to(device)
            joints, spread = model(batch.features)
            errors.append((joints - batch.joints).norm(dim=-1))
            moved = similarity_align(joints, batch.joints)
            aligned.append((moved - batch.joints).norm(dim=-1))
            expected.append(spread)
    error, guess = torch.cat(errors), torch.cat(expected)
    order = torch.corrcoef(torch.stack((error.flatten(), guess.flatten())))[0, 1]
    return {
        "MPJPE mm": _MM * float(error.mean()),
        "PA-MPJPE mm": _MM * float(torch.cat(aligned).mean()),
        "expected mm": _MM * float(guess.mean()),
        "correlation": float(order),
    }


def score_guess(
    people: MotionLibrary, data: LiftingData, batches: int = BATCHES
) -> dict[str, float]:
    """Scores of answering with the mean pose of people, whatever their detections are."""
    samples = LiftingSamples(people, as_recorded(data), _VALIDATION_SEED)
    poses = torch.cat([samples.batch(number, _TRACKS).joints for number in range(batches)])
    return {"MPJPE mm": _MM * float((poses - poses.mean((0, 1))).norm(dim=-1).mean())}


def lifting_loss(
    joints: Tensor, spread: Tensor, truth: Tensor, weights: LiftingLoss
) -> dict[str, Tensor]:
    """Losses of poses (N, F, 16, 3) and their spread (N, F, 16).

    The spread is fitted to errors that are held still (Laplace likelihood), so that hard joints
    are not given up.
    """
    error = joints - truth
    place = error.norm(dim=-1)
    velocity = error.diff(dim=1).norm(dim=-1).mean()
    likelihood = (place.detach() / spread + spread.log()).mean()
    mean = place.mean()
    total = mean + weights.velocity * velocity + weights.spread * likelihood
    return {"loss": total, "place": mean, "velocity": velocity, "likelihood": likelihood}
