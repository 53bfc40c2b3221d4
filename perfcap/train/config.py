"""Settings of training. Nothing heavy is imported here: the command line reads them."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class LoopConfig:
    """How to train."""

    steps: int = 6000
    batch: int = 256  # samples a step and process
    learning_rate: float = 2e-3  # at its peak
    warmup: int = 100  # steps until it is reached
    weight_decay: float = 0.02
    average: float = 0.998  # weights kept from step to step in the running mean that is evaluated
    clip: float = 1.0  # norm of the gradient
    seed: int = 0
    evaluate_every: int = 200  # steps
    save_every: int = 100  # steps


@dataclass(frozen=True)
class LifterConfig:
    """Size of a lifter."""

    channels: int = 256
    dilations: tuple[int, ...] = (1, 3, 9, 27)  # frames between the three taps of each block
    dropout: float = 0.0

    @property
    def reach(self) -> int:
        """Frames either side that an answer depends on."""
        return sum(self.dilations)


@dataclass(frozen=True)
class LiftingLoss:
    """Weights of the parts."""

    velocity: float = 3.0  # of the error of steps from frame to frame, against that of places
    spread: float = 0.02  # of the likelihood of the errors under the expected spread


@dataclass(frozen=True)
class DetectorNoise:
    """How 2D detectors err. Sizes in units, 1 % of a standing person's height; rates a frame."""

    offset: float = 1.0  # of a joint, for a whole clip
    drift: float = 0.75  # deviation of what changes slowly
    keep: float = 0.85  # share of the drift that is left after a frame at 30 Hz
    jitter: float = 0.25  # deviation of what is new every frame
    spread: float = 0.5  # deviation of the log size of all this from clip to clip
    outliers: float = 0.005  # joints anywhere in the body's box
    swaps: float = 0.004  # left and right exchanged, arms or legs or both
    gaps: float = 0.004  # a joint unseen for some frames
    blinks: float = 0.001  # nobody seen for some frames
    absent: float = 0.15  # share of clips whose detector has no crown; likewise no toes
    hidden: float = 0.08  # share of clips in which a limb is never seen


@dataclass(frozen=True)
class LiftingData:
    """What tracks are made of."""

    frames: int = 96  # of a track
    rate: tuple[float, float] = (24.0, 36.0)  # frames a second, evenly drawn
    distance: tuple[float, float] = (2.2, 9.0)  # m, evenly in the logarithm
    elevation: tuple[float, float] = (8.0, 14.0)  # degrees above the person, mean and deviation
    roll: float = 4.0  # degrees, deviation
    size: float = 0.05  # deviation of the log size of people
    bone: float = 0.04  # deviation of the log length of one bone, the same left and right
    recombined: float = 0.5  # share of tracks with the arms or the upper body of another clip
    loosened: float = 6.0  # degrees, deviation that limbs are turned by for a whole track
    swung: float = 2.5  # factor of it for arms
    noise: DetectorNoise = field(default_factory=DetectorNoise)


@dataclass(frozen=True)
class TrainLifterConfig:
    """Everything that a lifter depends on, but for the recorded motion."""

    held_out: tuple[str, ...] = ("06",)  # people to report on
    validation: tuple[str, ...] = ("07",)  # people that the best weights are chosen by
    dense: float = 0.15  # share of the steps, at the end, that learn from whole tracks
    loop: LoopConfig = field(default_factory=LoopConfig)
    lifter: LifterConfig = field(default_factory=LifterConfig)
    data: LiftingData = field(default_factory=LiftingData)
    loss: LiftingLoss = field(default_factory=LiftingLoss)
